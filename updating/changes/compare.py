"""What changed, and where: a state and its reference as two states of one model, and every kind of change weighed.

Errors of the model and of the sensors are common to both states and cancel. What remains in a state that has not
changed is the scatter of assembly: what holds the structure and the contact are a little different each time, and so is
everything else, by a random perturbation of which only the size is known. Its prior is what the campaign states, raised
where repeats of the reference scatter more. Each kind of change is tried at every location, size and direction, with
the amplitude integrated out; kinds are compared by what that gives in the mean over all candidates, and locations
within them by their shares.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
import scipy
import scipy.linalg as la
from numpy.typing import NDArray

from ema.campaign.campaign_file import Reassembly
from updating.changes.candidate import Candidates, Kind, joined_candidates, three
from updating.changes.damping import damping_changes
from updating.changes.kinds import kinds
from updating.changes.reference import FittedReference
from updating.changes.refined import Condensed, Refined, refine
from updating.changes.scan import Actions, Weighed, conditional, weigh
from updating.changes.situation import EXPLAINED, IDEAL, IN_FULL, SCATTER_SPREAD, Situation
from updating.changes.structure import Structure
from updating.diagnosis.evidence import Campaigned
from updating.inference.levels import MISSING, NAMED, SEPARATE
from updating.results.what_changed import KindOfChange, Verdict, WhatChanged, sentences

Vector = NDArray[np.float64]

_SIZES = np.geomspace(0.25, 6.0, 9)
"""Sizes of the scatter over its median at which all is weighed."""
LEAST_CELL = 5e-3
"""Probability of a cell, within its kind, from which that is done."""
WITHIN = 12.0
"""Logarithm of the evidence that a kind may lack of the best and may yet gain by the structure's answer to it."""
_COUNTS = 1e-9
"""Share of the largest probability from which a candidate, or a value, counts in an interval: a million of others have
a thousandth together."""
_NODES = scipy.special.ndtri((np.arange(9) + 0.5) / 9.0)


def what_changed(
    reference: FittedReference,
    changed: Sequence[Campaigned],
    reassembly: Reassembly | None = None,
    *,
    seen: bool = False,
    known: Sequence[Kind] | None = None,
) -> WhatChanged:
    """Say what changed between a state and its reference, and where.

    Parameters
    ----------
    reference : FittedReference
        The reference.
    changed : sequence of (str, float, ModalModel)
        The state and its repeats.
    reassembly : Reassembly, optional
        Scatter of a state that is assembled anew.
    seen : bool
        Whether the comparison without a model calls the state changed.
    known : sequence of Kind, optional
        Kinds of change; all by default.

    Raises
    ------
    FitError
        State or reference have too few modes in common with the model.
    """
    assembly = Reassembly() if reassembly is None else reassembly
    stated = float(np.sqrt(2.0)) * assembly.frequency
    at = Situation(reference, changed, stated)
    every = kinds() if known is None else known
    impossible = {kind.name: why for kind in every if (why := kind.why_not(at.structure)) is not None}
    if np.isfinite(at.shift).all():
        no_split = "it splits a mode in two, and this state has no further mode"
        impossible |= {kind.name: no_split for kind in every if kind.splits}
    median = _scatter(at, stated)
    shift = at.shift[np.isfinite(at.shift)]
    at.idealised = IDEAL * 2.0 * float(np.sqrt(np.mean(shift**2))) if shift.size else 0.0
    tried = _tried(at, [kind for kind in every if kind.name not in impossible], median)
    found = _concluded(at, tried, impossible, (median, stated), seen=seen)
    damping = damping_changes(at, assembly.damping)
    found = replace(found, damping=damping, damping_left=_left(damping))
    return replace(found, sentences=sentences(found))


@dataclass(frozen=True, eq=False)
class _Batch:
    """Candidates of one kind with their prior and what they do."""

    kind: Kind
    candidates: Candidates
    log_prior: Vector  # of each among all of the kind
    action: Vector
    effect: Vector

    def weighed(self, error: Vector, root: Vector) -> Weighed:
        """Weigh them at one size of the scatter."""
        flat = self.action.reshape(len(self.action), -1)
        return weigh(flat, self.effect, self.candidates.upper, error, root)


