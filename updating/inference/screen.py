"""A screening of all terms: the cost that one step from each of their starts is expected to reach.

A change of the model acts linearly on equation errors, whatever its size, for given modal coordinates of the measured
modes. So the errors at a start of a term are those at the origin, where the term is neutral, plus
-phi_s' (dK - lambda_r dM) Phi a_r / (omega_s omega_r): no modes are solved for, and all covariances are those of the
origin. The best are then evaluated with the model itself.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from updating.inference.descent import Descent, begun, raced
from updating.inference.discrepancy import Problem, Sizes, joined, roots, whitened
from updating.inference.equation_error import Errors, equation_errors, scales
from updating.inference.explain import Setting, coordinates_of, step_within
from updating.inference.protocol import Change, Coordinate, LocalModel, Modal, Model, Screen, State, Term

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Origin:
    """Errors at a point with the derivatives by the coordinates of all terms, whitened, and roots of the covariance."""

    x: Vector
    screens: tuple[Screen, ...]
    errors: tuple[Errors, ...]
    problem: Problem
    roots: tuple[Vector, Vector]
    value: Vector
    jacobian: Vector
    log: float


def _origin(model: Model, setting: Setting, screens: tuple[Screen, ...], x: Vector, sizes: Sizes) -> _Origin:
    """Put the measured modes into the model at a point."""
    errors = tuple(
        equation_errors(state, screen.modal, setting.noise[c], x.size, [r for d, r in setting.apart if d == c])
        for c, (state, screen) in enumerate(zip(model.states, screens, strict=True))
    )
    problem = joined(errors, setting.common)
    factors = roots(problem, sizes)
    value, jacobian, log = whitened(problem, sizes, factors)
    return _Origin(x, screens, errors, problem, factors, value, jacobian, log - problem.log_map)


def _changed(state: State, errors: Errors, modal: Modal, change: Change) -> tuple[Vector, Vector]:
    """Return equation errors and logarithms of damping after a change less those before, and their derivatives.

    Modes beyond the equations take part as they answer to the change (static condensation, their stiffness taken as
    diagonal). Column 0 has the differences, the others the derivatives by the coordinates that moved: (n * m, 1 + k),
    (n, 1 + k).
    """
    weight, lam, m = errors.weight, errors.eigenvalue[:, None], errors.weight.shape[1]
    n, k = len(weight), change.moved.size

    def with_derivatives(pair: tuple[Vector, Vector]) -> Vector:
        return np.concatenate([pair[0][None], np.broadcast_to(pair[1], (k, *pair[0].shape))])

    def force(stiffness: Vector, mass: Vector, modes: Vector) -> Vector:
        """Return the dynamic stiffness at each measured mode times modal coordinates, (..., n, m)."""
        return np.asarray((stiffness @ modes[..., None] - lam[..., None] * (mass @ modes[..., None]))[..., 0])

    stiffness = with_derivatives(change.stiffness)  # (1 + k, 1 or n, M, m)
    mass = with_derivatives(change.mass)
    onto = force(stiffness, mass, weight)
    beyond = with_derivatives(change.stiffness_beyond) - lam * with_derivatives(change.mass_beyond)
    held = modal.beyond - lam
    held = np.maximum(held + beyond[0], 0.1 * held)
    answer = -onto[0, :, m:] / held  # of the modes beyond
    turned = -(onto[1:, :, m:] + beyond[1:] * answer) / held
    stiff_back, mass_back = (matrix[:, :, m:].swapaxes(-1, -2) for matrix in (stiffness, mass))
    low = onto[:, :, :m] + force(stiff_back, mass_back, answer)
    low[1:] += force(stiff_back[:1], mass_back[:1], turned)
    value = -(low / scales(state, modal)).reshape(k + 1, -1).T
    lost, carried = (
        np.einsum("ri,krij,rj->kr", weight, np.broadcast_to(matrix, (k + 1, n, m, m)), weight)
        for matrix in (with_derivatives(change.damping), mass[:, :, :m])
    )
    carried[0] += 1.0  # the modal mass of what was measured
    omega = 2.0 * np.pi * state.frequency
    before = 2.0 * omega * state.damping * np.exp(-errors.damping)
    after = np.maximum(before + lost[0], 2e-3 * omega * state.damping)
    return value, np.vstack([np.log(before * carried[0] / after), carried[1:] / carried[0] - lost[1:] / after]).T


def screened(
    model: Model,
    settings: Sequence[Setting],
    present: Sequence[Term],
    further: Sequence[Term],
    origins: Sequence[Mapping[str, float]],
    local: Sequence[LocalModel],
    sizes: Sizes,
    *,
    asked: int = 12,
    starts_each: int = 4,
    carried: int = 2,
    steps: int = 5,
    weak: float = 0.1,
    later: int = 10,
    behind: float = 12.0,
) -> dict[str, Descent]:
    """Return where a few steps with each further term lead, by its name, the likeliest first.

    Of terms that cannot come near the lowest cost, nothing is returned (see `raced`).

    Parameters
    ----------
    model, sizes
        As `explain` takes them.
    settings : sequence of Setting
        What fits may begin with, which differ in the modes that they set apart.
    present, further : sequence of Term
        Terms of the explanation, and those of which each is added alone.
    origins : sequence of mapping of str to float
        Coordinates of the explanation from which steps are taken; further ones are at their starts.
    local : sequence of LocalModel
        The model about each origin, with the coordinates of all terms.
    asked, starts_each : int
        Number of terms, the best of the screening, that are evaluated with the model itself, and number of starts of
        each: the best of each place (of coordinates with more than two starts), and the best from each origin.
    carried, steps : int
        Starts of a term that are carried on beside the best of each origin, and damped steps that are tried from each:
        what one step promises far off is little more than a rank.
    weak : float
        Terms of several coordinates also start at this share of their starts; those of one coordinate at neutral.
    later, behind : int, float
        Steps that a fit may take from there, and how far above the lowest cost, at given sizes of the discrepancy, it
        may end then (see `raced`).
    """
    coordinates = coordinates_of(model, [*present, *further])
    index = {c.name: i for i, c in enumerate(coordinates)}
    at: list[tuple[Vector, LocalModel, list[_Origin | None]]] = []
    for values_of, about in zip(origins, local, strict=True):
        x = np.array([values_of.get(c.name, 0.0) for c in coordinates])
        with contextlib.suppress(np.linalg.LinAlgError, ValueError):  # no modes there
            screens = [about.screen(x, c) for c in range(len(model.states))]
            known = tuple(screen for screen in screens if screen is not None)
            whole = len(known) == len(screens)
            at.append((x, about, [_origin(model, s, known, x, sizes) if whole else None for s in settings]))
    if not at:
        return {}
    # By setting and term: what a step is expected to reach, its origin, and its start.
    first: list[dict[str, list[tuple[float, int, Vector]]]] = [{} for _ in settings]
    for term in further:
        together = coordinates_of(model, [*present, term])
        columns = np.array([index[c.name] for c in together])
        new = [c for c in together if c.name not in origins[0]]
        trials = list(itertools.product(*(c.starts for c in new)))
        trials += [(0.0,)] if len(new) == 1 else [tuple(weak * v for v in values) for values in trials if new]
        for values, (o, (x, _, of_setting)) in itertools.product(trials, enumerate(at)):
            start = x.copy()
            start[[index[c.name] for c in new]] = values
            expected = _expected(model, of_setting, start, columns, together)
            for by_term, reaches in zip(first, expected, strict=True):
                by_term.setdefault(term.name, []).append((reaches, o, start[columns]))

    nears = dict[tuple[str, int], LocalModel]()
    descents, by_name = list[Descent](), {term.name: term for term in further}
    for setting, of_term in zip(settings, first, strict=True):
        for rank, name in enumerate(sorted(of_term, key=lambda name: -max(expected for expected, *_ in of_term[name]))):
            starts = sorted(of_term[name], key=lambda trial: -trial[0])
            known = np.isfinite(starts[0][0])
            if rank >= asked and known:
                break
            together = coordinates_of(model, [*present, by_name[name]])
            placed = [i for i, c in enumerate(together) if c.name not in origins[0] and len(c.starts) > 2]
            tried = list[tuple[int, Descent]]()
            for _, o, start in _best_starts(starts, placed, starts_each) if known else starts:
                if (name, o) not in nears:
                    nears[name, o] = at[o][1].of(together)
                with contextlib.suppress(np.linalg.LinAlgError, ValueError):  # no modes there
                    terms = [*present, by_name[name]]
                    tried.append((o, begun(model, terms, setting, start, nears[name, o], sizes)))
            tried.sort(key=lambda trial: trial[1].cost - trial[1].fall)
            of_origin = {o: i for i, (o, _) in reversed(list(enumerate(tried)))}
            best = sorted({*range(min(carried if placed else 1, len(tried))), *of_origin.values()})
            descents += [tried[i][1] for i in best]
    best_of = dict[str, Descent]()
    ends = raced(descents, steps=steps, later=later, behind=behind)
    for end in sorted(ends, key=lambda end: -end.log_evidence):
        best_of.setdefault(end.terms[-1].name, end)
    return best_of


def _best_starts(
    starts: Sequence[tuple[float, int, Vector]], placed: Sequence[int], n: int
) -> list[tuple[float, int, Vector]]:
    """Return the best start of each of the `n` best places, or the `n` best, and the best from each origin.

    `starts` hold what each is expected to reach, its origin and its coordinates, the best first; the coordinates
    `placed` say a place.
    """
    chosen = dict[tuple[float, ...], tuple[float, int, Vector]]()
    for i, trial in enumerate(starts):
        chosen.setdefault(tuple(trial[2][placed]) if placed else (i,), trial)
    of_origin = {trial[1]: trial for trial in reversed(starts)}
    best = [*list(chosen.values())[:n], *of_origin.values()]
    return [trial for i, trial in enumerate(best) if not any(trial is other for other in best[:i])]


def _expected(
    model: Model,
    origins: Sequence[_Origin | None],
    start: Vector,
    columns: NDArray[np.intp],
    coordinates: Sequence[Coordinate],
) -> list[float]:
    """Return the negative cost that one step from a start is expected to reach, by the settings of one origin.

    It is infinite where no change is known: there the model itself is to be asked.
    """
    known = [origin for origin in origins if origin is not None]
    if not known:
        return [np.inf] * len(origins)
    changes = list[Change]()
    if np.any(start != known[0].x):
        for screen in known[0].screens:
            change = screen.change(start)
            if change is None:
                return [np.inf] * len(origins)
            changes.append(change)
    x = start[columns]
    precision = np.array([c.std**-2.0 for c in coordinates])
    reached = []
    for origin in known:
        value, jacobian = origin.value, origin.jacobian[:, columns]
        if changes:
            parts = [
                _changed(state, errors, screen.modal, change)
                for state, errors, screen, change in zip(
                    model.states, origin.errors, origin.screens, changes, strict=True
                )
            ]
            damped = np.isfinite(np.concatenate([errors.damping for errors in origin.errors]))
            stiffness = np.vstack([part[0] for part in parts])
            damping = np.vstack([part[1] for part in parts])[damped]
            white = np.vstack(
                [
                    la.solve_triangular(root, part, lower=True, check_finite=False)
                    for root, part in zip(origin.roots, (stiffness, damping), strict=True)
                ]
            )
            value = value + white[:, 0]
            jacobian[:, [columns.tolist().index(i) for i in changes[0].moved.tolist()]] = white[:, 1:]
        slope = jacobian.T @ value + precision * x
        hessian = jacobian.T @ jacobian + np.diag(precision)
        hessian += origin.problem.curvature[np.ix_(columns, columns)]
        step = step_within(slope, hessian, x, coordinates) - x
        total = 0.5 * float(value @ value + np.sum(precision * x**2)) + origin.log
        reached.append(-total - float(slope @ step + 0.5 * step @ hessian @ step))
    return reached
