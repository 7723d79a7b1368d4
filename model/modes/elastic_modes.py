"""Elastic modes of equations whose stiffness, mass or damping may follow frequency, and their derivatives."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from lamella_shared import Booleans, Reals
from model.elements.equations import OMEGA, ParameterFactor, Target
from model.reduction.reduced_equations import InRange, Matrix, ReducedEquations, full
from model.solvers.eigen import inverse_iterated, orthogonal_answers
from model.stack.errors import SolveError


@dataclass(frozen=True, eq=False, kw_only=True)
class Derivatives:
    """Eigenvalues, vectors and phi' C phi of some modes, with derivatives by each parameter as the last axis.

    `coordinate` are the vectors, (n, n_mode), and `d_shape` the derivatives of their observed rows,
    (n_dof, n_mode, n_parameter). With c = V' C V, mode r obeys s**2 (1 - S) + s c_rr + lambda_r = 0 to second order of
    the damping, where its `coupling` S is the sum of c_rs**2 / (lambda_s - lambda_r) over the other modes.
    """

    eigenvalue: Reals
    coordinate: Reals
    modal_damping: Reals
    coupling: Reals
    d_eigenvalue: Reals
    d_shape: Reals
    d_modal_damping: Reals

    def without_omega(self) -> Derivatives:
        """Return the derivatives along the modes' own frequency, which was the last parameter.

        The eigenvalue obeys lambda = L(theta, omega) with omega = sqrt(lambda), so by a parameter
        d lambda = L_theta / (1 - L_omega / (2 omega)), and likewise for all that follows from it.
        """
        omega = np.sqrt(self.eigenvalue)[:, None]
        d_eigenvalue = self.d_eigenvalue[:, :-1] / (1.0 - self.d_eigenvalue[:, -1:] / (2.0 * omega))
        d_omega = d_eigenvalue / (2.0 * omega)
        return dataclasses.replace(
            self,
            d_eigenvalue=d_eigenvalue,
            d_shape=self.d_shape[:, :, :-1] + self.d_shape[:, :, -1:] * d_omega,
            d_modal_damping=self.d_modal_damping[:, :-1] + self.d_modal_damping[:, -1:] * d_omega,
        )

    @classmethod
    def steady(cls, eigenvalue: Reals, coordinate: Reals, n_dof: int, n_parameter: int) -> Derivatives:
        """Return modes that no parameter changes, undamped: rigid-body motion, of which any mixture is as good."""
        n_mode = eigenvalue.size
        return cls(
            eigenvalue=eigenvalue,
            coordinate=coordinate,
            modal_damping=np.zeros(n_mode),
            coupling=np.zeros(n_mode),
            d_eigenvalue=np.zeros((n_mode, n_parameter)),
            d_shape=np.zeros((n_dof, n_mode, n_parameter)),
            d_modal_damping=np.zeros((n_mode, n_parameter)),
        )

    def unknown_by(self, n_parameter: int) -> Derivatives:
        """Return the modes with derivatives that nobody asked for: NaN."""
        n_mode = self.eigenvalue.size
        return dataclasses.replace(
            self,
            d_eigenvalue=np.full((n_mode, n_parameter), np.nan),
            d_shape=np.full((len(self.d_shape), n_mode, n_parameter), np.nan),
            d_modal_damping=np.full((n_mode, n_parameter), np.nan),
        )

    def ordered(self, order: NDArray[np.intp]) -> Derivatives:
        """Return the modes in another order."""
        return self._each(lambda axis, value: np.take(value, order, axis=axis))

    @classmethod
    def joined(cls, parts: list[Derivatives]) -> Derivatives:
        """Return the modes of all parts, in their order."""
        first, *rest = parts
        return first._each(lambda axis, value, *others: np.concatenate([value, *others], axis=axis), *rest)

    def _each(self, function: Callable[..., Reals], *others: Derivatives) -> Derivatives:
        """Return what a function makes of each array's axis of modes and the array, beside those of others."""
        axis = {"coordinate": 1, "d_shape": 1}
        return Derivatives(
            **{
                f.name: function(axis.get(f.name, 0), getattr(self, f.name), *(getattr(o, f.name) for o in others))
                for f in dataclasses.fields(self)
            }
        )


