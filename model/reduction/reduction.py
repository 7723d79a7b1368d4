"""Reduction of the full equations of motion: over z, then to the span of snapshot modes.

First the displacements over z are written with a few functions, drawn from modes over a few shapes of the plan with
all laminas and all interfaces (proper orthogonal decomposition). What remains is solved exactly for a few
values of the parameters; the modes found span the final basis, in which every term is projected on its own.
A solve for new parameters then costs a small dense eigenvalue problem.
"""

from __future__ import annotations

import dataclasses
import difflib
import logging
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from lamella_shared import readonly
from model.contact.contact import contact_terms
from model.contact.pressing import pressure_distribution
from model.elements.equations import OMEGA, Assembly, Riding, Term
from model.elements.mesh import FIELDS, Field, plan_of
from model.elements.terms import clamp_terms, lamina_terms, rigid_body_modes, support_terms
from model.reduction.effect_basis import (
    attachment_answers,
    effect_answers,
    effect_samples,
    elastic_modes,
    second_answers,
)
from model.reduction.projection import projected_terms
from model.reduction.reduced_equations import Matrix, ReducedEquations, ReducedTerm, full, in_ranges
from model.reduction.riding import riding_terms
from model.reduction.through_thickness import FREE, N_RIGID, SOFT, SPARE, n_rigid, shear_shift, through_thickness_basis
from model.solvers.eigen import Block, Product, orthonormalize
from model.solvers.low_rank import Factor
from model.solvers.stack_solver import Solver, solver_over_plan
from model.stack.effect import OMEGA_REFERENCE, Effect
from model.stack.errors import SolveError
from model.stack.stack import Stack

_LOG = logging.getLogger(__name__)


def assemble(stack: Stack) -> Assembly:
    """Assemble laminas, contact, clamps, supports and physical effects of a stack.

    The parameters are `G_f` (Pa/Pa), `d_f` (s/Pa), the mean `pressure` (Pa), the factors `young`, `density`,
    `normal_modulus` and, with interlayers, `layer_modulus` on the stack's own values (nominal 1), and those of
    the stack's effects. Contact damping is beta = d_f p times the contact stiffness, tangential and normal. The
    assembly's own stack holds the pressure field that its clamps cause.

    Raises
    ------
    EffectError
        An effect needs something that the stack does not have.
    """
    stack = dataclasses.replace(stack, pressing=pressure_distribution(stack))
    plan = plan_of(stack)
    terms = (
        *lamina_terms(stack, plan),
        *clamp_terms(stack, plan),
        *contact_terms(stack, plan),
        *support_terms(stack, plan),
    )
    contact = stack.contact
    theta = {
        "G_f": contact.G_f,
        "d_f": contact.d_f,
        "pressure": contact.pressure,
        "young": 1.0,
        "density": 1.0,
        "normal_modulus": 1.0,
    }
    if stack.interlayers:
        theta["layer_modulus"] = 1.0
    base = Assembly(stack=stack, plan=plan, n_z=dict.fromkeys(FIELDS, stack.n_lamina), terms=terms, theta=theta)
    added = tuple(term for effect in stack.effects for term in effect.terms(base))
    frequency = {OMEGA: OMEGA_REFERENCE} if any(effect.frequency_dependent for effect in stack.effects) else {}
    return base.with_terms(added, {**stack.effect_values, **frequency})


def sobol(n: int, n_axis: int) -> NDArray[np.float64]:
    """Return the first points of a scrambled Sobol sequence in the unit box, (n, n_axis), always the same."""
    if not n or not n_axis:
        return np.empty((n, n_axis))
    from scipy.stats import qmc  # here: it takes long to import, and few commands need it

    with warnings.catch_warnings():  # that a number of points is not a power of 2 does not matter here
        warnings.simplefilter("ignore", UserWarning)
        return np.asarray(qmc.Sobol(n_axis, rng=np.random.default_rng(0)).random(n))


_TOLERANCE = 1e-6  # relative, of the snapshots' eigenvalues


