"""Elastic modes of equations whose stiffness, mass or damping may follow frequency, each with its own matrices."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model.elements.equations import OMEGA, ParameterFactor, Target
from model.modes.mode_derivatives import Derivatives, mode_derivatives, own_derivatives
from model.reduction.reduced_equations import ReducedEquations
from model.reduction.shared_range import full
from model.solvers.eigen import inverse_iterated
from model.stack.errors import SolveError

_TWIN = 1e-6  # relative gap of eigenvalues below which one mode's derivatives are taken beside all others
_MOST_STEPS = 30  # of the search for a mode's own frequency
_CONVERGED = 1e-10  # relative change of that frequency
_MOST_GROWTH = 0.9  # of a frequency with the one that its stiffness is taken at, so that steps stay finite


@dataclass(frozen=True, eq=False)
class ElasticModes:
    """The elastic modes of a system at some parameters, from which their derivatives follow.

    `eigenvalues` and `vectors` are all of the matrices at `theta`; `mode` are the elastic ones' indices in them.
    `settled` holds each elastic mode at its own frequency where stiffness or mass follow frequency, and is empty
    where they do not.
    """

    system: ReducedEquations
    theta: Mapping[str, float]
    eigenvalues: NDArray[np.float64]
    vectors: NDArray[np.float64]
    mode: range
    settled: tuple[_Settled, ...]

    @property
    def frequency(self) -> NDArray[np.float64]:
        """Return the undamped natural frequencies, Hz, (n_mode,)."""
        if self.settled:
            return np.array([own.omega for own in self.settled]) / (2.0 * np.pi)
        return np.sqrt(self.eigenvalues[self.mode.start : self.mode.stop]) / (2.0 * np.pi)

    @property
    def coordinate(self) -> NDArray[np.float64]:
        """Return the modes in the coordinates of the system, (n, n_mode)."""
        if self.settled:
            return np.column_stack([own.shape for own in self.settled])
        return self.vectors[:, self.mode.start : self.mode.stop]

    def derivatives(
        self, wanted: NDArray[np.bool_], names: tuple[str, ...], rows: NDArray[np.float64]
    ) -> Derivatives:
        """Return the wanted ones with their derivatives, each with the matrices at its own frequency."""
        which = np.array(self.mode, dtype=np.intp)[wanted]
        pairs = self.eigenvalues, self.vectors
        if self.settled and which.size:
            chosen = [self.settled[i] for i in np.flatnonzero(wanted)]
            return Derivatives.joined([own.derivatives(self.system, names, rows) for own in chosen])
        if OMEGA not in self.theta:
            return mode_derivatives(self.system, self.theta, names, *pairs, which, rows)
        # only damping follows frequency: the undamped modes are the same for all
        at = np.sqrt(self.eigenvalues[which])
        every = (*names, OMEGA)
        return mode_derivatives(self.system, self.theta, every, *pairs, which, rows, at).without_omega()


def elastic_modes(
    system: ReducedEquations,
    theta: Mapping[str, float],
    eigenvalues: NDArray[np.float64],
    vectors: NDArray[np.float64],
    mode: range,
) -> ElasticModes:
    """Return the elastic modes, each at its own frequency.

    Parameters
    ----------
    system : ReducedEquations
        The equations.
    theta : mapping of str to float
        All their parameters.
    eigenvalues, vectors : (n,), (n, n)
        All eigenpairs of the matrices at `theta`, the vectors mass-normalised.
    mode : range
        Which of them.

    Raises
    ------
    SolveError
        A frequency-dependent stiffness does not settle, or is negative.
    """
    settled: tuple[_Settled, ...] = ()
    if OMEGA in theta and any(t.target != "C" and t.factor.derivative(theta, OMEGA) for t in system.terms):
        moving = _OverFrequency.of(system, theta)
        settled = tuple(_Settled.of(moving, eigenvalues, vectors, r) for r in mode)
    return ElasticModes(system, theta, eigenvalues, vectors, mode, settled)


@dataclass(frozen=True, eq=False)
class _OverFrequency:
    """M and K at any frequency: `steady` ones, and a few terms that follow it, with their own factors."""

    theta: Mapping[str, float]
    steady: Mapping[Target, NDArray[np.float64]]
    following: tuple[tuple[Target, ParameterFactor, NDArray[np.float64]], ...]

    @classmethod
    def of(cls, system: ReducedEquations, theta: Mapping[str, float]) -> _OverFrequency:
        """Sort the terms of a system at some parameters."""
        follows = tuple(
            t
            for t in system.terms
            if t.target != "C"
            and OMEGA in t.factor.names(theta)
            and (t.factor(theta) or t.factor.derivative(theta, OMEGA))
        )
        rest = dataclasses.replace(system.equations, terms=tuple(t for t in system.terms if t not in follows))
        steady: dict[Target, NDArray[np.float64]] = {t: rest.matrix(t, theta) for t in ("M", "K")}
        return cls(theta, steady, tuple((t.target, t.factor, full(t.matrix)) for t in follows))

    def matrix(self, target: Target, omega: float) -> NDArray[np.float64]:
        """Return M or K at an angular frequency, (n, n)."""
        here, total = {**self.theta, OMEGA: omega}, self.steady[target].copy()
        for own, factor, matrix in self.following:
            if own == target:
                total += factor(here) * matrix
        return total

    def rayleigh(self, shape: NDArray[np.float64], omega: float) -> float:
        """Return the frequency near `omega`, rad/s, at which shape' (K - omega**2 M) shape vanishes, by Newton.

        Raises
        ------
        SolveError
            The stiffness is negative there.
        """
        steady = {target: float(shape @ own @ shape) for target, own in self.steady.items()}
        shares = [(target, factor, float(shape @ own @ shape)) for target, factor, own in self.following]
        for _ in range(_MOST_STEPS):
            here = {**self.theta, OMEGA: omega}
            value, slope = dict(steady), dict.fromkeys(steady, 0.0)
            for target, factor, share in shares:
                value[target] += factor(here) * share
                slope[target] += factor.derivative(here, OMEGA) * share
            if not min(value.values()) > 0.0:
                hertz = omega / 2.0 / np.pi
                message = f"the stiffness at {here} is negative for a mode near {hertz:.6g} Hz"
                raise SolveError(message)
            next_one = float(np.sqrt(value["K"] / value["M"]))
            growth = 0.5 * next_one * (slope["K"] / value["K"] - slope["M"] / value["M"])
            stretch = (next_one - omega) / (1.0 - min(growth, _MOST_GROWTH))
            last, omega = omega, max(omega + stretch, omega / 2.0)
            if abs(omega - last) < _CONVERGED * omega:
                break
        return omega


@dataclass(frozen=True, eq=False)
class _Settled:
    """A mode with the matrices at its own frequency: `theta` holds it; `twin` tells whether another is next to it."""

    theta: Mapping[str, float]
    omega: float
    shape: NDArray[np.float64]
    mass: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    twin: bool

    @classmethod
    def of(
        cls,
        moving: _OverFrequency,
        eigenvalues: NDArray[np.float64],
        vectors: NDArray[np.float64],
        mode: int,
    ) -> _Settled:
        """Follow one mode by its shape to its own frequency.

        The shape is improved by inverse iteration at the frequency of its nonlinear Rayleigh quotient, which converges
        cubically (Schwetlick and Schreiber 2012).

        Raises
        ------
        SolveError
            The iteration does not converge.
        """
        omega, shape = float(np.sqrt(eigenvalues[mode])), vectors[:, mode]
        for _ in range(_MOST_STEPS):
            last, omega = omega, moving.rayleigh(shape, omega)
            mass, stiffness = moving.matrix("M", omega), moving.matrix("K", omega)
            if abs(omega - last) < _CONVERGED * omega:
                break
            better = inverse_iterated(stiffness - omega**2 * mass, mass @ shape)
            shape = better / np.sqrt(better @ mass @ better)
        else:
            hertz = omega / 2 / np.pi
            message = f"mode {mode}: its frequency-dependent stiffness does not settle near {hertz:.6g} Hz"
            raise SolveError(message)
        near = np.abs(eigenvalues - eigenvalues[mode]) < _TWIN * eigenvalues[mode]
        return cls(
            theta={**moving.theta, OMEGA: omega},
            omega=omega,
            shape=shape,
            mass=mass,
            stiffness=stiffness,
            twin=bool(np.count_nonzero(near) > 1),
        )

    def derivatives(
        self, system: ReducedEquations, names: tuple[str, ...], rows: NDArray[np.float64]
    ) -> Derivatives:
        """Return the mode with its derivatives."""
        every = (*names, OMEGA)
        if self.twin:
            values, basis = la.eigh(
                self.stiffness, self.mass
            )  # only beside all modes are twins resolved from it
            index = np.array([np.argmax(np.abs(basis.T @ (self.mass @ self.shape)))])
            own = mode_derivatives(system, self.theta, every, values, basis, index, rows)
        else:
            own = own_derivatives(system, self.theta, every, self.shape, self.mass, self.stiffness, rows)
        return own.without_omega()