def mode_derivatives(
    system: ReducedEquations,
    theta: Mapping[str, float],
    names: tuple[str, ...],
    eigenvalues: Reals,
    vectors: Reals,
    which: NDArray[np.intp],
    rows: Reals,
    omega: Reals | None = None,
) -> Derivatives:
    """Return modes and their derivatives as sums over all modes (Fox and Kapoor 1968).

    Parameters
    ----------
    system : ReducedEquations
        The equations.
    theta : mapping of str to float
        All their parameters.
    names : tuple of str
        Those by which derivatives are wanted.
    eigenvalues, vectors : (n,), (n, n)
        All eigenpairs at `theta`, the vectors mass-normalised.
    which : (n_mode,) int
        Modes that are wanted.
    rows : (n_dof, n)
        Observed degrees of freedom in the coordinates of the equations.
    omega : (n_mode,), optional
        Angular frequencies, rad/s, of these: factors are taken at each mode's own.
    """
    same = 1e-9  # relative gap below which two eigenvalues count as one and their vectors are not separated
    row, column = which, np.arange(which.size)
    chosen, lam = vectors[:, row], eigenvalues[row]
    gap = lam - eigenvalues[:, None]
    scale = np.maximum(np.abs(lam), np.abs(eigenvalues[:, None]))
    apart = np.where(np.abs(gap) > same * scale, gap, np.inf)
    slopes, damped = _images(system, theta, names, chosen, omega)
    # beside all modes once for each parameter, which takes part in many terms
    unbalanced = np.moveaxis(slopes["K"] - slopes["M"] * lam, 0, 1).reshape(len(vectors), -1)
    coupling = np.moveaxis((vectors.T @ unbalanced).reshape(len(vectors), len(slopes["K"]), lam.size), 0, 1)
    damped = vectors.T @ damped
    mixing = coupling / apart  # (n_parameter, n, n_mode)
    mixing[:, row, column] = -0.5 * _own(chosen, slopes["M"])
    d_modal = 2.0 * np.sum(mixing * damped, axis=1) + _own(chosen, slopes["C"])
    return Derivatives(
        eigenvalue=lam,
        coordinate=chosen,
        modal_damping=damped[row, column],
        coupling=-np.sum(damped**2 / apart, axis=0),
        d_eigenvalue=coupling[:, row, column].T,
        d_shape=np.moveaxis((rows @ vectors) @ mixing, 0, -1),
        d_modal_damping=d_modal.T,
    )


def own_derivatives(
    system: ReducedEquations,
    theta: Mapping[str, float],
    names: tuple[str, ...],
    shape: Reals,
    mass: Reals,
    stiffness: Reals,
    rows: Reals,
) -> Derivatives:
    """Return one mode and its derivatives without the other modes: one factorisation takes their place (Nelson 1976).

    Parameters
    ----------
    system, theta, names
        As in `mode_derivatives`; the mode's own frequency is among `theta`.
    shape : (n,)
        The mode, of unit modal mass.
    mass, stiffness : (n, n)
        The matrices at `theta`.
    rows : (n_dof, n)
        As in `mode_derivatives`.
    """
    eigenvalue = theta[OMEGA] ** 2
    found, image = _images(system, theta, names, shape[:, None])
    slopes, damped = {target: slope[:, :, 0].T for target, slope in found.items()}, image[:, 0]
    unbalanced = slopes["K"] - eigenvalue * slopes["M"]
    answer = orthogonal_answers(stiffness - eigenvalue * mass, mass @ shape, np.column_stack([-unbalanced, damped]))
    d_shape = answer[:, :-1] - 0.5 * np.outer(shape, shape @ slopes["M"])
    return Derivatives(
        eigenvalue=np.array([eigenvalue]),
        coordinate=shape[:, None],
        modal_damping=np.array([shape @ damped]),
        coupling=np.array([answer[:, -1] @ damped]),
        d_eigenvalue=(shape @ unbalanced)[None],
        d_shape=(rows @ d_shape)[:, None],
        d_modal_damping=(2.0 * damped @ d_shape + shape @ slopes["C"])[None],
    )


def _own(shape: Reals, image: Reals) -> Reals:
    """Return what each mode has of its own image, (n_parameter, n_mode)."""
    return np.asarray(np.einsum("nm,pnm->pm", shape, image))


