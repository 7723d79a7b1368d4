"""A diagnosis in plain sentences, the answer first."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from updating.diagnosis.answer import Diagnosis, Ranked, Strained
from updating.diagnosis.calibration import STRAINED
from updating.diagnosis.discrepancy import MEDIAN, SPREAD, Sizes
from updating.diagnosis.evidence import DECAY, POINTS_SHIFT
from updating.diagnosis.mixed_up import MixedUp
from updating.diagnosis.point_change import PointChange
from updating.diagnosis.sensor_gain import SensorGain
from updating.results.text import interval_text, percent, quantity

_FOLDED = 5  # names that are listed before a count stands for the rest
_LISTED = 3  # explanations that are told in a sentence
_KINDS = {"frequency": "frequency", "damping": "damping ratio", "shape": "shape"}


def sentences(found: Diagnosis) -> tuple[str, ...]:
    """Write the verdict, what supports it, what stays open and what to measure next."""
    text = [_verdict(found), _rests_on(found), *(_mixed_up(own) for own in found.mixed_up)]
    if len(found.steps) > 2:
        text.append(_way(found))
    if found.verdict == "one of":
        text += [
            f"If it is {named(found, effects)}: {_values(found.ranked(effects))}."
            for effects in found.set[:_LISTED]
            if found.ranked(effects).parameter
        ]
    if found.set:
        text.append(f"Beyond the noise of the measurement, what remains is {_sizes(found.discrepancy)}.")
    if found.verdict == "partly explained":
        text.append(_remains(found))
    if found.set and (further := [name for name in found.steps[-1].effects if name not in found.set[0]]):
        text.append(
            f"It looks like {named(found, further)}, but is no more than what {named(found, found.set[0])} leaves "
            "where its form differs from the catalogue's."
        )
    if found.verdict == "unlike anything":
        text.append(_where(found))
    if found.point_change is not None:
        text.append(_at_a_point(found, found.point_change))
    text += [_strained(own) for own in found.strained]
    text += _at_bounds(found)
    text += _misread(found.sensor_gains)
    text += _next(found)
    if found.ruled_out:
        text.append(f"Ruled out at their usual strength: {_folded(found.ruled_out)}.")
    if found.not_visible:
        text.append(
            f"Too weak to show in these data at any plausible strength: {_folded(found.not_visible)}."
        )
    return tuple(text)


def next_command(found: Diagnosis, campaign: str, folder: str) -> str | None:
    """Return the command that adds what was found and shows the error fall; None where there is nothing to add."""
    effects = [name for name in (found.set[0] if found.set else ()) if name not in found.measurement]
    if not effects:
        return None
    return " ".join(["lamella fit", campaign, "-o", folder, *(f"--effect {name}" for name in effects)])


def named(found: Diagnosis, effects: Sequence[str]) -> str:
    """Return one or several effects in words, with the key of each beside it."""
    return " together with ".join(f"{found.labels.get(e, e)} ({e})" for e in effects) or "the base model"


def _verdict(found: Diagnosis) -> str:
    """Write the sentence that a customer needs."""
    base = found.ranked(())
    if found.verdict == "nothing missing":
        return (
            "Nothing is missing that these data can show. The model meets the frequencies to "
            f"{percent(base.frequency_error)} in the mean; beyond noise it is right to {_sizes(found.discrepancy)}."
        )
    if found.verdict == "unlike anything":
        return (
            f"Unlike anything in the catalogue: the model misses the frequencies by {percent(base.frequency_error)} in "
            "the mean, and no effect that was tried helps to predict modes that it has not seen."
        )
    own, share = found.ranked(found.set[0]), f"{100.0 * found.explained:.0f} %"
    what = named(found, own.effects)
    if found.verdict == "one of":
        every = "; or ".join(named(found, effects) for effects in found.set)
        return (
            f"One of these, and the data cannot tell which: {every}. {_change(base, own, 'With the first')}"
        )
    if found.verdict == "partly explained":
        others = "; ".join(named(found, effects) for effects in found.set[1 : 1 + _LISTED])
        near = f" Nearly as likely: {others}." if others else ""
        return f"Part of the misfit ({share}) is {what}{_said(own)}. {_change(base, own, 'With it')}{near}"
    where = (
        "Not the model but the measurement" if set(own.effects) <= set(found.measurement) else "Identified"
    )
    return f"{where}: {what}{_said(own)}. It explains {share} of the misfit. {_change(base, own, 'With it')}"


def _said(own: Ranked) -> str:
    values = _values(own)
    return f": {values}" if values else ""


def _values(own: Ranked) -> str:
    """Write the parameters of an explanation with their intervals."""
    return ", ".join(map(interval_text, own.parameter))


def _change(base: Ranked, own: Ranked, start: str) -> str:
    """Say what the frequency error falls to, also where each mode is predicted from all others."""
    before, after = percent(base.frequency_error), percent(own.frequency_error)
    if own.frequency_error >= base.frequency_error:
        return (
            f"{start} the mean error of damping ratios falls from {percent(base.damping_error)} to "
            f"{percent(own.damping_error)}, that of frequencies stays at {after}."
        )
    text = f"{start} the mean frequency error falls from {before} to {after}"
    if not np.isfinite([base.left_out_error, own.left_out_error]).all():
        return f"{text}."
    before, after = percent(base.left_out_error), percent(own.left_out_error)
    return f"{text}; for modes that are predicted from all others, from {before} to {after}."


def _rests_on(found: Diagnosis) -> str:
    parts = [f"{used} of {n} modes of {name}" for name, (used, n) in found.n_used.items()]
    left_out = (
        ""
        if np.isfinite(found.discrepancy.damping)
        else " Damping is not compared: one lamina has no contact, and its model no loss of its own."
    )
    return f"The answer rests on {', '.join(parts)}.{left_out}"


def _mixed_up(own: MixedUp) -> str:
    """Say which points of the measurement were mixed up."""
    where = " and ".join(own.configuration)
    what = (
        f"the sensor at point {own.node[0]} seems to have been turned over"
        if own.kind == "turned"
        else f"points {own.node[0]} and {own.node[1]} seem to have been exchanged"
    )
    return f"In {where} {what}: check the campaign file. The answer takes the points as put right."


def _way(found: Diagnosis) -> str:
    """Say what each of several effects brings."""
    parts = []
    for before, after in itertools.pairwise(found.steps):
        added = [name for name in after.effects if name not in before.effects]
        parts.append(
            f"{named(found, added)} from {percent(before.frequency_error)} to {percent(after.frequency_error)} "
            f"({percent(before.left_out_error)} to {percent(after.left_out_error)} for modes left out)"
        )
    return f"Step by step the frequency error goes with {'; with '.join(parts)}."


def _sizes(own: Sizes) -> str:
    compared = [kind for kind in _KINDS if np.isfinite(getattr(own, kind))]
    parts = [f"{percent(getattr(own, kind))} of a {_KINDS[kind]}" for kind in compared]
    return f"{', '.join(parts[:-1])} and {parts[-1]}"


def _remains(found: Diagnosis) -> str:
    """Say why what remains is too much."""
    if found.lacking:
        return f"The model has no mode like {', '.join(found.lacking)}: what was said is of the others."
    large = [
        f"{percent(getattr(found.discrepancy, kind))} of a {_KINDS[kind]}, where right models leave up to "
        f"{percent(MEDIAN[kind] * float(np.exp(1.645 * SPREAD)))}"
        for kind in found.too_large
    ]
    reason = (
        f"That is too much for a model to which nothing is missing: {'; '.join(large)}. " if large else ""
    )
    return f"{reason}{_where(found)}"


def _where(found: Diagnosis) -> str:
    """Say which frequencies the first explanation, or the base model, misses most."""
    off = np.array([-(own.base if np.isnan(own.explained) else own.explained) for own in found.errors])
    parts = [
        f"{own.configuration}, mode {own.mode} at {own.frequency:.1f} Hz "
        f"(measured {percent(abs(off[i]))} {'higher' if off[i] > 0 else 'lower'})"
        for i, own in ((int(i), found.errors[int(i)]) for i in np.argsort(-np.abs(off))[:_LISTED])
    ]
    return f"It fails most at {'; '.join(parts)}."


def _at_a_point(found: Diagnosis, own: PointChange) -> str:
    """Say where something is that no effect of the catalogue explains."""
    size = quantity(abs(own.size), "kg" if own.kind == "mass" else "N/m")
    what = f"{size} {'more' if own.size > 0.0 else 'less'} {'mass' if own.kind == 'mass' else 'stiffness'}"
    return (
        f"What {named(found, own.beside)} leaves looks like {what} "
        f"at or near point {own.node} in the measured direction. Look there."
    )


def _strained(own: Strained) -> str:
    """Say that something stated would have to be far from what is known of it."""
    what, _, where = own.name.partition("[")
    known = f"what is known of it leaves {_off(own, own.std)}"
    if what in ("G_f", "d_f"):
        name = {"G_f": "contact stiffness G_f", "d_f": "contact damping d_f"}[what]
        known = f"reassembly and torque explain {_off(own, own.std)}"
        text = f"the {name} at {where[:-1]} would have to be off the other torques' by {_off(own, own.value)}"
    elif what.startswith("clamp"):
        text = f"clamp {what.split('_')[1]} would have to sit {_off(own, own.value)} farther along {what[-1]}"
    elif what == POINTS_SHIFT:
        text = f"all points would have to sit {_off(own, own.value)} farther along x"
    else:
        text = f"the stack's {what.replace('_', ' ')} would have to be off by {_off(own, own.value)}"
    return f"Beware: {text}; {known}."


def _off(own: Strained, value: float) -> str:
    """Write how far a nuisance is off, in its unit or in percent."""
    if own.name == POINTS_SHIFT or own.name.startswith("clamp"):
        return quantity(value, "m")
    return quantity(value, "1/s") if own.name == DECAY else percent(float(np.expm1(value)))


def _at_bounds(found: Diagnosis) -> list[str]:
    text = []
    for effects in found.set:
        bound = [p.name for p in found.ranked(effects).parameter if p.at_bound]
        if bound:
            text.append(
                f"Beware: {', '.join(bound)} of {named(found, effects)} lies at the end of its plausible range, so "
                "that explanation is doubtful."
            )
    return text


def _misread(gains: Sequence[SensorGain]) -> list[str]:
    """Say which accelerometers read otherwise than the first."""
    return [
        f"Sensor {own.sensor} of each run reads {percent(abs(own.excess))} {'higher' if own.excess > 0 else 'lower'} "
        f"than sensor 1 (95 %: ± {percent(1.96 * own.std)}): check its calibration. It is taken into account."
        for own in gains
        if abs(own.excess) > STRAINED * own.std
    ]


def _next(found: Diagnosis) -> list[str]:
    useful = [t for t in found.next_tests if t.distance > max(t.now, 1.0)]
    if useful and useful[0].distance >= STRAINED:
        return [
            f"To tell them apart, {useful[0].instruction}: they would differ by {useful[0].distance:.1f} standard "
            f"deviations, now by {useful[0].now:.1f}."
        ]
    if found.next_tests:
        return [
            "None of the further tests that were considered would tell them apart by 3 standard deviations."
        ]
    return []


def _folded(effects: Sequence[str]) -> str:
    """Return how many effects there are, and the first few by their keys."""
    more = len(effects) - _FOLDED
    shown = ", ".join(effects[:_FOLDED])
    return f"{len(effects)} effects ({shown}{f' and {more} more' if more > 0 else ''})"
