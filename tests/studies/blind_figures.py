"""What blind cases say of the diagnosis: shares with their intervals, beside the targets and beside baselines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr, ndtri

from model import catalogue
from tests.studies.blind import DETECTABLE, MODEL_FORM_ERROR, Case
from tests.studies.runner import Share, share
from updating.diagnosis.fit_settings import coordinate_of

_NOTABLE = 0.5  # fall by the true effects of what is held out, in standard deviations, that is more than noise
_APART = 3.0  # standard deviations, from which the best other effect is no alias
_WORSE = 1.05  # ratio of errors
_FAR = 5.0  # standard deviations of the data
_ALARM = float(-ndtri(0.05))
"""Distance from which the best test says so that is wrong in 5 of 100 (Neyman and Pearson 1933)."""


def figures(cases: Sequence[Case]) -> tuple[Share, ...]:
    """Score cases: how often nothing, the right effect, the right set, or nothing wrong was said."""
    single = [c for c in cases if c.kind == "single"]
    seen = [c for c in single if c.distance >= DETECTABLE]
    return (
        *_of_nulls([c for c in cases if c.kind == "null"]),
        *_of_singles(single, seen),
        *_of_pairs([c for c in cases if c.kind == "pair" and min(c.distance, c.rival) >= DETECTABLE]),  # both show
        *_of_withheld([c for c in cases if c.kind == "withheld"]),
        *_of_model_form_errors([c for c in cases if c.kind == MODEL_FORM_ERROR and c.distance >= DETECTABLE]),
        *_of_what_is_excluded(cases, [c for c in single if c.distance < DETECTABLE]),
        *_of_predictions(seen),
    )


def _within(case: Case) -> bool:
    return any(set(case.truth) <= set(candidate) for candidate in case.candidates)


def _top(case: Case) -> bool:
    return bool(case.candidates) and case.candidates[0] == case.truth


def _unlike(case: Case) -> bool:
    return case.verdict == "unlike anything"


def _of_nulls(null: Sequence[Case]) -> tuple[Share, ...]:
    return (
        share("false alarms on nulls", "<= 5 %", [c.verdict != "nothing missing" for c in null]),
        share("  BIC stepwise instead", "baseline", [bool(c.bic) for c in null]),
    )


def _of_singles(single: Sequence[Case], seen: Sequence[Case]) -> tuple[Share, ...]:
    plain = [c for c in seen if c.rival >= _APART]
    effects = catalogue()
    return (
        share("named or in the set, detectable singles", "95 %", [_within(c) for c in seen]),
        share("top choice right, detectable singles", "90 %", [_top(c) for c in seen]),
        share("  of these not aliased", "reported", [_top(c) for c in plain]),
        Share(
            name="  an effect at random instead",
            target="baseline",
            hits=round(len(seen) / len(effects)),
            total=len(seen),
        ),
        share("  largest sensitivity instead", "baseline", [c.most_visible == c.truth for c in seen]),
        share("  BIC stepwise instead", "baseline", [c.bic == c.truth for c in seen]),
        share("top choice right, all singles", "reported", [_top(c) for c in single]),
    )


def _of_pairs(pairs: Sequence[Case]) -> tuple[Share, ...]:
    return (
        share("both of a pair right, where both show", "80 %", [_top(c) for c in pairs]),
        share("  BIC stepwise instead", "baseline", [c.bic == c.truth for c in pairs]),
    )


def _of_withheld(withheld: Sequence[Case]) -> tuple[Share, ...]:
    far = [c for c in withheld if c.distance >= _FAR]
    return (
        share("unlike anything, withheld beyond 5 sigma", "90 %", [_unlike(c) for c in far]),
        share("  of these as far from all else", "reported", [_unlike(c) for c in far if c.rival >= _FAR]),
        share("unlike anything, all withheld", "65 %", [_unlike(c) for c in withheld]),
        Share(
            name="  a test that knew what is withheld would say so, at most",
            target="baseline",
            hits=round(sum(float(ndtr(c.rival - _ALARM)) for c in withheld)),
            total=len(withheld),
        ),
        share("another's name given, all withheld", "reported", [bool(c.candidates) for c in withheld]),
        share("  BIC stepwise instead", "baseline", [bool(c.bic) for c in withheld]),
    )


def _of_model_form_errors(cases: Sequence[Case]) -> tuple[Share, ...]:
    families = {name: effect.family for name, effect in catalogue().items()}

    def akin(c: Case) -> bool:
        return {families.get(n) for n in c.candidates[0]} == {families.get(n) for n in c.truth}

    return (
        share(
            "model-form error: the effect or its family named",
            "reported",
            [bool(c.candidates) and akin(c) for c in cases],
        ),
        share("model-form error: unlike anything", "reported", [_unlike(c) for c in cases]),
    )


def _of_what_is_excluded(cases: Sequence[Case], unseen: Sequence[Case]) -> tuple[Share, ...]:
    effects = catalogue()

    def usual(c: Case) -> list[str]:
        """Return the planted effects that `ruled_out` judges, if they are as strong as usual or more."""
        return [
            name
            for name in c.truth
            for p in effects[name].parameters
            if len(effects[name].parameters) == 1
            and abs(coordinate_of(p, c.values[p.name])) >= abs(coordinate_of(p, p.nominal))
        ]

    judged = [c for c in cases if c.kind != "withheld" and usual(c)]
    return (
        share(
            "undetectable singles not wrongly named",
            "95 %",
            [c.verdict in ("nothing missing", "unlike anything") or _within(c) for c in unseen],
        ),
        share(
            "a planted effect, as strong as usual, ruled out",
            "reported",
            [bool(set(usual(c)) & set(c.ruled_out)) for c in judged],
        ),
    )


def _of_predictions(seen: Sequence[Case]) -> tuple[Share, ...]:
    fall = [_fall(c) for c in seen if _fall_of_oracle(c) > _NOTABLE]
    return (
        share("90 % parameter intervals hold", "85 to 95 %", [hit for c in seen for hit in c.covered]),
        share("held-out error worse after naming", "<= 5 %", [c.held_out[1] > c.held_out[0] * _WORSE for c in seen]),
        share(
            "  of its frequencies alone",
            "reported",
            [c.held_out_frequency[1] > c.held_out_frequency[0] * _WORSE for c in seen],
        ),
        share("held-out error falls by 70 % of the oracle's", "half of them", [f >= 0.7 for f in fall]),
    )


def mean_set_size(cases: Sequence[Case]) -> float:
    """Return how many explanations are left, in the mean, where a single effect is named; NaN without cases."""
    sizes = [len(c.candidates) for c in cases if c.kind == "single" and c.candidates]
    return float(np.mean(sizes)) if sizes else float("nan")


def held_out_errors(cases: Sequence[Case]) -> tuple[float, float, float]:
    """Return the median error of what was held out, in standard deviations, over detectable singles.

    With the base model refitted, with what is named, and with the true effects; NaN without cases.
    """
    errors = [c.held_out for c in cases if c.kind == "single" and c.distance >= DETECTABLE]
    base, named, true = np.median(errors, axis=0).tolist() if errors else (float("nan"),) * 3
    return base, named, true


def _fall_of_oracle(case: Case) -> float:
    return case.held_out[0] - case.held_out[2]


def _fall(case: Case) -> float:
    """Return the fall of the held-out error by what is named, over that by the true effects."""
    return (case.held_out[0] - case.held_out[1]) / _fall_of_oracle(case)