@dataclass(frozen=True, eq=False)
class _Tried:
    """A kind whose candidates were weighed at all sizes of the scatter."""

    batch: _Batch
    weighed: tuple[Weighed, ...]
    log: Vector  # (n_size, n_candidate), over no change, sizes integrated out, with the candidates' prior
    none: Vector  # (n_size,), of no change, over all sizes
    refined: Mapping[int, Refined] = field(default_factory=dict)  # by form

    @property
    def kind(self) -> Kind:
        """The kind."""
        return self.batch.kind

    @property
    def candidates(self) -> Candidates:
        """Its candidates."""
        return self.batch.candidates

    @property
    def evidence(self) -> float:
        """Logarithm of the likelihood of the kind over that of no change, in the mean over its candidates."""
        return float(scipy.special.logsumexp(self.log))

    @property
    def best(self) -> int:
        """The likeliest candidate."""
        return int(np.argmax(self.log.max(axis=0)))

    @property
    def best_refined(self) -> Refined | None:
        """What is known of its form with the structure's answer, where that was weighed."""
        return self.refined.get(int(self.candidates.form[self.best]))

    def mass(self, refined: Refined) -> Vector:
        """Return the logarithm of the posterior mass of a refined candidate, (n_size,), as `log` counts it."""
        return np.asarray(self.none + refined.evidence + self.batch.log_prior[refined.index])

    @property
    def share(self) -> Vector:
        """Posterior share of each size and candidate within the kind, (n_size, n_candidate)."""
        return np.asarray(np.exp(self.log - scipy.special.logsumexp(self.log)))


def _tried(at: Situation, every: Sequence[Kind], size: float) -> list[_Batch]:
    """Return all candidates, more closely where they are likely: cells that stand out are cut in nine.

    A kind that explains less than half of what another does is left as it is.
    """
    most_cells = 16  # of the coarse grid that are cut in nine, of each kind
    # Least probability of such a cell over that where all are alike: else the location hardly matters
    stands_out = 2.0
    actions, (location, step) = Actions(at.ours), at.structure.locations()
    error, covariance, _ = conditional(at.joint.value, at.covariance(size, size), at.is_changed)
    root = la.cholesky(covariance, lower=True, check_finite=False)
    coarse = [(kind, candidates) for kind in every if (candidates := kind.candidates(at.structure, location)).n]
    batches = [
        _batch(kind, candidates, np.full(candidates.n, -np.log(candidates.n)), actions) for kind, candidates in coarse
    ]
    logs = [batch.weighed(error, root).log for batch in batches]
    evidence = [float(scipy.special.logsumexp(log)) - np.log(log.size) for log in logs]
    best, found = max(evidence), list[_Batch]()
    for batch, log, log_evidence in zip(batches, logs, evidence, strict=True):
        if not batch.kind.on_plan or log_evidence < min(best / 2.0, best - WITHIN):
            found.append(batch)
            continue
        cell = scipy.special.logsumexp(log.reshape(-1, len(location)), axis=0)  # all of them for each size
        cell = np.exp(cell - scipy.special.logsumexp(cell))
        near = np.argsort(-cell)[:most_cells]
        near = near[cell[near] > max(LEAST_CELL, stands_out / len(location))]
        found += _closer(batch, near, at.structure.finer(location[near], step), at.structure, actions)
    return found


def _closer(
    batch: _Batch, near: NDArray[np.intp], finer: Vector, structure: Structure, actions: Actions
) -> list[_Batch]:
    """Return the candidates of a kind beyond some of the cells, and those at locations within these."""
    kind, candidates = batch.kind, batch.candidates
    if not near.size:
        return [batch]
    keep = np.flatnonzero(~np.isin(candidates.cell, near))
    far = _Batch(kind, candidates.only(keep), batch.log_prior[keep], batch.action[keep], batch.effect[keep])
    closer = kind.candidates(structure, finer)
    # of the prior of a cell that each has
    share = candidates.n / len(np.unique(candidates.cell)) * len(near) / closer.n
    return [far, _batch(kind, closer, np.full(closer.n, np.log(share / candidates.n)), actions)]


def _batch(kind: Kind, candidates: Candidates, log_prior: Vector, actions: Actions) -> _Batch:
    action = actions.of(candidates)
    return _Batch(kind, candidates, log_prior, action, actions.effect(action))


