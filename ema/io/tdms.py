"""Named arrays of numbers in LabVIEW's TDMS files: the one door to npTDMS."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC = b"TDSm"
"""First bytes of such a file."""

Channel = tuple[tuple[int, ...], Any, str]
"""Shape of an array, what reads it while the file is open, and its unit, empty where the file states none."""


@contextmanager
def channels_in(path: Path) -> Iterator[dict[str, Channel]]:
    """Open a TDMS file and give its channels of numbers, ``group/channel``, and their properties that are numbers.

    Properties are named ``group/channel@wf_increment``, as attributes of HDF5 are. Whatever npTDMS raises of a damaged
    file is raised.
    """
    from nptdms import TdmsFile  # here: few tests come in such files

    with path.open("rb") as stream, TdmsFile.open(stream) as file:
        found: dict[str, Channel] = {}
        for group in file.groups():
            for channel in group.channels():
                name = f"{group.name}/{channel.name}"
                if channel.dtype.kind in "fiubc" and len(channel):
                    unit = channel.properties.get("unit_string", "")
                    found[name] = (len(channel),), partial(_values, channel), str(unit)
                for key, value in channel.properties.items():
                    if isinstance(value, Real):
                        found[f"{name}@{key}"] = (), partial(np.asarray, value), ""
        yield found


def _values(channel: Any) -> NDArray[Any]:
    return np.asarray(channel[:])