@dataclass(frozen=True, eq=False, kw_only=True)
class ReducedSystem(ReducedEquations):
    """A stack reduced to a few degrees of freedom, affine in its parameters, with what it was reduced from.

    Attributes
    ----------
    phi : mapping of field to (n_lamina, n_function)
        Through-thickness functions of each field, one row a lamina.
    assembly : Assembly
        The equations of motion after reduction over z.
    basis : (assembly.size, n)
        Snapshot basis, orthonormal in the mass of the nominal parameters; the rigid-body modes come first. Columns of 0
        follow for what rides on the structure.
    n_displaced : int
        Columns of the basis that displace the structure.
    laminas : Assembly
        The equations of motion of all laminas, before any reduction.
    """

    phi: Mapping[Field, NDArray[np.float64]]
    assembly: Assembly
    basis: NDArray[np.float64]
    n_displaced: int
    laminas: Assembly

    def __post_init__(self) -> None:
        object.__setattr__(self, "basis", readonly("ReducedSystem", "basis", self.basis, (self.assembly.size, None)))

    def field_rows(self, field: Field, lamina: NDArray[np.intp], points: NDArray[np.float64]) -> sp.csr_matrix:
        """Return the matrix from z-reduced coordinates to u, v or w on given laminas at points of the plan.

        Parameters
        ----------
        field : "u", "v" or "w"
            The displacement.
        lamina : (n,)
            Lamina of each point, 0 the bottom one.
        points : (n, 2)
            x and y of each point, m.

        Returns
        -------
        csr_matrix, (n, assembly.size)
            Its product with `basis` acts on the reduced coordinates.
        """
        rows = self.assembly.plan.point_rows(field, points).tocoo()
        n_planar, n_function = self.assembly.plan.size(field), self.phi[field].shape[1]
        over_z = self.phi[field][lamina[rows.row]]  # (n_entry, n_function)
        start = self.assembly.slices()[field].start
        columns = start + rows.col[:, None] + n_planar * np.arange(n_function)
        return sp.coo_matrix(
            ((rows.data[:, None] * over_z).ravel(), (np.repeat(rows.row, n_function), columns.ravel())),
            (lamina.size, self.assembly.size),
        ).tocsr()


Kinds = Sequence[tuple[Sequence[Effect], Mapping[str, float]]]
"""Effects and the parameters at which the basis takes their answers."""


def no_terms(assembly: Assembly) -> tuple[Term, ...]:  # noqa: ARG001
    """Return no further terms."""
    return ()


def reduce(
    stack: Stack,
    *,
    G_f_range: tuple[float, float] | None = None,
    n_mode: int = 18,
    n_snapshot: int | None = None,
    z_tolerance: float = 1e-5,
    terms: Callable[[Assembly], tuple[Term, ...]] = no_terms,
    theta: Mapping[str, float] | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    local: Sequence[Effect] = (),
    ranged: bool = False,
) -> ReducedSystem:
    """Reduce a stack to a small system that is affine in its parameters.

    Parameters
    ----------
    stack : Stack
        The stack with its mesh. The reduction holds for its effects over the ranges of their parameters.
    G_f_range : (float, float), optional
        Values of G_f for which the reduction shall hold; by default from a quarter to four times the stack's
        own.
    n_mode : int
        Modes of each snapshot, the six rigid-body modes included.
    n_snapshot : int, optional
        Number of snapshots: at the Chebyshev nodes of log G_f, or, with n further ranges, one in n + 2 of them there
        and the others at points of a Sobol sequence over all ranges. By default four for each range.
    z_tolerance : float
        Relative error of frequencies that the through-thickness basis may cause, checked over a few shapes of the plan.
    terms : callable
        What physical effects add to the equations of motion of all laminas.
    theta : mapping of str to float, optional
        Nominal values of the parameters of `terms`.
    ranges : mapping of str to (float, float), optional
        Values of further parameters for which the reduction shall hold.
    local : sequence of Effect
        Those of its effects that act at few places, and may be strong there.
    ranged : bool
        Whether matrices of low rank are kept in ranges that they share, which takes a third of the memory.

    Raises
    ------
    SolveError
        A range names an unknown parameter or is empty, the equations are singular, or the modes do not
        converge.
    """
    plain = assemble(stack)
    stack = plain.stack  # with its pressure field
    laminas = plain.with_terms(terms(plain), {} if theta is None else theta)
    box = {"G_f": G_f_range or (stack.contact.G_f / 4.0, stack.contact.G_f * 4.0), **({} if ranges is None else ranges)}
    _check_ranges(box, laminas.theta)
    middle = {**laminas.theta, "G_f": float(np.sqrt(np.prod(box["G_f"])))}
    sampled = [effect for effect in stack.effects if any(p.name in box for p in effect.parameters)]
    samples = _samples_with(sampled, box, laminas.theta, middle, n_snapshot)
    kinds = ((stack.effects, middle), (sampled, samples[-1]))  # of effects; these have modes of their own there
    return _from_snapshots(laminas, box, samples, kinds, local, n_mode, z_tolerance, ranged=ranged)