def _concluded(
    at: Situation, tried: Sequence[_Batch], impossible: Mapping[str, str], scatter: tuple[float, float], *, seen: bool
) -> WhatChanged:
    median, stated = scatter
    sizes = median * _SIZES
    none, misfit, weighed = np.zeros(sizes.size), np.zeros(sizes.size), list[list[Weighed]]()
    problems = list[tuple[Vector, Vector]]()
    for g, size in enumerate(sizes.tolist()):
        error, covariance, _ = conditional(at.joint.value, at.covariance(size, median), at.is_changed)
        root = la.cholesky(covariance, lower=True, check_finite=False)
        white = la.solve_triangular(root, error, lower=True, check_finite=False)
        misfit[g] = float(white @ white)
        none[g] = -0.5 * misfit[g] - float(np.sum(np.log(np.diag(root))))
        none[g] -= 0.5 * (np.log(size / median) / SCATTER_SPREAD) ** 2
        problems.append((error, root))
        weighed.append([batch.weighed(error, root) for batch in tried])
    apart = none - float(scipy.special.logsumexp(none))
    found = _joined(
        [
            _Tried(
                batch,
                tuple(at_size[i] for at_size in weighed),
                np.array([apart[g] + at_size[i].log for g, at_size in enumerate(weighed)]) + batch.log_prior,
                apart,
            )
            for i, batch in enumerate(tried)
        ]
    )
    found = _refined(at, found, problems)
    odds = np.array([kind.evidence for kind in found]) + np.log(MISSING / len(found)) - np.log(1.0 - MISSING)
    return _answer(at, found, odds, impossible, (sizes, none, misfit), stated, seen=seen)


def _joined(tried: Sequence[_Tried]) -> list[_Tried]:
    """Join what is of one kind."""
    found: dict[str, _Tried] = {}
    for new in tried:
        before = found.get(new.kind.name)
        if before is None:
            found[new.kind.name] = new
            continue
        one, other = before.batch, new.batch
        batch = _Batch(
            new.kind,
            joined_candidates(one.candidates, other.candidates),
            np.concatenate([one.log_prior, other.log_prior]),
            np.concatenate([one.action, other.action]),
            np.concatenate([one.effect, other.effect]),
        )
        weighed = tuple(
            Weighed(**{f.name: np.concatenate([getattr(a, f.name), getattr(b, f.name)]) for f in fields(Weighed)})
            for a, b in zip(before.weighed, new.weighed, strict=True)
        )
        found[new.kind.name] = _Tried(batch, weighed, np.concatenate([before.log, new.log], axis=1), new.none)
    return list(found.values())


def _refined(at: Situation, found: Sequence[_Tried], problems: Sequence[tuple[Vector, Vector]]) -> list[_Tried]:
    """Weigh the likeliest candidates of the likeliest kinds once more, with the structure's answer to them."""
    evidence = np.array([tried.evidence for tried in found])
    structure = Condensed(at)
    return [
        tried
        if tried.kind.exact is None or log < max(evidence.max() - WITHIN, 0.0)
        else _with_answers(structure, tried, problems)
        for tried, log in zip(found, evidence, strict=True)
    ]


def _with_answers(structure: Condensed, tried: _Tried, problems: Sequence[tuple[Vector, Vector]]) -> _Tried:
    """Weigh the likeliest candidate of each of the likeliest forms with the structure's answer.

    A size trades against an amplitude, which to first order may be more than is possible. So forms are taken one after
    the other, the likeliest by then first, and what the likeliest candidate of a form gains is gained by all of it.
    """
    most_refined = 4  # forms of each kind that are weighed with that answer
    form, log, refined = tried.candidates.form, tried.log.copy(), dict[int, Refined]()
    for _ in range(most_refined):
        each = scipy.special.logsumexp(log, axis=0)
        mass = np.bincount(form, np.exp(each - each.max()))
        left = mass.copy()
        left[list(refined)] = 0.0
        f = int(np.argmax(left))
        if left[f] < LEAST_CELL * mass.sum():
            break
        i = int(np.argmax(np.where(form == f, each, -np.inf)))
        refined[f] = refine(structure, tried.kind, tried.candidates, i, float(tried.batch.effect[i]), problems)
        log[:, form == f] += (tried.mass(refined[f]) - log[:, i])[:, None]
    return replace(tried, log=log, refined=refined)


def _scatter(at: Situation, stated: float) -> float:
    """Return the median of the scatter: what is stated, or what repeats of the reference show where that is more."""
    if at.n_reference < 2:
        return stated
    sizes, log = stated * _SIZES, []
    for size in sizes.tolist():
        covariance = at.covariance(size, size)[np.ix_(~at.is_changed, ~at.is_changed)]
        root = la.cholesky(covariance, lower=True, check_finite=False)
        white = la.solve_triangular(root, at.joint.value[~at.is_changed], lower=True, check_finite=False)
        log.append(-0.5 * float(white @ white) - float(np.sum(np.log(np.diag(root)))))
    chance = np.array(log) - 0.5 * (np.log(_SIZES) / SCATTER_SPREAD) ** 2
    share = np.exp(chance - scipy.special.logsumexp(chance))
    return max(stated, float(np.exp(share @ np.log(sizes))))


