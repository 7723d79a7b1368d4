"""What the commands do with files: read, compute, show progress, and write each configuration as soon as it is done."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from ema import (
    Campaign,
    Comparison,
    compare,
    read_campaign,
    read_measurement,
    stabilization,
)
from ema.identification.poles_file import write_poles
from ema.modal.export import write_modes_csv, write_modes_uff, write_shapes_csv
from ema.plot.figures import comparison_figure, frf_figure, shape_figure, stabilization_figure
from ema.plot.picking import pick_poles
from model import Effect, Modes, Stack, catalogue, find_effects, read_stack
from model.contact.pressing import press
from model.contact.pressure import PressureSummary
from model.effects.conformance import effect_faults
from model.modes.verified import Verification, solve_verified
from model.plot.pressure import pressure_figure
from model.plot.shapes import mode_png
from model.stack.stack import Pressing
from model.stack.stack_file import stack_inputs
from updating.commands.effect_option import with_named_effects
from updating.commands.progress import progress
from updating.correlation.shape_class import class_grid, shape_classes
from updating.diagnosis.diagnosis import Diagnosis
from updating.diagnosis.diagnosis import diagnose as diagnose_stack
from updating.diagnosis.kept_model import kept_model
from updating.diagnosis.scan import MESSAGES
from updating.diagnosis.scatter_file import read_scatter
from updating.diagnosis.signature import Signature, signature, signature_figure
from updating.errors import FitError
from updating.fitting.fit import Fit
from updating.fitting.fit import fit as fit_configuration
from updating.fitting.fit_plot import as_png
from updating.fitting.modal_table import TableFit, TableRow, fit_row, read_modal_table
from updating.fitting.target import model_file, stack_in_state
from updating.report.page import write_report
from updating.results.identified import Assignment, Identified, assignments, every_identified, identified
from updating.results.store import folder_name, kept, read_frf, write_bytes, write_result
from updating.virtual.campaign import write_virtual_test
from updating.virtual.vibration_test_file import read_virtual_test
from updating.workers.workers import in_parallel, workers


def identify(
    campaign_file: Path, output: Path, poles: Path | None, console: Console, cluster: str | None = None
) -> tuple[tuple[Identified, ...], Comparison]:
    """Identify every configuration of a campaign, write each result as soon as it is there, and compare them.

    Configurations that an earlier run left are read back.

    With `poles`, the folder of earlier results, its poles.txt files take the place of the automatic choice.
    """
    campaign = read_campaign(campaign_file)
    assigned = assignments(campaign, output, poles)
    task = partial(_identify, keep_poles=poles == output)
    results = tuple(in_parallel(task, assigned, "identify", console, cluster))
    comparison = compare([found.modal_model for found in results])
    write_result(output / "comparison.json", comparison, inputs=(campaign.path,), options={})
    write_bytes(output / "comparison.png", as_png(comparison_figure(comparison, *_abscissa(campaign))))
    return results, comparison


def _identify(assigned: Assignment, *, keep_poles: bool) -> Identified:
    found = identified(assigned)
    _write_tables_and_pictures(found, keep_poles=keep_poles)
    return found


def pick(campaign_file: Path, configuration: str, output: Path) -> Path:
    """Let the user choose the poles of one configuration in its stabilisation chart and write poles.txt."""
    campaign = read_campaign(campaign_file)
    frf = read_measurement(campaign, configuration).frf
    options = campaign.identification
    lines = frf if options.band is None else frf.band(*options.band)
    diagram = stabilization(lines) if options.order is None else stabilization(lines, order=options.order)
    chosen = pick_poles(diagram)
    path = output / folder_name(configuration) / "poles.txt"
    write_poles(path, chosen)
    return path


@dataclass(frozen=True, eq=False, kw_only=True)
class Solved:
    """A stack with its elastic modes: what `solve` writes and the command line prints.

    `pressure` is None where the stack file gives one pressure for all places.
    """

    stack: Stack
    modes: Modes
    shape_class: tuple[str, ...]
    verification: Verification
    pressure: PressureSummary | None


@dataclass(frozen=True, eq=False, kw_only=True)
class AddedEffects:
    """Effects that the user adds to a stack: as in `with_named_effects`, and files of the user's own."""

    option: tuple[str, ...] = ()
    file: tuple[Path, ...] = ()


