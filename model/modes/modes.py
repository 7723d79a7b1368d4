"""Natural frequencies, damping ratios and shapes of a stack, with their derivatives by every parameter.

Damping ratios are modal, phi' C phi / (2 omega): the diagonal of the damping matrix in the coordinates of the undamped
modes. C is beta K_contact while K also holds the laminas, so damping is not proportional and the off-diagonal is
neglected. That suffices because it acts in second order of the damping: against the complex eigenproblem of the same
system (`complex_modes`), the first ten elastic modes of the paper's stack 6 (calibration C1, d_f = 4.6e-11 s/Pa,
damping up to 6 %) differ by at most 5e-5 in frequency and 2.4e-4 in damping ratio, both relative.
`Modes.pole_frequency` adds the second order for damping that is heavier: with ratios of 14 % it is within 5e-5 of the
complex eigenproblem, whose frequencies then differ from the undamped ones by 2.5e-3.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model.elements.equations import OMEGA, Target
from model.modes.mode_derivatives import Derivatives, mode_derivatives, own_derivatives
from model.modes.observation import Observation, Observed, observe
from model.reduction.reduced_equations import ReducedEquations, ReducedTerm
from model.reduction.through_thickness import shear_shift
from model.solvers.eigen import inverse_iterated
from model.stack.arrays import readonly
from model.stack.errors import SolveError

_RIGID = 1e-8  # of `shear_shift`: below it an eigenvalue is rounding around a rigid-body 0
_ROUNDING = 16.0 * np.finfo(float).eps  # of the largest eigenvalue: the same beside very stiff motion
_TWIN = 1e-6  # relative gap of eigenvalues below which one mode's derivatives are taken beside all others
_LEAST = 0.5  # of 1 - S: where damping couples modes more, second order says nothing any more

_MOST_STEPS = 30  # of the search for a mode's own frequency
_CONVERGED = 1e-10  # relative change of that frequency
_MOST_GROWTH = 0.9  # of a frequency with the one that its stiffness is taken at, so that steps stay finite


@dataclass(frozen=True, eq=False, kw_only=True)
class Modes:
    """Modes of a stack, ascending in frequency, the rigid-body modes first.

    Attributes
    ----------
    frequency : (n_mode,) float
        Undamped natural frequencies, Hz; 0 for rigid-body modes.
    damping : (n_mode,) float
        Damping ratios.
    pole_frequency : (n_mode,) float
        abs(pole) / 2 pi, Hz, which an identification finds: that of the undamped mode but for what damping couples it
        to others, to second order of the damping.
    shape : (n_dof, n_mode) float
        Mass-normalised shapes at the observed degrees of freedom, 1/sqrt(kg).
    node : (n_dof,) int
        Point number of each shape component.
    direction : (n_dof, 3) float
        Direction of each shape component.
    n_rigid : int
        Number of rigid-body modes.
    parameter : tuple of str
        Parameters of the derivatives.
    frequency_gradient, damping_gradient : (n_mode, n_parameter) float
        Derivatives by each parameter, Hz and 1 per unit of the parameter.
    shape_gradient : (n_dof, n_mode, n_parameter) float
        Derivatives of the shapes; 0 of rigid-body motion, of which the solver returns any mixture.
    coordinate : (n_basis, n_mode) float
        The modes in the coordinates of the reduced system.
    outside : tuple of str
        Parameters whose values lie outside the ranges that the reduction was made for: the modes are
        extrapolated, and `refine` tells their error.
    """

    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]
    pole_frequency: NDArray[np.float64]
    shape: NDArray[np.float64]
    node: NDArray[np.int64]
    direction: NDArray[np.float64]
    n_rigid: int
    parameter: tuple[str, ...]
    frequency_gradient: NDArray[np.float64]
    damping_gradient: NDArray[np.float64]
    shape_gradient: NDArray[np.float64]
    coordinate: NDArray[np.float64]
    outside: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n_mode, n_dof, n_parameter = np.size(self.frequency), np.size(self.node), len(self.parameter)
        expected: dict[str, tuple[int | None, ...]] = {
            "frequency": (n_mode,),
            "damping": (n_mode,),
            "pole_frequency": (n_mode,),
            "shape": (n_dof, n_mode),
            "direction": (n_dof, 3),
            "frequency_gradient": (n_mode, n_parameter),
            "damping_gradient": (n_mode, n_parameter),
            "shape_gradient": (n_dof, n_mode, n_parameter),
            "coordinate": (None, n_mode),
        }
        for name, shape in expected.items():
            object.__setattr__(self, name, readonly("Modes", name, getattr(self, name), shape))
        object.__setattr__(self, "node", readonly("Modes", "node", self.node, (n_dof,), int))

    def elastic(self) -> Modes:
        """Return the modes without the rigid-body ones."""
        keep = slice(self.n_rigid, None)
        return dataclasses.replace(
            self,
            frequency=self.frequency[keep],
            damping=self.damping[keep],
            pole_frequency=self.pole_frequency[keep],
            shape=self.shape[:, keep],
            n_rigid=0,
            frequency_gradient=self.frequency_gradient[keep],
            damping_gradient=self.damping_gradient[keep],
            shape_gradient=self.shape_gradient[:, keep],
            coordinate=self.coordinate[:, keep],
        )


def solve_modes(
    system: ReducedEquations,
    *,
    G_f: float,
    d_f: float,
    n_mode: int = 12,
    observation: Observation | Observed,
    parameters: Mapping[str, float] | None = None,
    by: Collection[str] | None = None,
) -> Modes:
    """Solve for the lowest modes at given contact parameters.

    Damping ratios are modal, phi' C phi / (2 omega); the module says why that suffices.

    Parameters
    ----------
    system : ReducedEquations
        The reduced stack.
    G_f : float
        Contact stiffness parameter, Pa/Pa.
    d_f : float
        Contact damping parameter, s/Pa.
    n_mode : int
        Number of modes, rigid-body modes included.
    observation : Observation or Observed
        Where shapes are wanted; `observe` it once where many solves follow.
    parameters : mapping of str to float, optional
        Values of further parameters that differ from `system.theta`.
    by : collection of str, optional
        Parameters whose derivatives are wanted; all by default.

    Returns
    -------
    Modes
        With effects that depend on frequency, each mode is that of the matrices at its own frequency.

    Raises
    ------
    SolveError
        More modes are asked for than the reduced system has, a parameter is unknown, or the stiffness is
        negative.
    """
    theta = full_parameters(system, G_f, d_f, parameters)
    eigenvalues, vectors, n_rigid = reduced_eigenpairs(system, theta, n_mode)
    observed = observe(system, observation)
    names = tuple(name for name in theta if name != OMEGA and (by is None or name in by))
    rigid = Derivatives.steady(eigenvalues[:n_rigid], vectors[:, :n_rigid], len(names))
    elastic = _elastic_derivatives(system, theta, names, eigenvalues, vectors, range(n_rigid, n_mode))
    found = Derivatives.joined([rigid, elastic])
    return _modes(found, observed, names, n_rigid, outside_ranges(system, theta))


def _modes(
    found: Derivatives, observed: Observed, names: tuple[str, ...], n_rigid: int, outside: tuple[str, ...]
) -> Modes:
    """Return eigenvalues, modal damping and vectors, with their derivatives, as modes at the observed DOFs."""
    omega = np.sqrt(np.where(np.arange(found.eigenvalue.size) < n_rigid, 0.0, found.eigenvalue))
    safe = np.where(omega > 0.0, omega, np.inf)
    d_omega = found.d_eigenvalue / (2.0 * safe[:, None])
    damping = found.modal_damping / (2.0 * safe)
    rows = observed.reduced_rows
    return Modes(
        frequency=omega / (2.0 * np.pi),
        damping=damping,
        pole_frequency=omega / (2.0 * np.pi) / np.sqrt(np.maximum(1.0 - found.coupling, _LEAST)),
        shape=rows @ found.coordinate,
        node=observed.node,
        direction=observed.direction,
        n_rigid=n_rigid,
        parameter=names,
        frequency_gradient=d_omega / (2.0 * np.pi),
        damping_gradient=found.d_modal_damping / (2.0 * safe[:, None])
        - damping[:, None] * d_omega / safe[:, None],
        shape_gradient=np.einsum("di,irp->drp", rows, found.d_coordinate, optimize=True),
        coordinate=found.coordinate,
        outside=outside,
    )


def _elastic_derivatives(
    system: ReducedEquations,
    theta: Mapping[str, float],
    names: tuple[str, ...],
    eigenvalues: NDArray[np.float64],
    vectors: NDArray[np.float64],
    elastic: range,
) -> Derivatives:
    """Return the elastic modes with their derivatives, each with the matrices at its own frequency."""
    if OMEGA not in theta:
        return mode_derivatives(system, theta, names, eigenvalues, vectors, elastic)
    if any(t.target != "C" and t.factor.derivative(theta, OMEGA) for t in system.terms):
        moving = _OverFrequency.of(system, theta)
        return Derivatives.joined(
            [_at_own_frequency(system, moving, names, eigenvalues, vectors, r) for r in elastic]
        )
    # only damping follows frequency: the undamped modes are the same for all
    at = np.sqrt(eigenvalues[elastic.start : elastic.stop])
    return mode_derivatives(system, theta, (*names, OMEGA), eigenvalues, vectors, elastic, at).without_omega()


@dataclass(frozen=True, eq=False)
class _OverFrequency:
    """M and K at any frequency: `steady` ones, and a few terms that follow it, with their own factors."""

    theta: Mapping[str, float]
    steady: Mapping[Target, NDArray[np.float64]]
    following: tuple[ReducedTerm, ...]

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
        return cls(theta, {target: rest.matrix(target, theta) for target in ("M", "K")}, follows)

    def matrix(self, target: Target, omega: float) -> NDArray[np.float64]:
        """Return M or K at an angular frequency, (n, n)."""
        here, total = {**self.theta, OMEGA: omega}, self.steady[target].copy()
        for term in self.following:
            if term.target == target:
                total += term.factor(here) * term.matrix
        return total

    def rayleigh(self, shape: NDArray[np.float64], omega: float) -> float:
        """Return the frequency near `omega`, rad/s, at which shape' (K - omega**2 M) shape vanishes, by Newton.

        Raises
        ------
        SolveError
            The stiffness is negative there.
        """
        steady = {target: float(shape @ own @ shape) for target, own in self.steady.items()}
        shares = [(t.target, t.factor, float(shape @ t.matrix @ shape)) for t in self.following]
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


def _at_own_frequency(
    system: ReducedEquations,
    moving: _OverFrequency,
    names: tuple[str, ...],
    eigenvalues: NDArray[np.float64],
    vectors: NDArray[np.float64],
    mode: int,
) -> Derivatives:
    """Solve for one mode with the matrices at its own frequency, the mode being followed by its shape.

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
        message = (
            f"mode {mode}: its frequency-dependent stiffness does not settle near {omega / 2 / np.pi:.6g} Hz"
        )
        raise SolveError(message)
    here = {**moving.theta, OMEGA: omega}
    if np.count_nonzero(np.abs(eigenvalues - eigenvalues[mode]) < _TWIN * eigenvalues[mode]) > 1:
        values, basis = la.eigh(stiffness, mass)  # only beside all modes are twins resolved from it
        index = int(np.argmax(np.abs(basis.T @ (mass @ shape))))
        own = mode_derivatives(system, here, (*names, OMEGA), values, basis, range(index, index + 1))
    else:
        own = own_derivatives(system, here, (*names, OMEGA), shape, mass, stiffness)
    return own.without_omega()


