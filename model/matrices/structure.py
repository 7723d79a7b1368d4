"""A structure of matrices and what may vary in it, read from its TOML file into SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from model.matrices.labelled import UNITS, WHOLE, Index, check_mass, check_rows, name_of, rigid_motion
from model.matrices.readers import Target
from model.matrices.rows import Rows, read_rows
from model.matrices.structure_file import StructureForm, TermForm, read_structure_form
from model.matrices.text import refuse
from model.stack.errors import MatricesError


@dataclass(frozen=True, kw_only=True)
class Factor:
    """What a term may be multiplied by, and how well that is known.

    Attributes
    ----------
    name : str
        The term's name.
    nominal : float
        Its value in the model as it is, 1 as a rule.
    std : float
        Prior standard deviation: of the factor, or of its natural logarithm where `scale` is "log".
    scale : "lin" or "log"
        Which of the two is normally distributed.
    lower, upper : float
        Bounds.
    """

    name: str
    nominal: float
    std: float
    scale: Literal["lin", "log"]
    lower: float
    upper: float

    def away(self, deviations: float) -> float:
        """Return the value some prior standard deviations from the nominal one, within the bounds."""
        by = deviations * self.std
        value = self.nominal * float(np.exp(by)) if self.scale == "log" else self.nominal + by
        return min(max(value, self.lower), self.upper)


@dataclass(frozen=True, eq=False, kw_only=True)
class SparseTerm:
    """A part of the equations: a factor, or none where it is always there, times a matrix in SI units, (n, n)."""

    name: str
    target: Target
    factor: str | None
    matrix: sp.csr_matrix


@dataclass(frozen=True, eq=False, kw_only=True)
class MatrixStructure:
    """A structure given by its matrices, in SI units.

    Attributes
    ----------
    name : str
        Its name.
    node, dof : (n,) int
        Label of each row.
    location : (n, 3) float
        Where it is, m; the number of the node where the file says no place.
    placed : bool
        Whether files say where nodes are.
    terms : tuple of SparseTerm
        K(theta) = K0 + sum of theta_j K_j, and so for M and C.
    factors : tuple of Factor
        What may vary.
    groups : mapping of str to (m,) int
        Nodes by the name of their group.
    band_Hz : float
        Frequency up to which modes are wanted.
    points, patches : tuple of str
        Groups: of single nodes where forces may act, and of nodes that forces move together.
    rigid_modes : int or None
        How many motions of a rigid body should cost no energy, if it is stated.
    notes : tuple of str
        What a user should know: mass, inertia, what was left out.
    """

    name: str
    node: Index
    dof: Index
    location: NDArray[np.float64]
    placed: bool
    terms: tuple[SparseTerm, ...]
    factors: tuple[Factor, ...]
    groups: Mapping[str, Index]
    band_Hz: float
    points: tuple[str, ...]
    patches: tuple[str, ...]
    rigid_modes: int | None
    notes: tuple[str, ...]

    @property
    def theta(self) -> dict[str, float]:
        """Nominal factors."""
        return {one.name: one.nominal for one in self.factors}

    def matrix(self, target: Target, theta: Mapping[str, float]) -> sp.csr_matrix:
        """Return M, C or K with some factors, (n, n)."""
        found = sp.csr_matrix((self.node.size, self.node.size))
        for term in self.terms:
            if term.target == target:
                found = found + (1.0 if term.factor is None else theta[term.factor]) * term.matrix
        return sp.csr_matrix(found)


def read_matrices(path: str | Path) -> MatrixStructure:
    """Read a structure and the matrices that its file names.

    Parameters
    ----------
    path : path-like
        TOML file with `[matrices]`, `[reduction]` and any number of `[[group]]`, `[[support]]` and `[[term]]`.

    Returns
    -------
    MatrixStructure
        In SI units, without what is held.

    Raises
    ------
    MatricesError
        A file cannot be read, or its matrices are not those of a vibrating structure; the message says what would
        be right.
    """
    path = Path(path)
    given = read_structure_form(path)
    try:
        return _structure(given, path.parent)
    except MatricesError as error:
        refuse(f"{path}: {error}")


def _structure(given: StructureForm, folder: Path) -> MatrixStructure:
    names = [one.name for one in given.term]
    if len(set(names)) < len(names) or not all(name.isidentifier() for name in names):
        refuse(f"term: names must differ and be one word each: {', '.join(names)}")
    rows, whole = read_rows(given, folder)
    always, varying = dict(whole), []
    for one in given.term:
        for target, matrix in _parts(one, rows, whole).items():
            name = f"{one.name}_{target}"
            varying.append(SparseTerm(name=name, target=target, factor=one.name, matrix=matrix))
            if one.contained and one.group is None and (target != "K" or given.matrices.stiffness):
                always[target] = always.get(target, 0.0 * matrix) - one.nominal * matrix
    _require_parts(always, whole, rows)
    fixed = [SparseTerm(name=f"{t}0", target=t, factor=None, matrix=matrix) for t, matrix in always.items()]
    reduction, sprung = given.reduction, {one.group for one in given.term}
    soft = [one.group for one in given.support if one.state == "released" and one.group not in sprung]
    found = MatrixStructure(
        name=given.name,
        node=rows.node,
        dof=rows.dof,
        location=rows.location,
        placed=rows.nodes is not None,
        terms=(*fixed, *varying),
        factors=tuple(_factor(one) for one in given.term),
        groups=rows.groups,
        band_Hz=reduction.band_Hz,
        points=rows.known(reduction.points),
        patches=rows.known(dict.fromkeys((*reduction.patches, *soft))),
        rigid_modes=given.matrices.rigid_modes,
        notes=rows.notes,
    )
    return _checked(found, given, rows)


def _checked(found: MatrixStructure, given: StructureForm, rows: Rows) -> MatrixStructure:
    """Return a structure without what is held and without rows that do nothing, with notes.

    Raises
    ------
    MatricesError
        As in `check_rows` and `check_mass`.
    """
    stiffness, mass = (found.matrix(target, found.theta) for target in ("K", "M"))
    idle, notes = check_rows(stiffness, mass, found.node, found.dof)
    n_node = (np.unique(found.node) if rows.nodes is None else rows.nodes.number).size
    notes += check_mass(
        mass,
        rigid_motion(found.location, found.dof),
        np.ptp(found.location, axis=0) if found.placed else None,
        given.matrices.total_mass_kg,
        UNITS[given.matrices.units],
        complete=bool(np.count_nonzero(found.dof <= 3) == 3 * n_node),
    )
    kept = ~(idle | rows.held(given.support))
    return replace(
        found, node=found.node[kept], dof=found.dof[kept], location=found.location[kept], notes=(*found.notes, *notes),
        terms=tuple(replace(term, matrix=sp.csr_matrix(term.matrix[kept][:, kept])) for term in found.terms),
    )  # fmt: skip


def _require_parts(left: Mapping[Target, sp.csr_matrix], whole: Mapping[Target, sp.csr_matrix], rows: Rows) -> None:
    """Refuse terms that take more out of the whole than is there; `left` is what it has without them.

    Raises
    ------
    MatricesError
        A diagonal entry falls below zero; the message names its node.
    """
    rounding = 1e-6  # of the largest entry: text of seven digits
    for target, matrix in whole.items():
        after, before = left[target].diagonal(), matrix.diagonal()
        i = int(np.argmin(np.where(after < before, after, np.inf)))
        if after[i] < min(before[i], 0.0) - rounding * np.abs(before).max():
            where = name_of(rows.node, rows.dof, i)
            refuse(
                f"terms take more {WHOLE[target]} out of {where} than the whole matrix has there. Each must be a part "
                "of it, and none be in two; where the whole lacks a term, say contained = false, and where its file "
                "is the whole matrix with a property changed, say multiplied_by"
            )


def _parts(given: TermForm, rows: Rows, whole: Mapping[Target, sp.csr_matrix]) -> dict[Target, sp.csr_matrix]:
    """Return the matrices of a term.

    Raises
    ------
    MatricesError
        There are none, or a file cannot be read.
    """
    nothing = 1e-12  # of the largest entry: rounding
    parts: dict[Target, sp.csr_matrix] = {}
    files: dict[Target, str | None] = {"K": given.stiffness, "M": given.mass, "C": given.damping}
    for target, file in files.items():
        if file is None:
            continue
        parts[target] = rows.matrix(file, target)
        if given.multiplied_by is not None:
            if given.multiplied_by == 1.0 or target not in whole:
                refuse(f"term {given.name}: multiplied_by needs a factor other than 1 and a matrix to compare with")
            parts[target] = (parts[target] - whole[target]) / (given.multiplied_by - 1.0)
            if abs(parts[target]).max() <= nothing * abs(whole[target]).max():
                refuse(
                    f"term {given.name}: {file} is the whole matrix as it is; multiplied_by needs the one that was "
                    "written with a property changed"
                )
    if given.group is not None:
        amounts: dict[Target, float | None] = {"K": given.spring_N_m, "M": given.mass_kg}
        share = rows.share(given.group, given.directions)
        parts.update({t: sp.csr_matrix(sp.diags_array(share * a)) for t, a in amounts.items() if a is not None})
    if not parts:
        refuse(f"term {given.name}: give stiffness, mass or damping, or a group with spring_N_m or mass_kg")
    return parts


def _factor(given: TermForm) -> Factor:
    if not given.lower <= given.nominal <= given.upper or (given.scale == "log" and given.nominal <= 0.0):
        refuse(f"term {given.name}: nominal {given.nominal:g} must lie between {given.lower:g} and {given.upper:g}")
    return Factor(**given.model_dump(include=set(Factor.__annotations__)))
