"""What a model misses alike in all specimens and torques, and what each measurement has of its own.

The discrepancy of a mode is nearly the same in all configurations of all specimens, see
`updating.diagnosis.discrepancy`. Its common part is a strength that all specimens share, so what is left is
independent from one specimen to the next: without it, six specimens would seem to bear out six times what the model
gets wrong once.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from updating.diagnosis.discrepancy import (
    CORRELATION,
    Block,
    Discrepancy,
    MeasuredShape,
    block_of,
    shape_block,
)
from updating.diagnosis.evidence import Evidence
from updating.diagnosis.residual import Spread

Vector = NDArray[np.float64]
LatentKind = Literal["frequency", "damping", "shape", "mesh"]

_DIRECTIONS = 10  # in which the common discrepancy of a shape may go
_NEGLIGIBLE = 1e-3  # share of its variance that other directions may have
_NO_PART = 1e6  # standard deviation of what takes no part
_LEAST = 1e-3  # of a variance that noise keeps when the mesh's share is taken out


@dataclass(frozen=True, eq=False, kw_only=True)
class Latent:
    """A discrepancy that specimens share.

    Attributes
    ----------
    kind : "frequency", "damping", "shape" or "mesh"
        Of what; the last is the error of the mesh in frequencies.
    mode : int
        Of which mode.
    direction : (n_dof, n) float
        Of a shape: in which directions it may go; else one column of one row.
    shape : (n_dof,) float
        The measured shape whose sign they have.
    """

    kind: LatentKind
    mode: int
    direction: Vector
    shape: Vector


@dataclass(frozen=True, eq=False, kw_only=True)
class Separated:
    """What separates a specimen's model from its measurement, own and common.

    Attributes
    ----------
    own : Discrepancy
        Noise, and the part of the discrepancy that is the configuration's own.
    shared : (n, n_latent) float
        Rows of data by the common discrepancies at unit strength, rotated as `own` does.
    """

    own: Discrepancy
    shared: Vector


def latents_of(evidences: Sequence[Evidence], spreads: Sequence[Spread]) -> tuple[Latent, ...]:
    """Return the discrepancies that specimens share: of each mode by the first configuration that has it."""
    one = np.ones((1, 1))
    scalar: dict[tuple[LatentKind, int], Latent] = {}
    shapes: dict[int, Latent] = {}
    kinds: tuple[LatentKind, ...] = ("frequency", "mesh", "damping")
    for evidence, spread in zip(evidences, spreads, strict=True):
        for kind in kinds:
            of = evidence.rows.kind == ("frequency" if kind == "mesh" else kind)
            for mode in np.unique(evidence.rows.mode[of]).tolist():
                scalar.setdefault((kind, mode), Latent(kind=kind, mode=mode, direction=one, shape=np.ones(1)))
        for own in spread.shape:
            if own.mode not in shapes:
                shapes[own.mode] = Latent(
                    kind="shape", mode=own.mode, direction=_leading(own.mixing.steady), shape=own.shape
                )
    return (*scalar.values(), *shapes.values())


def _leading(root: Vector) -> Vector:
    """Return the directions (n_dof, n) in which a symmetric root of a covariance has most of it."""
    size, direction = la.eigh(root)
    share = np.cumsum(size[::-1] ** 2) / np.sum(size**2)
    n = min(_DIRECTIONS, 1 + int(np.searchsorted(share, 1.0 - _NEGLIGIBLE)))
    return np.asarray(direction[:, ::-1][:, :n])


def separated(
    evidence: Evidence, spread: Spread, latents: Sequence[Latent], apart: Collection[int] = ()
) -> Separated:
    """Divide what separates model and measurement of a specimen into its own part and the common one.

    Parameters
    ----------
    evidence : Evidence
        The specimen's.
    spread : Spread
        How its data scatter.
    latents : sequence of Latent
        The common discrepancies.
    apart : collection of int
        Shapes that take no part, whether their modes are close to others or not.
    """
    mesh = np.concatenate(
        [
            evidence.scatter.mesh * shift.mesh[used]
            for shift, used in zip(evidence.shift, evidence.used, strict=True)
        ]
    )
    own = _own(evidence, spread, mesh, apart)
    rows = evidence.rows
    columns = []
    for latent in latents:
        column = np.zeros((rows.kind.size, latent.direction.shape[1]))
        if latent.kind == "shape":
            for shape in spread.shape:
                if shape.mode == latent.mode and shape.shape.size == latent.shape.size:
                    turned = 1.0 if shape.shape @ latent.shape >= 0.0 else -1.0
                    column[shape.row] = turned * shape.mixing.steady @ latent.direction
        else:
            kind = "frequency" if latent.kind == "mesh" else latent.kind
            of = np.flatnonzero(rows.kind == kind)
            strength = mesh if latent.kind == "mesh" else np.ones(of.size)
            column[of, 0] = strength * (rows.mode[of] == latent.mode)
        columns.append(column)
    return Separated(own=own, shared=own.rotated(np.hstack(columns)))


def _apart(own: MeasuredShape, i: int, *, none: bool) -> MeasuredShape:
    """Return a shape with the part of what it is wrong by that it has alone, as that of a mode of its own.

    One of close modes takes no part: how these mix is otherwise in each specimen, and as two pass each other in one
    they turn into each other at once, which would keep what all specimens share from moving. Nor does one of which none
    is asked.
    """
    std = np.full_like(own.std, _NO_PART) if own.mixing.meets or none else own.std
    return replace(own, mode=i, std=std, mixing=own.mixing.over(1.0 / np.sqrt(1.0 - CORRELATION)))


def _own(evidence: Evidence, spread: Spread, mesh: Vector, apart: Collection[int]) -> Discrepancy:
    """Return noise and the part of the discrepancy that differs from configuration to configuration."""
    rows = evidence.rows
    blocks: list[Block] = [
        shape_block([_apart(own, i, none=i in apart) for i, own in enumerate(spread.shape)])
    ]
    noise = np.sqrt(np.maximum(spread.frequency**2 - mesh**2, _LEAST * spread.frequency**2))
    for kind, std in (("frequency", noise), ("damping", spread.damping)):
        of = np.flatnonzero(rows.kind == kind)
        for c in np.unique(rows.configuration[of]):  # each by itself, so that one can be left out
            here = rows.configuration[of] == c
            form = (1.0 - CORRELATION) * np.eye(int(here.sum()))
            blocks.append(block_of(of[here], np.diag(std[here] ** 2), form))
    return Discrepancy(blocks=tuple(blocks))
