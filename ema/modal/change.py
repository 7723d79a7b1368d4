"""Has a structure changed? A state against its reference, mode by mode, without a model, and in words.

Every mode is tested three times: whether its frequency, its damping ratio and its shape differ by more than they
scatter from one assembly to the next. The tests of all modes share one level (Holm, Scand. J. Statist. 6, 1979, with
weights), so that a state that has not changed is called changed in at most 5 of 100 cases, however many modes it has.

The scatter is that of the repeats, which are few. It is therefore drawn towards the scatter that the campaign states,
as if that had been seen in `STATED_FREEDOM` + 1 assemblies, and the shift over it follows Student's t with the degrees
of freedom of both (Smyth, Stat. Appl. Genet. Mol. Biol. 3, 2004). Repeats that scatter more than is stated, over all
modes, raise what is stated; those that scatter less do not lower it, for a structure that was not taken apart in
between repeats too well.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ema.campaign.campaign_file import Reassembly
from ema.modal.configurations import CLOSE, Modes, clusters, match, sine
from ema.modal.mac import comac, mac, modal_scale_factor
from ema.types.errors import IdentificationError
from ema.types.frf import shared_dofs
from ema.types.modal_model import ModalModel
from lamella_shared import Booleans, Complexes, Integers, Reals, arrays, csv_text

LEVEL = 0.05
"""Probability that a state is called changed that is not."""
KINDS = ("frequency", "damping", "shape")
_WEIGHT = np.array([0.6, 0.2, 0.2])
"""Shares of the level that the kinds of test have: frequencies scatter least and tell most."""
STATED_FREEDOM = 8
"""Degrees of freedom that the stated scatter counts for: it is then right within a factor of 1.7 in nine of ten
laboratories, which spans what is known of reassembly (`ema.campaign.campaign_file`)."""
_FEWEST_DOFS = 5  # over which a change of shape is judged


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays(
    {
        "n": "mode reference_mode frequency reference_frequency damping reference_damping frequency_shift "
        "damping_shift frequency_scatter damping_scatter mac angle angle_scatter critical_shift freedom",
        "n 3": "probability",
        "any any": "mac_matrix",
        "any": "matrix_row matrix_column new_frequency gone_frequency",
        "dof": "node comac",
        "dof 3": "direction location",
        "new_frequency": "new_like",
        "gone_frequency": "gone_like",
    }
)
class Change:
    """What differs between a state and its reference, of every mode that both have, ascending in frequency.

    Where a state was measured several times, frequencies, damping ratios and shapes are means over the repeats.

    Attributes
    ----------
    name : str
        The state.
    repeats, reference : tuple of str
        The configurations that the state and its reference were measured in.
    mode, reference_mode : (n_mode,) int
        Numbers of the modes in the first of each, from 0.
    frequency, reference_frequency : (n_mode,) float
        Natural frequencies, Hz.
    damping, reference_damping : (n_mode,) float
        Damping ratios.
    frequency_shift, damping_shift : (n_mode,) float
        Differences of their logarithms, state less reference.
    frequency_scatter, damping_scatter : (n_mode,) float
        Standard deviations of these differences in a structure that has not changed.
    mac : (n_mode,) float
        MAC of the two shapes.
    angle : (n_mode,) float
        Angle between the shapes, rad; of close modes the largest one between the planes that they span. NaN where too
        few DOFs are shared to judge it.
    angle_scatter : (n_mode,) float
        Sine of this angle that is expected in a structure that has not changed, root mean square.
    probability : (n_mode, 3) float
        Of frequency, damping and shape: probability that any test of an unchanged structure comes out as clearly
        (adjusted for the number of tests). 1 where nothing could be tested.
    critical_shift : (n_mode,) float
        Size of a difference of the logarithms of the frequencies that would be called a change by itself.
    freedom : (n_mode,) float
        Degrees of freedom of the repeats behind the scatter; 0 where it is stated alone.
    mac_matrix : (n_reference_mode, n_state_mode) float
        MAC of all modes of the first configuration of each.
    matrix_row, matrix_column : (n_reference_mode,) float, (n_state_mode,) float
        Frequencies of its rows and columns, Hz.
    node : (n_dof,) int
        Point numbers of the shared DOFs.
    direction, location : (n_dof, 3) float
        Their directions, and places in m; NaN of points without coordinates.
    comac : (n_dof,) float
        CoMAC of the matched modes at these DOFs.
    new_frequency, gone_frequency : (any,) float
        Modes, Hz, that only the state or only the reference has, in all repeats and well within both bands.
    new_like, gone_like : (any,) int
        Number of the reference's mode, from 0, whose shape such a mode has although that mode has its partner: a
        resonator splits a mode in two, and so does an identification that takes one for two. -1 where there is none.
    level : float
        Level that the probabilities are judged at.
    """

    name: str
    repeats: tuple[str, ...]
    reference: tuple[str, ...]
    mode: Integers
    reference_mode: Integers
    frequency: Reals
    reference_frequency: Reals
    damping: Reals
    reference_damping: Reals
    frequency_shift: Reals
    damping_shift: Reals
    frequency_scatter: Reals
    damping_scatter: Reals
    mac: Reals
    angle: Reals
    angle_scatter: Reals
    probability: Reals
    critical_shift: Reals
    freedom: Reals
    mac_matrix: Reals
    matrix_row: Reals
    matrix_column: Reals
    node: Integers
    direction: Reals
    location: Reals
    comac: Reals
    new_frequency: Reals
    gone_frequency: Reals
    new_like: Integers
    gone_like: Integers
    level: float = LEVEL

    @property
    def which(self) -> Booleans:
        """Which modes changed in frequency, damping and shape, (n_mode, 3)."""
        return np.asarray(self.probability < self.level)

    @property
    def changed(self) -> bool:
        """Whether the structure changed."""
        return bool(self.which.any())


@dataclass(frozen=True, eq=False, kw_only=True)
class _Side:
    """The state or the reference: the modes that were matched, of each of its repeats.

    Logarithms of frequencies and damping ratios, and the variances that noise leaves in them, are (n_repeat, n_mode);
    NaN where a repeat lacks a mode. Shapes are of unit length: those of each repeat, turned to the first's,
    (n_repeat, n_dof, n_mode), and what noise leaves of their squared length, (n_repeat, n_mode). `overlapping` holds of
    each mode in each repeat the shapes, (n_dof, any), of modes without a partner whose half-power bands overlap with
    its own: two such shapes are as well any others of their plane, as where an identification takes one mode for two.
    """

    frequency: Reals
    frequency_noise: Reals
    damping: Reals
    damping_noise: Reals
    shape: Complexes
    shape_noise: Reals
    overlapping: Sequence[Sequence[Complexes]]

    @property
    def mean_shape(self) -> Complexes:
        """Means of the shapes over the repeats, (n_dof, n_mode)."""
        return np.asarray(np.nanmean(self.shape, axis=0))

    def span(self, group: Integers, repeat: int | None = None) -> Complexes:
        """Return what spans the plane of close modes, with those that overlap, in a repeat or in all, (n_dof, any)."""
        shape = self.mean_shape if repeat is None else self.shape[repeat]
        beside = self.overlapping if repeat is None else [self.overlapping[repeat]]
        return np.hstack([shape[:, group], *(column[k] for column in beside for k in group)])


def change(
    states: Sequence[ModalModel],
    references: Sequence[ModalModel],
    reassembly: Reassembly | None = None,
    *,
    level: float = LEVEL,
) -> Change:
    """Compare a state with its reference.

    Parameters
    ----------
    states, references : sequence of ModalModel
        The state and its repeats, and the reference and its repeats, of one structure.
    reassembly : Reassembly, optional
        Scatter of a state that is assembled anew.
    level : float
        Probability that a state is called changed that is not.

    Raises
    ------
    IdentificationError
        One of the two has no configuration, or they share no DOF.
    """
    dofs = _shared(states, references)
    before_modes, after_modes = (
        [(model.frequency, model.shape[of_model]) for model, of_model in zip(models, places, strict=True)]
        for models, places in ((references, dofs[: len(references)]), (states, dofs[len(references) :]))
    )
    rows, columns = match(before_modes[0], after_modes[0])
    before = _side(references, dofs[: len(references)], rows)
    after = _side(states, dofs[len(references) :], columns)
    stated = Reassembly() if reassembly is None else reassembly
    new = _only(states, after_modes, references, before_modes)
    gone = _only(references, before_modes, states, after_modes)
    first = references[0]
    return Change(
        name=states[0].name,
        repeats=tuple(model.name for model in states),
        reference=tuple(model.name for model in references),
        mode=columns,
        reference_mode=rows,
        **_tests(before, after, stated, (references[0].frequency, rows), level),
        mac_matrix=mac(before_modes[0][1], after_modes[0][1]),
        matrix_row=before_modes[0][0],
        matrix_column=after_modes[0][0],
        node=first.node[dofs[0]],
        direction=first.direction[dofs[0]],
        location=_places(first, dofs[0]),
        comac=comac(before.mean_shape, after.mean_shape) if rows.size else np.ones(dofs[0].size),
        new_frequency=states[0].frequency[new],
        gone_frequency=references[0].frequency[gone],
        new_like=_like(after_modes[0], new, columns, rows),
        gone_like=_like(before_modes[0], gone, rows, rows),
        level=level,
    )


def _shared(states: Sequence[ModalModel], references: Sequence[ModalModel]) -> tuple[Integers, ...]:
    """Return the positions of the DOFs that all have, of the references first."""
    if not states or not references:
        raise IdentificationError("change: give at least one modal model of the state and one of its reference")
    dofs = shared_dofs([*references, *states])
    if not dofs[0].size:
        names = [", ".join(model.name for model in models) for models in (states, references)]
        raise IdentificationError(
            f"{' and '.join(names)} share no point and direction, so that nothing of them can be compared"
        )
    return dofs


def _tests(
    before: _Side, after: _Side, stated: Reassembly, reference: tuple[Reals, Integers], level: float
) -> dict[str, Reals]:
    """Return what a `Change` holds of the modes that were matched, by its names; see `_angles` for `reference`."""
    shift, scatter, freedom = _shift(
        (after.frequency, after.frequency_noise), (before.frequency, before.frequency_noise), stated.frequency
    )
    damping_shift, damping_scatter, damping_freedom = _shift(
        (after.damping, after.damping_noise), (before.damping, before.damping_noise), stated.damping
    )
    angle, angle_scatter = _angles(after, before, stated, reference)
    tail = [
        2.0 * scipy.special.stdtr(STATED_FREEDOM + degrees, -size)
        for size, degrees in (
            (np.abs(shift) / scatter, freedom),
            (np.abs(damping_shift) / damping_scatter, damping_freedom),
            (np.sin(angle) / angle_scatter, 0.0),
        )
    ]
    alone = level * _WEIGHT[0] / max(before.shape.shape[2], 1)  # at which one frequency is enough
    return {
        "frequency": np.exp(np.nanmean(after.frequency, axis=0)),
        "reference_frequency": np.exp(np.nanmean(before.frequency, axis=0)),
        "damping": np.exp(np.nanmean(after.damping, axis=0)),
        "reference_damping": np.exp(np.nanmean(before.damping, axis=0)),
        "frequency_shift": shift,
        "damping_shift": damping_shift,
        "frequency_scatter": scatter,
        "damping_scatter": damping_scatter,
        "mac": np.diag(mac(before.mean_shape, after.mean_shape)) if shift.size else np.empty(0),
        "angle": angle,
        "angle_scatter": angle_scatter,
        "probability": _adjusted(np.column_stack(tail)),
        "critical_shift": scatter * -scipy.special.stdtrit(STATED_FREEDOM + freedom, alone / 2.0),
        "freedom": freedom,
    }


def _side(models: Sequence[ModalModel], dofs: Sequence[Integers], modes: Integers) -> _Side:
    """Collect modes of the first of some repeats, and the same ones of the others."""
    first = models[0].shape[dofs[0]][:, modes]
    values = np.full((5, len(models), modes.size), np.nan)
    shape = np.full((len(models), dofs[0].size, modes.size), np.nan, dtype=complex)
    overlapping = []
    for k, (model, of_model) in enumerate(zip(models, dofs, strict=True)):
        rows, columns = match((models[0].frequency, models[0].shape[dofs[0]]), (model.frequency, model.shape[of_model]))
        partner = dict(zip(rows.tolist(), columns.tolist(), strict=True))
        there = np.array([r in partner for r in modes.tolist()], dtype=bool)
        c = np.array([partner[r] for r in modes.tolist() if r in partner], dtype=np.int64)
        used = model.shape[of_model][:, c]
        length = np.linalg.norm(used, axis=0)
        values[:, k, there] = (
            np.log(model.frequency[c]),
            (model.frequency_std[c] / model.frequency[c]) ** 2,
            np.log(model.damping[c]),
            (model.damping_std[c] / model.damping[c]) ** 2,
            np.sum(model.shape_std[of_model][:, c] ** 2, axis=0) / length**2,
        )
        turn = modal_scale_factor(used, first[:, there])
        shape[k][:, there] = used / length * np.exp(1j * np.angle(turn))
        overlapping.append(_overlapping(model, of_model, modes, partner))
    return _Side(
        frequency=values[0],
        frequency_noise=values[1],
        damping=values[2],
        damping_noise=values[3],
        shape=shape,
        shape_noise=values[4],
        overlapping=overlapping,
    )


def _overlapping(model: ModalModel, dofs: Integers, modes: Integers, partner: Mapping[int, int]) -> list[Complexes]:
    """Return of each of some modes the shapes of those without a partner whose half-power bands overlap with its own.

    `partner` tells which mode of the model each of `modes` is, where it is any.
    """
    half, taken = model.frequency * model.damping, [partner[r] for r in modes.tolist() if r in partner]
    others = np.setdiff1d(np.arange(model.frequency.size), taken)
    shape = model.shape[dofs][:, others] / np.linalg.norm(model.shape[dofs][:, others], axis=0)
    found = []
    for other in (partner.get(r) for r in modes.tolist()):
        gap = np.inf if other is None else np.abs(model.frequency[others] - model.frequency[other]) - half[other]
        found.append(shape[:, gap < half[others]])
    return found


def _shift(after: tuple[Reals, Reals], before: tuple[Reals, Reals], stated: float) -> tuple[Reals, Reals, Reals]:
    """Return the shift of each mode, its standard deviation, and the degrees of freedom of repeats behind it.

    Both sides are logarithms and the variances that noise leaves in them, (n_repeat, n_mode). What is stated is the
    standard deviation of a logarithm from one assembly to the next.
    """
    shift = np.nanmean(after[0], axis=0) - np.nanmean(before[0], axis=0)
    freedom, squares, share, expected = np.zeros((4, shift.size))
    for value, noise in (after, before):
        n = np.count_nonzero(np.isfinite(value), axis=0)
        freedom = freedom + n - 1.0
        squares = squares + np.nansum((value - np.nanmean(value, axis=0)) ** 2, axis=0)
        share = share + 1.0 / n
        expected = expected + (stated**2 + np.nanmean(noise, axis=0)) / n
    seen = squares * share  # of the shift's variance, times the freedom
    if freedom.sum() > 0:
        expected = expected * max(1.0, float(np.sum(seen) / np.sum(freedom * expected)))
    variance = (STATED_FREEDOM * expected + seen) / (STATED_FREEDOM + freedom)
    return shift, np.sqrt(variance), freedom


def _angles(
    after: _Side, before: _Side, stated: Reassembly, reference: tuple[Reals, Integers], *, closest: float = 1e-3
) -> tuple[Reals, Reals]:
    """Return the angle between the shapes of each mode, or the planes of close ones, and its expected sine, (n_mode,).

    A relative change of stiffness by sigma moves a frequency by sigma / sqrt(2), and mixes a share
    sigma f_r f_s / (f_r^2 - f_s^2) of mode s into mode r. `reference` holds the frequencies of all its modes, Hz,
    and the numbers of those that were matched.

    `closest`: relative gap; closer modes are in one plane, and their mixing is not counted.
    """
    _, n_dof, n_mode = before.shape.shape
    if n_dof < _FEWEST_DOFS or not n_mode:
        return np.full(n_mode, np.nan), np.full(n_mode, np.nan)
    frequency, matched = reference
    matched_frequency = frequency[matched]
    groups = _planes(matched_frequency, np.exp(after.frequency[0]))
    angle, variance, assembly = np.zeros((3, n_mode))
    for group in groups:
        others = np.delete(frequency, matched[group])
        gap = np.abs(matched_frequency[group][:, None] / others - others / matched_frequency[group][:, None])
        mixed = 2.0 * np.sum((stated.frequency / np.maximum(gap, 2.0 * closest)) ** 2, axis=1)
        assembly[group] = np.sum(stated.shape**2 + mixed)
        angle[group] = np.arcsin(sine(before.span(group), after.span(group), group.size))
        for side in (before, after):
            n = np.min(np.count_nonzero(np.isfinite(side.shape_noise[:, group]), axis=0))
            variance[group] += (assembly[group] + np.sum(np.nanmean(side.shape_noise[:, group], axis=0))) / n
    seen = [
        sine(side.span(group, 0), side.span(group, repeat), group.size) ** 2
        / (2.0 * assembly[group[0]] + np.sum(side.shape_noise[[0, repeat]][:, group]))
        for side in (before, after)
        for repeat in range(1, len(side.shape))
        for group in groups
        if np.all(np.isfinite(side.shape[repeat][:, group]))
    ]
    return angle, np.sqrt(variance * max(1.0, float(np.mean(seen)) if seen else 1.0))


def _planes(first: Reals, second: Reals) -> list[Integers]:
    """Group modes that are close in either of two states."""
    number = np.arange(first.size)
    for group in (*clusters(first), *clusters(second)):
        number[np.isin(number, number[group])] = number[group].min()
    return [np.flatnonzero(number == k) for k in np.unique(number)]


def _adjusted(tail: Reals) -> Reals:
    """Adjust probabilities (n_mode, 3) for their number, so that each can be judged at the level of all (Holm)."""
    weight = np.broadcast_to(_WEIGHT / max(len(tail), 1), tail.shape).ravel()
    single = np.nan_to_num(tail.ravel(), nan=1.0)
    order = np.argsort(single / weight)
    # weights of this test and of those that come out less clearly
    left = np.cumsum(weight[order][::-1])[::-1]
    adjusted = np.empty(single.size)
    adjusted[order] = np.maximum.accumulate(single[order] / weight[order] * left)
    return np.minimum(adjusted, 1.0).reshape(tail.shape)


def _only(
    models: Sequence[ModalModel],
    own_modes: Sequence[Modes],
    others: Sequence[ModalModel],
    other_modes: Sequence[Modes],
    *,
    edge: float = 0.02,
) -> Integers:
    """Return numbers of modes that all repeats of one side have and none of the other, well within all bands.

    `edge`: share of a band's ends within which a mode may be missed.
    """
    first = own_modes[0]
    kept = np.ones(first[0].size, dtype=bool)
    for repeat in own_modes[1:]:
        kept &= np.isin(np.arange(kept.size), match(first, repeat)[0])
    for other in other_modes:
        kept &= ~np.isin(np.arange(kept.size), match(first, other)[0])
    lower = max(model.band[0] for model in (*models, *others)) * (1.0 + edge)
    upper = min(model.band[1] for model in (*models, *others)) * (1.0 - edge)
    return np.flatnonzero(kept & (first[0] > lower) & (first[0] < upper))


def _like(modes: Modes, single: Integers, matched: Integers, number: Integers, *, twin: float = 0.8) -> Integers:
    """Return for modes without a partner the number of the matched mode that is close by and has their shape, or -1.

    `twin`: MAC of a mode with its neighbour from which it is that one twice.
    """
    frequency, shape = modes
    likeliest = np.full(single.size, -1)
    if not matched.size or shape.shape[0] < _FEWEST_DOFS:
        return likeliest
    alike = mac(shape[:, single], shape[:, matched]) if single.size else np.empty((0, matched.size))
    for k, r in enumerate(single):
        near = np.abs(np.log(frequency[matched] / frequency[r])) < CLOSE
        likeness = np.where(near, alike[k], 0.0)
        if likeness.max() > twin:
            likeliest[k] = number[int(np.argmax(likeness))]
    return likeliest


def _places(model: ModalModel, dofs: Integers) -> Reals:
    """Return where DOFs of a model are, m, (n_dof, 3); NaN of points without coordinates."""
    where = dict(zip(model.geometry.node.tolist(), model.geometry.coordinate, strict=True))
    return np.array([where.get(n, np.full(3, np.nan)) for n in model.node[dofs].tolist()]).reshape(-1, 3)


_COLUMNS = (
    "mode", "reference_mode", "frequency_Hz", "reference_frequency_Hz", "frequency_shift", "frequency_scatter",
    "frequency_probability", "damping", "reference_damping", "damping_shift", "damping_scatter", "damping_probability",
    "mac", "angle_deg", "angle_scatter_deg", "shape_probability", "changed",
)  # fmt: skip


def change_sentence(change: Change) -> str:
    """Say in one sentence whether a state changed against its reference, which modes did, and by how much."""
    head = f"{change.name} against {_list(change.reference)}"
    if not change.mode.size:
        return f"{head}: they share no mode, so nothing can be said of a change{_one_sided(change)}"
    if not change.changed:
        return f"{head}: {_unchanged(change)}{_one_sided(change)}"
    parts = [*_moved(change), *_damped(change), *_turned(change)]
    same = np.flatnonzero(~change.which.any(axis=1))
    text = "; ".join(parts)
    if same.size:
        text += f"; {_modes(change, same)} did not by more than would be seen ({_seen(change, same)})"
    return f"{head}: changed: {text}{_one_sided(change)}"


def change_csv(change: Change) -> str:
    """Return a comparison as CSV, one row for each mode that both have; modes are numbered from 1.

    Shifts are differences of logarithms, state less reference, scatters their standard deviations without a change.
    """
    rows = (
        (
            change.mode[r] + 1, change.reference_mode[r] + 1, change.frequency[r], change.reference_frequency[r],
            change.frequency_shift[r], change.frequency_scatter[r], f, change.damping[r], change.reference_damping[r],
            change.damping_shift[r], change.damping_scatter[r], d, change.mac[r], np.rad2deg(change.angle[r]),
            np.rad2deg(np.arcsin(np.minimum(change.angle_scatter[r], 1.0))), s,
            " ".join(what for what, is_other in zip(KINDS, change.which[r], strict=True) if is_other),
        )
        for r, (f, d, s) in enumerate(change.probability)
    )  # fmt: skip
    return csv_text(_COLUMNS, rows)


def _unchanged(change: Change) -> str:
    size = float(np.abs(np.expm1(change.frequency_shift)).max())
    r = int(np.argmax(np.abs(change.frequency_shift) / change.frequency_scatter))
    times = abs(change.frequency_shift[r]) / change.frequency_scatter[r]
    return (
        f"no mode by itself shows a change: frequencies moved by at most {_two(100.0 * size)} %, "
        f"{f'{times:.1f}' if times >= 0.1 else 'less than 0.1'} times {_scatter(change)}; "
        f"one that moved by less than {_seen(change, np.arange(change.mode.size))} would not be seen"
    )


def _seen(change: Change, which: Integers) -> str:
    """Write the shift of a frequency that would be called a change, in the median of some modes."""
    return f"{_two(100.0 * float(np.expm1(np.median(change.critical_shift[which]))))} %"


def _moved(change: Change) -> Iterator[str]:
    """Say which frequencies fell and which rose."""
    times = np.abs(change.frequency_shift) / change.frequency_scatter
    first = True
    for sign, word in ((-1.0, "fell"), (1.0, "rose")):
        moved = np.flatnonzero(change.which[:, 0] & (np.sign(change.frequency_shift) == sign))
        if moved.size:
            size = np.abs(np.expm1(change.frequency_shift[moved]))
            scatter = _scatter(change) if first else "that scatter"
            yield (f"{_modes(change, moved)} {word} by {_range(size)}, {_between(times[moved])} times {scatter}")
            first = False


def _damped(change: Change) -> Iterator[str]:
    for sign, word in ((1.0, "more"), (-1.0, "less")):
        moved = np.flatnonzero(change.which[:, 1] & (np.sign(change.damping_shift) == sign))
        if moved.size:
            size = np.abs(np.expm1(change.damping_shift[moved]))
            yield f"the damping of {_modes(change, moved)} is {word} by {_range(size)}"


def _turned(change: Change) -> Iterator[str]:
    turned = np.flatnonzero(change.which[:, 2])
    if turned.size:
        yield f"the shape of {_modes(change, turned)} is another one (MAC down to {change.mac[turned].min():.2f})"


def _one_sided(change: Change) -> str:
    """Say which modes only one of the two has; the level does not count them, for an identification may miss one."""
    text = ""
    for frequency, like, where in (
        (change.new_frequency, change.new_like, change.name),
        (change.gone_frequency, change.gone_like, "the reference"),
    ):
        if frequency.size:
            one = frequency.size == 1
            each = [
                f"{f:.5g} Hz" + (f" (with the shape of mode {r + 1})" if r >= 0 else "")
                for f, r in zip(frequency, like, strict=True)
            ]
            head, verb = ("a mode", "was") if one else ("modes", "were")
            text += f"; {head} at {_list(each)} {verb} found in {where} only"
    return text


def _scatter(change: Change) -> str:
    if change.freedom.max(initial=0.0) > 0:
        return "the scatter of repeats and reassembly"
    return "the scatter that reassembly and noise bring"


def _modes(change: Change, which: Integers) -> str:
    numbers = [str(r + 1) for r in change.reference_mode[which]]
    return f"{'mode' if which.size == 1 else 'modes'} {_list(numbers)}"


def _list(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _range(size: Reals) -> str:
    lower, upper = (_two(100.0 * s) for s in (size.min(), size.max()))
    return f"{upper} %" if lower == upper else f"{lower} to {upper} %"


def _between(times: Reals) -> str:
    lower, upper = (_two(t) for t in (times.min(), times.max()))
    return upper if lower == upper else f"{lower} to {upper}"


def _two(value: float) -> str:
    """Two digits, without an exponent."""
    return f"{value:.2g}" if value < 99.5 else f"{value:.0f}"
