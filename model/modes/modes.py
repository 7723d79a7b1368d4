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
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from lamella_shared import Integers, Reals, arrays, readonly
from model.elements.equations import OMEGA
from model.elements.mesh import FIELDS
from model.modes.elastic_modes import Derivatives, ElasticModes, elastic_modes
from model.reduction.reduced_equations import ReducedEquations
from model.reduction.reduction import ReducedSystem
from model.reduction.through_thickness import shear_shift
from model.stack.errors import SolveError
from model.stack.stack import Stack


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"n": "node", "n 3": "location direction"})
class Observation:
    """Degrees of freedom at given places.

    Attributes
    ----------
    node : (n,) int
        Point number of each degree of freedom.
    location : (n, 3) float
        Its place, m, in coordinates with their origin at the centre of the stack: x along the length, y along
        the width, z along the height.
    direction : (n, 3) float
        Its direction, of unit length.

    Raises
    ------
    ValueError
        The shapes differ, or a direction is not of unit length.
    """

    node: Integers
    location: Reals
    direction: Reals

    def __post_init__(self) -> None:
        length = np.linalg.norm(self.direction, axis=1)
        if np.any(np.abs(length - 1.0) > 1e-6):
            worst = int(np.argmax(np.abs(length - 1.0)))
            raise ValueError(
                f"Observation.direction: expected unit vectors, got length {length[worst]:.6g} "
                f"at index {worst} (node {self.node[worst]})"
            )


def sample_points(stack: Stack, location: Reals) -> tuple[Reals, Reals]:
    """Return where the model is sampled for given places: the nearest point of the nearest lamina mid-plane.

    Parameters
    ----------
    stack : Stack
        The stack.
    location : (n, 3)
        Places, m.

    Returns
    -------
    sampled : (n, 3)
        Points of lamina mid-planes, m.
    distance : (n,)
        Their distances from `location`, m.
    """
    given = readonly("sample_points", "location", location, (None, 3))
    half = np.array([stack.length, stack.width]) / 2.0
    plan = np.clip(given[:, :2], -half, half)
    sampled = np.column_stack([plan, stack.lamina_z[nearest_lamina(stack, given[:, 2])]])
    return sampled, np.linalg.norm(sampled - given, axis=1)


def nearest_lamina(stack: Stack, z: Reals) -> NDArray[np.intp]:
    """Return the index of the lamina whose mid-plane is nearest to each height z, (n,) m."""
    return np.abs(np.asarray(z)[:, None] - stack.lamina_z).argmin(axis=1)


@dataclass(frozen=True, eq=False, kw_only=True)
class Observed:
    """An observation tied to a system: what repeated solves of that system need of it.

    Attributes
    ----------
    node : (n,) int
        Point numbers.
    direction : (n, 3) float
        Directions.
    rows : (n, assembly.size) sparse
        From z-reduced coordinates to the observed displacements.
    reduced_rows : (n, system.size) float
        From reduced coordinates to the observed displacements.
    """

    node: Integers
    direction: Reals
    rows: sp.csr_matrix
    reduced_rows: Reals


def observe(system: ReducedEquations, observation: Observation | Observed) -> Observed:
    """Tie an observation to a system, so that each further solve costs about a millisecond.

    What is tied already comes back as it is.

    Raises
    ------
    TypeError
        An observation that is not tied needs a `ReducedSystem`, which knows what it was reduced from.
    """
    if isinstance(observation, Observed):
        return observation
    if not isinstance(system, ReducedSystem):
        raise TypeError("observe: these equations alone know no points; tie the observation to their ReducedSystem")
    sampled, _ = sample_points(system.stack, observation.location)
    lamina = nearest_lamina(system.stack, sampled[:, 2])
    parts = [
        sp.diags_array(observation.direction[:, i]) @ system.field_rows(field, lamina, sampled[:, :2])
        for i, field in enumerate(FIELDS)
    ]
    rows = (parts[0] + parts[1] + parts[2]).tocsr()
    return Observed(
        node=observation.node, direction=observation.direction, rows=rows, reduced_rows=np.asarray(rows @ system.basis)
    )


