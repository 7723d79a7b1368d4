"""The answer first: what the campaign says in plain sentences, and all configurations at a glance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from updating.diagnosis.calibration import SEPARATE
from updating.report.part import Section, Table
from updating.report.results import Results
from updating.results.text import estimate_text

_SHOWN = 8  # explanations of a diagnosis


def answer_section(results: Results) -> Section:
    """Say how the model stands to the measurement and, where it was asked, which effect it lacks."""
    if results.diagnosis is not None:
        text = results.diagnosis.sentences
        blocks: tuple[Table, ...] = (explanation_table(results), next_test_table(results))
    else:
        text, blocks = _fit_sentences(results), ()
    if results.missing:
        text = (*text, f"Not done yet: {', '.join(results.missing)}.")
    return Section(title="Answer", text=text, blocks=tuple(b for b in blocks if b.rows), lead=True)


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
                    estimate_text(t.fit.G_f),
                    estimate_text(t.fit.d_f),
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
            "configuration", "torque [N m]", "pressure [kPa]", "modes", "paired", "G_f [Pa/Pa]", "d_f [s/Pa]",
            "frequency error [%]", "lowest MAC", "findings",
        ),
        rows=rows,
        note="± is half of the 95 % interval. The frequency error is the mean of |measured - model| / measured over "
        "the paired modes, eq. (2), each configuration with its own G_f. Findings are warnings of the checks of the "
        "measurement. A click on a heading sorts.",
        link=tuple(address),
    )  # fmt: skip


def explanation_table(results: Results) -> Table:
    """List the explanations that a diagnosis fitted in full, the most probable first."""
    ranking = results.diagnosis.ranking[:_SHOWN] if results.diagnosis is not None else ()
    return Table(
        title="Explanations that were tried",
        header=(
            "effects", "probability", "explained [%]", "frequency error [%]", "left out [%]",
            "parameters with 95 % interval",
        ),
        rows=tuple(
            (
                " + ".join(own.effects) or "none",
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


def next_test_table(results: Results) -> Table:
    """List further tests by how well they would tell apart what a diagnosis leaves open."""
    tests = results.diagnosis.next_tests if results.diagnosis is not None else ()
    return Table(
        title="What to measure next",
        header=("test", "distance after it", "distance now"),
        rows=tuple((t.instruction, f"{t.distance:.1f}", f"{t.now:.1f}") for t in tests),
        note="Distance between the two explanations that are hardest to tell apart; above 3 they are.",
    )


def _fit_sentences(results: Results) -> tuple[str, ...]:
    if results.table:
        return _table_sentences(results)
    fits = [t.fit for t in results.tested if t.fit is not None]
    n = len(results.tested)
    identified = f"{n} configuration{'s' if n > 1 else ''} identified"
    if not fits:
        modes = sum(t.measured.frequency.size for t in results.tested)
        return (f"{identified}, {modes} modes in all; no model was fitted.",)
    worst = max(fits, key=lambda fit: fit.error)
    left_over = sum(fit.pairing.unpaired_measured.size for fit in fits)
    return (
        f"{identified} and fitted. The model's natural frequencies differ from the measured ones by "
        f"{100 * np.mean([fit.error for fit in fits]):.2f} % on average, most in {worst.name} "
        f"({100 * worst.error:.2f} %). "
        + (
            "Every measured mode has its partner in the model."
            if left_over == 0
            else f"{left_over} measured mode{'s have' if left_over > 1 else ' has'} no partner in the model."
        ),
        *(f"First of all: {finding}." for fit in fits for finding in fit.findings),
        "Which physical effect the model lacks, if any, was not asked; lamella diagnose answers it.",
    )


def _table_sentences(results: Results) -> tuple[str, ...]:
    fits = results.table
    error, published, misfit = (
        100 * np.mean([getattr(f, name) for f in fits])
        for name in ("error", "published_error", "model_misfit")
    )
    return (
        f"{len(fits)} configurations fitted. The model's natural frequencies differ from the measured ones by "
        f"{error:.1f} % on average (published: {published:.1f} %). Fitted to the published model's frequencies "
        f"instead, it meets them to {misfit:.1f} %.",
    )
