"""The opening of the report: the answer, its figures and its warnings."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

import numpy as np

from ema import change_sentence
from model import catalogue
from updating.diagnosis.answer import Diagnosis, Verdict, telling
from updating.diagnosis.text import UNLISTED, further_effects, next_command
from updating.inference.levels import SEPARATE
from updating.report.change_part import mode_changes, mode_picture, step_picture, steps
from updating.report.ledger_part import APART
from updating.report.part import Opening, Picture, Section
from updating.report.results import Results, Tested
from updating.results.text import Z95, Table, estimate_text, in_percent, percent, quantity, together

_TONE: dict[Verdict, str] = {
    "nothing missing": "good",
    "identified": "found",
    "one of": "open",
    "partly explained": "open",
    "unlike anything": "open",
}


def opening_section(results: Results, configurations: Sequence[Section] = ()) -> Section:
    """Make the section that a reader sees first.

    Parameters
    ----------
    results : Results
        What to show.
    configurations : sequence of Section
        Sections of the configurations; their pictures of where the model fails are shown here, too.
    """
    way, modes, maps = steps(results), mode_changes(results), _places(results, configurations)
    first = [step_picture(way)] if way else []
    if way and modes and len(maps) % 2 == 0:  # then both share the first row, and maps stand side by side
        pictures = [*first, mode_picture(modes, width="half"), *maps]
    else:
        pictures = [*first, *maps, *([mode_picture(modes)] if modes else [])]
    return Section(title="Answer", text=results.remarks, blocks=(opening(results), *pictures))


def opening(results: Results) -> Opening:
    """Return the verdict, the answer, and the command to run next."""
    diagnosis = results.diagnosis
    if diagnosis is None:
        return _of_a_fit(results)
    tone = _TONE.get(diagnosis.verdict, "open")
    command, reason = _after_diagnosis(results, diagnosis)
    return Opening(
        badge=_badge(diagnosis),
        tone=tone,  # type: ignore[arg-type]
        sentence=" ".join((headline(diagnosis), *apart_sentence(diagnosis), *frac_sentence(results))),
        command=command,
        reason=reason,
    )


def _badge(diagnosis: Diagnosis) -> str:
    """Return the verdict in a word or two; where something was identified, say what, for modes are identified, too."""
    if diagnosis.verdict != "identified":
        return diagnosis.verdict
    if set(diagnosis.set[0]) <= set(diagnosis.measurement):
        return "fault of the measurement identified"
    return "effect identified" if len(diagnosis.set[0]) == 1 else "effects identified"


def apart_sentence(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Say how well the others predict a whole configuration, where they predict it much worse than a mode."""
    if diagnosis.verdict not in ("identified", "partly explained", "nothing missing"):
        return ()
    answer = diagnosis.ranked(diagnosis.set[0] if diagnosis.set else ())
    # the error is NaN where there is no other configuration
    if not answer.left_out_configuration_error > APART * answer.left_out_error:
        return ()
    return (
        f"A whole configuration that is left out is predicted to {percent(answer.left_out_configuration_error)} only: "
        "its contact is then taken from the others, and each assembly differs.",
    )


def frac_sentence(results: Results) -> tuple[str, ...]:
    """Say how well the model's functions match the measured ones, before and after; nothing where that is not known."""
    models = [t.identified for t in results.tested if t.identified is not None]
    models = [m for m in models if np.isfinite([m.base_frac, m.frac]).all()]
    if not models:
        return ()
    before, after = (float(np.mean([getattr(m, name) for m in models])) for name in ("base_frac", "frac"))
    way = "rises" if after > before else "goes"
    return (f"The likeness of modelled and measured FRFs (mean FRAC) {way} from {before:.2f} to {after:.2f}.",)