def _from_snapshots(
    laminas: Assembly,
    box: Mapping[str, tuple[float, float]],
    samples: Sequence[Mapping[str, float]],
    kinds: Kinds,
    local: Sequence[Effect],
    n_mode: int,
    z_tolerance: float,
    *,
    ranged: bool,
) -> ReducedSystem:
    """Reduce the equations of all laminas over z and then to the span of snapshots at the samples."""
    stack, outer = laminas.stack, samples[: len(box) + 1]
    with_effects = [at for sample in outer[:2] for at in effect_samples(laminas, sample)]
    _LOG.info("reduce the model, 1 of 4: functions over the height")
    over_z = through_thickness_basis(stack, seated(laminas), [*outer, *with_effects], n_mode, z_tolerance)
    assembly = laminas.project_z(over_z.phi)
    starts = [snapshot[:, n_rigid(stack) :] for snapshot in over_z.snapshots[: len(outer)]]
    rigid = rigid_body_modes(assembly, stack, over_z.phi)
    basis, n_base = _snapshot_basis(assembly, samples, starts, rigid, kinds, local, n_mode)
    _LOG.info("reduce the model, 4 of 4: project %d terms on %d shapes", len(assembly.terms), basis.shape[1])
    n_displaced = basis.shape[1]
    riding, n_riding = riding_terms(assembly, basis)
    if ranged:
        between = in_ranges(full(term.matrix) for term in riding)
        riding = tuple(dataclasses.replace(t, matrix=matrix) for t, matrix in zip(riding, between, strict=True))
    basis = np.hstack([basis, np.zeros((len(basis), n_riding))])
    return ReducedSystem(
        stack=stack,
        phi=over_z.phi,
        assembly=assembly,
        basis=basis,
        n_displaced=n_displaced,
        terms=(*reduced_terms(seated(assembly), basis, ranged=ranged), *riding),
        theta=assembly.theta,
        ranges=box,
        n_base=n_base,
        laminas=laminas,
    )


def seated(assembly: Assembly) -> Assembly:
    """Return the equations with all that rides on a spring sitting rigidly.

    An apparent mass is of one frequency, and negative above a rider's own; modes with it would not be those of the
    structure. In the reduced equations a rider has coordinates of its own.
    """
    return dataclasses.replace(assembly, terms=tuple(t for t in assembly.terms if not isinstance(t.factor, Riding)))


def _samples_with(
    sampled: Sequence[Effect],
    box: Mapping[str, tuple[float, float]],
    theta: Mapping[str, float],
    middle: Mapping[str, float],
    n_snapshot: int | None,
) -> list[dict[str, float]]:
    """Return the parameters of the snapshots; the last has the typical strength of effects whose ranges are sampled."""
    count = 4 * len(box) if n_snapshot is None else n_snapshot
    samples = [{**theta, **sample} for sample in _samples(box, theta, count)]
    if sampled and count > 1:
        samples[-1] = {**middle, **{p.name: p.nominal for effect in sampled for p in effect.parameters}}
    return samples


