"""Reduction of the full equations of motion: over z, then to the span of snapshot modes.

First the displacements over z are written with a few functions, drawn from the modes of a coarse plan with
all laminas and all interfaces (proper orthogonal decomposition). What remains is solved exactly for a few
values of G_f; the modes found span the final basis, in which every term is projected on its own. A solve
for new parameters then costs a small dense eigenvalue problem.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from model.arrays import readonly
from model.assemble import assemble
from model.chain import ChainFactor, factorize, levels
from model.eigen import lowest_modes, orthonormalize
from model.mesh import FIELDS, Field
from model.stack import Mesh, Stack
from model.system import Assembly, Monomial, Target

_COARSE = Mesh(n_x=4, n_y=2)
_SPARE = 6  # modes computed beyond those asked for, so that the last ones converge as fast as the first


@dataclass(frozen=True, eq=False, kw_only=True)
class ReducedTerm:
    """A term of the equations of motion projected on the reduced basis: `factor` times `matrix`, (n, n)."""

    name: str
    target: Target
    factor: Monomial
    matrix: NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class ReducedSystem:
    """A stack reduced to a few degrees of freedom, affine in its parameters.

    Attributes
    ----------
    stack : Stack
        What was reduced.
    phi : mapping of field to (n_lamina, n_function)
        Functions of z of each field, one row a lamina.
    assembly : Assembly
        The equations of motion after reduction over z.
    basis : (assembly.size, n)
        Snapshot basis, orthonormal in the mass of the nominal parameters; the rigid-body modes come first.
    terms : tuple of ReducedTerm
        The projected terms.
    theta : mapping of str to float
        Nominal parameters.
    G_f_range : (float, float)
        Values of G_f between which the snapshots were taken.
    """

    stack: Stack
    phi: Mapping[Field, NDArray[np.float64]]
    assembly: Assembly
    basis: NDArray[np.float64]
    terms: tuple[ReducedTerm, ...]
    theta: Mapping[str, float]
    G_f_range: tuple[float, float]

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "basis", readonly("ReducedSystem", "basis", self.basis, (self.assembly.size, None))
        )

    @property
    def size(self) -> int:
        """Number of reduced degrees of freedom."""
        return int(self.basis.shape[1])

    def matrix(self, target: Target, theta: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the reduced M, C or K at the parameters `theta`, (size, size)."""
        total = np.zeros((self.size, self.size))
        for term in self.terms:
            if term.target == target:
                total += term.factor(theta) * term.matrix
        return total

    def derivative(self, target: Target, theta: Mapping[str, float], name: str) -> NDArray[np.float64]:
        """Return the derivative of the reduced M, C or K by the parameter `name`, (size, size)."""
        total = np.zeros((self.size, self.size))
        for term in self.terms:
            if term.target == target and name in term.factor.exponent:
                total += term.factor.derivative(theta, name) * term.matrix
        return total

    def field_rows(
        self, field: Field, lamina: NDArray[np.intp], points: NDArray[np.float64]
    ) -> sp.csr_matrix:
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
            (
                (rows.data[:, None] * over_z).ravel(),
                (np.repeat(rows.row, n_function), columns.ravel()),
            ),
            (lamina.size, self.assembly.size),
        ).tocsr()


def chain_over_plan(assembly: Assembly) -> list[NDArray[np.intp]]:
    """Group the unknowns from one end of the plan to the other."""
    plan = assembly.plan
    pattern = sp.block_array(
        [[abs(plan.form(r, c)) for c in FIELDS] for r in FIELDS],
        format="csr",
    )
    x = np.concatenate([plan.basis(field).doflocs[0] for field in FIELDS])
    start = np.flatnonzero(x <= x.min() + 1e-9 * np.ptp(x))
    sizes = np.cumsum([0, *(plan.size(field) for field in FIELDS)])
    where = assembly.slices()
    groups = []
    for level in levels(pattern, start):
        parts = []
        for i, field in enumerate(FIELDS):
            planar = level[(level >= sizes[i]) & (level < sizes[i + 1])] - sizes[i]
            over_z = np.arange(assembly.n_z[field]) * plan.size(field)
            parts.append((where[field].start + planar[:, None] + over_z).ravel())
        groups.append(np.concatenate(parts))
    return groups


