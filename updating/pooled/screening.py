"""What every term at every level could add to a fit, by one linear step of all specimens: what is worth a full fit.

A change of the model acts linearly on equation errors, whatever its size. So one evaluation of all states, with the
derivatives by all effects, does for every level: an effect of a group or of one specimen is the sum of what it does in
these. Once all else is eliminated, a term is a border of one or a few coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.linalg as la

from lamella_shared import Reals
from updating.diagnosis.fit_settings import CONTACT
from updating.inference.discrepancy import Sizes
from updating.inference.explain import Explanation, Setting, coordinates_of, errors_at
from updating.inference.protocol import Coordinate, Term
from updating.inference.tree import Passing, TreeProblem
from updating.pooled.specimens_model import SpecimensModel, SpecimensNear

_ROUNDING = 1e-10  # of a diagonal


@dataclass(frozen=True, eq=False, kw_only=True)
class Screened:
    """What a term could add.

    Attributes
    ----------
    name : str
        The term.
    level : float
        What the logarithm of the evidence rises to, up to a constant that all origins have in common.
    leads : callable
        Returns the coordinates where the step leads, by name.
    reach : float
        Standard deviations by which data would change at the farthest end of a range.
    """

    name: str
    level: float
    leads: Callable[[], dict[str, float]]
    reach: float

    @property
    def at(self) -> dict[str, float]:
        """Coordinates where the step leads, by name."""
        return self.leads()


def screen(model: SpecimensModel, common: Setting, at: Explanation, origin: Mapping[str, float]) -> dict[str, Screened]:
    """Return what every further term could add to a fit, by its name.

    Parameters
    ----------
    model, common, at
        The model, what fits share, and the fit.
    origin : mapping of str to float
        Coordinates of the fit about which steps are taken; terms that it has not are neutral there.
    """
    present = coordinates_of(model, [model.terms[n] for n in at.terms])
    effects = model.first.effects
    base = [c.name for c in present]
    further = [c for n in effects for c in model.terms[n].coordinates if c.name not in base]
    coordinates = list({c.name: c for c in (*present, *further)}.values())
    start = {c.name: float(origin.get(c.name, 0.0)) for c in coordinates}
    near = model.about(coordinates, [np.array(list(start.values()))])
    placed = {n for n in effects if any(len(c.starts) > 2 and c.name not in base for c in model.terms[n].coordinates)}
    best: dict[str, Screened] = {}
    most = max((len(c.starts) for n in placed for c in model.terms[n].coordinates), default=1)
    for turn in range(max(most, 1)):
        tried = [n for n in effects if turn == 0 or n in placed]
        kept = [
            *present,
            *{c.name: c for n in tried for c in model.terms[n].coordinates if c.name not in base}.values(),
        ]
        here = {c.name: start[c.name] for c in kept}
        here |= {
            c.name: float(c.starts[turn % len(c.starts)]) for c in kept if len(c.starts) > 2 and c.name not in base
        }
        for candidate in _turn(model, common, at, near, kept, here, tried, whole=turn == 0):
            if candidate.name not in best or candidate.level > best[candidate.name].level:
                best[candidate.name] = candidate
    return best


def _turn(
    model: SpecimensModel,
    common: Setting,
    at: Explanation,
    near: SpecimensNear,
    kept: Sequence[Coordinate],
    here: dict[str, float],
    tried: Sequence[str],
    *,
    whole: bool,
) -> Iterator[Screened]:
    """Yield what terms of some effects could add, with their places as in `here`; `whole` tries all else as well."""
    x = np.array([here[c.name] for c in kept])
    local = near.of(kept)
    try:
        errors = errors_at(model, local, common, x)
    except (np.linalg.LinAlgError, ValueError):  # no modes there
        return
    problem = common.join(errors, x.size)
    assert isinstance(problem, TreeProblem)
    n_base = at.x.size
    precision = np.array([c.std**-2.0 for c in at.coordinates])
    bordered = Bordered(model, problem, at.evidence.sizes, x[:n_base], precision)
    column = {c.name: i for i, c in enumerate(kept)}
    fitted = {c.name for c in at.coordinates}
    for name, term in model.terms.items():
        meant = model.meant[name]
        if name in at.terms or _in_fit(model, at, term):
            continue
        if meant.effect in tried:
            local_names = [model.scope(c.name).local for c in term.coordinates]
            columns = [column[n] for n in local_names]
            # the same effect at another level has its place already; this one adds to it
            values = np.array([0.0 if n in fitted else here[n] for n in local_names])
            added = bordered.added(meant.level.members, columns, term.coordinates, values)
        elif whole and meant.effect in CONTACT:
            columns = [column[meant.effect]]
            added = bordered.added(meant.level.members, columns, term.coordinates, np.zeros(1))
        elif whole and term.frees:
            freed = {column[n]: std for n, std in term.frees.items() if n in column}
            added = bordered.freed(freed), np.zeros(0), bordered.step, 0.0
        else:
            continue
        gain, values, step, reach = added
        of_term = {c.name: float(v) for c, v in zip(term.coordinates, values, strict=True)}
        prior = term.log_prior or 0.0
        yield Screened(
            name=name,
            level=bordered.level + gain + prior,
            leads=partial(_after_step, here, [c.name for c in kept[:n_base]], step, of_term),
            reach=reach,
        )


def _after_step(
    here: Mapping[str, float], names: Sequence[str], step: Callable[[], Reals], of_term: Mapping[str, float]
) -> dict[str, float]:
    """Return the coordinates of a fit after a step, and those of a term."""
    return {n: here[n] + float(d) for n, d in zip(names, step(), strict=True)} | dict(of_term)


def _in_fit(model: SpecimensModel, at: Explanation, term: Term) -> bool:
    """Return whether a fit has this term already: the same effect at the same specimens."""
    meant = model.meant[term.name]
    return any(
        model.meant[n].effect == meant.effect and set(model.meant[n].level.members) == set(meant.level.members)
        for n in at.terms
    )


class Bordered:
    """A fit's linear system, with borders of further coordinates that some specimens have.

    Parameters
    ----------
    model : SpecimensModel
        The model.
    problem : TreeProblem
        Errors with derivatives by the fit's coordinates first, then by the effects' as the rig has them.
    sizes : Sizes
        Of the discrepancy.
    x, precision : (n_base,)
        Coordinates of the fit, and the precision of their priors.

    Attributes
    ----------
    level : float
        Logarithm of the evidence that a linear step of the fit's coordinates reaches, up to a constant of the sizes.
    """

    level: float

    def __init__(self, model: SpecimensModel, problem: TreeProblem, sizes: Sizes, x: Reals, precision: Reals) -> None:
        self.n, n_all = x.size, problem.n_coordinate
        passing = Passing(problem, sizes.stiffness)
        share = problem.tree.shares[0]
        p = problem.leaves[0].columns.shape[1] - 1 - problem.leaves[0].touched.size if share > 0.0 else 0
        inner = np.zeros((self.n + p, self.n + p))
        slope = np.zeros(self.n + p)
        n_specimen = len(model.specimens)
        self.cross = np.zeros((n_specimen, self.n + p, n_all))
        self.block = np.zeros((n_specimen, n_all, n_all))
        self.pull = np.zeros((n_specimen, n_all))
        self.constant, self.log = 0.0, 0.0
        curved = _curvatures(problem, model, sizes)
        for s, specimen in enumerate(model.specimens):
            message = passing.of(("rig", specimen.name))
            k = message.touched.size
            full = np.zeros((1 + n_all + p,) * 2)
            at = np.concatenate([[0], 1 + message.touched, 1 + n_all + np.arange(p)])
            full[np.ix_(at, at)] = message.product[: 1 + k + p, : 1 + k + p]
            full[1 : 1 + n_all, 1 : 1 + n_all] += curved[s][0]
            full[0, 1 : 1 + n_all] += curved[s][1]
            keep = np.concatenate([1 + np.arange(self.n), 1 + n_all + np.arange(p)])
            inner += full[np.ix_(keep, keep)]
            self.constant += float(message.product[0, 0])
            self.log += message.log_determinant
            slope += full[0, keep]
            self.cross[s] = full[keep, 1 : 1 + n_all]
            self.block[s] = full[1 : 1 + n_all, 1 : 1 + n_all]
            self.pull[s] = full[0, 1 : 1 + n_all]
        if p:
            inner[self.n :, self.n :] += np.eye(p) / (sizes.stiffness**2 * share)
        inner[: self.n, : self.n] += np.diag(precision + 1e-12)
        slope[: self.n] += precision * x
        self._damped(model, problem, sizes, inner, slope)
        self.x, self.precision = x, precision
        self.inner, self.slope = inner, slope
        misfit = self.constant + float(np.sum(precision * x**2))
        self.unit = 1.0 / np.sqrt(np.diag(inner))
        scaled = self.unit[:, None] * inner * self.unit + _ROUNDING * np.eye(len(inner))
        self.root = la.cholesky(scaled, lower=True)
        self.base = self._solve(slope)
        self.level = problem.log_map - 0.5 * (misfit - float(self.base @ self.base))
        self.level -= float(np.sum(np.log(np.diag(self.root) / self.unit))) + 0.5 * self.log

    def _damped(self, model: SpecimensModel, problem: TreeProblem, sizes: Sizes, inner: Reals, slope: Reals) -> None:
        """Add what damping ratios say, which are correlated across specimens."""
        n_all, n_specimen = problem.n_coordinate, len(model.specimens)
        self.loss = np.zeros((n_specimen, problem.damping.size, n_all))
        if not problem.damping.size:
            return
        root = la.cholesky(problem.damping_noise + sizes.damping**2 * problem.damping_discrepancy, lower=True)
        whose = np.array([model.indices[c][0] for c in problem.damping_at])
        value = la.solve_triangular(root, problem.damping, lower=True)
        base = la.solve_triangular(root, problem.damping_jacobian[:, : self.n], lower=True)
        self.constant += float(value @ value)
        self.log += 2.0 * float(np.sum(np.log(np.diag(root))))
        inner[: self.n, : self.n] += base.T @ base
        slope[: self.n] += base.T @ value
        for s in range(n_specimen):
            masked = np.where((whose == s)[:, None], problem.damping_jacobian, 0.0)
            self.loss[s] = la.solve_triangular(root, masked, lower=True)
            self.cross[s, : self.n] += base.T @ self.loss[s]
            self.pull[s] += self.loss[s].T @ value

    def _solve(self, right: Reals) -> Reals:
        """Return the root's inverse times something, scaled."""
        return np.asarray(la.solve_triangular(self.root, (self.unit * right.T).T, lower=True, check_finite=False))

    def step(self, right: Reals | None = None) -> Reals:
        """Return the step of the fit's coordinates, (n_base,), against a slope, by default that of the fit."""
        white = self.base if right is None else self._solve(right)
        back = la.solve_triangular(self.root, white, lower=True, trans="T")
        return np.asarray(-(self.unit * back)[: self.n])

    def added(
        self, members: Sequence[int], columns: Sequence[int], coordinates: Sequence[Coordinate], start: Reals
    ) -> tuple[float, Reals, Callable[[], Reals], float]:
        """Return what coordinates of some specimens add to the logarithm of the evidence, and where a step leads.

        Parameters
        ----------
        members : sequence of int
            Specimens.
        columns : sequence of int
            Where the coordinates' derivatives are.
        coordinates : sequence of Coordinate
            With their priors and bounds.
        start : (n,) float
            Where they stand.

        Returns
        -------
        float, (n,), callable, float
            The gain, the coordinates, what returns the step (n_base,) of the fit's, and by how many standard deviations
            the widest change moves the data.
        """
        those, these = list(members), list(columns)
        cross = sum(self.cross[s][:, these] for s in those)
        block = sum(self.block[s][np.ix_(these, these)] for s in those)
        loss = sum(self.loss[s][:, these] for s in those)
        block = block + loss.T @ loss
        pull = sum(self.pull[s][these] for s in those)
        towards = self._solve(cross)
        prior = np.array([c.std**-2.0 for c in coordinates])
        left = block - towards.T @ towards
        seen = np.maximum(np.diag(left), 0.0)
        hessian = left + np.diag(prior + _ROUNDING * np.diag(block))
        slope = pull - towards.T @ self.base + prior * start
        low, high = (np.array([getattr(c, end) for c in coordinates]) for end in ("lower", "upper"))
        step = np.clip(start - np.linalg.solve(hessian, slope), low, high) - start
        for _ in range(4):  # to the least between the bounds, one coordinate after the other
            for i in range(step.size):
                rest = slope[i] + hessian[i] @ step - hessian[i, i] * step[i]
                step[i] = np.clip(-rest / hessian[i, i], low[i] - start[i], high[i] - start[i])
        gain = -float(slope @ step + 0.5 * step @ hessian @ step)
        gain -= 0.5 * float(np.linalg.slogdet(hessian)[1] - np.sum(np.log(prior)))
        reach = float(np.max(np.maximum(np.abs(low), np.abs(high)) * np.sqrt(seen)))
        return gain, start + step, partial(self.step, self.slope + cross @ step), reach

    def free(self, members: Sequence[int], column: int) -> tuple[float, float]:
        """Return estimate and standard deviation of a coordinate of some specimens of which nothing is known."""
        cross = self.cross[list(members), :, column].sum(axis=0)
        loss = self.loss[list(members), :, column].sum(axis=0)
        curvature = float(self.block[list(members), column, column].sum() + loss @ loss)
        towards = self._solve(cross)
        left = max(curvature - float(towards @ towards), _ROUNDING * curvature)
        pull = float(self.pull[list(members), column].sum() - towards @ self.base)
        return -pull / left, left**-0.5

    def freed(self, wider: Mapping[int, float]) -> float:
        """Return what wider priors of some of the fit's coordinates add to the logarithm of the evidence."""
        if not wider:
            return -np.inf
        before = self._log(self.inner, self.slope, self.precision)
        precision = self.precision.copy()
        for i, std in wider.items():
            precision[i] = min(std**-2.0, precision[i])
        change = precision - self.precision
        inner, slope = self.inner.copy(), self.slope.copy()
        inner[np.arange(self.n), np.arange(self.n)] += change
        slope[: self.n] += change * self.x
        return self._log(inner, slope, precision) - before

    def _log(self, inner: Reals, slope: Reals, precision: Reals) -> float:
        root = la.cholesky(self.unit[:, None] * inner * self.unit + _ROUNDING * np.eye(len(inner)), lower=True)
        white = la.solve_triangular(root, self.unit * slope, lower=True)
        known = precision > 0.0
        least = float(np.sum(precision * self.x**2) - white @ white)
        return 0.5 * float(np.sum(np.log(precision[known]))) - 0.5 * least - float(np.sum(np.log(np.diag(root))))


def _curvatures(problem: TreeProblem, model: SpecimensModel, sizes: Sizes) -> list[tuple[Reals, Reals]]:
    """Return for each specimen the curvature of errors of shapes, and what the gradient has beside that of errors.

    See `updating.inference.gradient`.
    """
    beside = problem.beside(sizes)
    ends = np.cumsum([0, *(len(errors.value) for errors in problem.errors)])
    n = problem.n_coordinate
    parts = []
    for states in model.states_of:
        curvature, slope = np.zeros((n, n)), np.zeros(n)
        for c in states:
            touched, errors = problem.leaves[c].touched, problem.errors[c]
            slope += beside[ends[c] : ends[c + 1]].sum(axis=0)
            curvature[np.ix_(touched, touched)] += errors.curvature.sum(axis=0)
        parts.append((curvature, slope))
    return parts
