"""The through-thickness basis: a few displacement profiles over the height that stand for all laminas.

They are drawn by proper orthogonal decomposition from modes of all laminas and all interfaces over a few shapes of
the plan, so weak interfaces, uneven pressure and masses on the faces shape them. Those shapes come from modes with
polynomials over z. Polynomials alone do not do: the membrane stress has thin layers at both faces, and a weak
interface is a jump; the shapes over the plan hardly feel that.

The shapes over the plan are few, too, so that all laminas can be solved at once. They are drawn
by proper orthogonal decomposition from modes of the stack itself, so they follow its outline with
teeth and slots, uneven pressure and clamps; a coarse mesh of such an outline would still have hundreds of elements.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from model.contact.contact import jump, mean
from model.elements.equations import Assembly
from model.elements.mesh import FIELDS, Derivative, Field, Plan
from model.elements.terms import rigid_body_modes
from model.solvers.eigen import orthonormalize
from model.solvers.stack_solver import solver_over_laminas, solver_over_plan
from model.stack.stack import Stack

Vector = NDArray[np.float64]


_LINEAR = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, eq=False, kw_only=True)
class ShapePlan(Plan):
    """A plan whose displacement fields are sums of a few shapes.

    Attributes
    ----------
    shape : mapping of field to (n, n_shape)
        Degrees of freedom of each shape in the spaces `membrane` and `plate`, orthonormal in the mass; linear
        functions are among them.
    """

    shape: Mapping[Field, Vector]

    @functools.cached_property
    def meshed(self) -> Plan:
        """The plan with all its degrees of freedom."""
        return Plan(membrane=self.membrane, plate=self.plate)

    def size(self, field: Field) -> int:
        """Return the number of shapes of a field."""
        return int(self.shape[field].shape[1])

    def elements(self, field: Field) -> sp.csr_matrix:
        """Return that every shape covers all of the plan, (size(field), 1)."""
        return sp.csr_matrix(np.ones((self.size(field), 1)))

    def abscissa(self, field: Field) -> Vector:
        """Return one place for all shapes, (size(field),) m."""
        return np.zeros(self.size(field))

    def form(
        self,
        row: Field,
        column: Field,
        derivatives: tuple[Derivative, Derivative] = ("", ""),
        weight: NDArray[np.float64] | float = 1.0,
    ) -> sp.csr_matrix:
        """Integrate the product of two fields' shapes, or of their derivatives, over the plan."""
        return self.projected(row, column, self.meshed.form(row, column, derivatives, weight))

    def interpolate(self, field: Field, linear: tuple[float, float, float]) -> Vector:
        """Return the shares of the shapes, (size(field),), in the linear function c0 + c1 x + c2 y."""
        return np.asarray(la.lstsq(self.shape[field], self.meshed.interpolate(field, linear))[0])

    def coordinates(self, field: Field, x: Vector) -> Vector:
        """Return the projection on the shapes of displacements (n, ...) of the meshed plan."""
        flat = self.meshed.form(field, field) @ x.reshape(x.shape[0], -1)
        return np.asarray(self.shape[field].T @ flat).reshape(-1, *x.shape[1:])

    def projected(self, row: Field, column: Field, planar: sp.csr_matrix) -> sp.csr_matrix:
        """Return a matrix of the meshed plan in the coordinates of the shapes, with every entry stored."""
        dense = self.shape[row].T @ (planar @ self.shape[column])
        n, m = dense.shape
        return sp.csr_matrix((dense.ravel(), np.tile(np.arange(m), n), m * np.arange(n + 1)), (n, m))


