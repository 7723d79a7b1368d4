"""`lamella fit`: identify a campaign, fit G_f and d_f, and add effects that all configurations share.

What only some campaigns need, such as the diagnosis or a model of matrices, is imported where it is used: each takes
some tenths of a second to load.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ema import ModalModel, read_campaign
from ema.types.arrays import single_threaded
from ema.types.modal_model import frequency_text
from model import Effect, Modes, Stack, catalogue, find_effects, printed_effects, read_matrices, read_stack
from model.matrices.structure_file import is_structure_file, matrices_inputs
from model.stack.stack_file import stack_inputs
from updating import commands
from updating.commands.terminal import OUT, Run, print_lines, progress
from updating.correlation.correlation import correlate
from updating.correlation.pairing import LEAST_MAC
from updating.fitting.fit import Fit, ModelFit, model_file, specimen_name, stack_in_state
from updating.fitting.fit import fit as fit_configuration
from updating.pooled.campaign_file import has_specimens
from updating.pooled.specimen import Specimen
from updating.results.campaign import campaign_findings
from updating.results.identified import (
    Assignment,
    Failed,
    Identified,
    assignments,
    attempted,
    forget_choices,
    identified,
    require_none,
)
from updating.results.ledger import Entry, write_ledger
from updating.results.store import kept
from updating.results.text import Z95, Table, interval_text, parameter_text, quantity
from updating.workers.workers import in_parallel, workers


@single_threaded
def fit_command(run: Run, threshold: float, effect: Sequence[str]) -> None:
    """Identify and fit what a campaign file lists, and print what came of it."""
    known = catalogue(run.effect_files)
    if not _of_matrices(run.campaign):
        find_effects(effect, known)  # before hours of work
    if run.identify_anew:
        forget_choices(run.output)
    if has_specimens(run.campaign):
        from updating.commands.diagnose import diagnose_pooled, print_pooled

        print_pooled(diagnose_pooled(run, effect), run.output)
        return
    fits, done, failed = [], list[Identified](), []
    for outcome in fit_campaign(run, threshold):
        if isinstance(outcome, Failed):
            failed.append(outcome)
            continue
        result, fitted = outcome
        done.append(result)
        OUT.print(fit_table(result.modal_model, fitted))
        print_lines(OUT, (*result.quality.findings, *fitted.findings))
        if effect:  # without, models of a campaign of any length are not held
            fits.append(outcome)
    print_lines(OUT, campaign_findings(done))
    if fits and effect:
        OUT.print(ledger_table(campaign_ledger(run, fits, tuple(effect)), known))
    if done:
        OUT.print(f"Report: {commands.make_report(run.output, keep=run.keep)}")
    require_none(failed, len(done) + len(failed))


def fit_campaign(run: Run, threshold: float = LEAST_MAC) -> Iterator[tuple[Identified, ModelFit] | Failed]:
    """Identify and fit every configuration of a campaign, write each result as soon as it is there, and hand it on.

    A configuration of which nothing comes is handed on as `Failed`. What an earlier run left is read back. `threshold`
    is the smallest MAC that makes a pair of modes.
    """
    campaign = read_campaign(run.campaign)
    stack_file = model_file(campaign, "a fit")
    assigned = assignments(campaign, run.output, keep=run.keep)
    if is_structure_file(stack_file):
        from updating.diagnosis.matrices_answer import MatricesFit

        task = partial(
            _identify_and_fit, MatricesFit, _fit_matrices, stack_file, matrices_inputs(stack_file), threshold
        )
    else:
        stack = read_stack(stack_file)
        task = partial(_identify_and_fit, Fit, _fit_stack, stack, stack_inputs(stack_file), threshold)
    yield from in_parallel(partial(attempted, task), assigned, "identify and fit", run.console, run.cluster)


def _identify_and_fit(
    kind: type[ModelFit],
    make: Callable[..., ModelFit],
    model: Stack | Path,
    files: tuple[Path, ...],
    threshold: float,
    assigned: Assignment,
) -> tuple[Identified, ModelFit]:
    """Identify a configuration and fit a stack, or a structure of matrices; what an earlier run left is read back."""
    result = identified(assigned)
    inputs, options = (assigned.campaign.path, *files, result.folder / "modal_model.json"), {"threshold": threshold}
    again = partial(make, model, result, threshold)
    fitted = kept(result.folder / "fit.json", kind, again, inputs=inputs, options=options, keep=assigned.keep)
    if isinstance(fitted, Fit):
        kept(result.folder / "modes.json", Modes, lambda: fitted.modes, inputs=inputs, options=options)
    return result, fitted


def _fit_stack(stack: Stack, result: Identified, threshold: float) -> Fit:
    state = stack_in_state(stack, result.configuration)
    return fit_configuration(state, result.modal_model, threshold=threshold)


def _fit_matrices(file: Path, result: Identified, threshold: float) -> ModelFit:
    from updating.diagnosis.matrices_answer import fit_matrices

    return fit_matrices(read_matrices(file), result.modal_model, threshold=threshold)


def campaign_ledger(
    run: Run, fits: Sequence[tuple[Identified, ModelFit]], effects: tuple[str, ...]
) -> tuple[Entry, ...]:
    """Fit effects that all configurations of a campaign share, and write ledger.json and ledger.csv.

    Configurations of one height are one stack, with one G_f and one d_f for all its torques. One stack is fitted as a
    diagnosis does it, and with the same numbers; several, which share the effects alone, are fitted together.
    """
    from updating.commands.diagnose import diagnose_campaign
    from updating.pooled.joint_fit import entry_of

    heights = {fitted.stack.height for _, fitted in fits if isinstance(fitted, Fit)}
    if len(heights) < 2:
        together = [*((name,) for name in effects), *([effects] if len(effects) > 1 else [])]
        diagnosis = diagnose_campaign(run, together)
        entries = tuple(entry_of(diagnosis.ranked(names)) for names in ((), *together))
    else:
        added = find_effects(effects, catalogue(run.effect_files))
        stacks = [(result, fitted) for result, fitted in fits if isinstance(fitted, Fit)]
        stack = read_stack(model_file(read_campaign(run.campaign), "a fit"))
        entries = _together(_by_height(stacks, stack, heights), added, run.cluster)
    modal = (result.folder / "modal_model.json" for result, _ in fits)
    write_ledger(entries, {"effects": list(effects)}, (run.campaign, *run.effect_files, *modal), run.output)
    return entries


def _of_matrices(campaign_file: Path) -> bool:
    """Tell whether the model of a campaign is a structure of matrices."""
    if has_specimens(campaign_file):
        return False
    stack = read_campaign(campaign_file).stack
    return stack is not None and is_structure_file(stack)


def _by_height(fits: Sequence[tuple[Identified, Fit]], stack: Stack, heights: set[float]) -> list[Specimen]:
    """Return the configurations of each height as one stack."""
    specimens = []
    for height in sorted(heights):
        tested = tuple(
            (result.configuration.name, fitted.stack.contact.pressure, result.modal_model)
            for result, fitted in fits
            if fitted.stack.height == height
        )
        name = specimen_name(stack.name, height, heights)
        specimens.append(Specimen(name=name, stack=replace(stack, height=height), tested=tested))
    return specimens


def _together(specimens: Sequence[Specimen], effects: Sequence[Effect], cluster: str | None) -> tuple[Entry, ...]:
    """Return the ledger of effects that specimens share."""
    from updating.diagnosis.cached_model import cached_model
    from updating.diagnosis.candidates import MESSAGES
    from updating.pooled.joint_fit import joint_fit

    added = {effect.name: effect for effect in effects}
    with workers(MESSAGES, cluster) as executor, progress("fit", OUT):
        return joint_fit("", specimens, added, executor=executor, reduced=cached_model).ledger


def fit_table(measured: ModalModel, fit: ModelFit) -> Table:
    """Put measured beside fitted modes, with the parameters below; of matrices with the MAC before the fit."""
    pairs, paired = correlate(measured, fit.modes, fit.pairing), fit.pairing.measured
    error, of = f"mean frequency error {100 * fit.error:.2f} %", f"of {paired.size} of {measured.frequency.size}"
    if isinstance(fit, Fit):
        caption = [f"{parameter_text(fit.G_f)}   {parameter_text(fit.d_f)}", f"{error}, {of} measured modes"]
        beside = {
            "damping\nmeasured [%]": [f"{100 * xi:.3g}" for xi in pairs.measured_damping],
            "damping\nmodel [%]": [f"{100 * xi:.3g}" for xi in pairs.model_damping],
        }
    else:
        from updating.diagnosis.matrices_answer import MatricesFit

        assert isinstance(fit, MatricesFit)
        caption = [f"{error} ({100 * fit.initial_error:.2f} % before), {of} measured modes"]
        caption += [
            f"{p.label} {quantity(p.value, p.unit)} ± {quantity(Z95 * p.std, p.unit, p.value)} (stated {p.stated:g})"
            for p in fit.moved
            if not p.name.startswith("gain")
        ]
        beside = {"MAC\nbefore": [f"{mac:.4f}" for mac in fit.initial_mac]}
    if left_over := [frequency_text(f, 1) for f in measured.frequency[fit.pairing.unpaired_measured]]:
        caption.append(f"measured but not paired: {', '.join(left_over)} Hz")
    columns = {
        "mode": [str(mode + 1) for mode in paired],
        "measured\n[Hz]": [f"{f:.2f}" for f in pairs.measured_frequency],
        "model\n[Hz]": [f"{f:.2f}" for f in pairs.model_frequency],
        "error\n[%]": [f"{100 * e:+.2f}" for e in pairs.frequency_error],
        **beside,
        "MAC": [f"{mac:.4f}" for mac in pairs.mac],
    }
    rows = list(zip(*columns.values(), strict=True))
    return Table(f"{fit.name}: measured and fitted", tuple(columns), rows, "\n".join(caption))


def ledger_table(entries: Sequence[Entry], known: Mapping[str, Effect] | None = None) -> Table:
    """List what each effect, of those that are known, does to the error, on data used and held out."""
    damping = any(np.isfinite(e.damping_error) for e in entries)
    unknown = any(np.isnan(e.configuration_error) and np.isfinite(e.error) for e in entries)

    def cells(entry: Entry, *kinds: str) -> str:
        values = [getattr(entry, kind) for kind in kinds[: 1 + damping]]
        return " | ".join("-" if np.isnan(v) else f"{100 * v:.2f}" for v in values)

    return Table(
        "Mean relative error [%] of frequencies" + (" | of damping ratios" if damping else ""),
        ("model", "fitted", "mode\nheld out", "config.\nheld out", "parameters"),
        [
            (
                "\n+ ".join(("base", *printed_effects(e.effects, known))),
                cells(e, "error", "damping_error"),
                cells(e, "mode_error", "mode_damping_error"),
                cells(e, "configuration_error", "configuration_damping_error"),
                "\n".join([*(interval_text(p) for p in e.shared), *e.pulled]),
            )
            for e in entries
        ],
        "Held out: each mode predicted by a fit to all other modes; each configuration by a fit to the others."
        + (" -: there is no other." if unknown else ""),
        whole=True,
    )
