"""Functions that are the same to the last digit: no measurement repeats its noise, so one was copied."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from ema.quality.verdict import Verdict
from ema.types.frf import FRF

_TOLD = 3  # that are told one by one


def content_digests(frf: FRF) -> tuple[str, ...]:
    """Return a digest of the values of each output's functions: files of other names and headers have the same."""
    return tuple(hashlib.sha256(value.tobytes()).hexdigest() for value in frf.value)


def repeated(frf: FRF, channels: NDArray[np.int64]) -> Iterator[Verdict]:
    """Find outputs of one configuration that hold the same functions.

    Parameters
    ----------
    frf : FRF
        All functions.
    channels : (n,) int
        Positions of sound outputs.
    """
    digest, first = content_digests(frf), dict[str, int]()
    for channel in channels:
        before = first.setdefault(digest[channel], int(channel))
        if before != channel:
            both = f"{_label(frf, before)} and {_label(frf, int(channel))}"
            message = (
                f"{both} hold the same values to the last digit: one is a copy of the other's file or column"
            )
            yield Verdict(
                check="copied", level="warn", channel=(before, int(channel)), band=None, message=message
            )


def shared_functions(digests: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Say which configurations hold functions of another one.

    Parameters
    ----------
    digests : mapping of str to tuple of str
        Of each configuration the digests of its functions, see `content_digests`.
    """
    names, found = list(digests), []
    for i, name in enumerate(names):
        for other in names[:i]:
            common = set(digests[name]) & set(digests[other])
            if common:
                found.append(
                    f"{other} and {name} share {len(common)} of {len(digests[name])} functions to the last digit: "
                    "files of one stand in the other, too, which is no second measurement"
                )
    more = (
        [f"{len(found) - _TOLD} more pairs of configurations share functions"] if len(found) > _TOLD else []
    )
    return (*found[:_TOLD], *more)


def _label(frf: FRF, channel: int) -> str:
    return f"{frf.output.name(channel)} (run {frf.run[channel] + 1}, {frf.source[channel]})"
