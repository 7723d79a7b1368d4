"""A diagnosis in plain sentences, the answer first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from updating.diagnosis.adequacy import p_value
from updating.diagnosis.chance import DRAWS
from updating.diagnosis.experiment import NextTest
from updating.diagnosis.explanation import Explanation
from updating.diagnosis.point_change import PointChange
from updating.diagnosis.ranking import Ranked
from updating.diagnosis.sensor_gain import SensorGain
from updating.diagnosis.verdict import Decision, Doubt

_WORTH = 3.0


def sentences(
    decision: Decision,
    chance: float,
    base: Explanation,
    ranking: Sequence[Ranked],
    excluded: Sequence[str],
    not_visible: Sequence[str],
    lacking: Sequence[str],
    gains: Sequence[SensorGain],
    tests: Sequence[NextTest],
) -> tuple[str, ...]:
    """Write the verdict, what supports it, what stays open and what to measure next."""
    verdict, left = decision.verdict, decision.left
    ranked = {x.effects: x for x in ranking}
    error = _percent(ranked[()].frequency_error)
    text = []
    if verdict == "nothing missing":
        text.append(
            "Nothing is missing that these data can show: the base model meets frequencies within "
            f"{error} in the mean, and no effect of the catalogue improves it beyond chance: the best would explain as "
            f"much where nothing is missing in {_chance(chance)} cases."
        )
    else:
        text.append(_where(base, error))
        text.append(
            f"Where nothing is missing, the best effect alone explains as much in {_chance(chance)} cases."
        )
    if lacking:
        text.append(f"The model has no mode like {', '.join(lacking)}: what follows is of the others.")
    if verdict == "identified":
        own = ranked[left[0].effects]
        text.append(
            f"{_named(left[0].effects)} explains it: with {_estimates(own)} {_change(ranked[()], own)}, and no other "
            f"{'effect' if len(left[0].effects) == 1 else 'pair'} comes within a distance of 3."
        )
        text += [*_shares(own, ranked), _left_over(left[0])]
    if verdict == "one of":
        own = ranked[left[0].effects]
        text.append(
            f"These data cannot tell apart: {'; '.join(_named(x.effects) for x in left)}. With the first "
            f"{_change(ranked[()], own)}; with the others, nearly the same."
        )
        text.append(_left_over(left[0]))
        text += [f"If it is {_named(x.effects)}: {_estimates(ranked[x.effects])}." for x in left[:4]]
    if decision.doubt is not None:
        text.append(_doubtful(decision.doubt, left[0]))
    if decision.point is not None:
        text.append(_at_a_point(decision.point))
    elif verdict == "unlike anything":
        closest = [x for x in ranking if x.effects][:1]
        tail = (
            f" The closest, {_named(closest[0].effects)}, leaves {_percent(closest[0].frequency_error)}."
            if closest
            else ""
        )
        goal = "these modes" if lacking else "within the measurement's scatter"
        text.append(
            "This is unlike anything in the catalogue: no effect and no pair of effects brings the model "
            f"{goal}.{tail}"
        )
    for x in left:
        bound = [p.name for p, hit in zip(x.parameter, x.at_bound, strict=True) if hit]
        if bound:
            text.append(
                f"Beware: {', '.join(bound)} of {_named(x.effects)} lies at the end of its plausible range, so the "
                "explanation is doubtful."
            )
    if verdict != "unlike anything":
        text += _misread(gains)
    useful = [t for t in tests if t.distance > max(t.now, 1.0)]
    if useful and useful[0].distance >= _WORTH:
        text.append(
            f"To separate them, {useful[0].instruction}: the distance would grow from {useful[0].now:.1f} to "
            f"{useful[0].distance:.1f}."
        )
    elif tests:
        text.append(
            "None of the further tests that were considered would separate them beyond a distance of 3."
        )
    if excluded:
        text.append(f"Ruled out at their usual strength, or more: {', '.join(excluded)}.")
    if not_visible:
        text.append(f"Not visible in these data at any plausible strength: {', '.join(not_visible)}.")
    return tuple(text)


def _named(effects: Sequence[str]) -> str:
    return " with ".join(effects) if effects else "the base model"


def _estimates(own: Ranked) -> str:
    return ", ".join(
        f"{p.name} = {p.value:.4g}{'' if p.unit == '1' else ' ' + p.unit} (90 %: {p.lower:.4g} to {p.upper:.4g})"
        for p in own.parameter
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:#.2g} %".replace(". %", " %")


def _chance(probability: float) -> str:
    if probability < 2.0 / DRAWS:
        return f"fewer than 1 of {DRAWS // 2}"
    return f"{100.0 * probability:.0f} of 100" if probability > 0.01 else f"{1e4 * probability:.0f} of 10000"


def _left_over(own: Explanation) -> str:
    """Say how likely what an explanation leaves is: the only hint at an effect that no catalogue has."""
    return f"Where nothing else is missing, as much as it leaves is left in {_chance(p_value(own))} cases."


def _doubtful(doubt: Doubt, named: Explanation) -> str:
    """Say why a second effect that leaves less is not named."""
    second = _named(doubt.effects)
    return (
        f"{second} beside it would lower the squared misfit by {doubt.gain:.0f} more. What the form of "
        f"{_named(named.effects)} may be off by accounts for up to {doubt.least:.0f}, so {second} may be there "
        "and is not named."
    )


def _at_a_point(own: PointChange) -> str:
    """Say where something is that no effect of the catalogue explains."""
    size = f"{1e3 * abs(own.size):.2g} g" if own.kind == "mass" else f"{abs(own.size):.2g} N/m"
    what = f"{size} {'more' if own.size > 0.0 else 'less'} {'mass' if own.kind == 'mass' else 'stiffness'}"
    return (
        f"This is unlike anything in the catalogue: what {_named(own.beside)} leaves looks like {what} at or near "
        f"point {own.node} in the measured direction, which lowers the squared misfit by {own.gain:.0f}. Where nothing "
        f"is missing, some point does as much in {_chance(own.chance)} cases. Look there."
    )


def _misread(gains: Sequence[SensorGain]) -> list[str]:
    """Say which accelerometers read otherwise than the first."""
    return [
        f"Sensor {own.sensor} of each run reads {_percent(abs(own.excess))} {'higher' if own.excess > 0 else 'lower'} "
        f"than sensor 1 (standard deviation {_percent(own.std)}): check its calibration. It is taken into account."
        for own in gains
        if abs(own.excess) > _WORTH * own.std
    ]


def _change(base: Ranked, own: Ranked) -> str:
    """Say what the frequency error falls to, also where each mode is predicted from all others."""
    before, after = _percent(base.frequency_error), _percent(own.frequency_error)
    if own.frequency_error >= base.frequency_error:
        return f"the mean frequency error stays small ({before} before, {after} with it): other data show the effect"
    text = f"the mean frequency error falls from {before} to {after}"
    if not np.isfinite([base.held_out_error, own.held_out_error]).all():
        return text
    before, after = _percent(base.held_out_error), _percent(own.held_out_error)
    return f"{text} (from {before} to {after} for a mode that is predicted from all others)"


def _shares(own: Ranked, ranked: Mapping[tuple[str, ...], Ranked]) -> list[str]:
    """Say how much of what several effects explain each of them explains alone."""
    fall = ranked[()].misfit - own.misfit
    alone = {n: (ranked[()].misfit - ranked[(n,)].misfit) / fall for n in own.effects if (n,) in ranked}
    if len(own.effects) < 2 or not alone:
        return []
    shares = [f"{name} {100.0 * share:.0f} %" for name, share in sorted(alone.items(), key=lambda x: -x[1])]
    return [f"Of the squared misfit that both explain, each alone explains: {', '.join(shares)}."]


def _where(base: Explanation, error: str) -> str:
    """Say which data the base model misses most."""
    parts = []
    for kind in ("frequency", "damping"):
        inside = np.flatnonzero(base.residual.kind == kind)
        value = base.residual.value[inside]
        worst = inside[np.argsort(-np.abs(value))[:3]]
        far = [
            f"{base.residual.label[i]} ({'measured higher' if base.residual.value[i] > 0 else 'measured lower'})"
            for i in worst
            if abs(base.residual.value[i]) > _WORTH
        ]
        if far:
            name = "frequencies" if kind == "frequency" else "damping ratios"
            parts.append(f"{name} of {', '.join(far)}")
    held = np.flatnonzero((base.residual.kind == "prior") & (np.abs(base.residual.value) > _WORTH))
    parts += [
        f"{base.residual.label[i]}, which would have to leave what is known of it by "
        f"{abs(base.residual.value[i]):.0f} standard deviations"
        for i in held[:2]
    ]
    tail = f" It fails most at {'; '.join(parts)}." if parts else ""
    return f"The base model misses the measured frequencies by {error} in the mean.{tail}"
