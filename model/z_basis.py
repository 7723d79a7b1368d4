"""Functions of z: a few displacement profiles over the height that stand for all laminas.

They are drawn by proper orthogonal decomposition from the modes of a coarse plan with all laminas and all
interfaces, so weak interfaces, uneven pressure and masses on the faces shape them. Polynomials alone do not
do: the membrane stress has thin layers at both faces, and a weak interface is a jump.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from model.mesh import FIELDS, Field
from model.rigid import rigid_body_modes
from model.solver import solver_over_laminas, solver_over_plan
from model.stack import Mesh, Stack
from model.system import Assembly
from model.tangential_contact import jump, mean

Vector = NDArray[np.float64]
Phi = Mapping[Field, Vector]

N_RIGID = 6
COARSE = Mesh(n_x=4, n_y=2)
SPARE = 8  # vectors iterated beyond the modes asked for, so that the last ones converge as fast as the first
_TOLERANCE = 1e-6  # relative change of the coarse eigenvalues in the last step; their error is far smaller
_FEWEST: Mapping[Field, int] = {"u": 2, "v": 2, "w": 1}  # those of rigid-body motion
_MIN_STEPS = 4  # for modes that the start lacks
_POLYNOMIALS = 6
_FREE = 1e-6  # of `shear_shift`: an eigenvalue below it is rigid-body motion
_ROUNDING = 1e-15  # energy that no function can win any more
_MIRRORED = 1e-9  # relative difference up to which a stack counts as symmetric about mid-height
_REGULAR = 1e-6  # keeps the norm of the mean slope definite against a sawtooth over the laminas


@dataclass(frozen=True, eq=False, kw_only=True)
class ZBasis:
    """Functions of z and the coarse modes that they were drawn from.

    Attributes
    ----------
    phi : mapping of field to (n_lamina, n_function)
        Orthonormal columns. Uniform and linear displacement over z are among those of u and v, uniform
        displacement among those of w, so rigid-body modes are exact.
    coarse : Assembly
        The coarse plan's equations of motion, reduced by `phi`.
    snapshots : tuple of (coarse.size, n_vector)
        The coarse modes in that reduction, one array for each sample of the parameters.
    """

    phi: Phi
    coarse: Assembly
    snapshots: tuple[NDArray[np.float64], ...]


def shear_shift(stack: Stack, theta: Mapping[str, float]) -> float:
    """Return the squared angular frequency, (rad/s)**2, at which half a shear wave fits the length."""
    shear = theta["G_f"] * stack.contact.pressure
    return float(shear / (theta["density"] * stack.material.density) * (np.pi / stack.length) ** 2)


def _is_symmetric(assembly: Assembly) -> bool:
    """Return whether the stack is its own mirror image about mid-height."""
    sign = {"u": 1.0, "v": 1.0, "w": -1.0}
    for term in assembly.terms:
        for kron in term.krons:
            z = sp.csr_matrix(kron.z)
            turned = sign[kron.row] * sign[kron.column] * z[::-1, ::-1]
            if abs(z - turned).max() > _MIRRORED * abs(z).max():
                return False
    return True


def _principal_functions(
    values: NDArray[np.float64],
    weight: sp.csr_matrix,
    norm: NDArray[np.float64],
    first: NDArray[np.float64],
    *,
    symmetric: bool,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return functions of z: `first`, then the others by the energy that leaving them out would cost.

    Parameters
    ----------
    values : (n_lamina, n_planar, n_sample)
        Fields to represent.
    weight : (n_planar, n_planar)
        Planar form in which their size is measured.
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
    plain = values.transpose(1, 0, 2)
    weighted = (weight @ plain.reshape(plain.shape[0], -1)).reshape(plain.shape)
    gram = np.tensordot(plain, weighted, axes=([0, 2], [0, 2]))
    gram = (gram + gram.T) / 2.0
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


def _from_phi(reduced: Assembly, phi: Phi, x: Vector) -> Vector:
    """Return displacements in coordinates of the functions of z on all laminas, (n, k)."""
    where, k = reduced.slices(), x.shape[1]
    return np.vstack([(phi[f] @ x[where[f]].reshape(reduced.n_z[f], -1)).reshape(-1, k) for f in FIELDS])


def _over_phi(full: Assembly, phi: Phi, x: Vector) -> Vector:
    """Return displacements of all laminas, (full.size, k), in coordinates of the functions of z."""
    where, k = full.slices(), x.shape[1]
    return np.vstack([(phi[f].T @ x[where[f]].reshape(full.n_z[f], -1)).reshape(-1, k) for f in FIELDS])


def _coarse_start(
    full: Assembly, stack: Stack, theta: Mapping[str, float], n_vector: int, rigid: Vector
) -> Vector:
    """Return the lowest modes with polynomials over z, (full.size, n_vector): a start for all laminas."""
    z = np.linspace(-1.0, 1.0, stack.n_lamina)
    polynomials = np.polynomial.legendre.legvander(z, min(_POLYNOMIALS, stack.n_lamina) - 1)
    phi: Phi = dict.fromkeys(FIELDS, la.qr(polynomials, mode="economic")[0])
    reduced = full.project_z(phi)
    start = np.random.default_rng(0).standard_normal((reduced.size, n_vector))
    _, found = solver_over_plan(reduced).modes(
        theta, shear_shift(stack, theta), start, n_vector - SPARE + N_RIGID, 1e-2, _over_phi(full, phi, rigid)
    )
    return _from_phi(reduced, phi, found[:, N_RIGID:])


def z_basis(
    stack: Stack, full: Assembly, thetas: Sequence[Mapping[str, float]], n_mode: int, tolerance: float
) -> ZBasis:
    """Draw functions of z from the modes of a coarse plan.

    The number of functions grows until the coarse plan solved with them has the frequencies that it has
    with all laminas.

    Parameters
    ----------
    stack : Stack
        The stack.
    full : Assembly
        Equations of motion of all its laminas on a coarse plan.
    thetas : sequence of mapping of str to float
        Parameters at which the modes are taken.
    n_mode : int
        Number of modes for each, the six rigid-body modes included.
    tolerance : float
        Largest relative error of a coarse frequency.
    """
    solver = solver_over_laminas(full)
    every = np.eye(stack.n_lamina)
    rigid = rigid_body_modes(full, stack, dict.fromkeys(FIELDS, every))
    start = _coarse_start(full, stack, thetas[0], n_mode - N_RIGID + SPARE, rigid)
    eigenvalues, snapshots = [], []
    for theta in thetas:
        found, vectors = solver.modes(
            theta, shear_shift(stack, theta), start, n_mode, _TOLERANCE, rigid, _MIN_STEPS
        )
        eigenvalues.append(found)
        snapshots.append(vectors[:, :n_mode])
        start = vectors[:, N_RIGID:]

    strained = [v > _FREE * shear_shift(stack, theta) for v, theta in zip(eigenvalues, thetas, strict=True)]
    elastic = np.hstack(  # of unit energy, so that every mode counts alike
        [m[:, e] / np.sqrt(v[e]) for m, v, e in zip(snapshots, eigenvalues, strained, strict=True)]
    )
    functions, energy = _functions_and_energies(full, stack, thetas, elastic)
    allowed = 2.0 * tolerance  # an energy error of 2 e is a frequency error of e
    while True:
        keep = {f: max(int(np.count_nonzero(_tail(energy[f]) > allowed)), _FEWEST[f]) for f in FIELDS}
        phi: Phi = {f: la.qr(functions[f][:, : keep[f]], mode="economic")[0] for f in FIELDS}
        coarse = full.project_z(phi)
        reduced_solver = solver_over_plan(coarse)
        errors = []
        for theta, exact, e, modes in zip(thetas, eigenvalues, strained, snapshots, strict=True):
            shift = shear_shift(stack, theta)
            found, _ = reduced_solver.modes(
                theta,
                shift,
                _over_phi(full, phi, modes[:, N_RIGID:]),
                n_mode,
                _TOLERANCE,
                _over_phi(full, phi, rigid),
            )
            errors.append(np.max(np.sqrt(found[e] / exact[e]) - 1.0))
        if max(errors) < tolerance or allowed < _ROUNDING:
            break
        allowed *= min(0.5, 0.7 * tolerance / max(errors))
    return ZBasis(phi=phi, coarse=coarse, snapshots=tuple(_over_phi(full, phi, s) for s in snapshots))


def _functions_and_energies(
    full: Assembly, stack: Stack, thetas: Sequence[Mapping[str, float]], samples: Vector
) -> tuple[dict[Field, Vector], dict[Field, Vector]]:
    """Return principal functions of z of each field and the energy that each carries in `samples`.

    An error e(z) of a field costs energy in the laminas and in the interfaces; with the mean energy of the
    samples' planar shapes both become one norm over z.
    """
    where, n, t = full.slices(), stack.n_lamina, stack.pitch
    fields = {f: samples[where[f]].reshape(n, -1, samples.shape[1]) for f in FIELDS}
    form = full.plan.form
    q11, _, q22, _ = stack.material.plane_stress()
    shear = stack.contact.pressure * float(np.exp(np.mean([np.log(theta["G_f"]) for theta in thetas])))
    d, a = jump(n).toarray(), mean(n).toarray()
    symmetric = _is_symmetric(full)
    rigid = np.column_stack([np.ones(n), stack.lamina_z])[:, :n]

    def size(weight: sp.csr_matrix, field: Field) -> float:
        flat = fields[field].transpose(1, 0, 2).reshape(weight.shape[0], -1)
        return float(np.vdot(flat, weight @ flat))

    planar_mass, plate_mass = form("u", "u"), form("w", "w")
    stretch = q11 * size(form("u", "u", ("x", "x")), "u") + q22 * size(form("v", "v", ("y", "y")), "v")
    stretch /= size(planar_mass, "u") + size(planar_mass, "v")
    slope = size(form("w", "w", ("x", "x")) + form("w", "w", ("y", "y")), "w") / size(plate_mass, "w")
    over_u = t * stretch * np.eye(n) + shear / t * d.T @ d
    over_w = shear * t * slope * (a.T @ a + _REGULAR * np.eye(n)) + stack.contact.normal_modulus / t * d.T @ d
    membrane = np.concatenate([fields["u"], fields["v"]], axis=2)
    u, u_energy = _principal_functions(membrane, planar_mass, over_u, rigid, symmetric=symmetric)
    w, w_energy = _principal_functions(fields["w"], plate_mass, over_w, rigid[:, :1], symmetric=symmetric)
    return {"u": u, "v": u, "w": w}, {"u": u_energy, "v": u_energy, "w": w_energy}


def _tail(energy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return for each function the energy that it and all after it carry."""
    return np.cumsum(np.maximum(energy, 0.0)[::-1])[::-1]