def solve(
    stack_file: Path, output: Path, n_mode: int, tolerance: float, console: Console, effects: AddedEffects
) -> Solved:
    """Press the stack of a file where it says how, solve its elastic modes, write both and their pictures."""
    stack = read_stack(stack_file)
    if effects.option or effects.file:
        stack = with_named_effects(stack, effects.option, catalogue(effects.file))
    options = {"n_mode": n_mode, "tolerance": tolerance, "effects": dict(stack.effect_values)}
    inputs = (*stack_inputs(stack_file), *effects.file)
    pressure = None
    with _progress(console) as progress:
        task = progress.add_task("press and solve", total=2 + n_mode)
        if isinstance(stack.pressing, Pressing):
            field = press(stack)
            stack, pressure = replace(stack, pressing=field), field.summary()
            write_result(output / "pressure.json", pressure, inputs=inputs, options={})
            write_bytes(output / "pressure.png", as_png(pressure_figure(field)))
        progress.advance(task)
        system, every, verification = solve_verified(
            stack, n_mode=6 + n_mode, observation=class_grid(stack), tolerance=tolerance
        )
        modes = every.elastic()
        verification = replace(verification, error=verification.error[every.n_rigid :])
        write_result(output / "modes.json", modes, inputs=inputs, options=options)
        write_result(output / "verification.json", verification, inputs=inputs, options=options)
        progress.advance(task)
        for r in range(modes.frequency.size):
            write_bytes(output / f"mode_{r + 1:02d}.png", mode_png(system, modes, r))
            progress.advance(task)
    names = shape_classes(modes) if stack.outline is None else ("",) * modes.frequency.size
    return Solved(stack=stack, modes=modes, shape_class=names, verification=verification, pressure=pressure)


def fit(
    campaign_file: Path, output: Path, threshold: float, console: Console, cluster: str | None = None
) -> Iterator[tuple[Identified, Fit]]:
    """Identify and fit every configuration of a campaign, write each result as soon as it is there, and hand it on.

    Configurations that an earlier run left are read back.
    """
    campaign = read_campaign(campaign_file)
    stack_file = model_file(campaign, "a fit")
    assigned = assignments(campaign, output)
    task = partial(_identify_and_fit, read_stack(stack_file), stack_inputs(stack_file), threshold)
    yield from in_parallel(task, assigned, "identify and fit", console, cluster)


def _identify_and_fit(
    stack: Stack, stack_files: tuple[Path, ...], threshold: float, assigned: Assignment
) -> tuple[Identified, Fit]:
    found = identified(assigned)
    inputs = (assigned.campaign.path, *stack_files, found.folder / "modal_model.json")
    options = {"threshold": threshold}

    def make() -> Fit:
        state = stack_in_state(stack, found.configuration)
        fitted = fit_configuration(state, found.modal_model, threshold=threshold)
        write_result(found.folder / "modes.json", fitted.modes, inputs=inputs, options=options)
        return fitted

    return found, kept(found.folder / "fit.json", Fit, make, inputs=inputs, options=options)


def fit_modal_table(
    campaign_file: Path, output: Path, console: Console, cluster: str | None = None
) -> tuple[TableFit, ...]:
    """Fit every row of a modal table and write each result as soon as it is there.

    Rows that an earlier run left are read back.
    """
    table = read_modal_table(campaign_file)
    write_result(output / "modal_table.json", table, inputs=table.inputs, options={})
    inputs = tuple(file.absolute() for file in table.inputs)
    task = partial(_fit_row, table.shape_class, inputs, output.absolute())
    return tuple(in_parallel(task, table.rows, "fit", console, cluster))


def _fit_row(shape_class: tuple[str, ...], inputs: tuple[Path, ...], output: Path, row: TableRow) -> TableFit:
    path = output / f"stack_{folder_name(row.name)}" / "fit.json"
    return kept(path, TableFit, partial(fit_row, row, shape_class), inputs=inputs, options={})


