"""The search for explanations: the base model, effects alone and in pairs, the promising ones fitted in full."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model import SolveError, enriched
from updating.candidates import N_MODEL
from updating.coordinates import scaled
from updating.evidence import Evidence
from updating.explanation import Explanation, explain
from updating.screening import Screened, pair_steps, screen

Vector = NDArray[np.float64]

N_SINGLE, N_PAIR, N_BESIDE = 12, 8, 4
"""Effects that are fitted in full; pairs by their linear step; second effects beside each of the best first ones."""
N_FIRST = 3
"""First effects beside which a second is sought anew: where an effect is strong, steps from the base model mislead."""
N_EXACT = 4
"""Explanations whose modes are taken into the basis."""
VISIBLE = 3.0
"""Change of the data, in standard deviations, that an effect must be able to bring to be seen."""
_REFIT = 8  # evaluations after the basis has grown


@dataclass(frozen=True, eq=False, kw_only=True)
class Search:
    """What was found.

    Attributes
    ----------
    evidence : Evidence
        With the basis of the last fits.
    base : Explanation
        The base model.
    singles, pairs : tuple of Explanation
        Effects alone and two at a time, the best first.
    screened : tuple of Screened
        All effects of the catalogue beside the base model.
    """

    evidence: Evidence
    base: Explanation
    singles: tuple[Explanation, ...]
    pairs: tuple[Explanation, ...]
    screened: tuple[Screened, ...]

    @property
    def explanations(self) -> tuple[Explanation, ...]:
        """All that were fitted in full, the base model first."""
        return (self.base, *self.singles, *self.pairs)


def search(evidence: Evidence, worth: float) -> Search:
    """Fit the base model and the effects and pairs that could explain what it leaves.

    Pairs are tried where single effects leave more than chance does.

    Parameters
    ----------
    evidence : Evidence
        Measurement and model.
    worth : float
        Fall of the misfit below which an effect is not worth a fit.
    """
    base = explain(evidence)
    screened = screen(evidence, base)
    promising = sorted((s for s in screened if s.gain > worth), key=lambda s: -s.gain)[:N_SINGLE]
    singles = [explain(evidence, [s.effect], nuisance=base.nuisance, coordinate=s.start) for s in promising]
    evidence, singles = _exact(evidence, singles)
    pairs = []
    if any(base.misfit - x.misfit > worth for x in singles):
        starts = _pair_starts(evidence, base, screened, singles)
        pairs = [
            explain(evidence, names, nuisance=nuisance, coordinate=coordinate, most=_REFIT)
            for names, (nuisance, coordinate) in starts.items()
        ]
        evidence, pairs = _exact(evidence, pairs)
    return Search(evidence=evidence, base=base, singles=tuple(singles), pairs=tuple(pairs), screened=screened)


def _pair_starts(
    evidence: Evidence, base: Explanation, screened: Sequence[Screened], singles: Sequence[Explanation]
) -> Mapping[tuple[str, str], tuple[Vector, Vector]]:
    """Return pairs worth a fit with nuisances and coordinates from which to start."""
    starts = {}
    visible = [s for s in screened if s.reach >= VISIBLE]
    for _, (a, b), coordinate in pair_steps(base, visible)[:N_PAIR]:
        starts[tuple(sorted((a, b)))] = ((a, b), (base.nuisance, np.concatenate(coordinate)))
    for first in singles[:N_FIRST]:
        beside = sorted(screen(evidence, first), key=lambda s: -s.gain)[:N_BESIDE]
        for second in beside:
            names = (first.effects[0], second.effect)
            start = (first.nuisance, np.concatenate([first.coordinate, second.start]))
            starts[tuple(sorted(names))] = (names, start)
    return dict(starts.values())


def _exact(evidence: Evidence, fitted: Sequence[Explanation]) -> tuple[Evidence, list[Explanation]]:
    """Take the modes at the best explanations into the basis and fit these again; return all, the best first."""
    ordered = sorted(fitted, key=lambda x: x.misfit)
    system = evidence.system
    pressure = float(np.exp(np.mean([np.log(t.pressure) for t in evidence.tested])))
    for own in ordered[:N_EXACT]:
        effect = {p.name: scaled(p, float(x))[0] for p, x in zip(own.parameter, own.coordinate, strict=True)}
        try:
            theta = {**evidence.theta(own.nuisance, 0), "pressure": pressure, **effect}
            system = enriched(system, theta, N_MODEL)
        except SolveError:  # the fit went where the model ends; it stays as it is
            continue
    richer = evidence.with_system(system)
    again = [
        explain(richer, x.effects, nuisance=x.nuisance, coordinate=x.coordinate, most=_REFIT)
        for x in ordered[:N_EXACT]
    ]
    return richer, sorted([*again, *ordered[N_EXACT:]], key=lambda x: x.misfit)
