"""Matrices whose rows are labelled by node and degree of freedom, read and checked.

Checks say whether they can be those of a vibrating structure: signs, mass, motion as a rigid body, units.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from model.matrices.text import refuse

Index = NDArray[np.int64]

DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
"""Degrees of freedom 1 to 6 of a node: displacements along the axes, rotations about them."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Labelled:
    """A symmetric matrix as a file holds it, in its units.

    Attributes
    ----------
    source : str
        The file, for messages.
    node, dof : (n,) int
        Label of each row: node number and degree of freedom, 1 to 6.
    matrix : (n, n) sparse
        With both triangles.
    """

    source: str
    node: Index
    dof: Index
    matrix: sp.csr_matrix

    @property
    def key(self) -> Index:
        """Labels as one number each, (n,)."""
        return key(self.node, self.dof)

    @property
    def held(self) -> NDArray[np.bool_]:
        """Which rows, (n,), a program holds by an enormous stiffness on the diagonal."""
        held = 1e30  # Abaqus writes 1e36 on the diagonal where a displacement is prescribed
        return np.asarray(self.matrix.diagonal() >= held)

    def rows(self, kept: NDArray[np.bool_]) -> Labelled:
        """Return the matrix of some rows, (n,), and their columns."""
        part = sp.csr_matrix(self.matrix[kept][:, kept])
        return replace(self, node=self.node[kept], dof=self.dof[kept], matrix=part)


@dataclass(frozen=True, kw_only=True)
class Units:
    """A consistent system of units.

    Attributes
    ----------
    name : str
        Its name, such as "mm-t-s".
    length, mass, time : float
        Its units in m, kg and s.
    """

    name: str
    length: float
    mass: float
    time: float

    def factor(self, target: Literal["M", "C", "K"]) -> float:
        """Return an entry of a translation in SI units."""
        return self.mass / self.time ** {"M": 0, "C": 1, "K": 2}[target]


UNITS = {
    one.name: one
    for one in (
        Units(name="m-kg-s", length=1.0, mass=1.0, time=1.0),
        Units(name="mm-t-s", length=1e-3, mass=1e3, time=1.0),  # N and MPa: the usual one
        Units(name="mm-kg-s", length=1e-3, mass=1.0, time=1.0),  # mN and kPa
        Units(name="mm-kg-ms", length=1e-3, mass=1.0, time=1e-3),  # kN and GPa
        Units(name="mm-g-ms", length=1e-3, mass=1e-3, time=1e-3),  # N and MPa
        Units(name="m-t-s", length=1.0, mass=1e3, time=1.0),  # kN and kPa
        Units(name="in-lbfs2/in-s", length=0.0254, mass=175.126835, time=1.0),  # lbf and psi
        Units(name="in-kips2/in-s", length=0.0254, mass=175126.835, time=1.0),  # kip and ksi
        Units(name="ft-slug-s", length=0.3048, mass=14.5939029, time=1.0),  # lbf
        Units(name="ft-kips2/ft-s", length=0.3048, mass=14593.9029, time=1.0),  # kip
    )
}


WHOLE: dict[Literal["K", "M", "C"], str] = {"K": "stiffness", "M": "mass", "C": "damping"}
"""What each matrix is called."""


def name_of(node: Index, dof: Index, row: int | np.integer[Any]) -> str:
    """Return the label of a row in words."""
    one = int(dof[row])
    return f"node {node[row]}, {DIRECTIONS[one - 1] if 1 <= one <= len(DIRECTIONS) else f'degree of freedom {one}'}"


def key(node: Index, dof: Index) -> Index:
    """Return labels as one number each."""
    n_dof = 8  # more than a node has, so that a label is one number
    return np.asarray(node, dtype=np.int64) * n_dof + np.asarray(dof, dtype=np.int64)