def _images(
    system: ReducedEquations,
    theta: Mapping[str, float],
    names: tuple[str, ...],
    shape: Reals,
    omega: Reals | None = None,
) -> tuple[dict[Target, Reals], Reals]:
    """Return the images of modes by the derivatives of M, C and K, (n_parameter, n, n_mode) each, and by C.

    `shape` are the modes, (n, n_mode). With `omega`, (n_mode,), factors are taken at each mode's own.
    """
    known: dict[int, Reals] = {}
    sums: dict[int | None, _Sums] = {}  # by range
    place = {name: j for j, name in enumerate(names)}
    for term in system.terms:
        used = term.factor.names(theta)
        here = [theta] if omega is None or OMEGA not in used else [{**theta, OMEGA: float(o)} for o in omega]
        every = {place[n]: [term.factor.derivative(t, n) for t in here] for n in used if n in place}
        shares = {j: share for j, share in every.items() if any(share)}
        factor = [term.factor(t) for t in here] if term.target == "C" else [0.0]
        if not (shares or any(factor)):
            continue
        which = id(term.matrix.range) if isinstance(term.matrix, InRange) else None
        if which not in sums:
            sums[which] = _Sums(term.matrix, shape, len(names))
        total = sums[which]
        if id(term.matrix) not in known:
            known[id(term.matrix)] = total.image(term.matrix)
        for j, share in shares.items():
            total.slopes[term.target][j] += np.multiply(share, known[id(term.matrix)])
        if any(factor):
            total.damped += np.multiply(factor, known[id(term.matrix)])
    slopes: dict[Target, Reals] = {t: np.zeros((len(names), *shape.shape)) for t in ("M", "C", "K")}
    damped = np.zeros(shape.shape)
    for total in sums.values():
        total.add_to(slopes, damped)
    return slopes, damped


class _Sums:
    """Images of modes by matrices of one range, summed between its directions; of those in full, as they are."""

    def __init__(self, matrix: Matrix, shape: Reals, n_parameter: int) -> None:
        self._range = matrix.range if isinstance(matrix, InRange) else None
        self._shape = shape if self._range is None else self._range.T @ shape
        self.slopes: defaultdict[Target, Reals] = defaultdict(partial(np.zeros, (n_parameter, *self._shape.shape)))
        self.damped = np.zeros(self._shape.shape)

    def image(self, matrix: Matrix) -> Reals:
        """Return the images by one of the matrices."""
        return (matrix.core if isinstance(matrix, InRange) else matrix) @ self._shape

    def add_to(self, slopes: dict[Target, Reals], damped: Reals) -> None:
        """Add the sums in the coordinates of the modes."""
        for target, slope in self.slopes.items():
            slopes[target] += slope if self._range is None else self._range @ slope
        damped += self.damped if self._range is None else self._range @ self.damped


_MOST_STEPS = 30  # of the search for a mode's own frequency

_CONVERGED = 1e-10  # relative change of that frequency


@dataclass(frozen=True, eq=False)
class ElasticModes:
    """The elastic modes of a system at some parameters, from which their derivatives follow.

    `eigenvalues` and `vectors` are all of the matrices at `theta`; `mode` are the elastic ones' indices in them.
    `settled` holds each elastic mode at its own frequency where stiffness or mass follow frequency, and is empty
    where they do not.
    """

    system: ReducedEquations
    theta: Mapping[str, float]
    eigenvalues: Reals
    vectors: Reals
    mode: range
    settled: tuple[_Settled, ...]

    @property
    def frequency(self) -> Reals:
        """Return the undamped natural frequencies, Hz, (n_mode,)."""
        if self.settled:
            return np.array([mode.omega for mode in self.settled]) / (2.0 * np.pi)
        return np.sqrt(self.eigenvalues[self.mode.start : self.mode.stop]) / (2.0 * np.pi)

    @property
    def coordinate(self) -> Reals:
        """Return the modes in the coordinates of the system, (n, n_mode)."""
        if self.settled:
            return np.column_stack([mode.shape for mode in self.settled])
        return self.vectors[:, self.mode.start : self.mode.stop]

    def derivatives(self, wanted: Booleans, names: tuple[str, ...], rows: Reals) -> Derivatives:
        """Return the wanted ones with their derivatives, each with the matrices at its own frequency."""
        which = np.array(self.mode, dtype=np.intp)[wanted]
        pairs = self.eigenvalues, self.vectors
        if self.settled and which.size:
            chosen = [self.settled[i] for i in np.flatnonzero(wanted)]
            return Derivatives.joined([mode.derivatives(self.system, names, rows) for mode in chosen])
        if OMEGA not in self.theta:
            return mode_derivatives(self.system, self.theta, names, *pairs, which, rows)
        # only damping follows frequency: the undamped modes are the same for all
        at = np.sqrt(self.eigenvalues[which])
        every = (*names, OMEGA)
        return mode_derivatives(self.system, self.theta, every, *pairs, which, rows, at).without_omega()