def headline(diagnosis: Diagnosis) -> str:
    """Write the answer of a diagnosis as one sentence, with the names that a person uses."""
    most_in_sentence = 3  # explanations that one sentence can name
    base = diagnosis.ranked(())
    if diagnosis.verdict == "nothing missing":
        return (
            "The model lacks nothing that these data can show: its frequencies are off by "
            f"{percent(base.frequency_error)} in the mean."
        )
    if diagnosis.verdict == "unlike anything":
        why = "no effect makes it predict better"
        if diagnosis.unlisted == "refused":
            why = f"{UNLISTED} is more probable than any of them"
        return (
            "The model lacks something that is unlike anything in the catalogue: its frequencies are off by "
            f"{percent(base.frequency_error)} in the mean, and {why}."
        )
    named = [together([diagnosis.labels.get(e, e) for e in effects]) for effects in diagnosis.set]
    if diagnosis.verdict == "one of" and (beside := further_effects(diagnosis)):
        also = "; or ".join(
            together([diagnosis.labels.get(e, e) for e in effects]) for effects in beside[:most_in_sentence]
        )
        return f"What the model lacks is {named[0]}. Whether it lacks {also} as well, the data cannot tell."
    if diagnosis.verdict == "one of":
        first = "; or ".join(named[:most_in_sentence])
        more = f"; or one of {len(named) - most_in_sentence} more" if len(named) > most_in_sentence else ""
        more += f"; or {UNLISTED}" if diagnosis.unlisted == "instead" else ""
        return f"One of these is missing, and the data cannot tell which: {first}{more}."
    answer = diagnosis.ranked(diagnosis.set[0])
    kind = telling(base, answer)
    fall = (
        f"with it the mean {'frequency error' if kind == 'frequency' else 'error of damping ratios'} falls from "
        f"{percent(base.error(kind))} to {percent(answer.error(kind))}"
        if answer.error(kind) < base.error(kind)
        else f"it explains {100.0 * diagnosis.explained:.0f} % of the misfit"
    )
    if np.isfinite([base.left_out(kind), answer.left_out(kind)]).all():
        fall += f", of modes left out from {percent(base.left_out(kind))} to {percent(answer.left_out(kind))}"
    if diagnosis.verdict == "partly explained":
        return f"A part of what is missing is {named[0]}: {fall}; the rest is unlike it."
    if set(answer.effects) <= set(diagnosis.measurement):
        return f"Not the model but the measurement is wrong, in {named[0]}: {fall}."
    return f"What the model lacks is {named[0]}: {fall}."


def _after_diagnosis(results: Results, diagnosis: Diagnosis) -> tuple[str, str]:
    """Return the next command, and what it does; nothing where nothing is left to do, or its words are not known."""
    if results.campaign is None:
        return "", ""
    campaign, folder = str(results.campaign), str(results.folder)
    if diagnosis.verdict == "one of" and diagnosis.next_tests:
        arguments = ["lamella", "next-test", campaign, "-o", folder]
        return shlex.join(arguments), "ranks further tests by how well they would tell them apart"
    effects = diagnosis.set[0] if diagnosis.set else ()
    fitted = any(set(entry.effects) == set(effects) for entry in results.ledger)
    known = set(effects) <= catalogue().keys() | set(diagnosis.measurement)
    command = next_command(diagnosis, campaign, folder) if known and not fitted else None
    if command is None:
        sliders = "" if diagnosis.stack is None else ", with sliders for every parameter"  # matrices have none
        return shlex.join(["lamella", "open", folder]), f"opens this in the browser{sliders}"
    return command, "adds it to the model, for all torques together"


def _of_a_fit(results: Results) -> Opening:
    """Say how good the fit is, or what was identified."""
    campaign = "CAMPAIGN" if results.campaign is None else str(results.campaign)

    def command(name: str) -> str:
        return shlex.join(["lamella", name, campaign, "-o", str(results.folder)])

    (sentence, *_) = fit_sentences(results)
    if results.updated is not None:
        return Opening(badge="fitted", tone="good", sentence=sentence)
    if any(tested.fit is not None for tested in results.tested):
        return Opening(
            badge="fitted",
            tone="good",
            sentence=sentence,
            command=command("diagnose"),
            reason="says which physical effect the model lacks, if any",
        )
    changes = [tested.change for tested in results.tested if tested.change is not None]
    if changes:
        changed = any(_changed(tested) for tested in results.tested)
        return Opening(
            badge="changed" if changed else "no change seen",
            tone="found" if changed else "good",
            sentence=" ".join(_in_short(results)),
        )
    return Opening(
        badge="modes identified",
        tone="good",
        sentence=sentence,
        command=command("fit"),
        reason="fits the model to these modes",
    )


def changed_first(results: Results) -> list[Tested]:
    """Return the configurations, those first that have changed: they are what is asked for."""
    return sorted(results.tested, key=lambda tested: not _changed(tested))


