"""A diagnosis in plain sentences, the answer first."""

from __future__ import annotations

import itertools
import shlex
from collections.abc import Sequence

import numpy as np

from model.effects.contact_slip import STRAIN
from updating.diagnosis.answer import FAR, Diagnosis, MixedUp, PointChange, Ranked, SensorGain, Telling, telling
from updating.diagnosis.moved import REPORTED, misstated, moved_text, pulled_text
from updating.inference.discrepancy import DAMPING, STIFFNESS
from updating.inference.levels import FALLS, INADEQUATE, NAMED
from updating.results.text import MOST_LISTED, percent, quantity, together

_ERRORS: dict[Telling, str] = {"frequency": "frequency error", "damping": "error of damping ratios"}
_MOST_LEFT = {
    "frequency": STIFFNESS.quantile(1.0 - INADEQUATE) / float(np.sqrt(2.0)),
    "damping": DAMPING.quantile(1.0 - INADEQUATE),
}
UNLISTED = "something that no effect of the catalogue describes"
_KINDS = {"frequency": "frequency", "damping": "damping ratio"}


def sentences(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Write the verdict, what supports it, what stays open and what to measure next.

    What contradicts the measurement comes first: an answer is no better than what it rests on.
    """
    text = [f"First of all: {finding}." for rig in diagnosis.rig for finding in rig.findings]
    text += [_verdict(diagnosis), *(_mixed_up(points) for points in diagnosis.mixed_up)]
    if diagnosis.verdict == "one of":
        text += [
            f"If it is {named(diagnosis, effects)}: {values}."
            for effects in diagnosis.set[:MOST_LISTED]
            if (values := _values(diagnosis.ranked(effects)))
        ]
    without = "Without any of these" if diagnosis.verdict == "one of" else "Without it"
    text += [f"{without}, {sentence}" for sentence in pulled_text(diagnosis.relieved)[:MOST_LISTED]]
    if len(diagnosis.steps) > 2:
        text.append(_way(diagnosis))
    if diagnosis.set:
        which = "the first" if diagnosis.verdict == "one of" else "it"
        text.append(f"With {which} the model is right to {_sizes(diagnosis)}, beyond the noise.")
    if diagnosis.verdict in ("partly explained", "unlike anything"):
        text += _remains(diagnosis)
    text += [
        f"Whether it is {diagnosis.labels[name]} or {stated} that the stack file states wrongly, no vibration test can "
        "tell: check the file first."
        for name, stated in diagnosis.confounded.items()
    ]
    text += _over_amplitude(diagnosis)
    text += _likelier(diagnosis)
    if diagnosis.point_change is not None:
        text.append(_at_a_point(diagnosis, diagnosis.point_change))
    text += [f"Beware: {sentence}" for sentence in pulled_text(diagnosis.pulled)]
    text += _moved(diagnosis)
    text += _at_bounds(diagnosis)
    text += _misread(diagnosis.sensor_gains)
    text += _next(diagnosis)
    if diagnosis.ruled_out:
        text.append(f"Ruled out at their usual strength: {_folded(diagnosis, diagnosis.ruled_out)}.")
    if diagnosis.not_visible:
        text.append(
            f"Too weak to show in these data at any plausible strength: {_folded(diagnosis, diagnosis.not_visible)}."
        )
    return (*text, _rests_on(diagnosis))


def next_command(
    diagnosis: Diagnosis, campaign: str, folder: str, options: Sequence[tuple[str, str]] = ()
) -> str | None:
    """Return the command that adds what was identified and shows the error fall; None where there is nothing to add.

    `options` are those, with their values, that the diagnosis was made with.
    """
    effects = [name for name in (diagnosis.set[0] if diagnosis.set else ()) if name not in diagnosis.measurement]
    if not effects:
        return None
    arguments = itertools.chain(*(("--effect", name) for name in effects), *options)
    return shlex.join(["lamella", "fit", campaign, "-o", folder, *arguments])


def named(diagnosis: Diagnosis, effects: Sequence[str]) -> str:
    """Return one or several effects in words, with the key of each beside it."""
    return together([f"{diagnosis.labels.get(e, e)} ({e})" for e in effects]) or "the base model"


def further_effects(diagnosis: Diagnosis) -> tuple[tuple[str, ...], ...]:
    """Return what further explanations add, where all that are left hold all of the first; else nothing."""
    first, *others = diagnosis.set
    if diagnosis.unlisted == "instead" or not all(set(first) < set(effects) for effects in others):
        return ()
    return tuple(tuple(e for e in effects if e not in first) for effects in others)


def _verdict(diagnosis: Diagnosis) -> str:
    """Write the sentence that a customer needs."""
    most = 0.5  # share of the misfit from which it is most of it
    base = diagnosis.ranked(())
    if diagnosis.verdict == "nothing missing":
        return (
            "Nothing is missing that these data can show. The model's frequencies are off by "
            f"{percent(base.frequency_error)} in the mean; beyond the noise the model is right to "
            f"{_sizes(diagnosis)}."
        )
    if diagnosis.verdict == "unlike anything":
        why = (
            f"{UNLISTED} is more probable than any that was tried"
            if diagnosis.unlisted == "refused"
            else "with none of the effects that were tried does it predict better what it was not fitted to"
        )
        return (
            "Something is missing that is unlike anything in the catalogue. The model's frequencies are off by "
            f"{percent(base.frequency_error)} in the mean, and {why}."
        )
    first, share = diagnosis.ranked(diagnosis.set[0]), f"{100.0 * diagnosis.explained:.0f} %"
    what = named(diagnosis, first.effects)
    others = "; or ".join(named(diagnosis, effects) for effects in diagnosis.set[1 : 1 + MOST_LISTED])
    others += _more(diagnosis.set)
    if diagnosis.unlisted == "instead":
        others += f"{'; or ' if others else ''}{UNLISTED}"
    if diagnosis.verdict == "one of" and (beside := further_effects(diagnosis)):
        also = "; or ".join(named(diagnosis, effects) for effects in beside[:MOST_LISTED])
        return (
            f"Missing is {what}{_said(first)}. Whether {also} is missing as well, the data cannot tell. "
            f"{_change(base, first, 'With the first')}"
        )
    if diagnosis.verdict == "one of":
        return (
            f"One of these, and the data cannot tell which: {what}; or {others}. "
            f"{_change(base, first, 'With the first')}"
        )
    if diagnosis.verdict == "partly explained":
        near = f" Nearly as likely: {others}." if others else ""
        start = "Most" if diagnosis.explained > most else "Part"
        return f"{start} of the misfit ({share}) is {what}{_said(first)}. {_change(base, first, 'With it')}{near}"
    where = "Not the model but the measurement" if set(first.effects) <= set(diagnosis.measurement) else "Identified"
    return f"{where}: {what}{_said(first)}. It explains {share} of the misfit. {_change(base, first, 'With it')}"


def _more(left: Sequence[Sequence[str]]) -> str:
    """Return how many explanations there are beside those that are listed."""
    return f"; or one of {len(left) - 1 - MOST_LISTED} more" if len(left) > 1 + MOST_LISTED else ""


def _said(explanation: Ranked) -> str:
    values = _values(explanation)
    return f", {values}" if values else ""


def _values(explanation: Ranked) -> str:
    """Write the parameters of an explanation with their intervals."""
    return ", ".join(map(misstated, explanation.parameter))


def _change(base: Ranked, explanation: Ranked, start: str) -> str:
    """Say what the error falls to, also where each mode is predicted from all others."""
    if _stays(base, explanation):
        return f"{start} {_as_before(explanation)}."
    kind = telling(base, explanation)
    before, after = percent(base.frequency_error), percent(explanation.frequency_error)
    stays = f"that of frequencies {f'stays at {after}' if before == after else f'goes from {before} to {after}'}"
    if explanation.error(kind) < base.error(kind):
        ends = percent(base.error(kind)), percent(explanation.error(kind))
        text = f"{start} the mean {_ERRORS[kind]} falls from {ends[0]} to {ends[1]}"
        if np.isfinite([base.left_out(kind), explanation.left_out(kind)]).all():
            ends = percent(base.left_out(kind)), percent(explanation.left_out(kind))
            text += f"; where each mode is predicted from all others, it goes from {ends[0]} to {ends[1]}"
            if explanation.left_out(kind) > base.left_out(kind):
                text += " (too few modes determine the values of what was added to predict another mode)"
        return f"{text}." if kind == "frequency" else f"{text}; {stays}."
    if not np.isfinite(base.damping_error):
        return f"{start} {stays}."
    ends = percent(base.damping_error), percent(explanation.damping_error)
    return f"{start} {stays}, and that of damping ratios goes from {ends[0]} to {ends[1]}."


def _moved(diagnosis: Diagnosis) -> list[str]:
    """Name what was moved by more than two standard deviations; what is pulled farther has its own sentence."""
    known = {nuisance.name for nuisance in diagnosis.pulled}
    far = [
        moved_text(nuisance)
        for nuisance in diagnosis.moved
        if abs(nuisance.deviations or 0.0) > REPORTED
        and nuisance.name not in known
        and not nuisance.name.startswith("gain")
    ]
    if not far:
        return []
    return [f"Moved beside it, by more than two standard deviations of what is known: {'; '.join(far)}."]


def _stays(base: Ranked, explanation: Ranked) -> bool:
    """Tell whether no error changes: then an explanation is supported by the nuisances that it relieves."""
    pairs = [
        pair
        for kind in _ERRORS
        for pair in ((base.error(kind), explanation.error(kind)), (base.left_out(kind), explanation.left_out(kind)))
        if np.isfinite(pair).all()
    ]
    return all(FALLS * before <= after <= before / FALLS for before, after in pairs)


def _as_before(explanation: Ranked) -> str:
    """Describe an explanation that changes no error."""
    damping = (
        f" and {percent(explanation.damping_error)} of damping ratios" if np.isfinite(explanation.damping_error) else ""
    )
    return (
        f"the mean errors, {percent(explanation.frequency_error)} of frequencies{damping}, do not change, but "
        "quantities that are known have to move less"
    )


def _rests_on(diagnosis: Diagnosis) -> str:
    unseen = (
        f" Not compared: {', '.join(diagnosis.unseen)}, where the model has a mode that moves across the sensors; they "
        "cannot tell which mode it is."
        if diagnosis.unseen
        else ""
    )
    parts = [f"{used} of {n} modes of {name}" for name, (used, n) in diagnosis.n_used.items()]
    left_out = (
        ""
        if np.isfinite(diagnosis.discrepancy.damping)
        else " Damping is not compared: the model has no loss of its own (one lamina, or matrices without damping)."
    )
    return f"The answer rests on {', '.join(parts)}.{unseen}{left_out}"


def _mixed_up(points: MixedUp) -> str:
    """Say which points of the measurement were mixed up."""
    where = " and ".join(points.configuration)
    if points.kind == "exchanged":
        what = f"points {points.node[0]} and {points.node[1]} seem to have been exchanged"
    elif points.kind == "turned":
        what = f"the sensor at point {points.node[0]} seems to have been turned over"
    else:
        what = f"the sensor at point {points.node[0]} seems to read {points.factor:.3g} times what is there"
    return f"In {where} {what}: check the campaign file. The answer takes the points as corrected."


def _way(diagnosis: Diagnosis) -> str:
    """Give the gain of each of several effects."""
    parts = []
    for before, after in itertools.pairwise(diagnosis.steps):
        added = [name for name in after.effects if name not in before.effects]
        if _stays(before, after):
            parts.append(f"with {named(diagnosis, added)} {_as_before(after)}")
            continue
        kind = telling(before, after)
        text = (
            f"{named(diagnosis, added)} lowers the mean {_ERRORS[kind]} from {percent(before.error(kind))} to "
            f"{percent(after.error(kind))}"
        )
        if np.isfinite([before.left_out(kind), after.left_out(kind)]).all():
            text += (
                f" ({percent(before.left_out(kind))} to {percent(after.left_out(kind))} where each mode is predicted "
                "from all others)"
            )
        parts.append(text)
    return f"Step by step: {'; '.join(parts)}."


def _sizes(diagnosis: Diagnosis) -> str:
    """Write the sizes of the discrepancy of what is compared; one whose logarithm has no scatter was stated."""
    parts = [
        f"{percent(getattr(diagnosis.discrepancy, kind))} of a {name}"
        f"{'' if getattr(diagnosis.discrepancy_spread, kind) > 0.0 else ' (as stated)'}"
        for kind, name in _KINDS.items()
        if np.isfinite(getattr(diagnosis.discrepancy, kind))
    ]
    return " and ".join(parts)


def _remains(diagnosis: Diagnosis) -> list[str]:
    """Say why what remains is too much, and where it is."""
    text = []
    if diagnosis.lacking:
        others = "; what was said is of the other modes" if diagnosis.set else ""
        text.append(f"The model has no mode like what was measured as {', '.join(diagnosis.lacking)}{others}.")
    if diagnosis.too_large:
        large = [
            f"{percent(getattr(diagnosis.discrepancy, kind))} of a {_KINDS[kind]}, where right models leave "
            f"{percent(_MOST_LEFT[kind])} at most"
            for kind in diagnosis.too_large
        ]
        text.append(f"What remains is more than a model leaves to which nothing is missing: {'; '.join(large)}.")
    if diagnosis.unlisted == "beside":
        text.append(f"Beside that, {UNLISTED} is clearly more probable than nothing.")
    return [*text, _where(diagnosis)]


def _likelier(diagnosis: Diagnosis) -> list[str]:
    """Say what is more probable than the answer and why it is not the answer: the table has it first."""
    first, answer = diagnosis.ranking[0], diagnosis.ranked(diagnosis.set[0] if diagnosis.set else ())
    if first.effects in diagnosis.set or first.log_odds - answer.log_odds < NAMED:
        return []
    if diagnosis.unlisted == "refused":
        return [
            f"Of the effects, {named(diagnosis, first.effects)} comes nearest, but has another form than what is "
            "there: it is not named."
        ]
    further = [name for name in first.effects if name not in answer.effects]
    beside = " beside it" if further and diagnosis.set and set(answer.effects) < set(first.effects) else ""
    fits = named(diagnosis, further if beside else first.effects)
    kind = telling(answer, first)
    text = (
        f"By the odds alone, {fits}{beside} would be the answer, but then the mean {_ERRORS[kind]} goes "
        f"from {percent(answer.error(kind))} to {percent(first.error(kind))}"
    )
    why = "It predicts other modes no better"
    if np.isfinite([answer.left_out(kind), first.left_out(kind)]).all():
        ends = percent(answer.left_out(kind)), percent(first.left_out(kind))
        text += f" ({ends[0]} to {ends[1]} where each mode is predicted from all others)"
        if first.left_out(kind) < FALLS * answer.left_out(kind):
            why = "The gain is small"
    return [f"{text}. {why}: it may only describe an error of the model, and is not named."]


def _over_amplitude(diagnosis: Diagnosis) -> list[str]:
    """Say how far the contact was sheared, and what slip of the first explanation makes of that."""
    if not diagnosis.contact:
        return []
    low, high = (end(diagnosis.contact, key=lambda contact: contact.strain) for end in (min, max))
    levels = len({contact.configuration for contact in diagnosis.contact})
    sheared = (
        f"By the model's shapes, these {levels} force levels shear the contact by {low.strain:.2g} (mode {low.mode} of "
        f"{low.configuration}) to {high.strain:.2g} (mode {high.mode} of {high.configuration}), where faces move by up "
        f"to {quantity(1e6 * high.slip, 'µm')} against each other"
    )
    if not any(contact.softening for contact in diagnosis.contact):
        return [f"{sheared}; that it slips there is not said."]
    reached = "lies within that" if low.strain <= STRAIN <= high.strain else "was not tested"
    return [
        f"{sheared}. slip_softening is the share by which slip makes the contact softer at a strain of {STRAIN:g}, "
        f"which {reached}; it grows with the strain to the power 1 + slip_exponent. Beyond what was tested that is "
        "extrapolated."
    ]


def second_level_text(diagnosis: Diagnosis) -> str | None:
    """Say what a second force level would show, where it would show slip that one level does not."""
    if not diagnosis.second_level or diagnosis.second_level < FAR:
        return None
    return (
        "Whether the contact slips was not asked, for one force level does not show it. Test again at three times the "
        "force and list that as [[configuration.force_level]]: slip of the usual strength would move the frequencies "
        f"by {diagnosis.second_level:.0f} standard deviations."
    )


def _where(diagnosis: Diagnosis) -> str:
    """Say which frequencies the first explanation, or the base model, misses most."""
    off = np.array([-(error.base if np.isnan(error.explained) else error.explained) for error in diagnosis.errors])
    parts = [
        f"{error.configuration}, mode {error.mode} at {error.frequency:.1f} Hz "
        f"(measured {percent(abs(off[i]))} {'higher' if off[i] > 0 else 'lower'})"
        for i, error in ((int(i), diagnosis.errors[int(i)]) for i in np.argsort(-np.abs(off))[:MOST_LISTED])
    ]
    start = "With it the model still" if diagnosis.set else "The model"
    return f"{start} misses these frequencies most: {'; '.join(parts)}."


def _at_a_point(diagnosis: Diagnosis, change: PointChange) -> str:
    """Say where something is that no effect of the catalogue explains."""
    size = quantity(abs(change.size), "kg" if change.kind == "mass" else "N/m")
    what = f"{size} {'more' if change.size > 0.0 else 'less'} {'mass' if change.kind == 'mass' else 'stiffness'}"
    which = f"the model with {named(diagnosis, change.beside)}" if change.beside else "the model"
    return (
        f"The measurement looks as if there were {what} than {which} has, at or near point {change.node} in the "
        "measured direction. Look there."
    )


def _at_bounds(diagnosis: Diagnosis) -> list[str]:
    text = []
    for effects in diagnosis.set:
        bound = [p.name for p in diagnosis.ranked(effects).parameter if p.at_bound]
        if bound:
            text.append(
                f"Beware: {', '.join(bound)} of {named(diagnosis, effects)} lies at the end of what is plausible, so "
                "that explanation is doubtful."
            )
    return text


def _misread(gains: Sequence[SensorGain]) -> list[str]:
    """Say which accelerometers read otherwise than the first."""
    return [
        f"Sensor {gain.sensor} of each run reads {percent(abs(gain.excess))} "
        f"{'higher' if gain.excess > 0 else 'lower'} than sensor 1 (95 %: ± {percent(1.96 * gain.std)}): check its "
        "calibration. It is taken into account."
        for gain in gains
        if abs(gain.excess) > FAR * gain.std
    ]


def _next(diagnosis: Diagnosis) -> list[str]:
    useful = [t for t in diagnosis.next_tests if t.distance > max(t.now, 1.0)]
    if useful and useful[0].distance >= FAR:
        return [
            f"To tell them apart, {useful[0].instruction}: they would differ by {useful[0].distance:.1f} standard "
            f"deviations, now by {useful[0].now:.1f}."
        ]
    if diagnosis.next_tests:
        return ["None of the further tests that were considered would tell them apart by 3 standard deviations."]
    return []


def _folded(diagnosis: Diagnosis, effects: Sequence[str]) -> str:
    """Return how many effects there are, and the first few in words."""
    folded = 5  # names that are listed before a count stands for the rest
    more = len(effects) - folded
    shown = ", ".join(diagnosis.labels.get(e, e) for e in effects[:folded])
    return f"{len(effects)} effect{'s' if len(effects) > 1 else ''} ({shown}{f' and {more} more' if more > 0 else ''})"
