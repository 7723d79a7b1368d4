"""Second model (b): layers of solid-like finite elements on interface springs.

Each layer stands for a few sheets. In it u, v and w are cubic splines over the plan, and u and v change over its
thickness with its tilt, so it is a solid shell; its sheets are in plane stress and bend one by one. Between two layers,
springs over the area resist slip and opening of the facing surfaces; the sheets' own shear is in series with slip.
Functions of the height are those that snapshots of a coarser plan, with all layers, span; `reduced` turns that off.
"""

from __future__ import annotations

import dataclasses
import hashlib
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import scipy.linalg as la

from tests.independent.bench import Array, Bench, BenchModes
from tests.independent.layered_blocks import SHIFT, Tied, lowest
from tests.independent.layered_effects import Gauge, Laws, Rig, Tie, breaks, laws
from tests.independent.layered_plan import Line, Plan
from tests.independent.layered_terms import (
    ByHeight,
    ByLength,
    Height,
    Order,
    Term,
    contact_terms,
    energy,
    mass_terms,
    steel_terms,
)
from tests.independent.layered_usual import EXTRA, SNAPSHOT_ELEMENTS, SNAPSHOT_MODES, USUAL, Usual

KEPT = Path(__file__).parents[2] / "out" / "second_model"
"""Where what takes minutes is kept."""
RIGID = 0.05
"""Hz, below which a mode is a rigid-body one."""


@dataclass(frozen=True, kw_only=True)
class Layered:
    """The second model; more laminas a layer or fewer elements answer faster and less exactly.

    Attributes
    ----------
    laminas_per_layer : int
        Sheets that a layer stands for.
    n_element : (int, int)
        Elements along x and y.
    n_function : (int, int)
        Functions of the height of in-plane and of normal displacements, beside those of rigid-body motion and of
        what is planted.
    reduced : bool
        Whether the layers follow these functions or move freely.
    sheet_shear : bool
        Whether the sheets' own transverse shear gives way in series with the contact.
    """

    laminas_per_layer: int = 3
    n_element: tuple[int, int] = (24, 4)
    n_function: tuple[int, int] = (9, 6)
    reduced: bool = True
    sheet_shear: bool = True

    def modes(self, bench: Bench, n_mode: int) -> BenchModes:
        """Return the lowest modes of the bench with what is planted on it."""
        stack = LayeredStack.of(self, bench)
        value, fields, lost = stack.solve(n_mode)
        omega = np.sqrt(np.maximum(value, 0.0))
        omega[omega < 2.0 * np.pi * RIGID] = 0.0
        found = stack.laws
        lost = lost + energy(contact_terms(stack.plan, stack.height, found.viscous, found.normal_viscous), fields)
        hysteretic = energy(contact_terms(stack.plan, stack.height, found.hysteretic, ()), fields)
        lost += np.divide(hysteretic, omega, out=np.zeros_like(omega), where=omega > 0.0)
        damping = np.divide(lost, 2.0 * omega, out=np.zeros_like(omega), where=omega > 0.0)
        return BenchModes(frequency=omega / (2.0 * np.pi), damping=damping, shape_at=stack.reader(fields))