def elastic_modes(
    system: ReducedEquations, theta: Mapping[str, float], eigenvalues: Reals, vectors: Reals, mode: range
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
    steady: Mapping[Target, Reals]
    following: tuple[tuple[Target, ParameterFactor, Reals], ...]

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
        steady: dict[Target, Reals] = {t: rest.matrix(t, theta) for t in ("M", "K")}
        return cls(theta, steady, tuple((t.target, t.factor, full(t.matrix)) for t in follows))

    def matrix(self, target: Target, omega: float) -> Reals:
        """Return M or K at an angular frequency, (n, n)."""
        here, total = {**self.theta, OMEGA: omega}, self.steady[target].copy()
        for of, factor, matrix in self.following:
            if of == target:
                total += factor(here) * matrix
        return total

    def rayleigh(self, shape: Reals, omega: float) -> float:
        """Return the frequency near `omega`, rad/s, at which shape' (K - omega**2 M) shape vanishes, by Newton.

        Raises
        ------
        SolveError
            The stiffness is negative there.
        """
        # of a frequency with the one that its stiffness is taken at, so that steps stay finite
        most_growth = 0.9
        steady = {target: float(shape @ matrix @ shape) for target, matrix in self.steady.items()}
        shares = [(target, factor, float(shape @ matrix @ shape)) for target, factor, matrix in self.following]
        for _ in range(_MOST_STEPS):
            here = {**self.theta, OMEGA: omega}
            value, slope = dict(steady), dict.fromkeys(steady, 0.0)
            for target, factor, share in shares:
                value[target] += factor(here) * share
                slope[target] += factor.derivative(here, OMEGA) * share
            if not min(value.values()) > 0.0:
                hertz = omega / 2.0 / np.pi
                raise SolveError(f"the stiffness at {here} is negative for a mode near {hertz:.6g} Hz")
            next_one = float(np.sqrt(value["K"] / value["M"]))
            growth = 0.5 * next_one * (slope["K"] / value["K"] - slope["M"] / value["M"])
            stretch = (next_one - omega) / (1.0 - min(growth, most_growth))
            last, omega = omega, max(omega + stretch, omega / 2.0)
            if abs(omega - last) < _CONVERGED * omega:
                break
        return omega


@dataclass(frozen=True, eq=False)
class _Settled:
    """A mode with the matrices at its own frequency: `theta` holds it; `twin` tells whether another is next to it."""

    theta: Mapping[str, float]
    omega: float
    shape: Reals
    mass: Reals
    stiffness: Reals
    twin: bool

    @classmethod
    def of(cls, moving: _OverFrequency, eigenvalues: Reals, vectors: Reals, mode: int) -> _Settled:
        """Follow one mode by its shape to its own frequency.

        The shape is improved by inverse iteration at the frequency of its nonlinear Rayleigh quotient, which converges
        cubically (Schwetlick and Schreiber 2012).

        Raises
        ------
        SolveError
            The iteration does not converge.
        """
        # relative gap of eigenvalues below which one mode's derivatives are taken beside all others
        twin = 1e-6
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
            raise SolveError(f"mode {mode}: its frequency-dependent stiffness does not settle near {hertz:.6g} Hz")
        near = np.abs(eigenvalues - eigenvalues[mode]) < twin * eigenvalues[mode]
        return cls(
            theta={**moving.theta, OMEGA: omega},
            omega=omega,
            shape=shape,
            mass=mass,
            stiffness=stiffness,
            twin=bool(np.count_nonzero(near) > 1),
        )

    def derivatives(self, system: ReducedEquations, names: tuple[str, ...], rows: Reals) -> Derivatives:
        """Return the mode with its derivatives."""
        every = (*names, OMEGA)
        if self.twin:
            values, basis = la.eigh(self.stiffness, self.mass)  # only beside all modes are twins resolved from it
            index = np.array([np.argmax(np.abs(basis.T @ (self.mass @ self.shape)))])
            found = mode_derivatives(system, self.theta, every, values, basis, index, rows)
        else:
            found = own_derivatives(system, self.theta, every, self.shape, self.mass, self.stiffness, rows)
        return found.without_omega()
