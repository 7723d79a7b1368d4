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

_OF_NUMBERS = "Last segment", "Data size", "Cropping data", "Unsupported scale"
"""How npTDMS begins what it says of numbers that a file lacks or that it could not scale; other words are of names."""


class _Refusal(logging.Handler):
    """Raises what npTDMS only says: numbers that are not there, or not those of the file, are no measurement."""

    def emit(self, record: logging.LogRecord) -> None:
        if record.getMessage().startswith(_OF_NUMBERS):
            raise ValueError(record.getMessage())  # at an EOFError npTDMS ends in silence


def lacks_numbers(error: Exception) -> bool:
    """Whether an error says that a file ends before its numbers do."""
    return isinstance(error, EOFError) or str(error).startswith(_OF_NUMBERS[:2])


@contextmanager
def channels_in(path: Path) -> Iterator[dict[str, Channel]]:
    """Open a TDMS file and give its channels of numbers, ``group/channel``, and their properties that are numbers.

    Properties are named ``group/channel@wf_increment``, as attributes of HDF5 are. Whatever npTDMS raises of a damaged
    file, or says of one that is cut off, is raised.
    """
    from nptdms import TdmsFile  # here: few tests come in such files

    with path.open("rb") as stream, _refusing(), TdmsFile.open(stream) as file:
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


@contextmanager
def _refusing() -> Iterator[None]:
    """Raise what npTDMS says of lacking numbers, and keep the rest of what it says from the terminal."""
    from nptdms.log import log_manager

    log, console, refusal = logging.getLogger("nptdms"), log_manager.console_handler, _Refusal()
    level = console.level
    log.addHandler(refusal)
    console.setLevel(logging.ERROR)
    try:
        yield
    finally:
        console.setLevel(level)
        log.removeHandler(refusal)