@dataclass(frozen=True, kw_only=True)
class LayeredStack:
    """A bench in layers, ready to be solved."""

    bench: Bench
    plan: Plan
    height: Height
    laws: Laws
    order: Order
    ties: tuple[Tie, ...]

    @classmethod
    def of(cls, model: Layered, bench: Bench) -> LayeredStack:
        sizes = zip((bench.length, bench.width), model.n_element, strict=True)
        along, across = (Line(length=size, n_element=n) for size, n in sizes)
        plan = Plan(along, across, breaks(bench))
        n_layer = _n_layer(bench.n_lamina, model.laminas_per_layer)
        if model.reduced:
            basis = _height_functions(Usual.of(bench), model.laminas_per_layer, model.n_function)
            n_across = (basis[0].shape[1], basis[1].shape[1], basis[2].shape[1])
            order: Order = ByLength(plan=plan.shape, across=n_across)
        else:
            basis = (np.eye(n_layer),) * 3
            order = ByHeight(plan=plan.shape, n_layer=n_layer)
        return cls(
            bench=bench,
            plan=plan,
            height=Height(basis, bench.height),
            laws=laws(bench, plan, n_layer, model.sheet_shear),
            order=order,
            ties=tuple(Rig(bench=bench, plan=plan, n_layer=n_layer).ties()),
        )

    @property
    def n_layer(self) -> int:
        return len(self.height.basis[0])

    def solve(self, n_mode: int) -> tuple[Array, list[Array], Array]:
        """Return squared angular frequencies, fields of unit modal mass, and what the ties' dashpots lose."""
        weight = mass_terms(self.plan, self.height, self.bench.density)
        ties = list(self.ties)
        if isinstance(self.order, ByHeight):  # what a layer carries by itself fits its block
            weight += [self._carried(tie) for tie in ties if _only_carried(tie)]
            ties = [tie for tie in ties if not _only_carried(tie)]
        law = self.laws
        stiffness = contact_terms(self.plan, self.height, law.shear, law.normal)
        stiffness += steel_terms(self.plan, self.height, self.bench, law)
        shifted = [dataclasses.replace(term, across=SHIFT * term.across) for term in weight]
        rows = [(row, tie, share) for tie in ties for row, share in self._rows(tie.gauge)]
        riding = [i for i, (_, tie, _) in enumerate(rows) if tie.rider]

        def weigh(vector: Array) -> Array:
            fields = self.order.unpack(vector)
            moved = [sum(term.times(fields) for term in weight if term.row == i) for i in range(3)]
            return self.order.pack(moved)

        n_body = np.prod(self.plan.shape) * sum(basis.shape[1] for basis in self.height.basis)
        row = np.zeros((n_body + len(riding), len(rows)))
        if rows:
            row[:n_body] = np.hstack([one for one, _, _ in rows])
            row[n_body + np.arange(len(riding)), riding] = -1.0
        of = {
            name: np.array([getattr(tie, name) * share for _, tie, share in rows])
            for name in ("mass", "stiffness", "damping", "rider")
        }
        body = Tied(
            factor=self.order.factor(stiffness + shifted),
            weigh=weigh,
            rider=of["rider"][riding],
            row=row,
            mass=of["mass"],
            stiffness=of["stiffness"],
        )
        value, vector = lowest(body, n_mode)
        return value, self.order.unpack(vector[:n_body]), of["damping"] @ (row.T @ vector) ** 2

    def _rows(self, gauge: Gauge) -> list[tuple[Array, float]]:
        """Return what a gauge measures as columns (n, 1), one for all layers or for each function of the height."""
        basis = self.height.basis[gauge.component]
        each = basis.T if gauge.layer is None else (gauge.layer @ basis)[:, None]
        share = 1.0 if gauge.layer is not None else 1.0 / self.n_layer
        found = []
        for across in np.eye(basis.shape[1]) if gauge.layer is None else each.T:
            fields = [np.zeros((*self.plan.shape, one.shape[1], 1)) for one in self.height.basis]
            fields[gauge.component][..., 0] = np.einsum("a,b,c->abc", gauge.along, gauge.across, across)
            found.append((self.order.pack(fields), share))
        return found

    def _carried(self, tie: Tie) -> Term:
        """Return the mass that each layer carries by itself."""
        along, across = (np.multiply.outer(one, one) for one in (tie.gauge.along, tie.gauge.across))
        return Term(
            row=tie.gauge.component,
            column=tie.gauge.component,
            planar=np.multiply.outer(along, across),
            across=tie.mass / self.n_layer * np.eye(self.n_layer),
        )

    def reader(self, fields: Sequence[Array]) -> Callable[[Array], Array]:
        """Return the function from places (k, 3), m, to displacements (k, 3, n_mode)."""
        layered = [np.einsum("xycr,zc->xyzr", one, b) for one, b in zip(fields, self.height.basis, strict=True)]

        def shape_at(place: Array) -> Array:
            at = np.asarray(place, float)
            level = np.clip(at[:, 2] / self.height.pitch + 0.5 * self.n_layer - 0.5, 0.0, self.n_layer - 1.0)
            lower = np.minimum(level.astype(int), self.n_layer - 2)
            part = (level - lower)[:, None, None, None]
            beyond = at[:, 2] - (level - 0.5 * (self.n_layer - 1)) * self.height.pitch

            def read(component: int, d_x: int = 0, d_y: int = 0) -> Array:
                near = layered[component].transpose(2, 0, 1, 3)
                mixed = (1.0 - part) * near[lower] + part * near[lower + 1]
                along, across = self.plan.lines[0].at(at[:, 0], d_x), self.plan.lines[1].at(at[:, 1], d_y)
                return np.einsum("kx,ky,kxyr->kr", along, across, mixed, optimize=True)

            # the outer half of a face's layer tilts with it
            u, v = (read(0), read(1))
            u, v = u - beyond[:, None] * read(2, 1, 0), v - beyond[:, None] * read(2, 0, 1)
            return np.stack([u, v, read(2)], axis=1)

        return shape_at