def leading_shapes(plan: Plan, samples: Mapping[Field, Vector]) -> ShapePlan:
    """Return the plan reduced to linear functions and the principal shapes of samples.

    Parameters
    ----------
    plan : Plan
        The meshed plan.
    samples : mapping of field to (plan.size(field), n)
        Displacements over the plan.
    """
    left_out = 1e-3  # size, relative to the first, of shapes that are left out
    shape = {}
    for field in FIELDS:
        mass = plan.form(field, field)
        linear = np.column_stack([plan.interpolate(field, c) for c in _LINEAR])
        first, mass_first = orthonormalize(linear, lambda x, m=mass: m @ x)  # type: ignore[misc]
        rest = samples[field] - first @ (mass_first.T @ samples[field])
        gram = rest.T @ (mass @ rest)
        size, vectors = la.eigh((gram + gram.T) / 2.0)
        keep = size > left_out**2 * size[-1]
        shape[field] = np.hstack([first, rest @ (vectors[:, keep] / np.sqrt(size[keep]))])
    return ShapePlan(membrane=plan.membrane, plate=plan.plate, shape=shape)


def on_shapes(assembly: Assembly, plan: ShapePlan) -> Assembly:
    """Return the Galerkin projection of the equations of motion on the shapes of a plan."""
    terms = tuple(
        dataclasses.replace(
            term,
            krons=tuple(
                dataclasses.replace(kron, planar=plan.projected(kron.row, kron.column, kron.planar))
                for kron in term.krons
            ),
        )
        for term in assembly.terms
    )
    return dataclasses.replace(assembly, plan=plan, terms=terms)


Phi = Mapping[Field, Vector]

N_RIGID = 6

SPARE = 8  # vectors iterated beyond the modes asked for, so that the last ones converge as fast as the first

FREE = 1e-6  # of `shear_shift`: an eigenvalue below it is rigid-body motion

SOFT = 1e-2  # of it, beside stiffness where energies are compared: what an iteration leaves in softer modes is more

_TOLERANCE = 1e-6  # relative change of eigenvalues over the shapes in the last step; their error is far smaller

_FEWEST: Mapping[Field, int] = {"u": 2, "v": 2, "w": 1}  # those of rigid-body motion


_POLYNOMIALS = 4


@dataclass(frozen=True, eq=False, kw_only=True)
class ThroughThicknessBasis:
    """The through-thickness basis and the modes that it was drawn from.

    Attributes
    ----------
    phi : mapping of field to (n_lamina, n_function)
        Orthonormal columns. Uniform and linear displacement over z are among those of u and v, uniform
        displacement among those of w, so rigid-body modes are exact.
    snapshots : tuple of (n, n_vector)
        These modes in coordinates of the through-thickness functions and of all the plan, one array for each sample of
        the parameters.
    """

    phi: Phi
    snapshots: tuple[NDArray[np.float64], ...]


def n_rigid(stack: Stack) -> int:
    """Return how many rigid-body modes come before the elastic ones: none where supports hold the stack.

    What its supports leave free is sought like any other mode.
    """
    return 0 if stack.supports else N_RIGID


def shear_shift(stack: Stack, theta: Mapping[str, float]) -> float:
    """Return the squared angular frequency, (rad/s)**2, at which half a shear wave fits the length.

    Of one lamina, in which no contact shears, half a bending wave.
    """
    density, wave = theta["density"] * stack.material.density, np.pi / stack.length
    if stack.n_lamina == 1:
        bending = theta["young"] * stack.material.plane_stress()[0] * stack.pitch**2 / 12.0
        return float(bending / density * wave**4)
    return float(theta["G_f"] * theta["pressure"] / density * wave**2)


def _is_symmetric(assembly: Assembly) -> bool:
    """Return whether the stack is its own mirror image about mid-height."""
    mirrored = 1e-9  # relative difference up to which a stack counts as symmetric about mid-height
    sign = {"u": 1.0, "v": 1.0, "w": -1.0}
    for term in assembly.terms:
        for kron in term.krons:
            z = sp.csr_matrix(kron.z)
            turned = sign[kron.row] * sign[kron.column] * z[::-1, ::-1]
            if abs(z - turned).max() > mirrored * abs(z).max():
                return False
    return True


