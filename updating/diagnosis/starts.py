"""What a fit starts from, and the fits of many starts, in other processes where there are some."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from model import SolveError
from updating.diagnosis.assembly import Assembled
from updating.diagnosis.discrepancy import Sizes
from updating.diagnosis.evidence import Evidence
from updating.diagnosis.explanation import Explanation, explain
from updating.diagnosis.scan import MESSAGES
from updating.workers.workers import distribute

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Start:
    """Effects, and where their fit starts.

    Attributes
    ----------
    effects : sequence of str
        Which.
    nuisance : (n_nuisance,) float
        Nuisance coordinates.
    coordinate : (n_parameter,) float
        Effect parameters in units of their ranges.
    most : int
        Largest number of evaluations.
    sizes : Sizes, optional
        Of the discrepancy, by which the fit is weighed first; those of the evidence by default.
    """

    effects: Sequence[str]
    nuisance: Vector
    coordinate: Vector
    most: int
    sizes: Sizes | None = None


def started_at(own: Explanation, most: int) -> Start:
    """Return a start where an explanation stands."""
    return Start(own.effects, own.nuisance, own.coordinate, most)


def begin(
    evidence: Assembled, starts: Sequence[Start], executor: Executor | None
) -> Iterator[Explanation | None]:
    """Begin to fit explanations, where there is an executor at once."""
    return distribute(partial(explained_from, evidence.alone), starts, executor, MESSAGES)


def finished(begun: Iterator[Explanation | None]) -> list[Explanation]:
    """Wait for the fits that were begun; one that started where the model has no modes is left out."""
    return [own for own in begun if own is not None]


def explained_from(evidence: Evidence, start: Start) -> Explanation | None:
    """Fit an explanation from a start; None where the model has no modes there."""
    try:
        return explain(
            evidence,
            start.effects,
            nuisance=start.nuisance,
            coordinate=start.coordinate,
            most=start.most,
            sizes=start.sizes,
        )
    except SolveError:
        return None
