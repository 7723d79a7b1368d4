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
from collections.abc import Callable, Collection, Mapping
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
    differentiated: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.intp]] | None = None,
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
    differentiated : callable, optional
        Takes the frequencies, (n,), Hz, and shapes, (n_dof, n), of the elastic modes to the indices of those whose
        derivatives are wanted; others have NaN. All by default.

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
    rows = observed.reduced_rows
    rigid = Derivatives.steady(eigenvalues[:n_rigid], vectors[:, :n_rigid], len(rows), len(names))
    found = _elastic(system, theta, eigenvalues, vectors, range(n_rigid, n_mode))
    if differentiated is None:
        wanted = np.ones(len(found.mode), dtype=bool)
    else:
        wanted = np.zeros(len(found.mode), dtype=bool)
        wanted[differentiated(found.frequency, rows @ found.coordinate)] = True
    own, rest = found.derivatives(wanted, names, rows), found.derivatives(~wanted, (), rows)
    order = np.argsort(np.append(np.flatnonzero(wanted), np.flatnonzero(~wanted)))
    elastic = Derivatives.joined([own, rest.unknown_by(len(names))]).ordered(order)
    return _modes(
        Derivatives.joined([rigid, elastic]), observed, names, n_rigid, outside_ranges(system, theta)
    )


def _modes(
    found: Derivatives, observed: Observed, names: tuple[str, ...], n_rigid: int, outside: tuple[str, ...]
) -> Modes:
    """Return eigenvalues, modal damping and vectors, with their derivatives, as modes at the observed DOFs."""
    omega = np.sqrt(np.where(np.arange(found.eigenvalue.size) < n_rigid, 0.0, found.eigenvalue))
    safe = np.where(omega > 0.0, omega, np.inf)
    d_omega = found.d_eigenvalue / (2.0 * safe[:, None])
    damping = found.modal_damping / (2.0 * safe)
    return Modes(
        frequency=omega / (2.0 * np.pi),
        damping=damping,
        pole_frequency=omega / (2.0 * np.pi) / np.sqrt(np.maximum(1.0 - found.coupling, _LEAST)),
        shape=observed.reduced_rows @ found.coordinate,
        node=observed.node,
        direction=observed.direction,
        n_rigid=n_rigid,
        parameter=names,
        frequency_gradient=d_omega / (2.0 * np.pi),
        damping_gradient=found.d_modal_damping / (2.0 * safe[:, None])
        - damping[:, None] * d_omega / safe[:, None],
        shape_gradient=found.d_shape,
        coordinate=found.coordinate,
        outside=outside,
    )


@dataclass(frozen=True, eq=False)
class _Elastic:
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


def _elastic(
    system: ReducedEquations,
    theta: Mapping[str, float],
    eigenvalues: NDArray[np.float64],
    vectors: NDArray[np.float64],
    mode: range,
) -> _Elastic:
    settled: tuple[_Settled, ...] = ()
    if OMEGA in theta and any(t.target != "C" and t.factor.derivative(theta, OMEGA) for t in system.terms):
        moving = _OverFrequency.of(system, theta)
        settled = tuple(_Settled.of(moving, eigenvalues, vectors, r) for r in mode)
    return _Elastic(system, theta, eigenvalues, vectors, mode, settled)


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