def _answer(
    at: Situation,
    found: Sequence[_Tried],
    odds: Vector,
    impossible: Mapping[str, str],
    weighed: tuple[Vector, Vector, Vector],
    stated: float,
    *,
    seen: bool,
) -> WhatChanged:
    sizes, none, misfit = weighed
    total = float(scipy.special.logsumexp(odds))
    probability = np.exp(odds - np.logaddexp(total, 0.0))
    order = np.argsort(-odds)
    of_kind = {found[i].kind.name: _kind(at, found[i], float(odds[i]), float(probability[i]), misfit) for i in order}
    verdict, left = _verdict([of_kind[found[i].kind.name] for i in order], total, seen=seen)
    best = found[int(order[0])]
    shares = best.share.sum(axis=1) if left else np.exp(none - scipy.special.logsumexp(none))
    made = _made(at, best)
    used = [tried for tried in found if tried.kind.local and (tried.kind.name in left or not left)]
    chance = {tried.kind.name: float(probability[i]) for i, tried in enumerate(found)}
    x, y, where = _map(at.structure, [(tried, chance[tried.kind.name]) for tried in used])
    n = at.n_reference
    return WhatChanged(
        name=at.changed[0][0],
        repeats=tuple(name for name, _, _ in at.changed),
        reference=tuple(name for name, _, _ in at.reference.tested),
        verdict=verdict,
        left=left,
        kinds=tuple(of_kind.values()),
        damping=(),
        damping_left=(),
        impossible=dict(impossible),
        log_odds=total,
        scatter=float(np.exp(shares @ np.log(sizes))),
        stated=stated,
        frequency=at.states[n].frequency,
        shift=at.shift[: at.states[n].frequency.size],
        explained_shift=made[: at.states[n].frequency.size],
        x=x,
        y=y,
        map=where,
        axes=at.structure.axes,
        ends=at.structure.ends,
        box=at.structure.box,
        sentences=(),
    )


def _left(ordered: Sequence[KindOfChange]) -> tuple[str, ...]:
    """Return the kinds, the likeliest first, that the data cannot tell apart; none where they do not show."""
    if not ordered or np.logaddexp.reduce([kind.log_odds for kind in ordered]) < NAMED:
        return ()
    top = ordered[0].log_odds
    return tuple(kind.name for kind in ordered if kind.log_odds > max(top - SEPARATE, 0.0))


def _verdict(ordered: Sequence[KindOfChange], total: float, *, seen: bool) -> tuple[Verdict, tuple[str, ...]]:
    """Return the verdict, and the kinds that the data cannot tell apart."""
    if total < NAMED:
        return ("too little to say" if seen else "unchanged"), ()
    if ordered[0].explained < EXPLAINED:
        return "unlike anything", ()
    left = _left(ordered)
    if ordered[0].explained < IN_FULL:
        return "partly explained", left
    return ("identified" if len(left) == 1 else "one of"), left


def _made(at: Situation, best: _Tried) -> Vector:
    """Return the shifts of the logarithms of frequencies that the likeliest candidate makes."""
    if best.best_refined is not None:
        return best.best_refined.shift
    g, i = np.unravel_index(int(np.argmax(best.log)), best.log.shape)
    change = best.batch.action[i] * best.weighed[int(g)].amplitude[i]
    work = np.einsum("nm,nm,nm->n", change, at.ours.scale, at.ours.weight) / at.ours.eigenvalue  # Rayleigh's quotient
    return np.asarray(np.arcsinh(-0.5 * work))


def _explained(best: _Tried, misfit: Vector, n: int) -> float:
    """Return which share of the misfit, beyond what scatter leaves, the likeliest candidate takes away.

    `misfit` holds that of `n` errors without a change at each size of the scatter; the stated size is in the middle of
    the prior, and there it is looked at.
    """
    g, refined = int(np.argmin(np.abs(np.log(_SIZES)))), best.best_refined
    fall = float(best.weighed[g].fall[best.best] if refined is None else refined.fall[g])
    beyond = max(float(misfit[g]) - n, 1e-9)
    left = max(float(misfit[g]) - fall - n, 0.0)
    return 1.0 - left / beyond


