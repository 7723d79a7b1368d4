"""`lamella update`: fit several configurations at once, as a file says."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import model
from ema import read_campaign
from ema.plot.figures import as_png
from ema.types.threads import single_threaded
from model import Effect
from model.stack.stack_file import stack_inputs
from updating.commands.terminal import OUT
from updating.commands.update_file import CampaignSection, UpdateFile, read_update_file
from updating.errors import FitError
from updating.fitting.fit import G_F_BOUNDS
from updating.fitting.intervals import N_DRAW
from updating.fitting.joint_fit import JointFit, joint_fit
from updating.fitting.joint_plot import convergence_figure, correlation_figure
from updating.fitting.joint_problem import FitSettings, require_known
from updating.fitting.ledger import ledger
from updating.fitting.modal_table import is_modal_table, read_modal_table
from updating.fitting.prepared import Prepared, prepare
from updating.fitting.sensitivity import Scatter
from updating.fitting.target import (
    Target,
    model_file,
    specimen_name,
    stack_in_state,
    target_of_modes,
    target_of_table,
)
from updating.results.campaign_findings import measurement_findings
from updating.results.chosen_poles import forget_choices
from updating.results.identified import assignments, every_identified
from updating.results.ledger import ledger_table, write_ledger
from updating.results.store import folder_name, write_bytes, write_result
from updating.results.updated import Updated
from updating.workers.workers import workers


@single_threaded
def update_command(
    specification: Path,
    output: Path,
    effect_file: Sequence[Path],
    cluster: str | None,
    *,
    identify_anew: bool,
) -> None:
    """Fit what an updating file says, and print parameters and ledger."""
    if identify_anew:
        forget_choices(output)
    updated = run_update(specification, output, OUT, effect_file, cluster)
    OUT.print(parameter_table(updated.fit))
    OUT.print(ledger_table(updated.ledger, model.catalogue(effect_file)))
    OUT.print(f"Results in {output}")


def run_update(
    path: Path, output: Path, console: Console, effect_files: Sequence[Path] = (), cluster: str | None = None
) -> Updated:
    """Do what an updating file says and write update.json, ledger.json and tables and pictures of both.

    Raises
    ------
    FitError
        The file or a campaign is not as it should be, or the fit fails.
    """
    given = read_update_file(path)
    effects = model.find_effects(given.effects, model.catalogue(effect_files))
    inputs = [path, *effect_files]
    targets: list[Target] = []
    for section in given.campaign:
        found, files = _targets(path, section, given, effects, output, console, cluster)
        targets += found
        inputs += files
    hold_out = _held_out(given, targets)
    stiffness = given.bounds.get("G_f", G_F_BOUNDS)
    with console.status("reduce the models"):
        prepared = prepare(targets, threshold=given.threshold, G_f_bounds=stiffness)
    settings = FitSettings(
        free=given.free,
        scope=given.scope,
        fixed=given.fixed,
        bounds=given.bounds,
        priors=given.priors,
        damping=given.damping,
        scatter=Scatter(**given.scatter.model_dump()),
    )
    n_task = N_DRAW if given.intervals == "bootstrap" else 1 + len(effects)
    with workers(n_task, cluster) as executor:
        with console.status("fit"):
            fit = joint_fit(
                prepared,
                replace(settings, hold_out=hold_out),
                first=given.first,
                n_start=given.starts,
                intervals=given.intervals,
                seed=given.seed,
                executor=executor,
            )
        with console.status("ledger"):
            kept = [_without_modes(p, hold_out.get(p.target.name, ())) for p in prepared]
            entries = ledger(kept, [e.name for e in effects], settings, executor=executor)
    result = Updated(name=given.name, fit=fit, ledger=entries)
    _write(result, tuple(inputs), given, output)
    return result


def _without_modes(prepared: Prepared, modes: Sequence[int]) -> Prepared:
    """Return a configuration of which some modes do not take part."""
    out = np.isin(np.arange(prepared.used.size), modes)
    return replace(prepared, used=prepared.used & ~out)


def parameter_table(fit: JointFit) -> Table:
    """Print the estimates with their intervals, and the errors before and after."""
    held_out = fit.error(held_out=True)
    errors = (
        f"mean frequency error {100 * fit.error(before=True):.2f} % before, {100 * fit.error():.2f} % after"
    )
    if np.isfinite(held_out):
        errors += f", {100 * held_out:.2f} % on the modes held out"
    table = Table(title="Fitted together", title_justify="left", caption=errors, caption_justify="left")
    for name in ("parameter", "of", "value", "std", "95 %", ""):
        table.add_column(name, justify="left" if name in ("parameter", "of", "") else "right")
    for p in fit.parameter:
        doubt = "at its bound" if p.at_bound else "" if p.determined else "not determined"
        table.add_row(
            p.name if p.unit == "1" else f"{p.name} [{p.unit}]", p.group or "all", f"{p.value:.5g}", f"{p.std:.2g}",
            f"{p.interval[0]:.4g} to {p.interval[1]:.4g}", doubt or ("" if p.method == "normal" else p.method),
        )  # fmt: skip
    return table


def _targets(
    path: Path,
    section: CampaignSection,
    given: UpdateFile,
    effects: Sequence[Effect],
    output: Path,
    console: Console,
    cluster: str | None,
) -> tuple[list[Target], list[Path]]:
    """Return the configurations of one campaign as targets, and the files that they come from."""
    file, several = path.parent / section.file, len(given.campaign) > 1
    if is_modal_table(file):
        table = read_modal_table(file)
        name = section.name or table.name
        chosen = _chosen(path, section, [row.name for row in table.rows])
        found = [
            target_of_table(
                row.stack.with_effects(*effects),
                table.shape_class,
                row.frequency,
                name=f"{name}/{row.name}" if several else row.name,
            )
            for row in table.rows
            if row.name in chosen
        ]
        return found, list(table.inputs)
    campaign = read_campaign(file)
    stack_file = model_file(campaign, "a fit")
    name = section.name or campaign.name
    chosen = _chosen(path, section, [c.name for c in campaign.configurations])
    stack = model.read_stack(stack_file).with_effects(*effects)
    configurations = tuple(c for c in campaign.configurations if c.name in chosen)
    states = [stack_in_state(stack, c) for c in configurations]
    heights = {state.height for state in states}
    own = output / folder_name(name) if several else output
    assigned = assignments(replace(campaign, configurations=configurations), own)
    tests = every_identified(assigned, f"identify {name}", console, cluster)
    for sentence in measurement_findings(tests):
        console.print(sentence, highlight=False, markup=False)
    found = [
        replace(
            target_of_modes(state, one.modal_model, specimen=specimen_name(name, state.height, heights)),
            name=f"{name}/{one.configuration.name}" if several else one.configuration.name,
        )
        for state, one in zip(states, tests, strict=True)
    ]
    modal = [one.folder / "modal_model.json" for one in tests]
    return found, [file, *stack_inputs(stack_file), *modal]


def _chosen(path: Path, section: CampaignSection, known: Sequence[str]) -> Sequence[str]:
    if section.configurations is None:
        return known
    require_known(f"{path}: configuration of {section.file}:", section.configurations, known)
    return section.configurations


def _held_out(given: UpdateFile, targets: Sequence[Target]) -> Mapping[str, tuple[int, ...]]:
    """Return the modes held out, counted from 0."""
    size = {target.name: target.frequency.size for target in targets}
    require_known("hold_out: configuration", given.hold_out, size)
    for name, modes in given.hold_out.items():
        if max(modes, default=0) > size[name]:
            message = f"hold_out.{name}: there is no mode {max(modes)}; it has {size[name]}"
            raise FitError(message)
    return {name: tuple(m - 1 for m in modes) for name, modes in given.hold_out.items()}


def _write(result: Updated, inputs: tuple[Path, ...], given: UpdateFile, output: Path) -> None:
    options = given.model_dump(mode="json")
    write_result(output / "update.json", result, inputs=inputs, options=options)
    write_ledger(result.ledger, options, inputs, output)
    fit = result.fit
    names = [f"{p.name} {p.group}".strip() for p in fit.parameter]
    header = ["parameter", "group", "unit", "value", "std", "lower_95", "upper_95", "interval", "determined"]
    rows: list[list[object]] = [
        [p.name, p.group, p.unit, p.value, p.std, *p.interval, p.method, p.determined] for p in fit.parameter
    ]
    correlation = [[name, *map(float, row)] for name, row in zip(names, fit.correlation, strict=True)]
    modes: list[list[object]] = [
        [
            c.name, r + 1, bool(c.used[r]), c.measured_frequency[r], c.frequency_before[r], c.frequency[r],
            c.measured_damping[r], c.damping_before[r], c.damping[r], c.mac[r],
        ]
        for c in fit.configuration
        for r in range(c.used.size)
    ]  # fmt: skip
    columns = [
        "configuration", "mode", "fitted", "measured_Hz", "before_Hz", "after_Hz", "measured_damping",
        "damping_before", "damping_after", "mac",
    ]  # fmt: skip
    for name, content in (
        ("parameters.csv", _csv([header, *rows])),
        ("correlation.csv", _csv([["", *names], *correlation])),
        ("modes.csv", _csv([columns, *modes])),
        ("correlation.png", as_png(correlation_figure(fit))),
        ("convergence.png", as_png(convergence_figure(fit))),
    ):
        write_bytes(output / name, content)


def _csv(rows: Sequence[Sequence[object]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(
        [["" if isinstance(v, float) and not np.isfinite(v) else v for v in row] for row in rows]
    )
    return text.getvalue().encode()
