"""Effects fitted from where a search all over their ranges brings the model near, for a base model that is far off."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial

import numpy as np

from model import SolveError
from updating.diagnosis.assembly import Assembled
from updating.diagnosis.evidence import Evidence
from updating.diagnosis.explanation import Explanation, likeliest
from updating.diagnosis.residual import covariance_of
from updating.diagnosis.scan import MESSAGES, Place, nearest
from updating.diagnosis.starts import Start, explained_from, finished, started_at
from updating.workers.workers import distribute

N_NEAR, N_FIRST_STEPS = 5, 6
"""Places that are fitted in full, and evaluations of a first fit of the others."""
N_FOLLOWED, N_FULL_STEPS, N_WEIGHED = 5, 20, 3
"""How many of the others are then fitted in full, the evaluations of that, and times that it is weighed."""


def global_search(
    evidence: Assembled, places: Sequence[Place], executor: Executor | None
) -> list[Explanation]:
    """Fit effects from where they come nearest in a global search.

    They are weighed with usual sizes: with those that a model leaves that is far off, all that is near seems right.
    And each with the modes of its own place: those of the base model are others, and a fit so weighed runs off.
    """
    evidence = replace(evidence, sizes=evidence.scatter.sizes)
    starts: list[Start] = []
    for place in places or nearest(evidence.alone, executor):
        nuisance = evidence.start.copy()
        nuisance[0] = np.log(place.G_f / evidence.stack.contact.G_f)
        starts.append(Start([place.effect], nuisance, place.coordinate, N_FIRST_STEPS))
    near, rest = starts[:N_NEAR], starts[N_NEAR:]  # a few steps mislead from where much is right already
    in_full = partial(_fitted_there, evidence.alone, N_WEIGHED)
    begun = distribute(in_full, [replace(start, most=N_FULL_STEPS) for start in near], executor, MESSAGES)
    found = finished(distribute(partial(_fitted_there, evidence.alone, 1), rest, executor, MESSAGES))
    first = sorted(found, key=lambda x: -x.log_evidence)[:N_FOLLOWED]
    followed = distribute(in_full, [started_at(own, N_FULL_STEPS) for own in first], executor, MESSAGES)
    return [*finished(begun), *found, *finished(followed)]


def _fitted_there(evidence: Evidence, times: int, start: Start) -> Explanation | None:
    """Fit an explanation that is weighed where it starts, and again where it ends while that is better, so many times.

    Its evidence is one over the noise of `evidence`.
    """
    parameters = evidence.supposing(start.effects).parameters(start.effects)
    best: Explanation | None = None
    for _ in range(times):
        try:
            covariance = covariance_of(evidence, start.nuisance, parameters, start.coordinate)
        except SolveError:
            return best
        own = explained_from(replace(evidence, covariance=covariance), start)
        if own is None:
            return best
        other = 0.5 * (covariance.log_noise - evidence.covariance.log_noise)
        own = replace(own, log_evidence=own.log_evidence - other)
        if best is not None and own.log_evidence < best.log_evidence + 1.0:
            return likeliest([best, own])
        best, start = own, started_at(own, start.most)
    return best
