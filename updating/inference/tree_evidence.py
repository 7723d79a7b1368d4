"""Marginal likelihood of errors on a tree: over coordinates and over sizes by Laplace's method about the likeliest.

With many states sizes are known so well that a grid would step over them; so the likeliest are searched for.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from updating.inference.algebra import scaled_inverse
from updating.inference.discrepancy import Evidence, SizePrior, Sizes, Weighed
from updating.inference.tree import TreeProblem

Vector = NDArray[np.float64]

_NODES, _CHANCE = np.sqrt(3.0), np.array([1.0, 4.0, 1.0]) / 6.0  # Gauss and Hermite's rule of three points


def tree_evidence(
    problem: TreeProblem,
    x: Vector,
    precision: Vector,
    log_prior: float,
    priors: tuple[SizePrior, SizePrior],
    sizes: Sizes,
    *,
    rounds: int = 1,
) -> tuple[Evidence, Vector]:
    """Integrate over coordinates and sizes, and return standard deviations of the coordinates, (n_coordinate,).

    Parameters
    ----------
    problem : TreeProblem
        Errors, linear about `x`.
    x, precision : (n_coordinate,)
        Coordinates, and the precision of their normal priors about 0; 0 where nothing is known.
    log_prior : float
        Logarithm of what the priors of the coordinates are divided by.
    priors : (SizePrior, SizePrior)
        Of the two sizes.
    sizes : Sizes
        Where the search for the likeliest begins.
    rounds : int
        In each, one size is found after the other.
    """
    known = np.diag(precision + 1e-12) + problem.curvature
    looks = (_kept(problem.of_stiffness), _kept(problem.of_damping))
    at = [
        float(np.clip(size, prior.lowest, prior.highest))
        for size, prior in zip((sizes.stiffness, sizes.damping), priors, strict=True)
    ]

    def log(pair: list[float]) -> float:
        weighed = looks[0](pair[0]) + looks[1](pair[1])
        inner = weighed.misfit + 2.0 * weighed.log + float(np.linalg.slogdet(weighed.hessian + known)[1])
        prior = sum(prior_of_size.log_density_at(size) for prior_of_size, size in zip(priors, pair, strict=True))
        return -0.5 * (inner + float(np.sum(precision * x**2))) + prior

    widths = [0.0, 0.0]
    for _ in range(rounds):
        before = list(at)
        for i, prior in enumerate(priors):
            if prior.n > 1 and (i == 0 or problem.damping.size):
                at[i], widths[i] = _likeliest(
                    lambda size, i=i: log([*at[:i], size, *at[i + 1 :]]),  # type: ignore[misc]  # bound now
                    at[i],
                    prior,
                )
        if all(abs(np.log(a / b)) < 0.1 for a, b in zip(at, before, strict=True)):
            break
    top = log(at) + sum(0.5 * np.log(2.0 * np.pi) + np.log(w) for w in widths if w > 0.0)
    weighed = looks[0](at[0]) + looks[1](at[1])
    covariance = scaled_inverse(weighed.hessian + known)
    chance = [_CHANCE if w > 0.0 else np.ones(1) for w in widths]
    grids = tuple(
        prior.near(size, _NODES * w, 3) if w > 0.0 else SizePrior.exactly(size)
        for prior, size, w in zip(priors, at, widths, strict=True)
    )
    return (
        Evidence(
            log=float(top) + problem.log_map + log_prior,
            sizes=Sizes(stiffness=at[0], damping=at[1]),
            probability=np.outer(*chance),
            grids=(grids[0], grids[1]),
        ),
        np.sqrt(np.maximum(np.diag(covariance), 0.0)),
    )


def _kept(look: Callable[[float], Weighed]) -> Callable[[float], Weighed]:
    """Return a function of a size that keeps what it returned."""
    seen: dict[float, Weighed] = {}

    def of(size: float) -> Weighed:
        if size not in seen:
            seen[size] = look(size)
        return seen[size]

    return of


def _likeliest(
    log: Callable[[float], float], size: float, prior: SizePrior, *, step: float = 0.15, most: int = 12
) -> tuple[float, float]:
    """Return the likeliest size near one, and the standard deviation of its logarithm, by a parabola through three."""
    ends = np.log(prior.lowest), np.log(prior.highest)
    z = float(np.clip(np.log(size), *ends))
    seen: dict[float, float] = {}

    def at(z: float) -> float:
        key = round(z, 9)
        if key not in seen:
            seen[key] = log(float(np.exp(z)))
        return seen[key]

    for _ in range(most):
        low, here, high = at(z - step), at(z), at(z + step)
        bend = low + high - 2.0 * here
        if here >= max(low, high) and bend < 0.0:
            away = 0.5 * step * (low - high) / bend
            width = float(np.clip(step / np.sqrt(-bend), 0.01, 1.0))
            if step < 3.0 * width:
                return float(np.exp(z + away)), width
            z, step = z + away, 1.5 * width
        else:
            to = z - step if low > high else z + step
            if not ends[0] <= to <= ends[1]:
                return float(np.exp(z)), step
            z, step = to, min(1.5 * step, 0.5)
    return float(np.exp(z)), step
