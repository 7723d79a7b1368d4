"""Natural frequencies, damping ratios and shapes of a stack, with their derivatives by every parameter."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model.arrays import readonly
from model.errors import SolveError
from model.observation import Observation, Observed, observe
from model.reduction import ReducedSystem
from model.z_basis import shear_shift

_RIGID = 1e-8  # of `shear_shift`: below it an eigenvalue is rounding around a rigid-body 0
_SAME = 1e-9  # relative gap below which two eigenvalues count as one and their vectors are not separated


@dataclass(frozen=True, eq=False, kw_only=True)
class Modes:
    """Modes of a stack, ascending in frequency, the rigid-body modes first.

    Attributes
    ----------
    frequency : (n_mode,) float
        Undamped natural frequencies, Hz; 0 for rigid-body modes.
    damping : (n_mode,) float
        Damping ratios.
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
        Derivatives of the shapes.
    coordinate : (n_basis, n_mode) float
        The modes in the coordinates of the reduced system.
    outside : tuple of str
        Parameters whose values lie outside the ranges that the reduction was made for: the modes are
        extrapolated, and `refine` tells their error.
    """

    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]
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
            shape=self.shape[:, keep],
            n_rigid=0,
            frequency_gradient=self.frequency_gradient[keep],
            damping_gradient=self.damping_gradient[keep],
            shape_gradient=self.shape_gradient[:, keep],
            coordinate=self.coordinate[:, keep],
        )


def solve_modes(
    system: ReducedSystem,
    *,
    G_f: float,
    d_f: float,
    n_mode: int = 12,
    observation: Observation | Observed,
    parameters: Mapping[str, float] | None = None,
) -> Modes:
    """Solve for the lowest modes at given contact parameters.

    Damping ratios are modal, phi' C phi / (2 omega): the diagonal of the damping matrix in the coordinates of
    the undamped modes. C is beta K_contact while K also holds the laminas, so damping is not proportional and
    the off-diagonal is neglected. That suffices because it acts in second order of the damping: against the
    complex eigenproblem of the same system (`complex_modes`), the first ten elastic modes of the paper's stack
    6 (calibration C1, d_f = 4.6e-11 s/Pa, damping up to 6 %) differ by at most 5e-5 in frequency and 2.4e-4 in
    damping ratio, both relative.

    Parameters
    ----------
    system : ReducedSystem
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

    Returns
    -------
    Modes

    Raises
    ------
    SolveError
        More modes are asked for than the reduced system has, a parameter is unknown, or the stiffness is
        negative.
    """
    theta = full_parameters(system, G_f, d_f, parameters)
    eigenvalues, vectors, n_rigid = reduced_eigenpairs(system, theta, n_mode)
    omega = np.sqrt(np.where(np.arange(n_mode) < n_rigid, 0.0, eigenvalues[:n_mode]))
    coordinate = vectors[:, :n_mode]
    safe = np.where(omega > 0.0, omega, np.inf)
    damping_matrix = system.matrix("C", theta)
    modal_damping = np.einsum("ir,ij,jr->r", coordinate, damping_matrix, coordinate, optimize=True)
    observed = observe(system, observation)
    rows = observed.reduced_rows

    names = tuple(theta)
    frequency_gradient = np.zeros((n_mode, len(names)))
    damping_gradient = np.zeros((n_mode, len(names)))
    shape_gradient = np.zeros((rows.shape[0], n_mode, len(names)))
    for j, name in enumerate(names):
        d_lambda, d_coordinate = _eigen_derivative(system, theta, name, eigenvalues, vectors, n_mode)
        d_omega = d_lambda / (2.0 * safe)
        d_modal = 2.0 * np.einsum(
            "ir,ij,jr->r", d_coordinate, damping_matrix, coordinate, optimize=True
        ) + np.einsum(
            "ir,ij,jr->r", coordinate, system.derivative("C", theta, name), coordinate, optimize=True
        )
        frequency_gradient[:, j] = d_omega / (2.0 * np.pi)
        damping_gradient[:, j] = (d_modal - modal_damping * d_omega / safe) / (2.0 * safe)
        shape_gradient[:, :, j] = rows @ d_coordinate
    return Modes(
        frequency=omega / (2.0 * np.pi),
        damping=modal_damping / (2.0 * safe),
        shape=rows @ coordinate,
        node=observed.node,
        direction=observed.direction,
        n_rigid=n_rigid,
        parameter=names,
        frequency_gradient=frequency_gradient,
        damping_gradient=damping_gradient,
        shape_gradient=shape_gradient,
        coordinate=coordinate,
        outside=outside_ranges(system, theta),
    )


def reduced_eigenpairs(
    system: ReducedSystem, theta: Mapping[str, float], n_mode: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Return all eigenvalues and vectors of the reduced system, and how many of the first are rigid-body motion.

    Raises
    ------
    SolveError
        More modes are asked for than the reduced system has, or the stiffness is negative.
    """
    if not 0 < n_mode <= system.size:
        message = f"n_mode = {n_mode} must lie between 1 and {system.size}, the size of the reduced system"
        raise SolveError(message)
    eigenvalues, vectors = la.eigh(system.matrix("K", theta), system.matrix("M", theta))
    rigid_limit = _RIGID * abs(shear_shift(system.stack, theta))
    if eigenvalues[0] < -rigid_limit:
        message = f"the stiffness at {theta} is negative: lowest eigenvalue {eigenvalues[0]:.3g} (rad/s)**2"
        raise SolveError(message)
    return eigenvalues, vectors, int(np.count_nonzero(eigenvalues[:n_mode] < rigid_limit))


def outside_ranges(system: ReducedSystem, theta: Mapping[str, float]) -> tuple[str, ...]:
    """Return the parameters whose values lie outside the ranges that the reduction was made for."""
    return tuple(n for n, (low, high) in system.ranges.items() if not low <= theta[n] <= high)


def full_parameters(
    system: ReducedSystem, G_f: float, d_f: float, parameters: Mapping[str, float] | None
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


def _eigen_derivative(
    system: ReducedSystem,
    theta: Mapping[str, float],
    name: str,
    eigenvalues: NDArray[np.float64],
    vectors: NDArray[np.float64],
    n_mode: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return d eigenvalue (n_mode,) and d vector (n, n_mode) by a parameter (Fox and Kapoor 1968)."""
    lowest = vectors[:, :n_mode]
    stiffness = vectors.T @ system.derivative("K", theta, name) @ lowest
    mass = vectors.T @ system.derivative("M", theta, name) @ lowest
    lam = eigenvalues[:n_mode]
    coupling = stiffness - mass * lam
    gap = lam - eigenvalues[:, None]
    scale = np.maximum(np.abs(lam), np.abs(eigenvalues[:, None]))
    mixing = np.where(np.abs(gap) > _SAME * scale, coupling / np.where(gap == 0.0, 1.0, gap), 0.0)
    index = np.arange(n_mode)
    d_lambda = coupling[index, index]
    mixing[index, index] = -0.5 * mass[index, index]
    return d_lambda, vectors @ mixing


def complex_modes(
    system: ReducedSystem,
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
    n_rigid = int(np.count_nonzero(eigenvalues < _RIGID * shear_shift(system.stack, theta)))
    damping = vectors.T @ system.matrix("C", theta) @ vectors
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(eigenvalues), -damping]])
    poles = la.eigvals(state)
    poles = poles[poles.imag > 0.5 * np.sqrt(eigenvalues[n_rigid])]
    poles = poles[np.argsort(np.abs(poles))][: n_mode - n_rigid]
    return np.abs(poles) / (2.0 * np.pi), -poles.real / np.abs(poles)