Wanted = Callable[[Reals, Reals], NDArray[np.intp]]
"""Takes frequencies, (n,), Hz, and shapes, (n_dof, n), of elastic modes to the indices of those wanted."""


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays(
    {
        "mode": "frequency damping pole_frequency",
        "node mode": "shape",
        "any": "node",
        "node 3": "direction",
        "mode parameter": "frequency_gradient damping_gradient",
        "node mode parameter": "shape_gradient",
        "any mode": "coordinate",
    }
)
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

    frequency: Reals
    damping: Reals
    pole_frequency: Reals
    shape: Reals
    node: Integers
    direction: Reals
    n_rigid: int
    parameter: tuple[str, ...]
    frequency_gradient: Reals
    damping_gradient: Reals
    shape_gradient: Reals
    coordinate: Reals
    outside: tuple[str, ...] = ()

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
    differentiated: Wanted | None = None,
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
        Those modes whose derivatives are wanted; others have NaN. All by default.

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
    rigid = Derivatives.steady(eigenvalues[:n_rigid], vectors[:, :n_rigid], len(observed.reduced_rows), len(names))
    elastic = elastic_modes(system, theta, eigenvalues, vectors, range(n_rigid, n_mode))
    found = Derivatives.joined([rigid, _derivatives(elastic, names, observed.reduced_rows, differentiated)])
    return _modes(found, observed, names, n_rigid, outside_ranges(system, theta))


def _derivatives(
    elastic: ElasticModes, names: tuple[str, ...], rows: Reals, differentiated: Wanted | None
) -> Derivatives:
    """Return elastic modes with the derivatives of those for which they are wanted."""
    wanted = np.full(len(elastic.mode), differentiated is None)
    if differentiated is not None:
        wanted[differentiated(elastic.frequency, rows @ elastic.coordinate)] = True
    sought, rest = elastic.derivatives(wanted, names, rows), elastic.derivatives(~wanted, (), rows)
    order = np.argsort(np.append(np.flatnonzero(wanted), np.flatnonzero(~wanted)))
    return Derivatives.joined([sought, rest.unknown_by(len(names))]).ordered(order)


def _modes(
    found: Derivatives, observed: Observed, names: tuple[str, ...], n_rigid: int, outside: tuple[str, ...]
) -> Modes:
    """Return eigenvalues, modal damping and vectors, with their derivatives, as modes at the observed DOFs."""
    least = 0.5  # of 1 - S: where damping couples modes more, second order says nothing any more
    omega = np.sqrt(np.where(np.arange(found.eigenvalue.size) < n_rigid, 0.0, found.eigenvalue))
    safe = np.where(omega > 0.0, omega, np.inf)
    d_omega = found.d_eigenvalue / (2.0 * safe[:, None])
    damping = found.modal_damping / (2.0 * safe)
    return Modes(
        frequency=omega / (2.0 * np.pi),
        damping=damping,
        pole_frequency=omega / (2.0 * np.pi) / np.sqrt(np.maximum(1.0 - found.coupling, least)),
        shape=observed.reduced_rows @ found.coordinate,
        node=observed.node,
        direction=observed.direction,
        n_rigid=n_rigid,
        parameter=names,
        frequency_gradient=d_omega / (2.0 * np.pi),
        damping_gradient=found.d_modal_damping / (2.0 * safe[:, None]) - damping[:, None] * d_omega / safe[:, None],
        shape_gradient=found.d_shape,
        coordinate=found.coordinate,
        outside=outside,
    )