def labelled(source: str, label: Index, row: Index, column: Index, value: NDArray[np.float64]) -> Labelled:
    """Return the matrix of some entries, (m,), and labels, (n, 2): nodes and degrees of freedom.

    One triangle, either of the two or a mixture, is completed; a full matrix must be symmetric.

    Raises
    ------
    MatricesError
        A label is no displacement of a node, or an entry is no number; one of either is there twice, or an entry
        differs from its mirror image. The message names the first of them.
    """
    node, dof = label.T
    strange = (node < 1) | (dof < 1) | (dof > len(DIRECTIONS))
    if strange.any():
        i = int(np.argmax(strange))
        refuse(
            f"{source}: row {i + 1} is {name_of(node, dof, i)}, which is no displacement of a node (1 to 6, or x, y, "
            "z, rx, ry, rz) but an internal variable: a Lagrange multiplier, a scalar point, pressure, temperature. "
            "Write the matrices without them (ties by penalty or elimination, no acoustic elements); or does the table "
            "count from 0?"
        )
    _, first, count = np.unique(key(node, dof), return_index=True, return_counts=True)
    if (count > 1).any():
        refuse(
            f"{source}: {name_of(node, dof, first[np.argmax(count > 1)])} is there {count.max()} times. A sector with "
            "cyclic symmetry has real and imaginary rows; write the matrices of the whole structure"
        )

    def place(i: int) -> str:
        return f"{source}: entry ({name_of(node, dof, row[i])}; {name_of(node, dof, column[i])}) is"

    if not np.isfinite(value).all():
        i = int(np.argmin(np.isfinite(value)))
        refuse(f"{place(i)} {value[i]}; a finite number is needed")
    n = node.size
    matrix = sp.csr_matrix((value, (row, column)), shape=(n, n))
    if matrix.nnz < value.size:
        _, first = np.unique(row * n + column, return_index=True)
        i = int(np.setdiff1d(np.arange(value.size), first)[0])
        refuse(
            f"{place(i)} there twice; {value.size - first.size} entries are. Two files or two steps seem to be written "
            "one after the other: keep one of them"
        )
    pattern = sp.csr_matrix((np.ones(matrix.nnz), matrix.indices, matrix.indptr), shape=(n, n))
    lower, upper = sp.tril(pattern, -1), sp.triu(pattern, 1)
    if (lower + upper).nnz == 0 or lower.multiply(upper.T).nnz == 0:
        both = matrix + matrix.T - sp.diags_array(matrix.diagonal())
    else:
        _check_symmetric(source, matrix, node, dof)
        both = (matrix + matrix.T) / 2.0
    return Labelled(source=source, node=node, dof=dof, matrix=sp.csr_matrix(both))


def _check_symmetric(source: str, matrix: sp.csr_matrix, node: Index, dof: Index) -> None:
    # of the two diagonal entries: text of seven digits is no better, gyroscopic terms are far larger
    asymmetric = 1e-6
    size = np.sqrt(np.abs(matrix.diagonal()))
    difference = sp.coo_matrix(abs(matrix - matrix.T))
    allowed = asymmetric * size[difference.row] * size[difference.col]
    beyond = difference.data > allowed
    if beyond.any():
        worst = int(np.argmax(np.where(beyond, difference.data, 0.0)))
        i, j = int(difference.row[worst]), int(difference.col[worst])
        refuse(
            f"{source}: not symmetric: {matrix[i, j]:.9g} couples {name_of(node, dof, i)} to {name_of(node, dof, j)}, "
            f"{matrix[j, i]:.9g} the other way. Friction, follower loads, rotors, fluids and u-p elements give such "
            "matrices; write those of the structure alone"
        )


def placed(given: Labelled, node: Index, dof: Index, of: str) -> sp.csr_matrix:
    """Return a matrix in the rows of another one.

    Parameters
    ----------
    given : Labelled
        The matrix; it may lack rows, where it is zero.
    node, dof : (n,) int
        Labels of the rows of the other one.
    of : str
        What that is, for messages.

    Raises
    ------
    MatricesError
        A row has a label that the other one lacks.
    """
    wanted, own = key(node, dof), given.key
    order = np.argsort(wanted)
    at = order[np.minimum(np.searchsorted(wanted, own, sorter=order), wanted.size - 1)]
    there = wanted[at] == own
    strange = ~there & (np.diff(given.matrix.indptr) > 0)
    if strange.any():
        refuse(
            f"{given.source}: {name_of(given.node, given.dof, np.argmax(strange))} is not among the rows of {of}; "
            f"{int(strange.sum())} rows are not. Write all matrices from one model, with the same supports; or is one "
            "of the files cut off?"
        )
    kept = np.flatnonzero(there)
    turn = sp.csr_matrix((np.ones(kept.size), (at[kept], kept)), shape=(wanted.size, own.size))
    return sp.csr_matrix(turn @ given.matrix @ turn.T)


