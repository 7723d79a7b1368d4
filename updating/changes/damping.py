"""What changed in damping: in the contact all over or in a patch, at a point to the ground, or in everything alike.

Glue and oil may leave frequencies as they are. A change dC of the damping matrix adds a_r' Phi' dC Phi a_r /
(2 omega_r) to the ratio of mode r, whatever its shape does besides. Damping scatters by a fifth from one assembly to
the next and cannot fall below nothing, so logarithms are compared, and amplitudes are tried one by one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import numpy as np
import scipy
from numpy.typing import NDArray

from updating.changes.candidate import Candidates, needs_contact, plain, three
from updating.changes.fields import Fields
from updating.changes.kinds.contact import all_over, interfaces
from updating.changes.kinds.patches import patches
from updating.changes.scan import Actions
from updating.changes.situation import SCATTER_SPREAD, Situation
from updating.changes.structure import Part, Structure
from updating.inference.levels import MISSING
from updating.results.what_changed import KindOfChange

Vector = NDArray[np.float64]

_EFFECTS = np.geomspace(0.05, 20.0, 49)
"""Root mean square shares of damping ratios that are added, over which the prior is even in the logarithm."""


@dataclass(frozen=True, kw_only=True)
class DampingKind:
    """A kind of change of damping.

    Attributes
    ----------
    name, label : str
        Its key, and what it is called.
    candidates : callable, optional
        Takes the structure and locations; returns what to try, or None where that has nothing of the kind. A kind
        without any changes all damping ratios by one factor.
    sign : float
        1 where damping rises, -1 where it falls.
    quantity, unit : str
        What its size is.
    absolute : bool
        Whether the size is the amplitude; otherwise it is the share of damping ratios, root mean square.
    local : bool
        Whether it sits at one location; otherwise it is all over.
    """

    name: str
    label: str
    sign: float
    candidates: Callable[[Structure, Vector], Candidates | None] | None = None
    quantity: str = "share of damping ratios, root mean square"
    unit: str = "1"
    absolute: bool = False
    local: bool = False


def _contact(structure: Structure, at: Vector) -> Candidates | None:
    if needs_contact(structure) is not None:
        return None
    return all_over(cast("Fields", structure), at, of=interfaces, sign=1.0, upper=np.inf)


def _patch(structure: Structure, at: Vector) -> Candidates | None:
    if needs_contact(structure) is not None:
        return None
    return patches(cast("Fields", structure), at, of=Fields.contact, sign=1.0)


def _dashpot(structure: Structure, at: Vector) -> Candidates:
    points = structure.pulled(at)
    part = Part(rows=points.rows, target="K", weight=points.weight)
    return plain(points.location, (part,), part=points.part, n_cell=len(at))


DAMPING_KINDS = (
    DampingKind(name="more_loss", label="more damping of all modes alike", sign=1.0),
    DampingKind(name="less_loss", label="less damping of all modes alike", sign=-1.0),
    DampingKind(name="contact_damping", label="more damping of the contact all over", candidates=_contact, sign=1.0),
    DampingKind(
        name="less_contact_damping", label="less damping of the contact all over", candidates=_contact, sign=-1.0
    ),
    DampingKind(
        name="damped_patch",
        label="more damping of the contact in a patch, as by oil or glue",
        candidates=_patch,
        sign=1.0,
        local=True,
    ),
    DampingKind(
        name="dashpot",
        label="a dashpot to the ground",
        candidates=_dashpot,
        sign=1.0,
        quantity="viscosity",
        unit="N s/m",
        absolute=True,
        local=True,
    ),
)
"""Kinds of change of damping."""


def damping_changes(at: Situation, stated: float) -> tuple[KindOfChange, ...]:
    """Weigh the kinds of change of damping, the likeliest first.

    Parameters
    ----------
    at : Situation
        State and reference.
    stated : float
        Relative scatter of damping ratios from one assembly to the next.
    """
    least = 0.05  # share of a damping ratio that stays, whatever is taken away
    known = np.isfinite(at.damping_shift)
    if not known.any():
        return ()
    shift, ratio = at.damping_shift[known], at.damping[known]
    noise, n = at.damping_noise[known], len(at.reference.tested)
    location, _ = at.structure.locations()
    found = []
    for kind in DAMPING_KINDS:
        candidates = None if kind.candidates is None else kind.candidates(at.structure, location)
        if candidates is None and kind.candidates is not None:
            continue
        added = np.ones((1, shift.size)) if candidates is None else _added(at, candidates)[:, known] / ratio
        size = np.sqrt(np.mean(added**2, axis=1))
        keep = size > 1e-6 * size.max()
        share = kind.sign * _EFFECTS[None, :, None] * (added / np.maximum(size, 1e-300)[:, None])[:, None]
        predicted = np.log(np.maximum(1.0 + share, least))
        log = np.where(keep[:, None], _log_odds(shift - predicted, shift, (stated, noise, n)), -np.inf)
        found.append((kind, candidates, size, log))
    odds = np.array([float(scipy.special.logsumexp(log) - np.log(log.size)) for *_, log in found])
    odds += np.log(MISSING / len(found)) - np.log(1.0 - MISSING)
    chance = np.exp(odds - np.logaddexp(scipy.special.logsumexp(odds), 0.0))
    order = np.argsort(-odds)
    answers = []
    for i in order:
        answer = _kind(*found[i], structure=at.structure, odds=float(odds[i]), chance=float(chance[i]))
        answers.append(answer)
    return tuple(answers)


def _added(at: Situation, candidates: Candidates) -> Vector:
    """Return what an amplitude of 1 adds to the ratio of each mode, (n_candidate, n_mode)."""
    action = Actions(at.ours).of(candidates) * at.ours.scale
    return np.asarray(-np.einsum("cnm,nm->cn", action, at.ours.weight) / (2.0 * np.sqrt(at.ours.eigenvalue)))


def _log_odds(left: Vector, shift: Vector, scatter: tuple[float, Vector, int]) -> Vector:
    """Return the logarithm of the likelihood over that of no change, sizes of the scatter integrated out."""
    sizes = np.geomspace(0.5, 4.0, 7)  # of the scatter over what is stated
    stated, noise, n = scatter
    total, none = [], []
    for size in sizes:
        variance = (size * stated) ** 2 * (1.0 + 1.0 / n) + noise**2
        prior = -0.5 * (np.log(size) / SCATTER_SPREAD) ** 2 - 0.5 * float(np.sum(np.log(variance)))
        total.append(prior - 0.5 * np.sum(left**2 / variance, axis=-1))
        none.append(prior - 0.5 * float(np.sum(shift**2 / variance)))
    return np.asarray(scipy.special.logsumexp(np.array(total), axis=0) - scipy.special.logsumexp(none))


def _kind(
    kind: DampingKind,
    candidates: Candidates | None,
    size: Vector,
    log: Vector,
    *,
    structure: Structure,
    odds: float,
    chance: float,
) -> KindOfChange:
    """Return what is known of a kind."""
    share = np.exp(log - scipy.special.logsumexp(log))
    each = share.sum(axis=1)
    value = _EFFECTS[None, :] / (size[:, None] if kind.absolute else np.ones_like(size)[:, None])
    order = np.argsort(value.ravel())
    passed = np.cumsum(share.ravel()[order])
    lower, middle, upper = (float(value.ravel()[order][np.searchsorted(passed, q)]) for q in (0.05, 0.5, 0.95))
    nowhere = (float("nan"),) * 3
    mean, spread, best, part = nowhere, nowhere, nowhere, ""
    local = kind.local and bool(structure.axes)
    if kind.local and candidates is not None:
        part = structure.part_name(kind.name, int(candidates.part[int(np.argmax(each))]))
    if local and candidates is not None:
        centre = each @ candidates.location
        mean = three(centre)
        spread = three(np.sqrt(each @ (candidates.location - centre) ** 2))
        best = three(candidates.location[int(np.argmax(each))])
    return KindOfChange(
        name=kind.name,
        label=kind.label,
        log_odds=odds,
        probability=chance,
        local=local,
        place=mean,
        place_std=spread,
        best=best,
        quantity=kind.quantity,
        unit=kind.unit,
        size=middle,
        lower=lower,
        upper=upper,
        extent=float("nan"),
        angle=float("nan"),
        layer="",
        part=part,
        explained=float("nan"),
    )