def _kind(at: Situation, tried: _Tried, odds: float, probability: float, misfit: Vector) -> KindOfChange:
    """Return what is known of a kind: where and how large it is."""
    sure = 0.8  # probability of a direction from which it is said
    candidates, share = tried.candidates, tried.share
    local = tried.kind.local and bool(at.structure.axes)
    each = share.sum(axis=0)
    i = int(np.argmax(each))
    nowhere = (float("nan"),) * 3
    mean = each @ candidates.location
    spread = np.sqrt(each @ (candidates.location - mean) ** 2)
    lower, middle, upper = _size(tried)
    sized = candidates.size[np.isfinite(candidates.size)]
    return KindOfChange(
        name=tried.kind.name,
        label=tried.kind.label,
        log_odds=odds,
        probability=probability,
        local=local,
        place=three(mean) if local else nowhere,
        place_std=three(spread) if local else nowhere,
        best=three(candidates.location[i]) if local else nowhere,
        quantity=tried.kind.quantity,
        unit=tried.kind.unit,
        size=middle,
        lower=lower,
        upper=upper,
        extent=float(each @ candidates.size) if sized.size == candidates.n else float("nan"),
        angle=float(candidates.angle[i])
        if each[candidates.angle == candidates.angle[i]].sum() > sure
        else float("nan"),
        layer=at.structure.layer_name(int(candidates.layer[i])),
        part=at.structure.part_name(tried.kind.name, int(candidates.part[i])),
        explained=_explained(tried, misfit, at.ours.weight.size),
    )


def _size(tried: _Tried) -> list[float]:
    """Return the ends of the interval of 90 % of a kind's size, its median between them.

    An idealisation that is off is so in all modes alike, besides: by `IDEAL`.
    """
    levels, candidates = (0.05, 0.5, 0.95), tried.candidates
    if tried.refined and tried.kind.exact is not None:
        values, logs = [], []
        factor = np.exp(IDEAL * _NODES)[:, None]
        for form, one in tried.refined.items():
            of = candidates.only(np.array([one.index]))
            trial = np.minimum(factor * one.amplitude, tried.kind.whole)
            values += [tried.kind.exact(of, line[None, :])[0] for line in trial]
            log = scipy.special.logsumexp(tried.none[:, None] + one.log, axis=0)
            whole = scipy.special.logsumexp(tried.log[:, candidates.form == form])
            logs += [log - scipy.special.logsumexp(log) + whole] * len(factor)
        total = np.concatenate(logs)
        return _quantiles(np.concatenate(values), np.exp(total - total.max()), levels)
    counts = tried.share.max(axis=0) > _COUNTS * tried.share.max()
    candidates = candidates.only(np.flatnonzero(counts))
    mean = np.array([w.amplitude[counts] for w in tried.weighed])
    std = np.hypot(np.array([w.std[counts] for w in tried.weighed]), IDEAL * mean)
    trial = np.clip(mean[..., None] + std[..., None] * _NODES, 0.0, candidates.upper)
    value = np.array([tried.kind.value(candidates, line) for line in trial])
    return _quantiles(value.ravel(), np.repeat(tried.share[:, counts].ravel(), _NODES.size), levels)


def _quantiles(value: Vector, share: Vector, levels: Sequence[float]) -> list[float]:
    """Return weighted quantiles."""
    counts = share > _COUNTS * share.max()
    value, share = value[counts], share[counts]
    order = np.argsort(value)
    passed = np.cumsum(share[order]) / share.sum()
    return [float(value[order][min(int(np.searchsorted(passed, level)), value.size - 1)]) for level in levels]


def _map(structure: Structure, used: Sequence[tuple[_Tried, float]]) -> tuple[Vector, Vector, Vector]:
    """Return the middles of cells along the first two axes and the probability of each cell, (n_x, n_y)."""
    axes = ["xyz".index(name) for name in structure.axes[:2]]
    if not axes:
        return np.zeros(0), np.zeros(0), np.zeros((0, 0))
    cells, _ = structure.locations()
    x, y = (np.unique(np.round(cells[:, axis], 9)) for axis in axes)
    found = np.zeros((x.size, y.size))
    for tried, chance in used:
        i, j = (
            np.argmin(np.abs(tried.candidates.location[:, [axis]] - line), axis=1)
            for axis, line in zip(axes, (x, y), strict=True)
        )
        np.add.at(found, (i, j), chance * tried.share.sum(axis=0))
    return x, y, found / max(found.sum(), 1e-300)
