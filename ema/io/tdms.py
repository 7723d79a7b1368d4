"""Named arrays of numbers in LabVIEW's TDMS files: the one door to npTDMS."""

from __future__ import annotations

import logging
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

_CUT_OFF = "Last segment", "Data size"
"""How npTDMS begins what it says of a file that ends before its numbers do."""
_OF_NUMBERS = "Cropping data", "Unsupported scale"
"""How it begins what it says of numbers that it could not scale; other words are of names."""


class _Listener(logging.Handler):
    """Hears that a file is cut off, and raises what else npTDMS says of numbers: they are not those of the file."""

    def __init__(self) -> None:
        super().__init__()
        self.cut_off = False

    def emit(self, record: logging.LogRecord) -> None:
        said = record.getMessage()
        self.cut_off |= said.startswith(_CUT_OFF)
        if said.startswith(_OF_NUMBERS):
            raise ValueError(said)


class CutOffError(ValueError):
    """A file ends before all channels have numbers."""


@contextmanager
def channels_in(path: Path) -> Iterator[dict[str, Channel]]:
    """Open a TDMS file and give its channels of numbers, ``group/channel``, and their properties that are numbers.

    Properties are named ``group/channel@wf_increment``, as attributes of HDF5 are. Of a file that is cut off, groups
    that are whole are given; where none is, channels are given as far as the shortest of their group goes. Whatever
    npTDMS raises of a damaged file is raised.

    Raises
    ------
    CutOffError
        A file that is cut off has a channel without a number, and no group that is whole.
    """
    from nptdms import TdmsFile  # here: few tests come in such files

    with path.open("rb") as stream, _listening() as heard, TdmsFile.open(stream) as file:
        groups = [[c for c in group.channels() if c.dtype.kind in "fiubc"] for group in file.groups()]
        groups = [channels for channels in groups if channels]
        length = {id(channels): {len(c) for c in channels} for channels in groups}
        if heard.cut_off:
            whole = [channels for channels in groups if len(length[id(channels)]) == 1 and len(channels[0])]
            groups = whole or groups
            if any(min(length[id(channels)]) == 0 for channels in groups) or not groups:
                raise CutOffError
        found: dict[str, Channel] = {}
        for channels in groups:
            for channel in channels:
                name = f"{channel.group_name}/{channel.name}"
                n = min(length[id(channels)]) if heard.cut_off else len(channel)
                if n:
                    unit = channel.properties.get("unit_string", "")
                    found[name] = (n,), partial(_values, channel, n), str(unit)
                for key, value in channel.properties.items():
                    if isinstance(value, Real):
                        found[f"{name}@{key}"] = (), partial(np.asarray, value), ""
        yield found


def is_cut_off(path: Path) -> bool:
    """Whether a file is a TDMS file that ends before its numbers do."""
    with path.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            return False
    from nptdms import TdmsFile

    with path.open("rb") as stream, _listening() as heard:
        TdmsFile.read_metadata(stream)
    return heard.cut_off


def _values(channel: Any, n: int) -> NDArray[Any]:
    return np.asarray(channel[:n])


@contextmanager
def _listening() -> Iterator[_Listener]:
    """Hear what npTDMS says, and keep it from the terminal."""
    from nptdms.log import log_manager

    log, console, heard = logging.getLogger("nptdms"), log_manager.console_handler, _Listener()
    level = console.level
    log.addHandler(heard)
    console.setLevel(logging.ERROR)
    try:
        yield heard
    finally:
        console.setLevel(level)
        log.removeHandler(heard)
