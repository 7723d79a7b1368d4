"""Which effects, alone and in pairs, explain the published frequencies when all stacks share their parameters."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from model import ModelError
from updating.errors import UpdatingError
from updating.fitting.joint_fit import FittedParameter, joint_fit
from updating.fitting.joint_problem import FitSettings
from updating.published.campaign import SCATTER, Published, prepare_published

_AMONG = 4  # the best effects whose pairs are tried beside those with the best one


@dataclass(frozen=True, kw_only=True)
class Tried:
    """One effect, or one pair, with the 18 stacks.

    Attributes
    ----------
    effects : tuple of str
        The effects.
    error : float
        Mean relative frequency error, eq. (2); NaN where it was not found.
    shared : tuple of FittedParameter
        Their parameters, which all stacks share.
    note : str
        Why there is no error: the time was over, or the fit failed; empty otherwise.
    """

    effects: tuple[str, ...]
    error: float
    shared: tuple[FittedParameter, ...]
    note: str

    @property
    def at_bound(self) -> bool:
        """Whether a parameter asks for a value outside its range."""
        return any(p.at_bound for p in self.shared)


@dataclass(frozen=True, eq=False, kw_only=True)
class Screening:
    """All that was tried under one calibration, in order."""

    calibration: str
    tried: tuple[Tried, ...]


def screen(data: Published, calibration: str, names: Sequence[str], *, seconds: float) -> Screening:
    """Try effects one by one, then the best one with each other one, then the pairs of the next best.

    Parameters
    ----------
    data : Published
        The tables.
    calibration : str
        One of `CALIBRATIONS`.
    names : sequence of str
        Effects.
    seconds : float
        Processor time after which nothing new is begun; what is left is listed as not tried.
    """
    end = time.process_time() + seconds
    singles = [_try(data, calibration, (name,), end, {}) for name in names]
    alone = {t.effects[0]: {p.name: p.value for p in t.shared} for t in singles}
    pairs = [_try(data, calibration, pair, end, alone[pair[0]]) for pair in _pairs(singles)]
    return Screening(calibration=calibration, tried=(*singles, *pairs))


def _pairs(singles: Sequence[Tried]) -> Iterator[tuple[str, str]]:
    """Return the pairs worth trying, the most promising first."""
    fitted = [t for t in singles if np.isfinite(t.error)]  # what is not a number has no rank
    ranked = [t.effects[0] for t in sorted(fitted, key=lambda t: t.error)]
    if not ranked:
        return
    yield from ((ranked[0], other) for other in ranked[1:])
    yield from itertools.combinations(ranked[1 : 1 + _AMONG], 2)


def _try(
    data: Published, calibration: str, effects: tuple[str, ...], end: float, alone: Mapping[str, float]
) -> Tried:
    """Fit effects; one descent begins with what the first of them is alone, the others at their neutral values."""
    if time.process_time() > end:
        return Tried(effects=effects, error=float("nan"), shared=(), note="not tried: the time was over")
    try:
        stacks, _ = prepare_published(data, calibration, effects, both=False)
        neutral = {p.name: p.neutral for e in stacks[0].target.stack.effects for p in e.parameters}
        first = {**neutral, **alone} if alone else {}
        fit = joint_fit(
            stacks, FitSettings(effects=effects, damping=False, scatter=SCATTER), n_start=3, first=first
        )
    except (UpdatingError, ModelError) as error:
        return Tried(effects=effects, error=float("nan"), shared=(), note=str(error))
    return Tried(
        effects=effects,
        error=fit.error(),
        shared=tuple(p for p in fit.parameter if not p.group),
        note="",
    )