def _changed(tested: Tested) -> bool:
    """Tell whether a configuration has changed, by itself or beside a model, which sees all modes together."""
    seen = tested.change is not None and tested.change.changed
    return seen or (tested.what_changed is not None and tested.what_changed.verdict != "unchanged")


def _in_short(results: Results) -> list[str]:
    """Say of every state what changed and where, in two sentences, or whether it changed where no model says more."""
    sentences: list[str] = []
    for tested in changed_first(results):
        if tested.what_changed is not None and tested.what_changed.left:
            sentences += tested.what_changed.sentences[:2]
        elif tested.change is not None:
            sentences.append(f"{change_sentence(tested.change)}.")
    return sentences


def change_sentences(results: Results) -> tuple[str, ...]:
    """Say of every configuration that has a reference whether it changed, and what and where."""
    sentences: list[str] = []
    for tested in changed_first(results):
        if tested.change is not None:
            sentences.append(f"{change_sentence(tested.change)}.")
        if tested.what_changed is not None:
            sentences += tested.what_changed.sentences
    return tuple(sentences)


def fit_sentences(results: Results) -> tuple[str, ...]:
    """Say in words what was identified and how large the errors of the fitted model are."""
    n = len(results.tested)
    configurations = f"{n} configuration{'s' if n > 1 else ''}"
    modes = sum(t.measured.frequency.size for t in results.tested)
    if results.updated is not None:
        return _update_sentences(results, configurations)
    fits = [t.fit for t in results.tested if t.fit is not None]
    if not fits:
        compared = any(t.what_changed is not None for t in results.tested)
        fitted = "the model was fitted to references alone" if compared else "no model was fitted yet"
        return (f"{configurations} identified, {modes} modes in all; {fitted}.",)
    worst = max(fits, key=lambda fit: fit.error)
    left_over = sum(fit.pairing.unpaired_measured.size for fit in fits)
    return (
        f"{configurations} identified and fitted: the model's natural frequencies differ from the measured ones by "
        f"{percent(float(np.mean([fit.error for fit in fits])))} in the mean, most in {worst.name} "
        f"({percent(worst.error)}).",
        "Every measured mode has its partner in the model."
        if left_over == 0
        else f"{left_over} measured mode{'s have' if left_over > 1 else ' has'} no partner in the model.",
        *(f"First of all: {finding}." for fit in fits for finding in fit.findings),
        "Which physical effect the model lacks, if any, was not asked; lamella diagnose answers it.",
    )


def _update_sentences(results: Results, configurations: str) -> tuple[str, ...]:
    """Say how much an updating changed the frequency errors."""
    if results.updated is None:
        return ()
    fit = results.updated.fit
    held_out = fit.error(held_out=True)
    last = f", and is {percent(held_out)} of the modes held out" if np.isfinite(held_out) else ""
    return (
        f"{configurations} fitted together: the mean frequency error goes from {percent(fit.error(before=True))} to "
        f"{percent(fit.error())}{last}.",
    )


def _places(results: Results, configurations: Sequence[Section]) -> list[Picture]:
    """Return the pictures of where the model fails, side by side; those that more modes show stand first."""
    most_maps = 3  # of configurations; beside the steps they fill two rows
    maps = {p.name: p for part in configurations for p in part.pictures if p.name.startswith("error_map_")}
    fits = [t.fit for t in results.tested if t.fit is not None]
    order = sorted(fits, key=lambda fit: (-fit.pairing.measured.size, -fit.error))
    return [maps[name] for fit in order if (name := f"error_map_{fit.name}") in maps][:most_maps]


def answer_section(results: Results) -> Section:
    """Say in full what was identified, how sure that is and what was tried, or how far the model is from the data."""
    if results.diagnosis is not None:
        text = results.diagnosis.sentences
        blocks: tuple[Table, ...] = (
            before_after_table(results),
            explanation_table(results),
            moved_table(results),
            next_test_table(results.diagnosis),
        )
    else:
        text, blocks = fit_sentences(results), (before_after_table(results),)
    text = (*change_sentences(results), *text)
    if results.missing:
        text = (*text, f"Not done yet: {', '.join(results.missing)}.")
    return Section(title="In full", text=text, blocks=tuple(b for b in blocks if b.rows))


