"""A diagnosis in plain sentences, the answer first."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from updating.diagnosis.discrepancy import KINDS, MEDIAN, SPREAD, Sizes
from updating.diagnosis.experiment import NextTest
from updating.diagnosis.explanation import Explanation
from updating.diagnosis.point_change import PointChange
from updating.diagnosis.ranking import Ranked
from updating.diagnosis.search import Search
from updating.diagnosis.sensor_gain import SensorGain
from updating.diagnosis.verdict import Decision

_NOTABLE = 3.0  # standard deviations
_FOLDED = 5  # names that are listed before a count stands for the rest
_KINDS = {"frequency": "frequency", "damping": "damping ratio", "shape": "shape"}


def sentences(found: Search, decision: Decision, answer: Mapping[str, Any]) -> tuple[str, ...]:
    """Write the verdict, what supports it, what stays open and what to measure next.

    Parameters
    ----------
    found, decision
        What was found and what follows from it.
    answer : mapping of str to object
        Fields of the `Diagnosis` that is being made.
    """
    names = Names(answer["labels"])
    ranked = {x.effects: x for x in answer["ranking"]}
    text = [_verdict(decision, ranked, names), _rests_on(answer["n_used"])]
    if len(answer["steps"]) > 2:
        text.append(_way(answer["steps"], names))
    if decision.verdict == "one of":
        text += [
            f"If it is {names.of(x.effects)}: {_estimates(ranked[x.effects])}." for x in decision.left[:4]
        ]
    if decision.verdict in ("identified", "one of", "partly explained"):
        text.append(f"Beyond the noise of the measurement, what remains is {_sizes(answer['discrepancy'])}.")
    if decision.verdict == "partly explained":
        text.append(_remains(found, decision.left[0], answer["lacking"]))
    if decision.verdict == "unlike anything":
        text.append(_where(found, found.base))
    if decision.point is not None:
        text.append(_at_a_point(decision.point, names))
    text += _at_bounds(decision.left, names)
    text += _misread(answer["sensor_gains"])
    text += _next(answer["next_tests"])
    if answer["ruled_out"]:
        text.append(f"Ruled out at their usual strength: {names.folded(answer['ruled_out'])}.")
    if answer["not_visible"]:
        text.append(
            f"Too weak to show in these data at any plausible strength: {names.folded(answer['not_visible'])}."
        )
    return tuple(sentence for sentence in text if sentence)


class Names:
    """What a person calls effects, with the key of each beside it."""

    def __init__(self, labels: Mapping[str, str]) -> None:
        self._labels = labels

    def of(self, effects: Sequence[str]) -> str:
        """Return one or several effects in words."""
        return " together with ".join(f"{self._labels.get(e, e)} ({e})" for e in effects) or "the base model"

    def folded(self, effects: Sequence[str]) -> str:
        """Return a list of keys, the first few and how many more."""
        more = len(effects) - _FOLDED
        shown = ", ".join(effects[:_FOLDED])
        return shown if more <= 0 else f"{shown} and {more} more"


def _verdict(decision: Decision, ranked: Mapping[tuple[str, ...], Ranked], names: Names) -> str:
    """Write the sentence that a customer needs."""
    base = ranked[()]
    if decision.verdict == "nothing missing":
        return (
            f"Nothing is missing that these data can show: beyond noise the model is right to "
            f"{_sizes(base.discrepancy)}. Its mean frequency error is {percent(base.frequency_error)}, and no effect "
            "of the catalogue predicts modes better that it has not seen."
        )
    if decision.verdict == "unlike anything":
        return (
            f"Unlike anything in the catalogue: the model misses the frequencies by {percent(base.frequency_error)} in "
            "the mean, and no effect or combination explains that and predicts modes that it has not seen."
        )
    own = ranked[decision.left[0].effects]
    what = names.of(own.effects)
    share = f"{100.0 * own.explained:.0f} %"
    change = _change(base, own)
    if decision.verdict == "identified":
        return f"Identified: {what}, {_estimates(own)}. It explains {share} of the misfit: {change}."
    if decision.verdict == "one of":
        every = "; or ".join(names.of(x.effects) for x in decision.left)
        return (
            f"One of these, and the data cannot tell which: {every}. "
            f"The first explains {share} of the misfit: {change}."
        )
    others = decision.left[1:]
    tail = f" Nearly as likely: {'; '.join(names.of(x.effects) for x in others[:3])}." if others else ""
    return (
        f"Partly explained: mostly {what}, {_estimates(own)}. "
        f"It explains {share} of the misfit, and something remains: {change}.{tail}"
    )


def _change(base: Ranked, own: Ranked) -> str:
    """Say what the frequency error falls to, also where each mode is predicted from all others."""
    before, after = percent(base.frequency_error), percent(own.frequency_error)
    if own.frequency_error >= base.frequency_error:
        worse, better = (percent(x.discrepancy.damping) for x in (base, own))
        return f"the mean frequency error stays at {after}, and damping ratios are met to {better} instead of {worse}"
    text = f"with it the mean frequency error falls from {before} to {after}"
    if not np.isfinite([base.left_out_error, own.left_out_error]).all():
        return text
    before, after = percent(base.left_out_error), percent(own.left_out_error)
    return f"{text}, and from {before} to {after} for modes that are predicted from all others"


def _rests_on(n_used: Mapping[str, tuple[int, int]]) -> str:
    parts = [f"{used} of {n} modes of {name}" for name, (used, n) in n_used.items()]
    return f"The answer rests on {', '.join(parts)}."


def _way(steps: Sequence[Any], names: Names) -> str:
    """Say what each of several effects brings."""
    parts = []
    for before, after in itertools.pairwise(steps):
        added = [name for name in after.effects if name not in before.effects]
        parts.append(
            f"{names.of(added)} from {percent(before.frequency_error)} to {percent(after.frequency_error)} "
            f"({percent(before.left_out_error)} to {percent(after.left_out_error)} for modes left out)"
        )
    return f"Step by step the frequency error falls with {'; with '.join(parts)}."


def _estimates(own: Ranked) -> str:
    parts = [
        f"{p.name} = {p.value:.3g}{'' if p.unit == '1' else ' ' + p.unit} (95 %: {p.lower:.3g} to {p.upper:.3g})"
        for p in own.parameter
    ]
    return ", ".join(parts) or "which has no physical parameter"


def percent(share: float) -> str:
    """Write a share as percent with two digits."""
    if not np.isfinite(share):
        return "an unknown share"
    return f"{100.0 * share:#.2g} %".replace(". %", " %")


def _sizes(own: Sizes) -> str:
    parts = [f"{percent(getattr(own, kind))} of a {name}" for kind, name in _KINDS.items()]
    return f"{', '.join(parts[:-1])} and {parts[-1]}"


def _remains(found: Search, own: Explanation, lacking: Sequence[str]) -> str:
    """Say why what remains is too much."""
    if lacking:
        return f"The model has no mode like {', '.join(lacking)}: what was said is of the others."
    large = [
        f"{percent(getattr(own.mean, kind))} of a {_KINDS[kind]} (usual: up to "
        f"{percent(MEDIAN[kind] * float(np.exp(1.645 * SPREAD)))})"
        for kind in KINDS
        if getattr(own.mean, kind) > MEDIAN[kind] * np.exp(1.645 * SPREAD)
    ]
    reason = f"That is more than a right model leaves: {', '.join(large)}. " if large else ""
    return f"{reason}{_where(found, own)}"


def _where(found: Search, own: Explanation) -> str:
    """Say which frequencies an explanation misses most."""
    evidence, off = found.evidence, np.expm1(own.residual.log_frequency)
    worst = np.argsort(-np.abs(off))[:3]
    parts = [
        f"{evidence.tested[c].name}, mode {r + 1} at {evidence.tested[c].modes.frequency[r]:.1f} Hz "
        f"(measured {percent(abs(off[i]))} {'higher' if off[i] > 0 else 'lower'})"
        for i, (c, r) in ((int(i), evidence.modes[int(i)]) for i in worst)
    ]
    return f"It fails most at {'; '.join(parts)}."


def _at_a_point(own: PointChange, names: Names) -> str:
    """Say where something is that no effect of the catalogue explains."""
    size = f"{1e3 * abs(own.size):.2g} g" if own.kind == "mass" else f"{abs(own.size):.2g} N/m"
    what = f"{size} {'more' if own.size > 0.0 else 'less'} {'mass' if own.kind == 'mass' else 'stiffness'}"
    return (
        f"What {names.of(own.beside)} leaves looks like {what} "
        f"at or near point {own.node} in the measured direction."
    )


def _at_bounds(left: Sequence[Explanation], names: Names) -> list[str]:
    found = []
    for x in left:
        bound = [p.name for p, hit in zip(x.parameter, x.at_bound, strict=True) if hit]
        if bound:
            found.append(
                f"Beware: {', '.join(bound)} of {names.of(x.effects)} lies at the end of its plausible range, so the "
                "explanation is doubtful."
            )
    return found


def _misread(gains: Sequence[SensorGain]) -> list[str]:
    """Say which accelerometers read otherwise than the first."""
    return [
        f"Sensor {own.sensor} of each run reads {percent(abs(own.excess))} {'higher' if own.excess > 0 else 'lower'} "
        f"than sensor 1 (95 %: ± {percent(1.96 * own.std)}): check its calibration. It is taken into account."
        for own in gains
        if abs(own.excess) > _NOTABLE * own.std
    ]


def _next(tests: Sequence[NextTest]) -> list[str]:
    useful = [t for t in tests if t.distance > max(t.now, 1.0)]
    if useful and useful[0].distance >= _NOTABLE:
        return [
            f"To tell them apart, {useful[0].instruction}: they would differ by {useful[0].distance:.1f} standard "
            f"deviations, now by {useful[0].now:.1f}."
        ]
    if tests:
        return [
            "None of the further tests that were considered would tell them apart by 3 standard deviations."
        ]
    return []