def chain_over_laminas(assembly: Assembly) -> list[NDArray[np.intp]]:
    """Group the unknowns lamina by lamina."""
    where = assembly.slices()
    n_lamina = assembly.n_z["w"]
    return [
        np.concatenate(
            [where[f].start + k * assembly.plan.size(f) + np.arange(assembly.plan.size(f)) for f in FIELDS]
        )
        for k in range(n_lamina)
    ]


def _shift(stack: Stack) -> float:
    """Return the square of the angular frequency at which a shear wave fits twice into the length."""
    shear = stack.contact.G_f * stack.contact.pressure
    return float(shear / stack.material.density * (np.pi / stack.length) ** 2)


def _modes_at(
    assembly: Assembly,
    groups: list[NDArray[np.intp]],
    theta: Mapping[str, float],
    shift: float,
    start: NDArray[np.float64],
    n_mode: int,
    tolerance: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    factor = factorize(assembly.matrix("K", theta) + shift * assembly.matrix("M", theta), groups)
    mass = assembly.krons("M", theta)
    return lowest_modes(factor.solve, lambda x: assembly.apply(mass, x), shift, start, n_mode, tolerance)


def shifted_factor(system: ReducedSystem, theta: Mapping[str, float]) -> tuple[ChainFactor, float]:
    """Return the factor of K + shift M of the z-reduced equations at `theta`, and the shift, (rad/s)**2."""
    shift = _shift(system.stack)
    matrix = system.assembly.matrix("K", theta) + shift * system.assembly.matrix("M", theta)
    return factorize(matrix, chain_over_plan(system.assembly)), shift


def _principal_functions(
    values: Sequence[NDArray[np.float64]],
    weight: sp.csr_matrix,
    first: NDArray[np.float64],
    n_function: int,
) -> NDArray[np.float64]:
    """Return orthonormal functions of z: `first`, then those that carry most of what remains of `values`.

    Parameters
    ----------
    values : sequence of (n_lamina, n_planar, n_mode)
        Fields to represent.
    weight : (n_planar, n_planar)
        Planar mass form, which makes the products integrals over the plan.
    first : (n_lamina, m)
        Functions that must be in the span.
    n_function : int
        Total number of functions.
    """
    basis = la.qr(first, mode="economic")[0]
    gram = np.zeros((first.shape[0], first.shape[0]))
    for value in values:
        n_lamina, n_planar, n_mode = value.shape
        flat = value.transpose(1, 0, 2).reshape(n_planar, -1)
        weighted = (weight @ flat).reshape(n_planar, n_lamina, n_mode)
        plain = value.transpose(1, 0, 2)
        gram += np.einsum("pkm,plm->kl", plain, weighted, optimize=True)
    gram -= basis @ (basis.T @ gram)
    gram -= (gram @ basis) @ basis.T
    vectors = la.eigh((gram + gram.T) / 2.0)[1][:, ::-1]
    extra = min(n_function, first.shape[0]) - basis.shape[1]
    return la.qr(np.hstack([basis, vectors[:, : max(extra, 0)]]), mode="economic")[0]


def z_functions(
    stack: Stack, G_f: Sequence[float], n_mode: int, n_membrane: int, n_bending: int
) -> dict[Field, NDArray[np.float64]]:
    """Draw functions of z for u, v and w from the modes of a coarse plan with all laminas.

    Parameters
    ----------
    stack : Stack
        The stack; its mesh is replaced by 4 x 2 elements.
    G_f : sequence of float
        Contact stiffness parameters at which the modes are taken.
    n_mode : int
        Number of modes for each.
    n_membrane, n_bending : int
        Number of functions for u and v, and for w.

    Returns
    -------
    mapping of field to (n_lamina, n_function)
        Orthonormal columns; uniform and linear displacement over z are among those of u and v, uniform
        displacement among those of w, so rigid-body modes are exact.
    """
    coarse = assemble(dataclasses.replace(stack, mesh=_COARSE))
    groups = chain_over_laminas(coarse)
    start = np.random.default_rng(0).standard_normal((coarse.size, n_mode + _SPARE))
    snapshots = []
    for value in G_f:
        theta = {**coarse.theta, "G_f": value}
        _, start = _modes_at(
            coarse, groups, theta, _shift(stack.with_contact(G_f=value)), start, n_mode, 1e-6
        )
        snapshots.append(start)
    where = coarse.slices()

    def parts(field: Field) -> list[NDArray[np.float64]]:
        return [s[where[field]].reshape(stack.n_lamina, -1, s.shape[1]) for s in snapshots]

    uniform, linear = np.ones(stack.n_lamina), stack.lamina_z
    mass = coarse.plan.form("u", "u")
    membrane = _principal_functions(
        parts("u") + parts("v"), mass, np.column_stack([uniform, linear]), n_membrane
    )
    bending = _principal_functions(
        parts("w"), coarse.plan.form("w", "w"), np.column_stack([uniform]), n_bending
    )
    return {"u": membrane, "v": membrane, "w": bending}


def rigid_body_modes(
    assembly: Assembly, stack: Stack, phi: Mapping[Field, NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Return three translations and three rotations in the z-reduced coordinates, (assembly.size, 6)."""
    plan, where = assembly.plan, assembly.slices()
    one = np.ones(stack.n_lamina)

    def planar(field: Field, function: str) -> NDArray[np.float64]:
        return plan.interpolate(
            field, {"1": (1.0, 0.0, 0.0), "x": (0.0, 1.0, 0.0), "y": (0.0, 0.0, 1.0)}[function]
        )

    modes = np.zeros((assembly.size, 6))

    def add(mode: int, field: Field, over_z: NDArray[np.float64], function: str, sign: float = 1.0) -> None:
        modes[where[field], mode] = sign * np.outer(phi[field].T @ over_z, planar(field, function)).ravel()

    add(0, "u", one, "1")
    add(1, "v", one, "1")
    add(2, "w", one, "1")
    add(3, "v", stack.lamina_z, "1", -1.0)
    add(3, "w", one, "y")
    add(4, "u", stack.lamina_z, "1")
    add(4, "w", one, "x", -1.0)
    add(5, "u", one, "y", -1.0)
    add(5, "v", one, "x")
    return modes


def reduce(
    stack: Stack,
    *,
    G_f_range: tuple[float, float] | None = None,
    n_mode: int = 22,
    n_snapshot: int = 4,
    n_membrane: int = 12,
    n_bending: int = 10,
) -> ReducedSystem:
    """Reduce a stack to a small system that is affine in its parameters.

    Parameters
    ----------
    stack : Stack
        The stack with its mesh.
    G_f_range : (float, float), optional
        Values of G_f for which the reduction shall hold; by default from a quarter to four times the
        stack's own.
    n_mode : int
        Modes of each snapshot, the six rigid-body modes included.
    n_snapshot : int
        Number of snapshots, spaced evenly in log G_f.
    n_membrane, n_bending : int
        Number of functions of z for u and v, and for w.

    Raises
    ------
    SolveError
        The equations are singular, or the modes do not converge.
    """
    low, high = G_f_range or (stack.contact.G_f / 4.0, stack.contact.G_f * 4.0)
    samples = np.geomspace(low, high, n_snapshot)
    phi = z_functions(
        stack,
        [float(samples[0]), float(np.sqrt(low * high)), float(samples[-1])],
        n_mode,
        n_membrane,
        n_bending,
    )
    assembly = assemble(stack).project_z(phi)
    mass = assembly.krons("M", assembly.theta)

    def product(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return assembly.apply(mass, x)

    groups = chain_over_plan(assembly)
    nothing = np.empty((assembly.size, 0))
    basis, mass_basis = orthonormalize(rigid_body_modes(assembly, stack, phi), product, nothing, nothing)
    start = np.random.default_rng(0).standard_normal((assembly.size, n_mode + _SPARE))
    for value in samples:
        theta = {**assembly.theta, "G_f": float(value)}
        shift = _shift(stack.with_contact(G_f=float(value)))
        _, start = _modes_at(assembly, groups, theta, shift, start, n_mode, 1e-10)
        block, mass_block = orthonormalize(start, product, basis, mass_basis)
        basis, mass_basis = np.hstack([basis, block]), np.hstack([mass_basis, mass_block])
    terms = tuple(
        ReducedTerm(
            name=term.name,
            target=term.target,
            factor=term.factor,
            matrix=_symmetric(basis.T @ assembly.apply(term.krons, basis)),
        )
        for term in assembly.terms
    )
    return ReducedSystem(
        stack=stack,
        phi=phi,
        assembly=assembly,
        basis=basis,
        terms=terms,
        theta=assembly.theta,
        G_f_range=(low, high),
    )


def _symmetric(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    return (matrix + matrix.T) / 2.0