def _snapshot_basis(
    assembly: Assembly,
    samples: Sequence[Mapping[str, float]],
    starts: Sequence[NDArray[np.float64]],
    rigid: NDArray[np.float64],
    kinds: Kinds,
    local: Sequence[Effect],
    n_mode: int,
) -> tuple[NDArray[np.float64], int]:
    """Return the basis of the modes at all samples and of effects' answers, each kind where it is given.

    The directions of the modes are weighed where the first kind is given. Local effects have attachment modes at all
    samples but the outer two. Returned with the number of first vectors that are of modes.
    """
    sitting = seated(assembly)
    solver = solver_over_plan(sitting.acting(samples))
    mass = sitting.krons("M", assembly.theta)

    def product(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return assembly.apply(mass, x)

    _LOG.info("reduce the model, 2 of 4: modes at %d points of its parameters", len(samples))
    modes = _snapshot_modes(sitting, solver, samples, starts, rigid, product, n_mode)
    space = _extended(orthonormalize(rigid, product), leading(modes, sitting, kinds[0][1]), product)
    base = space[0]
    _LOG.info("reduce the model, 3 of 4: answers to its effects")

    def at_point(at: Mapping[str, float]) -> tuple[Factor, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Return the factor of K + shift M there, and the elastic modes."""
        return solver.factor(at, shear_shift(assembly.stack, at)), elastic_modes(sitting, at, base, n_mode)

    for effects, at in kinds:
        if effects:
            factor, elastic = at_point(at)
            space = _extended(space, effect_answers(assembly, effects, factor, at, elastic), product)
            space = _extended(space, second_answers(assembly, effects, factor, at, elastic, space[0]), product)
    for at in samples[2:] if local else ():
        factor, elastic = at_point(at)
        space = _extended(space, attachment_answers(assembly, local, factor, elastic[1]), product)
    return space[0], base.shape[1]


def _snapshot_modes(
    assembly: Assembly,
    solver: Solver,
    samples: Sequence[Mapping[str, float]],
    starts: Sequence[NDArray[np.float64]],
    rigid: NDArray[np.float64],
    product: Product,
    n_mode: int,
) -> NDArray[np.float64]:
    """Return the elastic modes at all samples, of unit energy.

    The first samples start from `starts`, the others from the modes in the space of those before them.
    """
    min_steps = 4  # for modes of a snapshot that those before it lack
    space, modes = orthonormalize(rigid, product), []
    fresh = np.random.default_rng(0).standard_normal((assembly.size, SPARE // 2))  # for what the start lacks
    for i, sample in enumerate(samples):
        if i < len(starts):
            start = starts[i]
        else:
            stiffness, inertia = (
                _symmetric(space[0].T @ assembly.apply(assembly.krons(target, sample), space[0]))
                for target in ("K", "M")
            )
            start = space[0] @ la.eigh(stiffness, inertia)[1][:, n_rigid(assembly.stack) : n_mode]
        shift = shear_shift(assembly.stack, sample)
        values, vectors = solver.modes(sample, shift, np.hstack([start, fresh]), n_mode, _TOLERANCE, rigid, min_steps)
        space = _extended(space, vectors[:, :n_mode], product)
        elastic = np.flatnonzero(values[:n_mode] > FREE * shift)
        modes.append(vectors[:, elastic] / np.sqrt(values[elastic]))
    return np.hstack(modes)


def _extended(space: Block, x: NDArray[np.float64], product: Product) -> Block:
    """Return a mass-orthonormal basis, with its products with the mass matrix, extended by more directions, if any."""
    if not x.shape[1]:
        return space
    block, mass_block = orthonormalize(x, product, [space])
    return np.hstack([space[0], block]), np.hstack([space[1], mass_block])


def reduced_terms(assembly: Assembly, basis: NDArray[np.float64], *, ranged: bool = False) -> tuple[ReducedTerm, ...]:
    """Return the terms of equations of motion in a basis, (assembly.size, n), that begins with rigid-body motion.

    Terms that differ by their factor alone share one matrix. With `ranged`, matrices of low rank are in ranges that
    they share.
    """
    number, projected = projected_terms(assembly, basis)
    each = (_without_rounding(_symmetric(matrix)) for matrix in projected)
    matrices: Sequence[Matrix] = in_ranges(each) if ranged else list(each)
    return tuple(
        ReducedTerm(name=term.name, target=term.target, factor=term.factor, matrix=matrices[i])
        for i, term in zip(number, assembly.terms, strict=True)
    )


def leading(modes: NDArray[np.float64], assembly: Assembly, theta: Mapping[str, float]) -> NDArray[np.float64]:
    """Return the directions, normalised, in which modes of unit energy have more than next to nothing.

    Parameters
    ----------
    modes : (assembly.size, n)
        The modes, or what they are beside a basis.
    assembly : Assembly
        Equations of motion after reduction over z.
    theta : mapping of str to float
        Parameters at which the energy is that of the strained stack.
    """
    left_out = 1e-6  # of a mode's energy: directions of the snapshots with less are left out
    shift = SOFT * shear_shift(assembly.stack, theta)
    image = assembly.apply(assembly.krons("K", theta), modes)
    image += shift * assembly.apply(assembly.krons("M", theta), modes)
    energy, principal = la.eigh(_symmetric(modes.T @ image))
    keep = energy > left_out
    return np.asarray(modes @ (principal[:, keep] / np.sqrt(energy[keep])))


def _check_ranges(ranges: Mapping[str, tuple[float, float]], theta: Mapping[str, float]) -> None:
    for name, (low, high) in ranges.items():
        if name not in theta:
            near = difflib.get_close_matches(name, theta, n=1)
            hint = f"; did you mean {near[0]}?" if near else f"; there are {', '.join(theta)}"
            raise SolveError(f"ranges: unknown parameter {name!r}{hint}")
        if not low < high:
            raise SolveError(f"ranges: {name} must reach from a lower to a higher value, got {low:g} to {high:g}")


def _samples(ranges: Mapping[str, tuple[float, float]], nominal: Mapping[str, float], n: int) -> list[dict[str, float]]:
    """Return n points of a box of parameters, some of them along its first parameter, and then all over it.

    Along the first parameter they stand at Chebyshev's nodes, the outer two first because they tell most, with the
    others at their nominal values. Positive parameters are spaced by their logarithm, those from 0 more closely near
    it.
    """
    n_first = n if len(ranges) == 1 else max(n // (len(ranges) + 1), 1)
    nodes = (1.0 + np.cos((np.arange(n_first) + 0.5) * np.pi / n_first)) / 2.0
    order = [*range(n_first)[:: max(n_first - 1, 1)], *range(n_first)[1:-1]]
    unit = sobol(n - n_first, len(ranges))

    def spaced(low: float, high: float, part: float) -> float:
        return float(low * (high / low) ** part if low > 0.0 else low + (high - low) * part**1.5)

    (first, range_), *further = ranges.items()
    middle = {name: float(np.clip(nominal[name], low, high)) for name, (low, high) in further}
    return [
        *({first: spaced(*range_, part), **middle} for part in nodes[order]),
        *(
            {name: spaced(low, high, part) for (name, (low, high)), part in zip(ranges.items(), point, strict=True)}
            for point in unit
        ),
    ]


def shifted_factor(assembly: Assembly, theta: Mapping[str, float]) -> Factor:
    """Return the factor of K + shift M of the z-reduced equations at `theta`; the shift is `shear_shift`."""
    return solver_over_plan(assembly.acting([theta])).factor(theta, shear_shift(assembly.stack, theta))


def _without_rounding(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a projected term with exact zeros for the rigid-body motion that it does not feel.

    What rounding leaves there would, times a large stiffness, pass for a negative one.
    """
    rounding = 1e-6  # of a term's largest entry; terms that feel rigid-body motion have 1e-2 there
    if np.abs(matrix[:N_RIGID]).max() < rounding * np.abs(matrix).max():
        matrix[:N_RIGID] = matrix[:, :N_RIGID] = 0.0
    return matrix


def _symmetric(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    return (matrix + matrix.T) / 2.0
