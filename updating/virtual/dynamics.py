"""The equations of motion that a virtual test is simulated on: sensors' mass added, poles of the damped stack.

All of it works on the reduced system in coordinates that make the mass matrix of the stack one, so a
sensor's mass and a pole cost small dense matrices only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model import Formula, Observed, ReducedSystem, SolveError
from model.elements.equations import OMEGA, Product, Target
from model.reduction.shared_range import full

_POWER: dict[Target, int] = {"K": 0, "C": 1, "M": 2}
_LINES_AT_ONCE = 128
_STEP = 1e-6  # relative, of the derivative that only steers the iteration
_MOST_STEPS = 40
_CONVERGED = 1e-11
_ROUNDED = 1e-6  # relative step that may be rounding beside stiff supports, if it does not fall any more
_ASIDE = 1e-13  # relative step aside


@dataclass(frozen=True, eq=False, kw_only=True)
class Dynamics:
    """Dynamic stiffness of a stack, s**2 M + s C + K, with factors that may depend on frequency.

    Attributes
    ----------
    steady : mapping of target to (n, n)
        Parts of M, C and K that do not depend on frequency.
    following : tuple of (target, callable, matrix)
        Parts that do: the factor at a complex angular frequency s / i, which continues the factor on the real
        axis, times an (n, n) matrix.
    """

    steady: Mapping[Target, NDArray[np.float64]]
    following: tuple[tuple[Target, Callable[[complex], complex], NDArray[np.float64]], ...]

    def at(self, s: complex) -> NDArray[np.complex128]:
        """Return the dynamic stiffness at the Laplace variable `s`, rad/s; (n, n) complex."""
        total: NDArray[Any] = s**2 * self.steady["M"] + s * self.steady["C"] + self.steady["K"]
        for target, factor, matrix in self.following:
            total = total + s ** _POWER[target] * factor(s / 1j) * matrix
        return np.asarray(total, dtype=complex)

    def slope(self, s: complex) -> NDArray[np.complex128]:
        """Return the derivative of the dynamic stiffness by `s`; a difference would drown in the supports."""
        total: NDArray[Any] = 2.0 * s * self.steady["M"] + self.steady["C"]
        h = _STEP * abs(s)
        for target, factor, matrix in self.following:
            ends = [z ** _POWER[target] * factor(z / 1j) for z in (s + h, s - h)]
            total = total + (ends[0] - ends[1]) / (2.0 * h) * matrix
        return np.asarray(total, dtype=complex)

    def with_parts(self, rows: NDArray[np.float64], mass: float, stiffness: float = 0.0) -> Dynamics:
        """Return the dynamics with a mass, kg, and a spring to the ground, N/m, on each of the `rows` (k, n)."""
        square = rows.T @ rows
        steady = {
            **self.steady,
            "M": self.steady["M"] + mass * square,
            "K": self.steady["K"] + stiffness * square,
        }
        return replace(self, steady=steady)


def dynamics(system: ReducedSystem, theta: Mapping[str, float]) -> Dynamics:
    """Return the dynamic stiffness of a reduced system at the parameters `theta`."""
    steady = {target: np.zeros((system.size, system.size)) for target in _POWER}
    following = []
    for term in system.terms:
        if OMEGA in theta and term.factor.derivative(theta, OMEGA) != 0.0:
            following.append((term.target, _continued(term.factor, theta), full(term.matrix)))
        else:
            steady[term.target] += term.factor(theta) * full(term.matrix)
    return Dynamics(steady=steady, following=tuple(following))


def _continued(factor: Any, theta: Mapping[str, float]) -> Callable[[complex], complex]:
    if isinstance(factor, Product):
        first, second = _continued(factor.first, theta), _continued(factor.second, theta)
        return lambda omega: first(omega) * second(omega)
    if isinstance(factor, Formula):
        return lambda omega: complex(factor.function({**theta, OMEGA: omega}))
    return lambda omega: complex(factor({**theta, OMEGA: omega.real}))


def poles(
    of: Dynamics, start: NDArray[np.complex128], vectors: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Solve (s**2 M + s C + K) x = 0 for the poles next to given ones, by Newton's inverse iteration.

    Parameters
    ----------
    of : Dynamics
        Dynamic stiffness.
    start : (n_mode,) complex
        Poles to start from, rad/s.
    vectors : (n, n_mode) float
        Their vectors.

    Returns
    -------
    pole : (n_mode,) complex
    vector : (n, n_mode) complex

    Raises
    ------
    SolveError
        A pole does not converge.
    """
    found, shapes = np.empty(start.size, complex), np.empty(vectors.shape, complex)
    for r, given in enumerate(start):
        s, x = complex(given), vectors[:, r].astype(complex)
        v, last = x.conj(), np.inf  # real modes are their own left vectors
        for _ in range(_MOST_STEPS):
            slope = of.slope(s)
            try:
                u = np.linalg.solve(of.at(s), slope @ x)  # at the pole nearly singular, and meant to be
            except np.linalg.LinAlgError:  # the pole to the last bit
                s *= 1.0 + _ASIDE
                u = np.linalg.solve(of.at(s), slope @ x)
            gain = (v @ u) / (v @ x)
            s, x = s - 1.0 / gain, u / gain
            step = abs(1.0 / gain)
            if step < _CONVERGED * abs(s) or last <= step < _ROUNDED * abs(s):
                break
            last = step
        else:
            message = f"the damped mode near {abs(given) / 2 / np.pi:.6g} Hz does not converge"
            raise SolveError(message)
        found[r], shapes[:, r] = s, x
    return found, shapes


