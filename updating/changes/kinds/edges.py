"""How an edge is held: more or less over a part of it, as by a bolt, gap or weld there, or all along, clamped anew."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from model.effects.support_compliance import RIGID_EDGE
from model.elements.mesh import Derivative, Field
from model.elements.terms import held_motions
from model.stack.parts import EdgeSupport
from updating.changes.candidate import Candidates, Kind, at_heights, gone, needs_supports, plain
from updating.changes.fields import Fields
from updating.changes.kinds.contact import all_over
from updating.changes.structure import Part

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class HeldEdge:
    """A held edge as the fitted reference has it.

    Attributes
    ----------
    number : int
        Of the support, from 0.
    name : str
        "left", "right", "front" or "back".
    location : (n, 2) float
        Points along it, m, and `weight` (n,), the length that each stands for.
    moving, turning : (n, R, m) float
        Rows whose squares are the energy per length by moving and by turning.
    """

    number: int
    name: str
    location: Vector
    weight: Vector
    moving: Vector
    turning: Vector


def held_edges(fields: Fields) -> tuple[HeldEdge, ...]:
    """Return the held edges of a structure."""
    if ("held edges",) not in fields.shared:
        fields.shared[("held edges",)] = _held_edges(fields)
    edges: tuple[HeldEdge, ...] = fields.shared[("held edges",)]
    return edges


def _held_edges(fields: Fields) -> tuple[HeldEdge, ...]:
    n_along = 121  # Points along an edge
    stack, plan = fields.stack, fields.system.assembly.plan
    found = []
    for i, support in enumerate(stack.supports):
        if not isinstance(support, EdgeSupport) or support.edge == "all":
            continue
        axis, side = {"left": (0, 0), "right": (0, 1), "front": (1, 0), "back": (1, 1)}[support.edge]
        (low, high), fixed = plan.bounds[1 - axis], plan.bounds[axis][side]
        along = np.linspace(low, high, n_along)
        weight = np.full(n_along, (high - low) / (n_along - 1))
        weight[[0, -1]] /= 2.0
        location = np.column_stack([np.full(n_along, fixed), along])
        location = location if axis == 0 else location[:, ::-1]
        moving, turning = list[Vector](), list[Vector]()
        for motion in held_motions(stack, plan, support):
            field, slope = motion.kron.row, "xy"[axis] if motion.turns else ""
            rows = _rows(fields, location, field, slope)  # type: ignore[arg-type]
            held = float(motion.kron.z.diagonal().mean())
            held *= _given(fields, "edge_rotation" if motion.turns else "edge_translation", motion.stiffness)
            (turning if motion.turns else moving).append(np.sqrt(held) * rows)
        nothing = np.zeros((n_along, 1, fields.n_mode))
        found.append(
            HeldEdge(
                number=i,
                name=support.edge,
                location=location,
                weight=weight,
                moving=np.concatenate(moving, axis=1) if moving else nothing,
                turning=np.concatenate(turning, axis=1) if turning else nothing,
            )
        )
    return tuple(found)


def _rows(fields: Fields, location: Vector, field: Field, derivative: Derivative) -> Vector:
    over_z = fields.system.phi[field]
    root = np.linalg.qr(over_z, mode="r")
    return np.einsum("rf,pfm->prm", root, fields.at_points(location, field, derivative), optimize=True)


def _given(fields: Fields, name: str, stiffness: float) -> float:
    """Return by which factor the fitted compliance leaves a stiffness (see `model.effects.support_compliance`)."""
    if name not in fields.theta:
        return 1.0
    return float(1.0 / (1.0 + stiffness * (1.0 / fields.theta[name] - 1.0 / RIGID_EDGE[name])))


def on_edges(fields: Fields, at: Vector, *, sign: float, upper: float) -> Candidates:  # noqa: ARG001
    """Return parts of held edges that hold less (sign -1) or more (1): against turning, moving, or both."""
    shares = np.array([0.08, 0.15, 0.3, 0.6])  # of an edge that gives way
    n_middle = 30  # along an edge, of parts that give way
    location, size, number, angle = [], [], [], []
    blocks: list[tuple[Vector, sp.csr_array, int, int]] = []
    n = 0
    for edge in held_edges(fields):
        axis = int(np.ptp(edge.location[:, 0]) < np.ptp(edge.location[:, 1]))
        along = edge.location[:, axis]
        whole = float(np.ptp(along))
        middle = along[0] + (np.arange(n_middle) + 0.5) * whole / n_middle
        for share in shares:
            inside = np.abs(along[None, :] - middle[:, None]) <= share * whole / 2.0
            weight = sign * inside * edge.weight
            for held in ([edge.turning], [edge.moving], [edge.turning, edge.moving]):
                here = np.full((middle.size, 2), edge.location[0])
                here[:, axis] = middle
                location.append(here)
                size.append(np.full(middle.size, share * whole))
                number.append(np.full(middle.size, edge.number))
                angle.append(np.full(middle.size, np.pi / 2.0 if axis else 0.0))
                blocks += [(rows, sp.csr_array(weight), n, len(along)) for rows in held]
                n += middle.size
    parts = []
    for rows, weight, first, n_point in blocks:
        coo = weight.tocoo()
        shifted = sp.csr_array((coo.data, (coo.coords[0] + first, coo.coords[1])), shape=(n, n_point))
        parts.append(Part(rows=rows, target="K", weight=shifted))
    return plain(
        at_heights(np.vstack(location), 0.0) if location else np.zeros((0, 3)),
        tuple(_merged(parts)),
        size=np.concatenate(size) if size else np.zeros(0),
        angle=np.concatenate(angle) if angle else np.zeros(0),
        part=np.concatenate(number) if number else np.zeros(0, dtype=np.intp),
        upper=upper,
    )


def _merged(parts: list[Part]) -> list[Part]:
    """Add the weights of parts that share their rows."""
    found: dict[int, Part] = {}
    for part in parts:
        key = id(part.rows)
        if key in found:
            weight = found[key].weight + part.weight
            found[key] = Part(rows=part.rows, target=part.target, weight=weight)
        else:
            found[key] = part
    return list(found.values())


def edges(fields: Fields) -> tuple[Part, ...]:
    """Return each held edge as a whole, against moving and against turning."""
    return tuple(
        Part(rows=rows, target="K", weight=sp.csr_array(edge.weight[None, :]))
        for edge in held_edges(fields)
        for rows in (edge.moving, edge.turning)
    )


KINDS = (
    Kind(
        name="softer_edge",
        label="a held edge that gives way over a part of it",
        quantity="share of what holds it that is gone",
        why_not=needs_supports,
        candidates=partial(on_edges, sign=-1.0, upper=3.0),
        on_plan=False,
        value=gone,
        whole=1.0,
    ),
    Kind(
        name="firmer_edge",
        label="a held edge that is firmer over a part of it",
        quantity="share by which it is held firmer",
        why_not=needs_supports,
        candidates=partial(on_edges, sign=1.0, upper=10.0),
        on_plan=False,
    ),
    Kind(
        name="softer_mounting",
        label="an edge that is held less all along",
        quantity="share of what holds it that is gone",
        why_not=needs_supports,
        candidates=partial(all_over, of=edges, sign=-1.0, upper=1.0),
        on_plan=False,
        local=False,
    ),
    Kind(
        name="firmer_mounting",
        label="an edge that is held more all along",
        quantity="share by which it is held firmer",
        why_not=needs_supports,
        candidates=partial(all_over, of=edges, sign=1.0, upper=10.0),
        on_plan=False,
        local=False,
    ),
)
