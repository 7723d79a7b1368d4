"""The diagnosis of a campaign of specimens: the answer as it is stored, and in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from updating.fitting.fit import ParameterEstimate
from updating.inference.levels import NAMED
from updating.results.text import MOST_LISTED, in_percent, interval_text, percent

LevelKind = Literal["rig", "group", "specimen"]

PooledVerdict = Literal["nothing missing", "identified", "one of", "partly explained", "unlike anything", "as asked"]


@dataclass(frozen=True, kw_only=True)
class Part:
    """One term of an explanation.

    Attributes
    ----------
    effect, label : str
        Its name and what a person calls it.
    level : "rig", "group" or "specimen"
        Whose it is.
    of : str
        Which group or specimen; empty where it is all.
    specimens : tuple of str
        Those that have it.
    parameter : tuple of ParameterEstimate
        With 95 % intervals; of shifts of what a file states or of contact parameters the ratio.
    log_odds : float
        Its gain: logarithm of the odds of the explanation with it against the best without; NaN where that was
        not fitted.
    """

    effect: str
    label: str
    level: LevelKind
    of: str
    specimens: tuple[str, ...]
    parameter: tuple[ParameterEstimate, ...]
    log_odds: float


@dataclass(frozen=True, kw_only=True)
class PooledRanked:
    """One explanation.

    Attributes
    ----------
    parts : tuple of Part
        None of the base model.
    log_odds : float
        Logarithm of its posterior odds against the base model.
    probability : float
        Among all that were fitted.
    frequency_error, left_out_error : float
        Mean relative errors of frequencies over all specimens, and the same where each is predicted from the others.
    left_out_torque_error : float
        The same where the frequencies and damping ratios of a specimen at one torque are predicted from all else; NaN
        with one torque.
    """

    parts: tuple[Part, ...]
    log_odds: float
    probability: float
    frequency_error: float
    left_out_error: float
    left_out_torque_error: float


@dataclass(frozen=True, kw_only=True)
class ContactState:
    """Contact parameters of a specimen from one torque alone.

    Attributes
    ----------
    name : str
        The configuration.
    pressure : float
        Nominal contact pressure, Pa.
    G_f, d_f : ParameterEstimate, optional
        With 95 % intervals, all else as it was found; none where the torque alone tells nothing of it, such as of d_f
        where no damping was measured.
    """

    name: str
    pressure: float
    G_f: ParameterEstimate | None
    d_f: ParameterEstimate | None


@dataclass(frozen=True, kw_only=True)
class ModeAnswer:
    """A measured mode of a specimen beside the model's.

    Attributes
    ----------
    configuration : str
        At which torque.
    frequency, damping : float
        Measured, Hz and 1; the latter NaN where it was not.
    base_frequency, model_frequency : float
        Of the base model, and with what was found, Hz.
    base_damping, model_damping : float
        The same of damping ratios; NaN of one lamina, which has no damping of its own.
    """

    configuration: str
    frequency: float
    damping: float
    base_frequency: float
    model_frequency: float
    base_damping: float
    model_damping: float


@dataclass(frozen=True, kw_only=True)
class SpecimenAnswer:
    """What is said of one specimen.

    Attributes
    ----------
    name : str
        Which.
    notes : mapping of str to str
        What was noted of it.
    n_mode : int
        Measured modes that the model has, over all its configurations.
    G_f, d_f : ParameterEstimate, optional
        Its contact parameters with 95 % intervals; none where no torque of its own tells anything of it.
    base_error, error, left_out_error : float
        Mean relative errors of its frequencies: base model, best explanation, and predicted from the others.
    odd : tuple of str
        Effects that it alone has.
    states : tuple of ContactState
        Its contact at each torque.
    modes : tuple of ModeAnswer
        Its measured modes, configuration by configuration.
    """

    name: str
    notes: Mapping[str, str]
    n_mode: int
    G_f: ParameterEstimate | None
    d_f: ParameterEstimate | None
    base_error: float
    error: float
    left_out_error: float
    odd: tuple[str, ...]
    states: tuple[ContactState, ...]
    modes: tuple[ModeAnswer, ...]


@dataclass(frozen=True, kw_only=True)
class Contrast:
    """What specimens of a group have of a contact parameter over what the others have, all else as it is found.

    Attributes
    ----------
    group : str
        Such as "treatment = glued".
    parameter, label : str
        "G_f" or "d_f", and what it is called.
    ratio, lower, upper : float
        With 95 % interval, which holds the scatter from specimen to specimen.
    """

    group: str
    parameter: str
    label: str
    ratio: float
    lower: float
    upper: float


@dataclass(frozen=True, kw_only=True)
class PooledDiagnosis:
    """Answer of a pooled diagnosis.

    Attributes
    ----------
    name : str
        The campaign.
    verdict : str
        "nothing missing"; "identified"; "one of" where data cannot tell; "partly explained" where what remains is more
        than a right model leaves; "unlike anything" where specimens are not predicted better for all that; "as asked"
        of a fit of terms that somebody asks for.
    ranking : tuple of PooledRanked
        What was fitted in full: the one that leads, those that the data do not tell from it, and the others, the most
        probable first.
    left : int
        Explanations, the first of the ranking, that the data do not tell apart.
    specimens : tuple of SpecimenAnswer
        All of them.
    contrasts : tuple of Contrast
        What groups do to contact parameters.
    scales : mapping of str to float
        What the model is right to, of a `frequency` and of a `damping` ratio; the scatter of ln G_f and ln d_f from
        specimen to specimen, `stiffness` and `loss`; and the shares of the discrepancy that the `rig`, each `specimen`
        and each `state` has.
    not_visible : tuple of str
        Effects too weak to show at any plausible strength, were they the rig's.
    impossible : mapping of str to str
        Why effects of the catalogue cannot be.
    relieved, pulled : tuple of str
        In words, what is known of the stacks and would have to be far off in the mean without what is found, and what
        has to be with it.
    sentences : tuple of str
        The answer in words, the first one first.
    """

    name: str
    verdict: PooledVerdict
    ranking: tuple[PooledRanked, ...]
    left: int
    specimens: tuple[SpecimenAnswer, ...]
    contrasts: tuple[Contrast, ...]
    scales: Mapping[str, float]
    not_visible: tuple[str, ...]
    impossible: Mapping[str, str]
    relieved: tuple[str, ...]
    pulled: tuple[str, ...]
    sentences: tuple[str, ...]

    @property
    def best(self) -> PooledRanked:
        """The explanation that is reported: the base model where nothing is missing, or nothing helps."""
        if self.verdict in ("nothing missing", "unlike anything"):
            return next(explanation for explanation in self.ranking if not explanation.parts)
        return self.ranking[0]


UNKNOWN = "-"
"""Of what data tell nothing of, such as d_f where no damping was measured."""


_FOLDED = 5  # names that are listed before a count stands for the rest


def sentences(diagnosis: PooledDiagnosis) -> tuple[str, ...]:
    """Write the verdict, the level of each effect, which specimens are odd, and what groups change."""
    text = [_verdict(diagnosis)]
    text += _likelier(diagnosis)
    text += [f"Without it, in the mean of all specimens, {finding}" for finding in diagnosis.relieved[:MOST_LISTED]]
    if diagnosis.left > 1:
        text.append(_cannot_tell(diagnosis))
    text.append(_odd(diagnosis))
    text += _groups(diagnosis.contrasts)
    text.append(_scatter(diagnosis))
    text += [f"Beware: in the mean of all specimens, {finding}" for finding in diagnosis.pulled[:MOST_LISTED]]
    if diagnosis.not_visible:
        text.append(
            "Too weak to show in these data at any plausible strength, were they the rig's: "
            f"{_folded(diagnosis.not_visible)}."
        )
    return tuple(text)


def part_text(part: Part) -> str:
    """Return a term in words: its effect, and whether it is of the rig, of a group or of a specimen."""
    alike = f", the same in all {len(part.specimens)} specimens" if part.level == "rig" else ""
    return f"{_named(part)}, {_whose(part)}{alike}"


def _named(part: Part) -> str:
    return f"{part.label} ({part.effect})"


def _whose(part: Part) -> str:
    return {"rig": "of the rig", "group": f"of the group {part.of}", "specimen": f"of specimen {part.of} alone"}[
        part.level
    ]


def explanation_text(explanation: PooledRanked) -> str:
    """Return all terms of an explanation in words."""
    return "; and ".join(map(part_text, explanation.parts)) or "the base model"


def _verdict(diagnosis: PooledDiagnosis) -> str:
    """Write the sentence that a customer needs."""
    base = next(explanation for explanation in diagnosis.ranking if not explanation.parts)
    n = len(diagnosis.specimens)
    if diagnosis.verdict == "nothing missing":
        return (
            f"Nothing is missing that these {n} specimens can show. The model's frequencies are off by "
            f"{percent(base.frequency_error)} in the mean, and by {percent(base.left_out_error)} for a specimen that "
            "is predicted from the others."
        )
    best = diagnosis.ranking[0]
    if diagnosis.verdict == "unlike anything":
        return (
            "Something is missing that no effect of the catalogue explains, in the rig or in a specimen. The model's "
            f"frequencies are off by {percent(base.frequency_error)} in the mean, and by "
            f"{percent(base.left_out_error)} for a specimen that is predicted from the others, "
            f"{_lowered(diagnosis, base)}."
        )
    parts = "; and ".join(f"{part_text(part)}{_values(part)}" for part in best.parts) or "the base model"
    start = {"identified": "Identified", "partly explained": "Part of what is missing", "as asked": "As asked for"}.get(
        diagnosis.verdict, "Most probable"
    )
    return (
        f"{start}: {parts}. Mean frequency errors, before and with it: fitted {_change('frequency_error', base, best)}"
        f"; a specimen predicted from the others {_change('left_out_error', base, best)}"
        f"; a torque predicted from all else {_change('left_out_torque_error', base, best)}."
    )


def _likelier(diagnosis: PooledDiagnosis) -> list[str]:
    """Say which explanation has higher odds than the answer, as the table shows it, and why it is not the answer."""
    likeliest = max(diagnosis.ranking, key=lambda explanation: explanation.log_odds)
    left = diagnosis.ranking[: diagnosis.left]
    answer = max(left, key=lambda explanation: explanation.log_odds)
    if diagnosis.verdict == "as asked" or likeliest in left or likeliest.log_odds - answer.log_odds < NAMED:
        return []
    known = {(part.effect, part.of) for part in answer.parts}
    further = [part for part in likeliest.parts if (part.effect, part.of) not in known]
    beside = " beside it" if answer.parts and len(further) < len(likeliest.parts) else ""
    names = "; and ".join(map(part_text, further if beside else likeliest.parts))
    return [
        f"By the odds alone, {names}{beside} would be the answer, but then the mean frequency error of a "
        f"specimen predicted from the others goes from {percent(answer.left_out_error)} to "
        f"{percent(likeliest.left_out_error)}. It predicts others little better: it may only describe an error of the "
        "model, and is not named."
    ]


def _lowered(diagnosis: PooledDiagnosis, base: PooledRanked) -> str:
    """Say how far the best explanation lowers the error of specimens left out, though it is not probable enough."""
    lowered = 0.8  # of an error, from which it is much lower
    least = min(diagnosis.ranking, key=lambda explanation: explanation.left_out_error)
    if least.left_out_error > lowered * base.left_out_error:
        return "which none of what was tried lowers much"
    return (
        f"which {explanation_text(least)} lowers to {percent(least.left_out_error)}; but that is not probable enough "
        "beside something that nobody thought of"
    )


def _change(name: str, base: PooledRanked, best: PooledRanked) -> str:
    return f"{percent(getattr(base, name))} and {percent(getattr(best, name))}"


def _values(part: Part) -> str:
    values = ", ".join(map(interval_text, part.parameter[:MOST_LISTED]))
    return f": {values}" if values else ""


def _cannot_tell(diagnosis: PooledDiagnosis) -> str:
    """Say which explanations the data do not separate, in effect or in level; name common terms once."""
    best, others = diagnosis.ranking[0], diagnosis.ranking[1 : diagnosis.left]
    what = "whose the effect is" if all(_effects(o) == _effects(best) for o in others) else "which effect it is"
    common = [part for part in best.parts if all(any(_is_same(part, other) for other in o.parts) for o in others)]
    listed = "; or ".join(_beside(common, explanation) for explanation in others[:MOST_LISTED])
    more = f"; or {len(others) - MOST_LISTED} more" if len(others) > MOST_LISTED else ""
    where = f"beside {' and '.join(map(_named, common))} " if common else ""
    return f"These data cannot tell {what}: {where}it may as well be {listed}{more}."


def _beside(common: Sequence[Part], explanation: PooledRanked) -> str:
    """Return in words the terms of an explanation that are not common to all."""
    rest = [part for part in explanation.parts if not any(_is_same(part, shared) for shared in common)]
    return " together with ".join(f"{_named(part)}, {_whose(part)}" for part in rest) or "nothing more"


def _is_same(first: Part, second: Part) -> bool:
    return (first.effect, first.level, first.of) == (second.effect, second.level, second.of)


def _effects(explanation: PooledRanked) -> set[str]:
    return {part.effect for part in explanation.parts}


def _odd(diagnosis: PooledDiagnosis) -> str:
    odd = [specimen for specimen in diagnosis.specimens if specimen.odd]
    if not odd:
        return f"No specimen is odd: none of the {len(diagnosis.specimens)} needs an effect that the others lack."
    listed = "; ".join(f"{specimen.name} ({', '.join(specimen.odd)})" for specimen in odd)
    return f"Odd among the {len(diagnosis.specimens)} specimens: {listed}."


def _groups(contrasts: Sequence[Contrast]) -> list[str]:
    """Say what groups change, and what they do not."""
    text, silent = [], []
    for contrast in sorted(contrasts, key=lambda contrast: contrast.upper / contrast.lower):
        if contrast.lower > 1.0 or contrast.upper < 1.0:
            text.append(
                f"Specimens with {contrast.group} have {contrast.ratio:.2f} times the {contrast.label} "
                f"{contrast.parameter} of the others (95 %: {contrast.lower:.2f} to {contrast.upper:.2f})."
            )
        else:
            silent.append(
                f"{contrast.parameter} of {contrast.group}: {contrast.ratio:.2f} times "
                f"({contrast.lower:.2f} to {contrast.upper:.2f})"
            )
    if silent:
        more = f"; and {len(silent) - _FOLDED} more" if len(silent) > _FOLDED else ""
        text.append(f"No change beyond the scatter of specimens: {'; '.join(silent[:_FOLDED])}{more}.")
    return text


def _scatter(diagnosis: PooledDiagnosis) -> str:
    s = diagnosis.scales
    return (
        f"From specimen to specimen G_f scatters by {percent(float(np.expm1(s['stiffness'])))} and d_f by "
        f"{percent(float(np.expm1(s['loss'])))}; beyond that and the noise the model is right to "
        f"{percent(s['frequency'])} of a frequency and {percent(s['damping'])} of a damping ratio."
    )


def _folded(names: Sequence[str]) -> str:
    rest = len(names) - _FOLDED
    return ", ".join(names[:_FOLDED]) + (f" and {rest} more" if rest > 0 else "")


def contact_cells(contact: SpecimenAnswer | ContactState) -> tuple[str, str]:
    """Return G_f and d_f as cells with their intervals; a dash where data tell nothing of it."""
    return (
        f"{contact.G_f.value:.0f} ({contact.G_f.lower:.0f} to {contact.G_f.upper:.0f})" if contact.G_f else UNKNOWN,
        f"{contact.d_f.value:.2g} ({contact.d_f.lower:.2g} to {contact.d_f.upper:.2g})" if contact.d_f else UNKNOWN,
    )


def specimen_row(specimen: SpecimenAnswer) -> tuple[str, ...]:
    """Return a specimen as cells: name, modes, G_f, d_f, errors before, after and left out, what is odd."""
    return (
        specimen.name,
        str(specimen.n_mode),
        *contact_cells(specimen),
        in_percent(specimen.base_error),
        in_percent(specimen.error),
        in_percent(specimen.left_out_error),
        ", ".join(specimen.odd),
    )


SPECIMEN_HEADER = (
    "specimen",
    "modes",
    "G_f (95 %)",
    "d_f (95 %) [s/Pa]",
    "f error before [%]",
    "after [%]",
    "left out [%]",
    "odd",
)
"""Heads of the columns of `specimen_row`."""
