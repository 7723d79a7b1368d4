"""Second model (a): the stack smeared into an orthotropic solid, by a Ritz method of high order in three dimensions.

Displacements are Legendre polynomials over the plan times cubic splines over the height, whose knots crowd at the faces
where the membrane stress of the sheets has its boundary layers, about (length / pi) sqrt(G / E) thick. Sheets are in
plane stress, the contact is the shear moduli of x-z and y-z, and thin sheets' own bending may be added.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.linalg as la
from numpy.polynomial import legendre
from scipy.interpolate import BSpline

from tests.independent.bench import Array, Bench, BenchModes
from tests.independent.solid_effects import Attached, Gauge, Moduli, Part, Points, attachments, moduli

RIGID = 0.05
"""Hz, below which a mode is a rigid-body one."""
SHIFT = (2.0 * np.pi * 60.0) ** 2
"""(rad/s)**2 that keeps the stiffness of the free solid invertible."""
KRYLOV = 5
"""Blocks of the Krylov space."""
_KNOTS_INPLANE = (-1.0, -0.92, -0.7, 0.0, 0.7, 0.92, 1.0)
_KNOTS_NORMAL = (-1.0, 1.0)


_Derivative = tuple[int, int, int, int]
"""A displacement component and how often it is derived along x, y, z."""
_Strain = tuple[_Derivative, ...]
_Term = tuple[Part, tuple[_Strain, _Strain], float]
"""The integral of a field times two strains times a factor."""


class Line:
    """Functions on -1 to 1 that are orthonormal there, with their values and derivatives at Gauss points."""

    def __init__(self, evaluate, n_function: int, panels: Array, n_gauss: int):
        at, weight = legendre.leggauss(n_gauss)
        half = 0.5 * np.diff(panels)[:, None]
        self.point: Array = (0.5 * (panels[:-1] + panels[1:])[:, None] + half * at).ravel()
        self.weight: Array = (half * weight).ravel()
        self._evaluate = evaluate
        raw = evaluate(self.point, 0)
        chol = la.cholesky((raw.T * self.weight) @ raw)
        self._scale: Array = la.solve_triangular(chol, np.eye(n_function))
        self.n_function = n_function

    def at(self, place: Array, derivative: int = 0) -> Array:
        """Return the functions at places (k,) as (k, n_function)."""
        return self._evaluate(place, derivative) @ self._scale


@lru_cache
def legendre_line(order: int, n_panel: int) -> Line:
    """Return Legendre polynomials up to an order, integrated over equal panels as fields may have steps."""

    def evaluate(place: Array, derivative: int) -> Array:
        one = np.eye(order + 1)
        return legendre.legval(place, legendre.legder(one, derivative) if derivative else one).T

    return Line(evaluate, order + 1, np.linspace(-1.0, 1.0, n_panel + 1), 4)


@lru_cache
def spline_line(knots: tuple[float, ...], panels: tuple[float, ...]) -> Line:
    """Return cubic splines on knots, integrated over panels."""
    full = np.r_[[knots[0]] * 3, knots, [knots[-1]] * 3]
    n_function = len(full) - 4

    def evaluate(place: Array, derivative: int) -> Array:
        spline = BSpline(full, np.eye(n_function), 3)
        return (spline.derivative(derivative) if derivative else spline)(np.clip(place, -1.0, 1.0))

    return Line(evaluate, n_function, np.array(panels), 4)


@dataclass(frozen=True)
class Solid:
    """The second model; a larger order or more panels answer finer fields.

    Attributes
    ----------
    order : (int, int)
        Degrees of the polynomials along x and y.
    bending : bool
        Whether the sheets' own bending stiffness counts.
    """

    order: tuple[int, int] = (24, 5)
    bending: bool = True
    knots: tuple[float, ...] = _KNOTS_INPLANE

    def modes(self, bench: Bench, n_mode: int) -> BenchModes:
        """Return the lowest modes of the bench with what is planted on it."""
        frame = _Frame.of(self, bench)
        fields = moduli(bench, frame.points)
        hung = attachments(bench)
        rows = _rows(frame, hung)
        n_solid, n_dof = sum(frame.size), rows.shape[1]
        stiffness = np.zeros((n_dof, n_dof))
        for term in _stiffness(bench, fields, self.bending):
            _add(frame, stiffness[:n_solid, :n_solid], term)
        mass = _Mass.of(bench, hung, rows)
        springs = np.array([one.stiffness for one in hung])
        stiffness += (rows.T * springs) @ rows
        value, vector = _lowest(stiffness, mass, n_mode)
        omega = np.sqrt(np.maximum(value, 0.0))
        omega[omega < 2.0 * np.pi * RIGID] = 0.0
        inner = vector[:n_solid]
        lost = np.array([one.damping for one in hung]) @ (rows @ vector) ** 2
        viscous = _contact(fields.viscous_x, fields.viscous_y, fields.viscous_normal)
        lost += sum(_energy(frame, term, inner) for term in viscous)
        if fields.eta:
            contact = _contact(fields.contact_x, fields.contact_y, ())
            lost += fields.eta * _over(sum(_energy(frame, term, inner) for term in contact), omega)

        def shape_at(place: Array) -> Array:
            return frame.displacement(np.asarray(place, float), inner)

        return BenchModes(frequency=omega / (2.0 * np.pi), damping=_over(lost, 2.0 * omega), shape_at=shape_at)


def _over(lost: Array, omega: Array) -> Array:
    """Return the quotient, and 0 for rigid-body modes."""
    return np.divide(lost, omega, out=np.zeros_like(lost), where=omega > 0.0)


@dataclass(frozen=True)
class _Frame:
    """Functions of the solid in its own coordinates; freedoms are u, v, w, each planar function by height function."""

    half: Array
    x: Line
    y: Line
    inplane: Line
    normal: Line
    points: Points

    @classmethod
    def of(cls, solid: Solid, bench: Bench) -> _Frame:
        half = np.array([bench.length, bench.width, bench.height]) / 2.0
        x, y = legendre_line(solid.order[0], 40), legendre_line(solid.order[1], 10)
        panels = tuple(sorted({*solid.knots, *_KNOTS_NORMAL, 1.0 - 40.0 / bench.n_lamina}))
        inplane, normal = spline_line(solid.knots, panels), spline_line(_KNOTS_NORMAL, panels)
        weight = np.multiply.outer(x.weight, y.weight).ravel() / 4.0
        plan = np.meshgrid(half[0] * x.point, half[1] * y.point, indexing="ij")
        points = Points(x=plan[0].ravel(), y=plan[1].ravel(), weight=weight, z=half[2] * inplane.point)
        return cls(half, x, y, inplane, normal, points)

    @property
    def size(self) -> tuple[int, int, int]:
        """Numbers of freedoms of u, v, w."""
        planar = self.x.n_function * self.y.n_function
        return (planar * self.inplane.n_function,) * 2 + (planar * self.normal.n_function,)

    def over_plan(self, part: Part, left: tuple[int, int], right: tuple[int, int]) -> Array:
        """Return the integral of a part over the plan times two derivatives of the planar functions."""
        area = part.planar * self.points.weight * 4.0 * self.half[0] * self.half[1]
        field = area.reshape(len(self.x.point), -1)
        along, across = (
            [line.at(line.point, d) / half ** (d + 0.5) for d in (left[i], right[i])]
            for i, (line, half) in enumerate(((self.x, self.half[0]), (self.y, self.half[1])))
        )
        across_pairs = (across[0][:, :, None] * across[1][:, None, :]).reshape(len(self.y.point), -1)
        along_pairs = (along[0][:, :, None] * along[1][:, None, :]).reshape(len(self.x.point), -1)
        n_x, n_y = self.x.n_function, self.y.n_function
        both = (along_pairs.T @ (field @ across_pairs)).reshape(n_x, n_x, n_y, n_y)
        return both.transpose(0, 2, 1, 3).reshape(n_x * n_y, n_x * n_y)

    def over_height(self, component: int, derivative: int) -> Array:
        """Return height functions of a component or their derivative at the points over the height."""
        line = self.normal if component == 2 else self.inplane
        return line.at(self.inplane.point, derivative) / self.half[2] ** (derivative + 0.5)

    def at(self, component: int, place: Array) -> tuple[Array, Array]:
        """Return planar (k, n) and height functions (k, m) of a component at places (k, 3)."""
        local, scale = place / self.half, 1.0 / np.sqrt(self.half)
        x, y = self.x.at(local[:, 0]) * scale[0], self.y.at(local[:, 1]) * scale[1]
        line = self.normal if component == 2 else self.inplane
        planar = np.einsum("ka,kb->kab", x, y).reshape(len(place), -1)
        return planar, line.at(local[:, 2]) * scale[2]

    def displacement(self, place: Array, vector: Array) -> Array:
        """Return (k, 3, n_mode) displacements at places (k, 3)."""
        found = []
        for component, block in enumerate(np.split(vector, np.cumsum(self.size)[:2])):
            planar, across = self.at(component, place)
            shaped = block.reshape(planar.shape[1], across.shape[1], -1)
            inner = np.tensordot(planar, shaped, axes=1)
            found.append(np.einsum("km,kmr->kr", across, inner))
        return np.stack(found, axis=1)

    def row(self, gauge: Gauge) -> Array:
        """Return a gauge as a row over all freedoms of the solid."""
        planar, across = self.at(gauge.component, gauge.place)
        row = np.zeros(sum(self.size))
        start = sum(self.size[: gauge.component])
        value = ((planar * gauge.weight[:, None]).T @ across).ravel()
        row[start : start + len(value)] = value
        return row

    def forms(self, part: Part, left: _Derivative, right: _Derivative) -> tuple[Array, Array]:
        """Return the integral of a part times two derivatives, over the plan and over the height."""
        height = part.across * self.inplane.weight * self.half[2]
        above, below = (self.over_height(one[0], one[3]) for one in (left, right))
        return self.over_plan(part, left[1:3], right[1:3]), (above.T * height) @ below


_GXZ: _Strain = ((0, 0, 0, 1), (2, 1, 0, 0))
_GYZ: _Strain = ((1, 0, 0, 1), (2, 0, 1, 0))
_EZ: _Strain = ((2, 0, 0, 1),)
_EX: _Strain = ((0, 1, 0, 0),)
_EY: _Strain = ((1, 0, 1, 0),)
_GXY: _Strain = ((0, 0, 1, 0), (1, 1, 0, 0))
_KX: _Strain = ((2, 2, 0, 0),)
_KY: _Strain = ((2, 0, 2, 0),)
_KXY: _Strain = ((2, 1, 1, 0),)


def _blocks(frame: _Frame, term: _Term) -> Iterator[tuple[int, int, Array, Array]]:
    """Yield components with the forms over plan and height of each pair of derivatives."""
    part, pair, factor = term
    for left in pair[0]:
        for right in pair[1]:
            planar, across = frame.forms(part, left, right)
            yield left[0], right[0], factor * planar, across


def _add(frame: _Frame, matrix: Array, term: _Term) -> None:
    """Add a term to the lower blocks of a matrix."""
    stop = np.cumsum(frame.size)
    start = stop - np.array(frame.size)
    for row, column, planar, across in _blocks(frame, term):
        if row >= column:
            matrix[start[row] : stop[row], start[column] : stop[column]] += np.kron(planar, across)


def _energy(frame: _Frame, term: _Term, vector: Array) -> Array:
    """Return the quadratic form of a term with each of the vectors (n_solid, n)."""
    parts = np.split(vector, np.cumsum(frame.size)[:2])
    found = np.zeros(vector.shape[1])
    for row, column, planar, across in _blocks(frame, term):
        left = parts[row].reshape(len(planar), len(across), -1)
        right = parts[column].reshape(planar.shape[1], across.shape[1], -1)
        moved = np.einsum("pmr,nm->pnr", np.tensordot(planar, right, axes=1), across)
        found += np.einsum("pnr,pnr->r", left, moved)
    return found


def _contact(along: Iterable[Part], across: Iterable[Part], normal: Iterable[Part]) -> list[_Term]:
    """Return the terms of shear x-z, shear y-z and strain z with given moduli or viscosities."""
    kinds = ((along, _GXZ), (across, _GYZ), (normal, _EZ))
    return [(part, (strain, strain), 1.0) for parts, strain in kinds for part in parts]


def _stiffness(bench: Bench, fields: Moduli, bending: bool) -> list[_Term]:
    """Return the terms of contact and steel."""
    ratio, poisson = fields.young_ratio, bench.poisson
    stretch = bench.young / (1.0 - ratio * poisson**2)
    q11, q12, q22 = stretch, ratio * poisson * stretch, ratio * stretch
    q66 = bench.young / (2.0 * (1.0 + poisson))
    plane = ((_EX, _EX, q11), (_EY, _EY, q22), (_EX, _EY, q12), (_EY, _EX, q12), (_GXY, _GXY, q66))
    terms = _contact(fields.shear_x, fields.shear_y, fields.normal)
    terms += [(part, (a, b), factor) for part in fields.membrane for a, b, factor in plane]
    if bending:
        thin = (bench.height / bench.n_lamina) ** 2 / 12.0
        bent = ((_KX, _KX, q11), (_KY, _KY, q22), (_KX, _KY, q12), (_KY, _KX, q12), (_KXY, _KXY, 4.0 * q66))
        terms += [(fields.membrane[0], (a, b), thin * factor) for a, b, factor in bent]
    return terms


def _rows(frame: _Frame, hung: list[Attached]) -> Array:
    """Return the gauges (n_hung, n_dof); each rider has one of the last freedoms."""
    riders = [i for i, one in enumerate(hung) if one.rider]
    n_solid = sum(frame.size)
    rows = np.zeros((len(hung), n_solid + len(riders)))
    for i, one in enumerate(hung):
        rows[i, :n_solid] = frame.row(one.gauge)
    rows[riders, n_solid + np.arange(len(riders))] = -1.0
    return rows


@dataclass(frozen=True)
class _Mass:
    """Mass matrix: a diagonal, as the functions are orthonormal, and one of low rank."""

    diagonal: Array
    hung: Array
    rows: Array

    @classmethod
    def of(cls, bench: Bench, hung: list[Attached], rows: Array) -> _Mass:
        riders = [one.rider for one in hung if one.rider]
        solid = np.full(rows.shape[1] - len(riders), bench.density)
        return cls(np.r_[solid, riders], np.array([one.mass for one in hung]), rows)

    def __matmul__(self, vector: Array) -> Array:
        return self.diagonal[:, None] * vector + self.rows.T @ (self.hung[:, None] * (self.rows @ vector))


def _lowest(stiffness: Array, mass: _Mass, n_mode: int) -> tuple[Array, Array]:
    """Return the lowest squared angular frequencies and their modes of unit modal mass, by block Krylov vectors."""
    shifted = stiffness + SHIFT * (mass.rows.T * mass.hung) @ mass.rows
    shifted[np.diag_indices_from(shifted)] += SHIFT * mass.diagonal
    factor = la.cholesky(shifted, lower=True, overwrite_a=True, check_finite=False)
    block = np.random.default_rng(0).standard_normal((len(shifted), n_mode + 6))
    found: list[Array] = []
    for _ in range(KRYLOV):
        block = la.cho_solve((factor, True), mass @ block, check_finite=False)
        for _ in range(2):  # once is not enough in floating point
            for before in found:
                block -= before @ (before.T @ (mass @ block))
        chol = la.cholesky(block.T @ (mass @ block), lower=True)
        block = la.solve_triangular(chol, block.T, lower=True).T
        found.append(block)
    space = np.hstack(found)
    moved = la.solve_triangular(factor, mass @ space, lower=True, check_finite=False)
    inverse, turn = la.eigh(moved.T @ moved)
    value = 1.0 / inverse[::-1][:n_mode] - SHIFT
    return value, space @ turn[:, ::-1][:, :n_mode]