def reduced_eigenpairs(system: ReducedEquations, theta: Mapping[str, float], n_mode: int) -> tuple[Reals, Reals, int]:
    """Return all eigenvalues and vectors of the reduced system, and how many of the first are rigid-body motion.

    Raises
    ------
    SolveError
        More modes are asked for than the reduced system has, the stiffness is negative, or the mass is not positive.
    """
    if not 0 < n_mode <= system.size:
        raise SolveError(f"n_mode = {n_mode} must lie between 1 and {system.size}, the size of the reduced system")
    try:
        eigenvalues, vectors = la.eigh(system.matrix("K", theta), system.matrix("M", theta))
    except la.LinAlgError as error:
        raise SolveError(f"the mass at {theta} is not positive") from error
    rigid_limit = _rigid_limit(system, theta, eigenvalues)
    if eigenvalues[0] < -rigid_limit:
        raise SolveError(f"the stiffness at {theta} is negative: lowest eigenvalue {eigenvalues[0]:.3g} (rad/s)**2")
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
        raise SolveError(f"unknown parameters {', '.join(unknown)}; the system has {', '.join(system.theta)}")
    return {**system.theta, **given, "G_f": G_f, "d_f": d_f}


def _rigid_limit(system: ReducedEquations, theta: Mapping[str, float], eigenvalues: Reals) -> float:
    """Return the eigenvalue, (rad/s)**2, below which all is rounding around rigid-body motion."""
    rounding = 16.0 * np.finfo(float).eps  # of the largest eigenvalue: the same beside very stiff motion
    rigid = 1e-8  # of `shear_shift`: below it an eigenvalue is rounding around a rigid-body 0
    return max(rigid * abs(shear_shift(system.stack, theta)), rounding * float(eigenvalues[-1]))


def complex_modes(
    system: ReducedEquations, *, G_f: float, d_f: float, n_mode: int = 12, parameters: Mapping[str, float] | None = None
) -> tuple[Reals, Reals]:
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


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"any any 3": "location displacement", "any any": "element", "any 2": "edge"})
class Surface:
    """A mode's displacement at the corners of the mesh of some laminas.

    Attributes
    ----------
    location : (n_lamina, n_point, 3) float
        The points at rest, m.
    displacement : (n_lamina, n_point, 3) float
        Their mass-normalised displacement along x, y and z, 1/sqrt(kg).
    element : (n_element, 3 or 4) int
        Points of each element, in order around it.
    edge : (n_edge, 2) int
        Points of the element sides that lie on the outline or on a hole.
    """

    location: Reals
    displacement: Reals
    element: Integers
    edge: Integers


def mode_surface(system: ReducedSystem, modes: Modes, mode: int, *, lamina: Sequence[int]) -> Surface:
    """Sample a mode at the corners of the mesh of some laminas.

    Parameters
    ----------
    system : ReducedSystem
        The reduced stack.
    modes : Modes
        Modes of that system.
    mode : int
        Column of `modes.shape`, from 0.
    lamina : sequence of int
        Laminas to sample, 0 the bottom one; negative ones count from the top.

    Raises
    ------
    SolveError
        There is no such mode or lamina.
    """
    stack, assembly = system.stack, system.assembly
    if not 0 <= mode < modes.frequency.size:
        raise SolveError(f"mode = {mode}: the modes are numbered from 0 to {modes.frequency.size - 1}")
    chosen = np.asarray(lamina, dtype=np.intp)
    if chosen.size == 0 or chosen.min() < -stack.n_lamina or chosen.max() >= stack.n_lamina:
        raise SolveError(f"lamina = {list(lamina)}: the laminas are numbered from 0 to {stack.n_lamina - 1}")
    chosen = chosen % stack.n_lamina
    mesh = assembly.plan.membrane.mesh
    point = mesh.p.T
    coordinate = system.basis @ modes.coordinate[:, mode]
    displacement = np.empty((chosen.size, len(point), 3))
    for axis, field in enumerate(FIELDS):
        over = coordinate[assembly.slices()[field]].reshape(assembly.n_z[field], -1)
        displacement[:, :, axis] = system.phi[field][chosen] @ (assembly.plan.point_rows(field, point) @ over.T).T
    location = np.empty_like(displacement)
    location[:, :, :2] = point
    location[:, :, 2] = stack.lamina_z[chosen, None]
    return Surface(
        location=location, displacement=displacement, element=mesh.t.T, edge=mesh.facets[:, mesh.boundary_facets()].T
    )
