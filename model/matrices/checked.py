"""Whether matrices can be those of a vibrating structure: signs, mass, motion as a rigid body, units."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from model.matrices.labelled import UNITS, Index, Units, name_of
from model.stack.errors import MatricesError

_SAME_MASS = 0.02  # of a stated mass: what weighing and a model without screws leave
_HELD_MASS = 0.2  # more than the nodes of a support hold, which held matrices lack
_NOTHING = 1e-14  # of the largest diagonal entry: rounding
_ROOT = 4.4e-8  # least share of an entry's size beyond which a coupling without a diagonal is meant


def check_rows(
    stiffness: sp.csr_matrix, mass: sp.csr_matrix, node: Index, dof: Index
) -> tuple[NDArray[np.bool_], list[str]]:
    """Return which rows do nothing, (n,), and notes.

    Raises
    ------
    MatricesError
        There is no mass, a diagonal entry is negative, or a row couples without a diagonal: a Lagrange multiplier.
    """
    zero = {}
    for what, matrix in (("stiffness", stiffness), ("mass", mass)):
        diagonal = matrix.diagonal()
        largest = float(np.abs(diagonal).max(initial=0.0))
        if largest == 0.0:
            message = f"the {what} matrix is zero; " + (
                "give the material a density" if what == "mass" else "no structure vibrates without stiffness"
            )
            raise MatricesError(message)
        if (diagonal < -_NOTHING * largest).any():
            i = int(np.argmin(diagonal))
            message = (
                f"{name_of(int(node[i]), int(dof[i]))} has a {what} of {diagonal[i]:.4g}, below zero; no part of a "
                "structure at rest has that. Is a factor too small, or a matrix not what its file says?"
            )
            raise MatricesError(message)
        zero[what] = np.abs(diagonal) <= _NOTHING * largest
        coupling = abs(matrix).max(axis=1).toarray().reshape(-1)
        lagrange = zero[what] & (coupling > _ROOT * largest)
        if lagrange.any():
            i = int(np.argmax(lagrange))
            message = (
                f"{name_of(int(node[i]), int(dof[i]))} couples to others in the {what} matrix with nothing on its "
                f"diagonal: a Lagrange multiplier ({int(lagrange.sum())} rows are). Write ties and contacts by "
                "elimination or penalty"
            )
            raise MatricesError(message)
    idle = zero["stiffness"] & zero["mass"]
    notes = []
    if idle.any():
        notes.append(f"{int(idle.sum())} rows have neither stiffness nor mass and are left out")
    massless = int((zero["mass"] & ~idle).sum())
    if massless:
        notes.append(
            f"{massless} rows have no mass; they follow the others statically, as the reduction takes them"
        )
    return idle, notes


def rigid_motion(location: NDArray[np.float64], dof: Index) -> NDArray[np.float64]:
    """Return the six motions of a rigid body, (n, 6): along x, y, z, and about them through the mean place."""
    arm = location - location.mean(axis=0)
    found = np.zeros((dof.size, 6))
    for axis in range(3):
        found[dof == axis + 1, axis] = 1.0
        found[dof == axis + 4, axis + 3] = 1.0
        turned = np.cross(np.eye(3)[axis], arm)
        for i in range(3):
            found[dof == i + 1, axis + 3] = turned[dof == i + 1, i]
    return found


def check_mass(
    mass: sp.csr_matrix, motion: NDArray[np.float64], stated: float | None, units: Units, *, complete: bool
) -> str:
    """Return mass and inertia in words.

    Parameters
    ----------
    mass : (n, n) sparse
        Mass matrix, SI.
    motion : (n, 6)
        Motions of a rigid body.
    stated : float, optional
        What the structure weighs, kg.
    units : Units
        Those that the matrices are stated to have.
    complete : bool
        Whether all displacements of all nodes are in the matrix.

    Raises
    ------
    MatricesError
        It weighs something else; the message names units with which it would be right.
    """
    moved = motion.T @ (mass @ motion)
    weights = np.diag(moved)[:3]
    total = float(weights.max())
    if total <= 0.0:
        message = "moving the structure moves no mass; is the mass matrix that of another model?"
        raise MatricesError(message)
    if stated is not None:
        least = 1.0 - (_SAME_MASS if complete else _HELD_MASS)
        if not least * stated <= total <= (1.0 + _SAME_MASS) * stated:
            found = total / units.mass
            right = [u.name for u in UNITS.values() if least <= found * u.mass / stated <= 1.0 + _SAME_MASS]
            hint = f"; in {' or '.join(right)} it would be right" if right else ""
            message = f"in units {units.name} the matrices weigh {total:.4g} kg; total_mass_kg is {stated:.4g}{hint}"
            raise MatricesError(message)
    own = moved[3:, 3:] - moved[3:, :3] @ np.linalg.pinv(moved[:3, :3]) @ moved[:3, 3:]
    inertia = ", ".join(f"{value:.4g}" for value in np.diag(own))
    along = (
        ""
        if np.ptp(weights) <= 1e-6 * total
        else f" along x, y, z {', '.join(f'{w:.4g}' for w in weights)} kg:"
    )
    return f"total mass {total:.6g} kg{along}, inertia about its centre {inertia} kg m2"
