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
from model import Effect, Modes, Stack, catalogue, find_effects, printed_effects, read_stack
from model.matrices.structure_file import is_structure_file
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
from updating.results.text import Table, interval_text, parameter_text
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
        OUT.print(_table(result.modal_model, fitted))
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
    task: Callable[[Assignment], tuple[Identified, ModelFit]]
    if is_structure_file(stack_file):
        from updating.commands.model import identify_and_fit_matrices

        task = partial(identify_and_fit_matrices, stack_file, threshold)
    else:
        task = partial(_identify_and_fit, read_stack(stack_file), stack_inputs(stack_file), threshold)
    yield from in_parallel(partial(attempted, task), assigned, "identify and fit", run.console, run.cluster)


def _identify_and_fit(
    stack: Stack, stack_files: tuple[Path, ...], threshold: float, assigned: Assignment
) -> tuple[Identified, Fit]:
    result = identified(assigned)
    inputs = (assigned.campaign.path, *stack_files, result.folder / "modal_model.json")
    options = {"threshold": threshold}

    def make() -> Fit:
        state = stack_in_state(stack, result.configuration)
        return fit_configuration(state, result.modal_model, threshold=threshold)

    fitted = kept(result.folder / "fit.json", Fit, make, inputs=inputs, options=options, keep=assigned.keep)
    kept(result.folder / "modes.json", Modes, lambda: fitted.modes, inputs=inputs, options=options)
    return result, fitted


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


def _table(measured: ModalModel, fit: ModelFit) -> Table:
    """Put measured beside fitted modes, of matrices or of a stack."""
    if isinstance(fit, Fit):
        return fit_table(measured, fit)
    from updating.commands.model import matrices_fit_table
    from updating.diagnosis.matrices_answer import MatricesFit

    assert isinstance(fit, MatricesFit)
    return matrices_fit_table(measured, fit)


def fit_table(measured: ModalModel, fit: Fit) -> Table:
    """Put measured beside fitted modes, with the parameters below."""
    pairs = correlate(measured, fit.modes, fit.pairing)
    caption = (
        f"{parameter_text(fit.G_f)}   {parameter_text(fit.d_f)}\nmean frequency error {100 * fit.error:.2f} %, of "
        f"{fit.pairing.measured.size} of {measured.frequency.size} measured modes"
    )
    left_over = [frequency_text(f, 1) for f in measured.frequency[fit.pairing.unpaired_measured]]
    if left_over:
        caption += f"\nmeasured but not paired: {', '.join(left_over)} Hz"
    columns = (
        fit.pairing.measured, pairs.measured_frequency, pairs.model_frequency, pairs.frequency_error,
        pairs.measured_damping, pairs.model_damping, pairs.mac,
    )  # fmt: skip
    return Table(
        f"{fit.name}: measured and fitted",
        ("mode", "measured\n[Hz]", "model\n[Hz]", "error\n[%]", "damping\nmeasured [%]", "damping\nmodel [%]", "MAC"),
        [
            (
                str(mode + 1), f"{f_exp:.2f}", f"{f_num:.2f}", f"{100 * error:+.2f}", f"{100 * xi_exp:.3g}",
                f"{100 * xi_num:.3g}", f"{mac:.4f}",
            )
            for mode, f_exp, f_num, error, xi_exp, xi_num, mac in zip(*columns, strict=True)
        ],
        caption,
    )  # fmt: skip


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
