"""Functions of z: a few displacement profiles over the height that stand for all laminas.

They are drawn by proper orthogonal decomposition from the modes of a coarse plan with all laminas and all
interfaces, so weak interfaces, uneven pressure and masses on the faces shape them. Polynomials alone do not
do: the membrane stress has thin layers at both faces, and a weak interface is a jump.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from model.assemble import assemble
from model.mesh import FIELDS, Field
from model.solver import solver_over_laminas, solver_over_plan
from model.stack import Mesh, Stack
from model.system import Assembly

Vector = NDArray[np.float64]
Phi = Mapping[Field, Vector]

N_RIGID = 6
COARSE = Mesh(n_x=4, n_y=2)
SPARE = 8  # vectors iterated beyond the modes asked for, so that the last ones converge as fast as the first
_TOLERANCE = 1e-7  # relative, of the coarse eigenvalues
_FEWEST = 8  # functions to begin with


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
        The coarse modes in that reduction, one array for each value of G_f.
    """

    phi: Phi
    coarse: Assembly
    snapshots: tuple[NDArray[np.float64], ...]


def shear_shift(stack: Stack, theta: Mapping[str, float]) -> float:
    """Return the squared angular frequency, (rad/s)**2, at which half a shear wave fits the length."""
    shear = theta["G_f"] * stack.contact.pressure
    return float(shear / (theta["density"] * stack.material.density) * (np.pi / stack.length) ** 2)


def _principal_functions(
    values: Sequence[NDArray[np.float64]],
    weights: Sequence[sp.csr_matrix],
    first: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return orthonormal functions of z: `first`, then the others by how much of `values` they carry.

    Parameters
    ----------
    values : sequence of (n_lamina, n_planar, n_mode)
        Fields to represent.
    weights : sequence of (n_planar, n_planar)
        Planar form of each, in which its size is measured.
    first : (n_lamina, m)
        Functions that must be in the span.

    Returns
    -------
    (n_lamina, n_lamina)
    """
    basis = la.qr(first, mode="economic")[0]
    gram = np.zeros((first.shape[0], first.shape[0]))
    for value, weight in zip(values, weights, strict=True):
        plain = value.transpose(1, 0, 2)
        weighted = (weight @ plain.reshape(plain.shape[0], -1)).reshape(plain.shape)
        gram += np.tensordot(plain, weighted, axes=([0, 2], [0, 2]))
    gram -= basis @ (basis.T @ gram)
    gram -= (gram @ basis) @ basis.T
    vectors = la.eigh((gram + gram.T) / 2.0)[1][:, : basis.shape[1] - 1 : -1]
    return np.asarray(la.qr(np.hstack([basis, vectors]), mode="economic")[0])


def _over_phi(full: Assembly, phi: Phi, x: Vector) -> Vector:
    """Return displacements of all laminas, (full.size, k), in coordinates of the functions of z."""
    where, k = full.slices(), x.shape[1]
    return np.vstack([(phi[f].T @ x[where[f]].reshape(full.n_z[f], -1)).reshape(-1, k) for f in FIELDS])


def z_basis(stack: Stack, G_f: Sequence[float], n_mode: int, tolerance: float) -> ZBasis:
    """Draw functions of z from the modes of a coarse plan.

    The number of functions grows until the coarse plan solved with them has the frequencies that it has
    with all laminas.

    Parameters
    ----------
    stack : Stack
        The stack; its mesh is replaced by 4 x 2 elements.
    G_f : sequence of float
        Contact stiffness parameters at which the modes are taken.
    n_mode : int
        Number of modes for each, the six rigid-body modes included.
    tolerance : float
        Largest relative error of a coarse frequency.
    """
    full = assemble(dataclasses.replace(stack, mesh=COARSE))
    solver = solver_over_laminas(full)
    start = np.random.default_rng(0).standard_normal((full.size, n_mode + SPARE))
    thetas = [{**full.theta, "G_f": value} for value in G_f]
    eigenvalues, snapshots = [], []
    for theta in thetas:
        found, start = solver.modes(theta, shear_shift(stack, theta), start, n_mode, _TOLERANCE)
        eigenvalues.append(found)
        snapshots.append(start[:, :n_mode])

    where, n = full.slices(), stack.n_lamina
    fields: dict[Field, list[Vector]] = {field: [] for field in FIELDS}
    for values, modes in zip(eigenvalues, snapshots, strict=True):
        elastic = modes[:, N_RIGID:] / np.sqrt(values[N_RIGID:])  # unit energy: every mode counts alike
        for field in FIELDS:
            fields[field].append(elastic[where[field]].reshape(n, -1, elastic.shape[1]))
    form = full.plan.form
    stretch = [form("u", "u", ("x", "x")), form("v", "v", ("y", "y"))]
    slope = form("w", "w", ("x", "x")) + form("w", "w", ("y", "y"))
    rigid = np.column_stack([np.ones(n), stack.lamina_z])
    membrane = _principal_functions(
        fields["u"] + fields["v"], [w for w in stretch for _ in snapshots], rigid[:, :n]
    )
    bending = _principal_functions(fields["w"], [slope for _ in snapshots], rigid[:, :1])

    for n_membrane in range(min(_FEWEST, n), n + 1, 2):
        u = membrane[:, :n_membrane]
        phi: Phi = {"u": u, "v": u, "w": bending[:, : max(n_membrane - 2, 1)]}
        coarse = full.project_z(phi)
        reduced_solver = solver_over_plan(coarse)
        errors = []
        for theta, exact, modes in zip(thetas, eigenvalues, snapshots, strict=True):
            shift = shear_shift(stack, theta)
            found, _ = reduced_solver.modes(theta, shift, _over_phi(full, phi, modes), n_mode, _TOLERANCE)
            errors.append(np.max(np.sqrt(found[N_RIGID:] / exact[N_RIGID:]) - 1.0))
        if max(errors) < tolerance:
            break
    return ZBasis(phi=phi, coarse=coarse, snapshots=tuple(_over_phi(full, phi, s) for s in snapshots))