def _principal_functions(
    gram: NDArray[np.float64], norm: NDArray[np.float64], first: NDArray[np.float64], *, symmetric: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return through-thickness functions: `first`, then the others by the energy that leaving them out would cost.

    Parameters
    ----------
    gram : (n_lamina, n_lamina)
        Products of the laminas' displacements with one another, all samples together.
    norm : (n_lamina, n_lamina)
        Symmetric positive definite matrix in which a function's size is measured.
    first : (n_lamina, m)
        Functions that must be in the span.
    symmetric : bool
        Whether to give every function a parity about mid-height.

    Returns
    -------
    functions : (n_lamina, n_lamina)
    energy : (n_lamina,)
        Of all samples together in each function, without `first`'s, which is infinite.
    """
    if symmetric:
        gram = (gram + gram[::-1, ::-1]) / 2.0
    root = la.cholesky(norm, lower=True)
    gram = root.T @ gram @ root
    basis = la.qr(root.T @ first, mode="economic")[0]
    gram -= basis @ (basis.T @ gram)
    gram -= (gram @ basis) @ basis.T
    energy, vectors = la.eigh((gram + gram.T) / 2.0)
    n_rest = first.shape[0] - first.shape[1]
    energy, vectors = energy[::-1][:n_rest], vectors[:, ::-1][:, :n_rest]
    functions = la.solve_triangular(root.T, vectors)
    if symmetric:
        functions = _with_parity(functions)
    return np.hstack([first, functions]), np.concatenate([np.full(first.shape[1], np.inf), energy])


def _with_parity(functions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the even or the odd part of each function, whichever is larger."""
    even, odd = functions + functions[::-1], functions - functions[::-1]
    return np.where((even**2).sum(axis=0) > (odd**2).sum(axis=0), even, odd)


def _over_phi(full: Assembly, phi: Phi, x: Vector) -> Vector:
    """Return displacements of all laminas, (full.size, k), in coordinates of the through-thickness functions."""
    where, k = full.slices(), x.shape[1]
    return np.vstack([(phi[f].T @ x[where[f]].reshape(full.n_z[f], -1)).reshape(-1, k) for f in FIELDS])


def _smooth_modes(
    reduced: Assembly, stack: Stack, thetas: Sequence[Mapping[str, float]], phi: Phi, n_mode: int
) -> list[tuple[Vector, Vector]]:
    """Return roughly converged eigenvalues and vectors with a smooth thickness basis, one pair for each sample."""
    rough = 1e-2  # relative change of the eigenvalues with polynomials in the last step
    solver, rigid = solver_over_plan(reduced), rigid_body_modes(reduced, stack, phi)
    first = n_rigid(stack)
    start = np.random.default_rng(0).standard_normal((reduced.size, n_mode - first + SPARE))
    found = []
    for theta in thetas:
        found.append(solver.modes(theta, shear_shift(stack, theta), start, n_mode, rough, rigid))
        start = found[-1][1][:, first:]
    return found


def _elastic(eigenvalues: Sequence[Vector], modes: Sequence[Vector], shifts: Sequence[float]) -> Vector:
    """Return the elastic modes of all samples, of unit energy, so that every one counts alike.

    Very soft ones, as of a stack on springs, have less: what the iteration leaves in them would pass for functions of
    z.
    """
    return np.hstack(
        [
            m[:, : v.size][:, v > FREE * shift] / np.sqrt(np.maximum(v[v > FREE * shift], SOFT * shift))
            for v, m, shift in zip(eigenvalues, modes, shifts, strict=True)
        ]
    )


def through_thickness_basis(
    stack: Stack, laminas: Assembly, thetas: Sequence[Mapping[str, float]], n_mode: int, tolerance: float
) -> ThroughThicknessBasis:
    """Draw the through-thickness basis from modes of all laminas over a few shapes of the plan.

    The number of functions grows until the frequencies over these shapes are those with all laminas.

    Parameters
    ----------
    stack : Stack
        The stack.
    laminas : Assembly
        Equations of motion of all its laminas.
    thetas : sequence of mapping of str to float
        Parameters at which the modes are taken.
    n_mode : int
        Number of modes for each, the six rigid-body modes included.
    tolerance : float
        Largest relative error of a frequency over the shapes.
    """
    min_steps = 4  # for modes that the start lacks
    symmetric, laminas = _is_symmetric(laminas), laminas.acting(thetas)
    smooth = _polynomials(stack.n_lamina)
    reduced = laminas.project_z(smooth)
    found = _smooth_modes(reduced, stack, thetas, smooth, n_mode)
    shifts = [shear_shift(stack, theta) for theta in thetas]
    values, modes = zip(*found, strict=True)
    samples = _elastic(values, modes, shifts)
    shapes = leading_shapes(
        laminas.plan, {f: _over_plan(reduced, f, samples).reshape(laminas.plan.size(f), -1) for f in FIELDS}
    )

    full = on_shapes(laminas, shapes)
    rigid = rigid_body_modes(full, stack, dict.fromkeys(FIELDS, np.eye(stack.n_lamina)))
    solver = solver_over_laminas(full)
    eigenvalues, snapshots = [], []
    for theta, shift, rough in zip(thetas, shifts, modes, strict=True):
        start = _on_shapes(reduced, shapes, smooth, rough[:, n_rigid(stack) :])
        exact, vectors = solver.modes(theta, shift, start, n_mode, _TOLERANCE, rigid, min_steps)
        eigenvalues.append(exact)
        snapshots.append(vectors[:, :n_mode])
    elastic = _elastic(eigenvalues, snapshots, shifts)
    functions, energy = _functions_and_energies(full, stack, thetas, elastic, symmetric=symmetric)

    def worst_error(phi: Phi) -> float:
        """Return the largest relative error of a frequency over the shapes with these functions."""
        reduced_solver = solver_over_plan(full.project_z(phi))
        errors = []
        for theta, shift, exact, snapshot in zip(thetas, shifts, eigenvalues, snapshots, strict=True):
            start = _over_phi(full, phi, snapshot[:, n_rigid(stack) :])
            over_phi = _over_phi(full, phi, rigid)
            approximate, _ = reduced_solver.modes(theta, shift, start, n_mode, _TOLERANCE, over_phi)
            errors.append(np.max((approximate - exact) / (2.0 * np.maximum(exact, SOFT * shift))))
        return float(max(errors))

    phi = _enough(functions, energy, worst_error, tolerance)
    return ThroughThicknessBasis(phi=phi, snapshots=tuple(_on_mesh(full, shapes, phi, s) for s in snapshots))


def _polynomials(n_lamina: int) -> Phi:
    """Return orthonormal polynomials over the height."""
    z = np.linspace(-1.0, 1.0, n_lamina)
    polynomials = np.polynomial.legendre.legvander(z, min(_POLYNOMIALS, n_lamina) - 1)
    return dict.fromkeys(FIELDS, la.qr(polynomials, mode="economic")[0])


def _enough(
    functions: Mapping[Field, Vector],
    energy: Mapping[Field, Vector],
    worst_error: Callable[[Phi], float],
    tolerance: float,
) -> Phi:
    """Return as many principal functions of each field as keep the error of the frequencies in the tolerance."""
    rounding = 1e-15  # energy that no function can win any more
    allowed = 2.0 * tolerance  # an energy error of 2 e is a frequency error of e
    while True:
        keep = {f: max(int(np.count_nonzero(_tail(energy[f]) > allowed)), _FEWEST[f]) for f in FIELDS}
        phi: Phi = {f: la.qr(functions[f][:, : keep[f]], mode="economic")[0] for f in FIELDS}
        error = worst_error(phi)
        if error < tolerance or allowed < rounding:
            return phi
        allowed *= min(0.5, 0.7 * tolerance / error)


def _over_plan(assembly: Assembly, field: Field, x: Vector) -> Vector:
    """Return a field of displacement vectors with the planar index first, (n_planar, n_z, k)."""
    part = x[assembly.slices()[field]]
    return part.reshape(assembly.n_z[field], assembly.plan.size(field), -1).transpose(1, 0, 2)


def _on_shapes(reduced: Assembly, shapes: ShapePlan, phi: Phi, x: Vector) -> Vector:
    """Return displacements in coordinates of the thickness basis on the meshed plan, for all laminas over shapes."""
    parts = []
    for f in FIELDS:
        over = shapes.coordinates(f, _over_plan(reduced, f, x))
        parts.append(np.einsum("kj,pjm->kpm", phi[f], over, optimize=True).reshape(-1, x.shape[1]))
    return np.vstack(parts)


def _on_mesh(full: Assembly, shapes: ShapePlan, phi: Phi, x: Vector) -> Vector:
    """Return displacements of all laminas over shapes in coordinates of the thickness basis on the meshed plan."""
    parts = []
    for f in FIELDS:
        over = np.einsum("kj,pkm->jpm", phi[f], _over_plan(full, f, x), optimize=True)
        parts.append(np.einsum("np,jpm->jnm", shapes.shape[f], over, optimize=True).reshape(-1, x.shape[1]))
    return np.vstack(parts)


def _functions_and_energies(
    full: Assembly, stack: Stack, thetas: Sequence[Mapping[str, float]], samples: Vector, *, symmetric: bool
) -> tuple[dict[Field, Vector], dict[Field, Vector]]:
    """Return principal through-thickness functions of each field and the energy that each carries in `samples`.

    An error e(z) of a field costs energy in the laminas and in the interfaces; with the mean energy of the
    samples' planar shapes both become one norm over z.
    """
    regular = 1e-6  # keeps the norm of the mean slope definite against a sawtooth over the laminas
    where, n, t = full.slices(), stack.n_lamina, stack.pitch
    fields = {f: samples[where[f]].reshape(n, -1, samples.shape[1]) for f in FIELDS}
    form = full.plan.form
    q11, _, q22, _ = stack.material.plane_stress()
    shear = stack.contact.pressure * float(np.exp(np.mean([np.log(theta["G_f"]) for theta in thetas])))
    d, a = jump(n).toarray(), mean(n).toarray()
    rigid = np.column_stack([np.ones(n), stack.lamina_z])[:, :n]

    def gram(weight: sp.csr_matrix, field: Field) -> Vector:
        plain = fields[field].transpose(1, 0, 2)
        weighted = (weight @ plain.reshape(plain.shape[0], -1)).reshape(plain.shape)
        products = np.tensordot(plain, weighted, axes=([0, 2], [0, 2]))
        return (products + products.T) / 2.0

    def size(weight: sp.csr_matrix, field: Field) -> float:
        return float(np.trace(gram(weight, field)))

    membrane = gram(form("u", "u"), "u") + gram(form("v", "v"), "v")
    deflection = gram(form("w", "w"), "w")
    stretch = q11 * size(form("u", "u", ("x", "x")), "u") + q22 * size(form("v", "v", ("y", "y")), "v")
    stretch /= np.trace(membrane)
    slope = size(form("w", "w", ("x", "x")) + form("w", "w", ("y", "y")), "w") / np.trace(deflection)
    over_u = t * stretch * np.eye(n) + shear / t * d.T @ d
    over_w = shear * t * slope * (a.T @ a + regular * np.eye(n)) + stack.contact.normal_modulus / t * d.T @ d
    u, u_energy = _principal_functions(membrane, over_u, rigid, symmetric=symmetric)
    w, w_energy = _principal_functions(deflection, over_w, rigid[:, :1], symmetric=symmetric)
    return {"u": u, "v": u, "w": w}, {"u": u_energy, "v": u_energy, "w": w_energy}


def _tail(energy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return for each function the energy that it and all after it carry."""
    return np.cumsum(np.maximum(energy, 0.0)[::-1])[::-1]