def receptance(
    of: Dynamics,
    frequency: NDArray[np.float64],
    rows: NDArray[np.float64],
    force: NDArray[np.float64],
) -> NDArray[np.complex128]:
    """Return receptances, (n_output, n_frequency), to one force.

    Parameters
    ----------
    of : Dynamics
        The stack.
    frequency : (n_frequency,) float
        Lines, Hz.
    rows : (n_output, n) float
        Observed displacements in reduced coordinates.
    force : (n,) float
        The unit force in reduced coordinates.
    """
    return np.asarray(rows @ np.array([np.linalg.solve(of.at(s), force) for s in 2j * np.pi * frequency]).T)


def loaded_response(
    of: Dynamics,
    clean: NDArray[np.complex128],
    frequency: NDArray[np.float64],
    sensors: Observed,
    run: NDArray[np.int64],
    mass: float,
) -> NDArray[np.complex128]:
    """Return receptances of roving sensors that load the stack where they stand, run by run.

    With the unloaded receptances H_ss between the sensors' degrees of freedom of a run and H_sf to the force,
    the loaded ones are (I - omega**2 m H_ss)^-1 H_sf: a mass is a modification of low rank.

    Parameters
    ----------
    of : Dynamics
        The unloaded stack.
    clean : (n, n_frequency) complex
        Unloaded receptances to the one force, at the degrees of freedom of `sensors`.
    frequency : (n_frequency,) float
        Lines, Hz.
    sensors : Observed
        All degrees of freedom in which sensors move: x, y and z at each point.
    run : (n,) int
        Run of each of them.
    mass : float
        Mass of one sensor, kg.

    Returns
    -------
    (n, n_frequency) complex
    """
    rows = sensors.reduced_rows
    groups = [np.flatnonzero(run == number) for number in np.unique(run)]
    value = clean.copy()
    for first in range(0, frequency.size, _LINES_AT_ONCE):
        omega = 2.0 * np.pi * frequency[first : first + _LINES_AT_ONCE]
        stiffness = np.stack([of.at(1j * line) for line in omega])
        flexibility = np.linalg.solve(stiffness, np.broadcast_to(rows.T, (omega.size, *rows.T.shape)))
        for group in groups:
            own = rows[group] @ flexibility[:, :, group]
            system = np.eye(group.size) - (omega**2 * mass)[:, None, None] * own
            here = value[group, first : first + omega.size].T[:, :, None]
            value[group, first : first + omega.size] = np.linalg.solve(system, here)[:, :, 0].T
    return value