def check_rows(
    stiffness: sp.csr_matrix, mass: sp.csr_matrix, node: Index, dof: Index
) -> tuple[NDArray[np.bool_], list[str]]:
    """Return which rows do nothing, (n,), and notes.

    Raises
    ------
    MatricesError
        There is no mass, a diagonal entry is negative, or a row couples without a diagonal: a Lagrange multiplier.
    """
    nothing = 1e-14  # of the largest diagonal entry: rounding
    root = 4.4e-8  # least share of an entry's size beyond which a coupling without a diagonal is meant
    zero = {}
    for what, matrix in (("stiffness", stiffness), ("mass", mass)):
        diagonal = matrix.diagonal()
        largest = float(np.abs(diagonal).max(initial=0.0))
        if largest == 0.0:
            refuse(
                f"the {what} matrix is zero; "
                + ("give the material a density" if what == "mass" else "no structure vibrates without stiffness")
            )
        if (diagonal < -nothing * largest).any():
            i = int(np.argmin(diagonal))
            refuse(
                f"{name_of(node, dof, i)} has a {what} of {diagonal[i]:.4g}, below zero; no part of a "
                "structure at rest has that. Is a factor too small, or a matrix not what its file says?"
            )
        zero[what] = np.abs(diagonal) <= nothing * largest
        coupling = abs(matrix).max(axis=1).toarray().reshape(-1)
        lagrange = zero[what] & (coupling > root * largest)
        if lagrange.any():
            i = int(np.argmax(lagrange))
            refuse(
                f"{name_of(node, dof, i)} couples to others in the {what} matrix with nothing on its "
                f"diagonal: a Lagrange multiplier ({int(lagrange.sum())} rows are), or the file is cut off. Write "
                "ties and contacts by elimination or penalty"
            )
    idle = zero["stiffness"] & zero["mass"]
    notes = []
    if idle.any():
        notes.append(f"{int(idle.sum())} rows have neither stiffness nor mass and are left out")
    massless = int((zero["mass"] & ~idle).sum())
    if massless:
        notes.append(f"{massless} rows have no mass; they follow the others statically, as the reduction takes them")
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
    mass: sp.csr_matrix,
    motion: NDArray[np.float64],
    size: NDArray[np.float64] | None,
    stated: float | None,
    units: Units,
    *,
    complete: bool,
) -> list[str]:
    """Return mass and inertia in words, and what no structure has in them.

    Parameters
    ----------
    mass : (n, n) sparse
        Mass matrix, SI.
    motion : (n, 6)
        Motions of a rigid body.
    size : (3,) float, optional
        Of the box about all nodes, m, where it is known.
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
    held_mass = 0.2  # more than the nodes of a support hold, which held matrices lack
    same_mass = 0.02  # of a stated mass: what weighing and a model without screws leave
    moved = motion.T @ (mass @ motion)
    weights = np.diag(moved)[:3]
    total = float(weights.max())
    if total <= 0.0:
        refuse("moving the structure moves no mass; is the mass matrix that of another model?")
    if stated is not None:
        least = 1.0 - (same_mass if complete else held_mass)
        if not least * stated <= total <= (1.0 + same_mass) * stated:
            found = total / units.mass
            right = [u.name for u in UNITS.values() if least <= found * u.mass / stated <= 1.0 + same_mass]
            hint = f"; in {' or '.join(right)} it would be right" if right else ""
            refuse(f"in units {units.name} the matrices weigh {total:.4g} kg; total_mass_kg is {stated:.4g}{hint}")
    along = "" if np.ptp(weights) <= 1e-6 * total else f" (along x, y, z {', '.join(f'{w:.4g}' for w in weights)} kg)"
    words, strange = f"total mass {total:.6g} kg{along}", []
    if complete and np.abs(moved[:3, :3] - total * np.eye(3)).max() > same_mass * total:
        strange.append(
            "it does not weigh the same along x, y and z though all displacements are there, as a structure does: is "
            "the table of rows in the order of the matrices?"
        )
    if size is not None:
        about_centre = moved[3:, 3:] - moved[3:, :3] @ np.linalg.pinv(moved[:3, :3]) @ moved[:3, 3:]
        words += f", inertia about its centre {', '.join(f'{value:.4g}' for value in np.diag(about_centre))} kg m2"
        words += f"; {' by '.join(f'{side:.4g}' for side in size)} m"
        strange += _odd_density(total, size, units)
    return [words, *strange]


def _odd_density(mass: float, size: NDArray[np.float64], units: Units) -> list[str]:
    """Say that no structure is so light or so heavy: its units are others than stated.

    What a plane structure or a line lacks of three extents is taken to be as large as the least that it has.
    """
    flat = 1e-3  # of the largest extent, below which nodes do not say how thick a structure is
    least = (1e-3, 1e-6)  # kg/m3: a truss of aluminium in a box ten times as wide as its tubes are long; a wire
    most = 3e4  # kg/m3: more than osmium
    wide = size > flat * size.max()
    box = float(np.prod(np.where(wide, size, size[wide].min(initial=size.max()))))
    if box <= 0.0 or least[int(not wide.all())] <= mass / box <= most:
        return []
    return [
        f"the box about its nodes would hold {mass / box:.2g} kg for each m3, as no structure does: are the units of "
        f"all files {units.name}? State total_mass_kg, which checks them"
    ]