def reduced_eigenpairs(
    system: ReducedEquations, theta: Mapping[str, float], n_mode: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Return all eigenvalues and vectors of the reduced system, and how many of the first are rigid-body motion.

    Raises
    ------
    SolveError
        More modes are asked for than the reduced system has, the stiffness is negative, or the mass is not positive.
    """
    if not 0 < n_mode <= system.size:
        message = f"n_mode = {n_mode} must lie between 1 and {system.size}, the size of the reduced system"
        raise SolveError(message)
    try:
        eigenvalues, vectors = la.eigh(system.matrix("K", theta), system.matrix("M", theta))
    except la.LinAlgError as error:
        message = f"the mass at {theta} is not positive"
        raise SolveError(message) from error
    rigid_limit = _rigid_limit(system, theta, eigenvalues)
    if eigenvalues[0] < -rigid_limit:
        message = f"the stiffness at {theta} is negative: lowest eigenvalue {eigenvalues[0]:.3g} (rad/s)**2"
        raise SolveError(message)
    return eigenvalues, vectors, int(np.count_nonzero(eigenvalues[:n_mode] < rigid_limit))


def outside_ranges(system: ReducedEquations, theta: Mapping[str, float]) -> tuple[str, ...]:
    """Return the parameters whose values lie outside the ranges that the reduction was made for."""
    return tuple(n for n, (low, high) in system.ranges.items() if not low <= theta[n] <= high)


def full_parameters(
    system: ReducedEquations, G_f: float, d_f: float, parameters: Mapping[str, float] | None
) -> dict[str, float]:
    """Return all parameters of the system, with the given ones in place of the nominal.

    Raises
    ------
    SolveError
        A parameter is unknown.
    """
    given = {} if parameters is None else dict(parameters)
    unknown = sorted(set(given) - set(system.theta))
    if unknown:
        message = f"unknown parameters {', '.join(unknown)}; the system has {', '.join(system.theta)}"
        raise SolveError(message)
    return {**system.theta, **given, "G_f": G_f, "d_f": d_f}


def _rigid_limit(
    system: ReducedEquations, theta: Mapping[str, float], eigenvalues: NDArray[np.float64]
) -> float:
    """Return the eigenvalue, (rad/s)**2, below which all is rounding around rigid-body motion."""
    return max(_RIGID * abs(shear_shift(system.stack, theta)), _ROUNDING * float(eigenvalues[-1]))


def complex_modes(
    system: ReducedEquations,
    *,
    G_f: float,
    d_f: float,
    n_mode: int = 12,
    parameters: Mapping[str, float] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Solve the complex eigenproblem of the reduced system, without assuming proportional damping.

    Returns
    -------
    frequency : (n,)
        abs(pole) / 2 pi of the first elastic modes, Hz; n is at most `n_mode` less the rigid-body modes.
    damping : (n,)
        -Re(pole) / abs(pole).
    """
    theta = full_parameters(system, G_f, d_f, parameters)
    eigenvalues, vectors = la.eigh(system.matrix("K", theta), system.matrix("M", theta))
    n = system.size
    n_rigid = int(np.count_nonzero(eigenvalues < _rigid_limit(system, theta, eigenvalues)))
    damping = vectors.T @ system.matrix("C", theta) @ vectors
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(eigenvalues), -damping]])
    poles = la.eigvals(state)
    poles = poles[poles.imag > 0.5 * np.sqrt(eigenvalues[n_rigid])]
    poles = poles[np.argsort(np.abs(poles))][: n_mode - n_rigid]
    return np.abs(poles) / (2.0 * np.pi), -poles.real / np.abs(poles)