def _only_carried(tie: Tie) -> bool:
    return tie.gauge.layer is None and not tie.rider


def _height_functions(usual: Usual, laminas_per_layer: int, number: tuple[int, int]) -> tuple[Array, Array, Array]:
    """Return orthonormal functions of the height (n_layer, n) of u, v, w: rigid, usual, of what is planted."""
    inplane, normal = _rigid(usual.n_lamina, laminas_per_layer)
    for kind in usual.kinds:
        gram = _seen(dataclasses.replace(usual, kinds=(kind,)), laminas_per_layer)
        n_inplane, n_normal = number if kind == USUAL else EXTRA
        inplane = _with_leading(inplane, gram[0] + gram[1], n_inplane)
        normal = _with_leading(normal, gram[2], n_normal)
    return inplane, inplane, normal


@lru_cache
def _seen(usual: Usual, laminas_per_layer: int) -> tuple[Array, Array, Array]:
    """Return the Gram matrices (n_layer, n_layer) of u, v, w in the snapshots of one kind.

    They take minutes and depend on nothing but their arguments, so they are kept in a file.
    """
    name = hashlib.sha256(repr((usual, laminas_per_layer)).encode()).hexdigest()[:16]
    kept = KEPT / f"{name}.npy"
    if kept.exists():
        u, v, w = np.load(kept, allow_pickle=False)
        return u, v, w
    coarse = Layered(laminas_per_layer=laminas_per_layer, n_element=SNAPSHOT_ELEMENTS, reduced=False)
    n_layer = _n_layer(usual.n_lamina, laminas_per_layer)
    gram = np.zeros((3, n_layer, n_layer))
    for bench in usual.benches(usual.kinds[0]):
        for i, field in enumerate(LayeredStack.of(coarse, bench).solve(SNAPSHOT_MODES)[1]):
            across = field.transpose(2, 0, 1, 3).reshape(n_layer, -1)
            gram[i] += across @ across.T
    KEPT.mkdir(parents=True, exist_ok=True)
    beside = kept.with_suffix(f".{os.getpid()}")
    with beside.open("wb") as file:
        np.save(file, gram)
    beside.replace(kept)
    return gram[0], gram[1], gram[2]


def _rigid(n_lamina: int, laminas_per_layer: int) -> tuple[Array, Array]:
    """Return the functions of rigid-body motion of in-plane and normal displacements."""
    level = np.linspace(-1.0, 1.0, _n_layer(n_lamina, laminas_per_layer))
    both = la.qr(np.stack([np.ones_like(level), level], axis=1), mode="economic")[0]
    return both, both[:, :1]


def _with_leading(before: Array, gram: Array, number: int) -> Array:
    """Return functions with those that best describe, beside them, what a Gram matrix of snapshots holds."""
    rest = np.eye(len(gram)) - before @ before.T
    return np.hstack([before, la.eigh(rest @ (gram + gram[::-1, ::-1]) @ rest)[1][:, ::-1][:, :number]])


def _n_layer(n_lamina: int, laminas_per_layer: int) -> int:
    return max(2, round(n_lamina / laminas_per_layer))
