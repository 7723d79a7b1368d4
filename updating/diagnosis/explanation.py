"""An explanation: the model with some effects, fitted to all configurations of a stack together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from model import Parameter, SolveError
from updating.diagnosis.calibration import WIDER
from updating.diagnosis.candidates import G_F_RANGE
from updating.diagnosis.coordinates import bounds_of, scaled
from updating.diagnosis.discrepancy import KINDS, Kind, Sizes
from updating.diagnosis.evidence import Evidence
from updating.diagnosis.marginal import Linearized, Marginal, marginal
from updating.diagnosis.residual import Residual, residual, reweighed

Vector = NDArray[np.float64]

Z95 = 1.96
"""Standard deviations to either side that hold 95 % of a normal distribution."""
RANGE_PRECISION = 2.0 * np.pi
"""Of a normal distribution of a volume of 1, as ranges have: what the data do not show leaves the evidence as it is."""
TRUST = 0.05**-2.0
"""Inverse variance of steps, of a logarithm or in units of a range, for which first order does."""
_FARTHEST = 5.0  # prior standard deviations that a nuisance may move
_EDGE = 1e-4
_ROBUST = 10.0  # residual beyond which a robust loss counts it less
_FAR_OFF = 30.0  # squared residual of a value, in the mean, from which a search begins with such a loss
_UNSEEN = 1e-9  # precision of a nuisance, beside that of data and priors
_ALIKE = 1.5  # ratio of sizes of the discrepancy from which a fit is weighed anew
_REWEIGHED = 3  # times
_WEIGHED = 0.01  # size of the discrepancy of frequencies by which a fit is weighed wherever it is so small
_FORBIDDEN = 1e6  # residual of a step to where the model has no modes, so that a shorter one is tried


@dataclass(frozen=True, eq=False, kw_only=True)
class Explanation:
    """The model with some effects, fitted to all configurations together.

    Attributes
    ----------
    effects : tuple of str
        Which; none for the base model.
    parameter : tuple of Parameter
        Their parameters.
    value, lower, upper : (n_parameter,) float
        Estimates and the ends of their 95 % intervals, within the plausible ranges.
    std : (n_parameter,) float
        Standard deviations of `coordinate`.
    at_bound : (n_parameter,) bool
        Which lie on an end of the plausible range.
    nuisance, nuisance_std : (n_nuisance,) float
        Nuisance coordinates and their standard deviations.
    coordinate : (n_parameter,) float
        Effect parameters in units of their ranges.
    misfit : float
        Squared length of the whitened residual at `Evidence.sizes`, priors included.
    log_evidence : float
        Logarithm of the marginal likelihood over parameters and sizes of the discrepancy, up to a constant of the data.
    likeliest, mean, spread : Sizes
        Of the discrepancy that the explanation leaves, see `marginal.Marginal`.
    residual : Residual
        At the estimate.
    """

    effects: tuple[str, ...]
    parameter: tuple[Parameter, ...]
    value: Vector
    lower: Vector
    upper: Vector
    std: Vector
    at_bound: NDArray[np.bool_]
    nuisance: Vector
    nuisance_std: Vector
    coordinate: Vector
    misfit: float
    log_evidence: float
    likeliest: Sizes
    mean: Sizes
    spread: Sizes
    residual: Residual

    @property
    def strain(self) -> float:
        """Squared deviations of the nuisances from what is known of them, over its variances."""
        return float(np.sum(self.residual.value[self.residual.kind == "prior"] ** 2))

    @property
    def effect_values(self) -> dict[str, float]:
        """The estimates by the parameters' names."""
        return dict(zip((p.name for p in self.parameter), self.value.tolist(), strict=True))


def likeliest(fitted: Sequence[Explanation]) -> Explanation:
    """Return the explanation of the largest marginal likelihood."""
    return max(fitted, key=lambda own: own.log_evidence)


def explained(base: Explanation, own: Explanation) -> float:
    """Return the share of the base model's misfit that an explanation explains."""
    return float(np.clip(1.0 - own.misfit / base.misfit, 0.0, 1.0))


