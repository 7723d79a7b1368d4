"""The answer in full: what the campaign says in plain sentences, and all configurations at a glance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from updating.inference.levels import SEPARATE
from updating.report.opening import change_sentences, fit_sentences
from updating.report.part import Section, Table
from updating.report.results import Results
from updating.results.text import Z95, estimate_text, quantity

_SHOWN = 8  # explanations of a diagnosis


def answer_section(results: Results) -> Section:
    """Say in full what was found, how sure that is and what was tried, or how the model stands to the measurement."""
    if results.diagnosis is not None:
        text = results.diagnosis.sentences
        blocks: tuple[Table, ...] = (
            before_after_table(results),
            explanation_table(results),
            moved_table(results),
            next_test_table(results),
        )
    else:
        text, blocks = fit_sentences(results), (before_after_table(results),)
    text = (*change_sentences(results), *text)
    if results.missing:
        text = (*text, f"Not done yet: {', '.join(results.missing)}.")
    return Section(title="In full", text=text, blocks=tuple(b for b in blocks if b.rows))


def before_after_table(results: Results) -> Table:
    """List what the base model and the model with what was identified do in each configuration."""
    pairs = [(t, t.fit, t.identified) for t in results.tested]
    rows = [
        (
            t.name,
            f"{100 * fit.error:.2f}",
            f"{100 * own.fit.error:.2f}",
            f"{fit.pairing.paired_mac.mean():.3f}",
            f"{own.fit.pairing.paired_mac.mean():.3f}",
            "" if np.isnan(own.base_frac) else f"{own.base_frac:.3f}",
            "" if np.isnan(own.frac) else f"{own.frac:.3f}",
        )
        for t, fit, own in pairs
        if fit is not None and own is not None
    ]
    return Table(
        title="The base model, and the model with what was identified",
        header=(
            "configuration", "frequency error, base [%]", "with what was identified [%]", "mean MAC, base",
            "with what was identified", "mean FRAC, base", "with what was identified",
        ),
        rows=tuple(rows),
        note="Both models have the numbers of the answer. MAC compares shapes, FRAC frequency response functions: 1 "
        "where two are equal but for their scale, 0 where they share nothing. The switch at the top of the "
        "page chooses which of the two models it shows.",
    ).without_empty_columns()  # fmt: skip


def overview_section(results: Results, address: Sequence[str]) -> Section:
    """List all configurations, each leading to an address: its section or its page."""
    table = overview_table(results, address).without_empty_columns()
    return Section(title="All configurations", blocks=(table,))


def overview_table(results: Results, address: Sequence[str]) -> Table:
    """List every configuration with its state and its fitted parameters."""
    rows = tuple(
        (
            t.name,
            "" if t.torque is None else f"{t.torque:g}",
            "" if t.pressure is None else f"{t.pressure / 1e3:g}",
            str(t.measured.frequency.size),
            *(
                ("", "", "", "", "")
                if t.fit is None
                else (
                    str(t.fit.pairing.measured.size),
                    *(("", "") if t.opt is None else map(estimate_text, (t.opt.G_f, t.opt.d_f))),
                    f"{100 * t.fit.error:.2f}",
                    f"{t.fit.pairing.paired_mac.min():.4f}",
                )
            ),
            str(len(t.quality.findings)),
        )
        for t in results.tested
    )
    return Table(
        title="",
        header=(
            "configuration", "torque [N m]", "pressure [kPa]", "modes", "paired", "G_f by opt_G [Pa/Pa]",
            "d_f by opt_d [s/Pa]", "frequency error [%]", "lowest MAC", "findings",
        ),
        rows=rows,
        note="± is half of the 95 % interval. The frequency error is the mean of |measured - model| / measured over "
        "the paired modes of the base model, eq. (2). opt_G and opt_d, eq. (1), fit one configuration alone. Findings "
        "are warnings of the checks of the measurement. A click on a heading sorts.",
        link=tuple(address),
    )  # fmt: skip


def explanation_table(results: Results) -> Table:
    """List the explanations that a diagnosis fitted in full, the most probable first."""
    ranking = results.diagnosis.shown(_SHOWN) if results.diagnosis is not None else ()
    labels = {} if results.diagnosis is None else results.diagnosis.labels
    return Table(
        title="Explanations that were tried",
        header=(
            "effects", "probability", "explained [%]", "frequency error [%]", "left out [%]",
            "parameters with 95 % interval",
        ),
        rows=tuple(
            (
                " + ".join(labels.get(e, e) for e in own.effects) or "none",
                f"{own.probability:.3f}",
                f"{100 * own.explained:.0f}",
                f"{100 * own.frequency_error:.2g}",
                f"{100 * own.left_out_error:.2g}",
                "; ".join(
                    f"{p.name} {p.value:.3g} ({p.lower:.3g} to {p.upper:.3g}){'' if p.unit == '1' else ' ' + p.unit}"
                    for p in own.parameter
                ),
            )
            for own in ranking
        ),
        note="Explained: share of the squared differences of frequencies, damping ratios and shapes, over the "
        "variances of noise and of the discrepancy that the best explanation leaves. Left out: the frequency error "
        "where each mode is predicted from all others. Explanations less than "
        f"{np.exp(SEPARATE):.0f} times less probable than the first are not told apart.",
    )  # fmt: skip


def moved_table(results: Results) -> Table:
    """List every quantity of stack file and measurement that all fits may move, as stated and as fitted."""
    every = results.diagnosis.moved if results.diagnosis is not None else ()
    ordered = sorted(every, key=lambda own: -abs(own.deviations or 0.0))
    return Table(
        title="What else was fitted",
        header=("quantity", "stated", "fitted", "± 95 %", "known to ± 95 %", "standard deviations moved"),
        rows=tuple(
            (
                own.label,
                quantity(own.stated, own.unit, own.value),
                quantity(own.value, own.unit),
                quantity(Z95 * own.std, own.unit, own.value),
                "" if own.prior is None else quantity(Z95 * own.prior, own.unit, own.value),
                "" if own.deviations is None else f"{abs(own.deviations):.1f}",
            )
            for own in ordered
        ),
        note="Beside effects, every fit may move these within what is known of them beforehand; of G_f and d_f nothing "
        "is. Beyond three standard deviations either the stack file states something wrongly, or something is missing "
        "that this makes up for.",
    )


def next_test_table(results: Results) -> Table:
    """List further tests by how well they would tell apart what a diagnosis leaves open."""
    tests = results.diagnosis.next_tests if results.diagnosis is not None else ()
    return Table(
        title="What to measure next",
        header=("test", "distance after it", "distance now"),
        rows=tuple((t.instruction, f"{t.distance:.1f}", f"{t.now:.1f}") for t in tests),
        note="Distance between the two explanations that are hardest to tell apart; above 3 they are.",
    )
