"""An explanation: the model with some effects, fitted to all configurations of a stack together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.optimize import least_squares

from model import Parameter, SolveError
from updating.diagnosis.candidates import G_F_RANGE
from updating.diagnosis.coordinates import bounds_of, scaled
from updating.diagnosis.evidence import Evidence
from updating.diagnosis.residual import Residual, residual

Vector = NDArray[np.float64]

Z90 = 1.6449
"""Standard deviations to either side that hold 90 % of a normal distribution."""
_FARTHEST = 5.0  # prior standard deviations that a nuisance may move
_EDGE = 1e-4
_ROBUST = 10.0  # residual beyond which a robust loss counts it less
_ASTRAY = 30.0  # squared residual of a value, in the mean, from which a search begins with such a loss
_UNSEEN = 1e-9  # precision of a nuisance, beside that of data and priors
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
        Estimates and the ends of their 90 % intervals, within the plausible ranges.
    at_bound : (n_parameter,) bool
        Which lie on an end of the plausible range.
    nuisance : (n_nuisance,) float
        Nuisance coordinates.
    coordinate : (n_parameter,) float
        Effect parameters in units of their ranges.
    misfit : float
        Squared length of the whitened residual, priors included.
    log_evidence : float
        Logarithm of the marginal likelihood by Laplace's approximation, up to a constant of the data.
    residual : Residual
        At the estimate.
    """

    effects: tuple[str, ...]
    parameter: tuple[Parameter, ...]
    value: Vector
    lower: Vector
    upper: Vector
    at_bound: NDArray[np.bool_]
    nuisance: Vector
    coordinate: Vector
    misfit: float
    log_evidence: float
    residual: Residual

    @property
    def effect_values(self) -> dict[str, float]:
        """The estimates by the parameters' names."""
        return dict(zip((p.name for p in self.parameter), self.value.tolist(), strict=True))


def best_of(fitted: Sequence[Explanation], otherwise: Explanation) -> Explanation:
    """Return the explanation of least misfit, or another one where there is none."""
    return min(fitted, key=lambda own: own.misfit, default=otherwise)


def explain(
    evidence: Evidence,
    effects: Sequence[str] = (),
    *,
    nuisance: Vector | None = None,
    coordinate: Vector | None = None,
    most: int = 12,
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

    Raises
    ------
    SolveError
        The model has no modes where the search starts.
    """
    parameters = evidence.parameters(effects)
    n_own = len(evidence.nuisances)
    low, high = bounds_of(parameters)
    first = np.concatenate(
        [
            evidence.start if nuisance is None else nuisance,
            np.clip(np.zeros(len(parameters)) if coordinate is None else coordinate, low + 1e-9, high - 1e-9),
        ]
    )
    nuisance_low, nuisance_high = _nuisance_bounds(evidence)
    first[:n_own] = np.clip(first[:n_own], nuisance_low + 1e-9, nuisance_high - 1e-9)
    bounds = (np.concatenate([nuisance_low, low]), np.concatenate([nuisance_high, high]))

    at = _Residuals(evidence, parameters)

    def minimum(at: _Residuals, start: Vector, loss: str) -> Vector:
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

    if np.mean(at(first).value ** 2) > _ASTRAY:  # modes that are still taken for others must not decide
        first = minimum(_Residuals(evidence.rough, parameters), first, "cauchy")
    solution = minimum(at, first, "linear")
    best = at(solution)
    z = solution[n_own:]
    hessian = best.jacobian.T @ best.jacobian
    covariance = la.pinvh(hessian)
    std = np.hypot(np.sqrt(np.maximum(np.diag(covariance)[n_own:], 0.0)), evidence.scatter.form * np.abs(z))
    # a normal distribution of a volume of 1, as ranges have: what the data do not show leaves the evidence as it is
    prior = np.concatenate([np.full(n_own, _UNSEEN), np.full(z.size, 2.0 * np.pi)])
    logdet = float(np.linalg.slogdet(hessian + np.diag(prior))[1])
    misfit = float(best.value @ best.value)

    def ends(step: Vector) -> Vector:
        clipped = np.clip(z + step, low, high)
        return np.array([scaled(p, float(x))[0] for p, x in zip(parameters, clipped, strict=True)])

    return Explanation(
        effects=tuple(effects),
        parameter=parameters,
        value=ends(np.zeros(z.size)),
        lower=ends(-Z90 * std),
        upper=ends(Z90 * std),
        at_bound=(z - low < _EDGE) | (high - z < _EDGE),
        nuisance=solution[:n_own],
        coordinate=z,
        misfit=misfit,
        log_evidence=0.5 * (z.size * float(np.log(2.0 * np.pi)) - logdet - misfit),
        residual=best,
    )


class _Residuals:
    """Residuals at coordinates, nuisances first; the last is kept, for its value and Jacobian are asked for apart."""

    def __init__(self, evidence: Evidence, parameters: Sequence[Parameter]) -> None:
        self._evidence, self._parameters = evidence, parameters
        self._last: tuple[bytes, Residual] | None = None

    def __call__(self, x: Vector) -> Residual:
        key, n = x.tobytes(), len(self._evidence.nuisances)
        if self._last is None or self._last[0] != key:
            try:
                found = residual(self._evidence, x[:n], self._parameters, x[n:])
            except SolveError:
                if self._last is None:
                    raise
                found = replace(self._last[1], value=np.full(self._last[1].value.size, _FORBIDDEN))
            self._last = key, found
        return self._last[1]


def _nuisance_bounds(evidence: Evidence) -> tuple[Vector, Vector]:
    """Return how far nuisances may go: G_f over the range of the reduction, d_f a hundredfold, others by their priors.

    A first step from a model that lacks an effect can ask for far more, and then the contact turns negative.
    """
    reach = _FARTHEST * evidence.prior_std
    low, high = -reach, reach.copy()
    low[0], high[0] = np.log(np.array(G_F_RANGE) / evidence.stack.contact.G_f)
    low[1], high[1] = evidence.start[1] - np.log(100.0), evidence.start[1] + np.log(100.0)
    return low, high