def explain(
    evidence: Evidence,
    effects: Sequence[str] = (),
    *,
    nuisance: Vector | None = None,
    coordinate: Vector | None = None,
    most: int = 12,
    sizes: Sizes | None = None,
) -> Explanation:
    """Fit nuisances and the parameters of some effects to all configurations by weighted least squares.

    Parameters
    ----------
    evidence : Evidence
        Measurement and model.
    effects : sequence of str
        Names of effects; none fits the base model.
    nuisance, coordinate : optional
        Where the search starts.
    most : int
        Largest number of evaluations.
    sizes : Sizes, optional
        Of the discrepancy, by which the fit is weighed first; those of the evidence by default.

    Raises
    ------
    SolveError
        The model has no modes where the search starts.
    """
    evidence = evidence.supposing(effects)
    sizes = weights(evidence.sizes if sizes is None else sizes, evidence.scatter.stated)
    begun = replace(evidence, sizes=sizes)
    parameters = evidence.parameters(effects)
    bounds = _bounds(evidence, parameters)
    first = np.concatenate(
        [
            evidence.start if nuisance is None else nuisance,
            np.zeros(len(parameters)) if coordinate is None else coordinate,
        ]
    )
    first = np.clip(first, bounds[0] + 1e-9, bounds[1] - 1e-9)
    at = _Residuals(begun, parameters)
    if np.mean(at(first).value ** 2) > _FAR_OFF:
        # modes that are still taken for others must not decide
        first = _minimum(_Residuals(begun.rough, parameters), first, bounds, most, "cauchy")
    solution = first
    for _ in range(_REWEIGHED if most > 1 else 1):
        solution = _minimum(at, solution, bounds, most, "linear")
        best, at_bound = at(solution), _at_bound(parameters, solution)
        found = marginal(
            linearized(evidence, best, solution, at_bound), evidence.scatter.sizes, evidence.scatter.stated
        )
        sizes = weights(found.likeliest, evidence.scatter.stated)
        if _alike(sizes, at.evidence.sizes):
            break
        at = at.weighed(sizes)
    return _explanation(evidence, tuple(effects), solution, found, reweighed(best, evidence))


def weights(sizes: Sizes, stated: Sequence[Kind]) -> Sizes:
    """Return sizes by which a fit is weighed: of frequencies none that is implausible beside what shapes leave.

    Frequencies would be left to small errors of shapes, which are many, and all of them end as far off.
    """
    if "frequency" in stated:
        return sizes
    return replace(sizes, frequency=min(sizes.frequency, max(_WEIGHED, sizes.shape)))


def _explanation(
    evidence: Evidence, effects: tuple[str, ...], solution: Vector, found: Marginal, best: Residual
) -> Explanation:
    """Return the explanation that a fit with some effects arrives at."""
    n_own, parameters = len(evidence.nuisances), evidence.parameters(effects)
    low, high = bounds_of(parameters)
    z = solution[n_own:]
    variance = np.maximum(np.diag(found.covariance), 0.0)
    by_form = np.maximum(variance - found.noise_variance, 0.0)
    std = np.sqrt(variance + (WIDER**2 - 1.0) * by_form)[n_own:]

    def ends(step: Vector) -> Vector:
        clipped = np.clip(z + step, low, high)
        return np.array([scaled(p, float(x))[0] for p, x in zip(parameters, clipped, strict=True)])

    return Explanation(
        effects=effects,
        parameter=parameters,
        value=ends(np.zeros(z.size)),
        lower=ends(-Z95 * std),
        upper=ends(Z95 * std),
        std=std,
        at_bound=_at_bound(parameters, solution),
        nuisance=solution[:n_own],
        nuisance_std=np.sqrt(variance[:n_own]),
        coordinate=z,
        misfit=float(best.value @ best.value),
        log_evidence=found.log_evidence,
        likeliest=found.likeliest,
        mean=found.mean,
        spread=found.spread,
        residual=best,
    )


def _minimum(
    at: _Residuals, start: Vector, bounds: tuple[Vector, Vector], most: int, loss: Literal["linear", "cauchy"]
) -> Vector:
    """Return the coordinates, within bounds, of the least squares from a start."""
    found = least_squares(
        lambda x: at(x).value,
        start,
        jac=lambda x: at(x).jacobian,
        bounds=bounds,
        x_scale="jac",
        xtol=1e-5,
        ftol=1e-4,
        max_nfev=most,
        loss=loss,
        f_scale=_ROBUST,
    )
    return np.asarray(found.x)