def before_after_table(results: Results) -> Table:
    """List errors, MAC and FRAC of the base model and of the identified model in each configuration."""
    pairs = [(t, t.fit, t.identified) for t in results.tested]
    rows = [
        (
            t.name,
            in_percent(fit.error),
            in_percent(identified.fit.error),
            f"{fit.pairing.paired_mac.mean():.3f}",
            f"{identified.fit.pairing.paired_mac.mean():.3f}",
            "" if np.isnan(identified.base_frac) else f"{identified.base_frac:.3f}",
            "" if np.isnan(identified.frac) else f"{identified.frac:.3f}",
        )
        for t, fit, identified in pairs
        if fit is not None and identified is not None
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
                    in_percent(t.fit.error),
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
            "d_f by opt_d [s/Pa]", "frequency error, paired [%]", "lowest MAC", "findings",
        ),
        rows=rows,
        note="± is half of the 95 % interval. The frequency error is the mean of |measured - model| / measured over "
        "the paired modes of the base model. opt_G and opt_d, the root of the summed squared differences of "
        "frequencies and of damping ratios, fit one configuration alone. Findings are warnings of the checks of the "
        "measurement. A click on a heading sorts.",
        link=tuple(address),
    )  # fmt: skip


def explanation_table(results: Results) -> Table:
    """List the explanations that a diagnosis fitted in full, the most probable first."""
    shown = 8  # explanations of a diagnosis
    ranking = results.diagnosis.shown(shown) if results.diagnosis is not None else ()
    labels = {} if results.diagnosis is None else results.diagnosis.labels
    return Table(
        title="Explanations that were tried",
        header=(
            "effects", "probability", "explained [%]", "frequency error [%]", "left out [%]",
            "parameters with 95 % interval",
        ),
        rows=tuple(
            (
                " + ".join(labels.get(e, e) for e in explanation.effects) or "none",
                f"{explanation.probability:.3f}",
                f"{100 * explanation.explained:.0f}",
                in_percent(explanation.frequency_error),
                in_percent(explanation.left_out_error),
                "; ".join(
                    f"{p.name} {quantity(p.value, p.unit)} ({quantity(p.lower, p.unit, p.value)} to "
                    f"{quantity(p.upper, p.unit, p.value)})"
                    for p in explanation.parameter
                ),
            )
            for explanation in ranking
        ),
        note="Explained: share of the squared differences of frequencies, damping ratios and shapes, over the "
        "variances of noise and of the discrepancy that the best explanation leaves. Left out: the frequency error "
        "where each mode is predicted from all others. Explanations less than "
        f"{np.exp(SEPARATE):.0f} times less probable than the first are not told apart.",
    )  # fmt: skip


def moved_table(results: Results) -> Table:
    """List every quantity of stack file and measurement that all fits may move, as stated and as fitted."""
    quantities = results.diagnosis.moved if results.diagnosis is not None else ()
    ordered = sorted(quantities, key=lambda moved: -abs(moved.deviations or 0.0))
    return Table(
        title="What else was fitted",
        header=("quantity", "stated", "fitted", "± 95 %", "known to ± 95 %", "standard deviations moved"),
        rows=tuple(
            (
                moved.label,
                quantity(moved.stated, moved.unit, moved.value),
                quantity(moved.value, moved.unit),
                quantity(Z95 * moved.std, moved.unit, moved.value),
                "" if moved.prior is None else quantity(Z95 * moved.prior, moved.unit, moved.value),
                "" if moved.deviations is None else f"{abs(moved.deviations):.1f}",
            )
            for moved in ordered
        ),
        note="Beside effects, every fit may move these within what is known of them beforehand; of G_f and d_f nothing "
        "is. Beyond three standard deviations either the stack file states something wrongly, or something is missing "
        "that this makes up for.",
    )


def next_test_table(diagnosis: Diagnosis) -> Table:
    """List further tests by how well they would tell apart what a diagnosis leaves open."""
    return Table(
        title="What to measure next",
        header=("test", "distance after it", "distance now"),
        rows=tuple((t.instruction, f"{t.distance:.1f}", f"{t.now:.1f}") for t in diagnosis.next_tests),
        note="Distance between the two explanations that are hardest to tell apart; above 3 they are.",
    )