def diagnose(
    campaign_file: Path,
    output: Path,
    effect_files: Sequence[Path],
    console: Console,
    scatter_file: Path | None = None,
) -> Diagnosis:
    """Identify a campaign, diagnose its model, and write diagnosis.json.

    What an earlier run left is read back.
    """
    scatter = None if scatter_file is None else read_scatter(scatter_file)
    campaign = read_campaign(campaign_file)
    stack_file = model_file(campaign, "a diagnosis")
    stack, known = read_stack(stack_file), catalogue(effect_files)
    states = [stack_in_state(stack, c) for c in campaign.configurations]
    heights = {state.height for state in states}
    if len(heights) > 1:
        listed = " and ".join(f"{1e3 * height:g}" for height in sorted(heights))
        message = (
            f"{campaign_file}: a diagnosis is of one stack; give the heights {listed} mm a campaign each"
        )
        raise FitError(message)
    assigned = assignments(campaign, output)
    tests = every_identified(assigned, "identify", console)
    tested = [
        (found.configuration.name, state.contact.pressure, found.modal_model)
        for state, found in zip(states, tests, strict=True)
    ]

    def make() -> Diagnosis:
        with workers(MESSAGES) as executor, progress("diagnose", console):
            own = replace(stack, height=states[0].height)
            return diagnose_stack(own, tested, known, scatter=scatter, executor=executor, reduced=kept_model)

    modal = (found.folder / "modal_model.json" for found in tests)
    stated = () if scatter_file is None else (scatter_file,)
    inputs = (campaign_file, *stack_inputs(stack_file), *effect_files, *stated, *modal)
    return kept(output / "diagnosis.json", Diagnosis, make, inputs=inputs, options={})


def report(folder: Path) -> Path:
    """Make the page of a results folder, its configurations in parallel."""
    with workers(len(list(folder.glob("*/modal_model.json")))) as executor:
        return write_report(folder, executor)


def simulate(specification: Path, output: Path, effect_files: Iterable[Path]) -> None:
    """Play a virtual test and write its campaign."""
    write_virtual_test(read_virtual_test(specification, effect_files), output)


@dataclass(frozen=True, eq=False, kw_only=True)
class Explained:
    """An effect as `explain` finds it.

    `signature` is None without a stack; `faults` are those of an effect that does not ship.
    """

    effect: Effect
    faults: tuple[str, ...]
    signature: Signature | None


def explain(
    name: str, stack_file: Path | None, output: Path | None, files: Iterable[Path], console: Console
) -> Explained:
    """Find an effect, check it if it is the user's own, and try it on the stack; with `output` draw that."""
    shipped = catalogue()
    (effect,) = find_effects([name], catalogue(files))
    with _progress(console) as progress:
        task = progress.add_task("explain", total=2)
        faults = () if effect.name in shipped else effect_faults(effect)
        progress.advance(task)
        found = None
        if stack_file is not None and not faults:
            found = signature(read_stack(stack_file), effect)
            if output is not None:
                write_bytes(output / f"{effect.name}.png", as_png(signature_figure(found)))
        progress.advance(task)
    return Explained(effect=effect, faults=faults, signature=found)


def _abscissa(campaign: Campaign) -> tuple[NDArray[np.float64], str]:
    """Return what to compare over: torque or pressure where all state it and it varies, else the number."""
    for name, unit, factor in (("torque", "N m", 1.0), ("pressure", "kPa", 1e-3)):
        stated = [getattr(c, name) for c in campaign.configurations]
        if None not in stated and len(set(stated)) > 1:
            return factor * np.array(stated), f"{name} [{unit}]"
    return np.arange(1.0, len(campaign.configurations) + 1.0), "configuration [number in the campaign file]"


def _write_tables_and_pictures(found: Identified, *, keep_poles: bool) -> None:
    """Write what is made from a modal model, but not over the poles of the user that it was made from."""
    folder, modes = found.folder, found.modal_model
    last = folder / f"shape_{modes.frequency.size:02d}.png"
    if last.exists() and last.stat().st_mtime_ns >= (folder / "modal_model.json").stat().st_mtime_ns:
        return  # all of them are there, made from this model
    frf = read_frf(folder / "measurement.npz")
    write_bytes(folder / "frf.png", as_png(frf_figure(frf, modes)))
    write_bytes(
        folder / "stabilization.png", as_png(stabilization_figure(stabilization(frf.band(*modes.band))))
    )
    write_modes_uff(folder / "modes.uff", modes, step=float(frf.frequency[1] - frf.frequency[0]))
    write_modes_csv(folder / "modes.csv", modes)
    write_shapes_csv(folder / "shapes.csv", modes)
    if not keep_poles or not (folder / "poles.txt").exists():
        write_poles(folder / "poles.txt", modes.pole)
    for r in range(modes.frequency.size):
        write_bytes(folder / f"shape_{r + 1:02d}.png", as_png(shape_figure(modes, r)))


def _progress(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        console=console, transient=True,
    )  # fmt: skip