def _at_bound(parameters: Sequence[Parameter], solution: Vector) -> NDArray[np.bool_]:
    """Return which effect parameters, the last of the coordinates, lie on an end of their range."""
    low, high = bounds_of(parameters)
    z = solution[solution.size - low.size :]
    return np.asarray((z - low < _EDGE) | (high - z < _EDGE))


def _alike(one: Sizes, other: Sizes) -> bool:
    """Tell whether two sizes of the discrepancy weigh data nearly alike."""
    ratio = [getattr(one, kind) / getattr(other, kind) for kind in KINDS]
    return all(1.0 / _ALIKE < r < _ALIKE for r in ratio)


def linearized(evidence: Evidence, at: Residual, solution: Vector, at_bound: NDArray[np.bool_]) -> Linearized:
    """Return a fit to first order, with the priors of nuisances, and those of effects over their ranges.

    `solution` holds the coordinates, nuisances first; `at_bound` says which of the others lie on an end of their range.
    """
    std, n = evidence.prior_std, at_bound.size
    return Linearized(
        value=at.rotated,
        jacobian=at.rotated_jacobian,
        kind=evidence.rows.kind,
        growth=evidence.covariance.growth,
        prior_value=np.concatenate([-solution[: std.size], np.zeros(n)]),
        prior_precision=np.concatenate([std**-2.0, np.zeros(n)]),
        trust=np.full(std.size + n, TRUST),
        unseen=np.concatenate([np.full(std.size, _UNSEEN), np.full(n, RANGE_PRECISION)]),
        free=free_coordinates(evidence, solution, at_bound),
    )


def free_coordinates(evidence: Evidence, solution: Vector, at_bound: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which coordinates, nuisances first, lie on no end of their range: steps beyond an end say nothing."""
    std = evidence.prior_std
    return np.concatenate([np.abs(solution[: std.size]) < (1.0 - _EDGE) * _FARTHEST * std, ~at_bound])


class _Residuals:
    """Residuals at coordinates, nuisances first; the last is kept, for its value and Jacobian are asked for apart."""

    def __init__(self, evidence: Evidence, parameters: Sequence[Parameter]) -> None:
        self.evidence, self._parameters = evidence, parameters
        self._last: tuple[bytes, Residual] | None = None

    def weighed(self, sizes: Sizes) -> _Residuals:
        """Return the same residuals, weighed with a discrepancy of other sizes."""
        other = _Residuals(replace(self.evidence, sizes=sizes), self._parameters)
        if self._last is not None:
            other._last = self._last[0], reweighed(self._last[1], other.evidence)
        return other

    def __call__(self, x: Vector) -> Residual:
        key, n = x.tobytes(), len(self.evidence.nuisances)
        if self._last is None or self._last[0] != key:
            try:
                found = residual(self.evidence, x[:n], self._parameters, x[n:])
            except SolveError:
                if self._last is None:
                    raise
                found = replace(self._last[1], value=np.full(self._last[1].value.size, _FORBIDDEN))
            self._last = key, found
        return self._last[1]


def _bounds(evidence: Evidence, parameters: Sequence[Parameter]) -> tuple[Vector, Vector]:
    """Return how far coordinates go: G_f over the range of the reduction, d_f a hundredfold, others by their priors.

    G_f and d_f of one lamina, on which nothing depends, have priors too.
    A first step from a model that lacks an effect can ask for far more, and then the contact turns negative.
    """
    reach = _FARTHEST * evidence.prior_std
    low, high = -reach, reach.copy()
    if evidence.touching:
        low[0], high[0] = np.log(np.array(G_F_RANGE) / evidence.stack.contact.G_f)
        low[1], high[1] = evidence.start[1] - np.log(100.0), evidence.start[1] + np.log(100.0)
    ends = bounds_of(parameters)
    return np.concatenate([low, ends[0]]), np.concatenate([high, ends[1]])
