"""Where a few steps from some coordinates lead, at given sizes of the discrepancy: cheap, to choose starts of a fit."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from updating.inference.discrepancy import Sizes
from updating.inference.explain import (
    DAMP,
    Cost,
    Setting,
    coordinates_of,
    errors_at,
    evidence_of,
    step_within,
    weighed_at,
)
from updating.inference.protocol import Coordinate, LocalModel, Model, Term

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Descent:
    """Where damped steps with some terms have led.

    Attributes
    ----------
    model, terms, setting, local, sizes
        As `explain` takes them.
    x : (n_coordinate,) float
        Coordinates.
    cost : float
        Negative logarithm of the posterior density there, of the modes that are set apart included.
    to : (n_coordinate,) float
        Where the next step leads.
    fall : float
        By how much it is expected to lower the cost.
    ended : bool
        Whether the last step lowered it by so little that further ones do not matter.
    """

    model: Model
    terms: tuple[Term, ...]
    setting: Setting
    local: LocalModel
    sizes: Sizes
    x: Vector
    cost: float
    to: Vector
    fall: float
    ended: bool = False
    _slope: Vector
    _hessian: Vector
    _damp: float

    @cached_property
    def log_evidence(self) -> float:
        """Logarithm of the marginal likelihood there, sizes of the discrepancy integrated out.

        Costs at the sizes of a model that is far off hardly tell a good end from one that is less bad.
        """
        problem = self.setting.join(errors_at(self.model, self.local, self.setting, self.x), self.x.size)
        return evidence_of(problem, self.x, coordinates_of(self.model, self.terms), self.setting, self.sizes)[0].log

    def further(self, *, small: float = 1.0) -> Descent:
        """Return where one more step leads; one that raises the cost is damped more the next time.

        A fall of the cost by less than `small` ends the steps.
        """
        with contextlib.suppress(np.linalg.LinAlgError, ValueError):  # no modes there: step less far
            there = begun(self.model, self.terms, self.setting, self.to, self.local, self.sizes, damp=self._damp / 5.0)
            if there.cost < self.cost:
                return replace(there, ended=self.cost - there.cost < small)
        damp = max(8.0 * self._damp, 1e-2)
        to, fall = _ahead(self.x, self._slope, self._hessian, coordinates_of(self.model, self.terms), damp)
        return replace(self, to=to, fall=fall, _damp=damp)


def begun(
    model: Model,
    terms: Sequence[Term],
    setting: Setting,
    x: Vector,
    local: LocalModel,
    sizes: Sizes,
    *,
    damp: float = DAMP,
) -> Descent:
    """Return the beginning of steps from some coordinates, (n_coordinate,); the others as `explain` takes them.

    Far off, the terms by the noise of shapes are as large as the misfit and curved: errors alone are nearly linear.

    Raises
    ------
    numpy.linalg.LinAlgError
        The model has no modes there.
    """
    coordinates = coordinates_of(model, terms)
    precision = np.array([c.std**-2.0 for c in coordinates])
    _, problem, white = weighed_at(model, local, setting, x, sizes)
    hessian = white.hessian + np.diag(precision) + problem.curvature
    slope = white.slope + precision * x
    to, fall = _ahead(x, slope, hessian, coordinates, damp)
    return Descent(
        model=model,
        terms=tuple(terms),
        setting=setting,
        local=local,
        sizes=sizes,
        x=x,
        cost=Cost(precision, sizes).total(problem, white, x) - setting.log_prior_apart,
        to=to,
        fall=fall,
        _slope=slope,
        _hessian=hessian,
        _damp=damp,
    )


def _ahead(
    x: Vector, slope: Vector, hessian: Vector, coordinates: Sequence[Coordinate], damp: float
) -> tuple[Vector, float]:
    """Return where the next step leads, and by how much it is expected to lower the cost."""
    to = step_within(slope, hessian, x, coordinates, damp=damp)
    step = to - x
    return to, -float(slope @ step + 0.5 * step @ hessian @ step)


def raced(descents: Sequence[Descent], *, steps: int, later: int, behind: float) -> list[Descent]:
    """Return the descents that may come near the lowest cost, after at most `steps` further steps each.

    One goes on, and is returned, as long as it would come within `behind` of the lowest cost if each of the steps that
    are left lowered its cost by as much as the next is expected to. After the race a fit may take `later` more.
    """
    going = list(descents)
    for left in range(steps, -1, -1):
        limit = min((d.cost for d in going), default=np.inf) + behind
        going = [d for d in going if d.cost - (0.0 if d.ended else (left + later) * d.fall) <= limit]
        if left:
            going = [d if d.ended else d.further() for d in going]
    return going
