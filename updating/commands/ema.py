"""The commands that identify: the modes of a campaign, and poles chosen by clicks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from ema import (
    Campaign,
    Comparison,
    ExplainedPower,
    ModalModel,
    change_sentence,
    compare,
    complexity,
    read_campaign,
    read_measurement,
    repeats,
    stabilization,
)
from ema.identification.amplitude import AmplitudeDependence
from ema.identification.exchange import write_modes_csv, write_modes_uff, write_poles, write_shapes_csv
from ema.io.uff import write_uff
from ema.plot.figures import (
    amplitude_figure,
    as_png,
    comparison_figure,
    overlay_figure,
    pick_poles,
    shape_figure,
    stabilization_figure,
)
from ema.types.arrays import single_threaded
from ema.types.modal_model import frequency_text
from lamella_shared import Reals
from updating.commands.terminal import OUT, Run, print_lines, print_results
from updating.results.campaign import campaign_findings, change_table, compared, over_amplitude, stored_amplitude
from updating.results.identified import (
    Assignment,
    Failed,
    Identified,
    assignments,
    attempted,
    forget_choices,
    identified,
    keep_choice,
    require_none,
)
from updating.results.store import folder_name, read_frf, write_bytes, write_result
from updating.results.text import Table, abscissa
from updating.workers.workers import in_parallel


@single_threaded
def ema_command(run: Run, poles: Path | None) -> None:
    """Identify every configuration of a campaign, and print modes, comparison and findings."""
    if run.identify_anew:
        forget_choices(run.output)
    results, comparison, failed = identify_campaign(run, poles)
    for result in results:
        OUT.print(modes_table(result.modal_model, result.quality.explained))
        print_lines(OUT, result.quality.findings)
        print_amplitude(result)
    if comparison is not None and len(results) > 1:
        OUT.print(*comparison_tables(comparison, OUT.width))
        contradictions = repeats([result.configuration for result in results], comparison)
        print_lines(OUT, [repeat.finding for repeat in contradictions])
    print_lines(OUT, campaign_findings(results))
    print_changes(read_campaign(run.campaign), results)
    if results:
        print_results(OUT, run.output)
    require_none(failed, len(results) + len(failed))


def identify_campaign(
    run: Run, poles: Path | None = None
) -> tuple[tuple[Identified, ...], Comparison | None, tuple[Failed, ...]]:
    """Identify every configuration of a campaign, write each result as soon as it is there, and compare them.

    Configurations that an earlier run left are read back; one that cannot be identified does not end the others.

    With `poles`, the folder of earlier results, its poles.txt files take the place of the automatic choice, now and in
    every later command on these results.
    """
    campaign, output = read_campaign(run.campaign), run.output
    assigned = assignments(campaign, output, poles, keep=run.keep)
    outcomes = tuple(in_parallel(partial(attempted, _identify), assigned, "identify", run.console, run.cluster))
    results = tuple(outcome for outcome in outcomes if not isinstance(outcome, Failed))
    failed = tuple(outcome for outcome in outcomes if isinstance(outcome, Failed))
    if not results:
        return results, None, failed
    configurations = [result.configuration for result in results]
    comparison = compare([result.modal_model for result in results])
    write_result(output / "comparison.json", comparison, inputs=(campaign.path,), options={})
    for number, repeat in enumerate(repeats(configurations, comparison), start=1):
        write_result(output / f"repeats_{number}.json", repeat, inputs=(campaign.path,), options={})
    figure = comparison_figure(comparison, *abscissa(configurations))
    write_bytes(output / "comparison.png", as_png(figure))
    return results, comparison, failed


def _identify(assigned: Assignment) -> Identified:
    result = identified(assigned)
    _write_tables_and_pictures(result, keep_poles=assigned.poles is not None)
    levels = over_amplitude(assigned, result)
    if levels is not None:
        write_bytes(result.folder / "amplitude.png", as_png(amplitude_figure(levels.dependence)))
    return result


def _write_tables_and_pictures(result: Identified, *, keep_poles: bool) -> None:
    """Write what is made from a modal model, but not over the poles of the user that it was made from."""
    folder, modes = result.folder, result.modal_model
    is_drawn = bool(np.isin(modes.node, modes.geometry.node).any())
    last = folder / (f"shape_{modes.frequency.size:02d}.png" if is_drawn else "shapes.csv")
    if last.exists() and last.stat().st_mtime_ns >= (folder / "modal_model.json").stat().st_mtime_ns:
        return  # all of them are there, made from this model
    if modes.read_from:
        write_uff(folder / "modes.uff", modes.geometry, modal_model=modes)
    else:
        _write_functions(folder, modes, keep_poles=keep_poles)
    write_modes_csv(folder / "modes.csv", modes)
    write_shapes_csv(folder / "shapes.csv", modes)
    for r in range(modes.frequency.size if is_drawn else 0):
        write_bytes(folder / f"shape_{r + 1:02d}.png", as_png(shape_figure(modes, r)))


def _write_functions(folder: Path, modes: ModalModel, *, keep_poles: bool) -> None:
    """Write what is made of functions with their modes."""
    frf = read_frf(folder / "measurement.npz")
    write_bytes(folder / "frf.png", as_png(overlay_figure(frf, modes)))
    write_bytes(folder / "stabilization.png", as_png(stabilization_figure(stabilization(frf.band(*modes.band)))))
    write_modes_uff(folder / "modes.uff", modes, step=float(frf.frequency[1] - frf.frequency[0]))
    if not keep_poles or not (folder / "poles.txt").exists():
        write_poles(folder / "poles.txt", modes.pole)


def modes_table(measured: ModalModel, explained: ExplainedPower) -> Table:
    """List frequencies and damping ratios with standard deviations, and the power explained around them.

    Where a shape is too complex to be compared as real, a column has the MPC of all.
    """
    title = f"{measured.name}: {measured.frequency.size} modes in {measured.band[0]:g} to {measured.band[1]:g} Hz"
    title += f", read from {Path(measured.read_from).name}" if measured.read_from else ""
    complexities = complexity(measured)
    columns = ["mode", "f [Hz]", "std [Hz]", "damping [%]", "std [%]"]
    numbers = (measured.frequency, measured.frequency_std, measured.damping, measured.damping_std)
    rows = [
        [str(r + 1), frequency_text(f, 3), f"{f_std:.2g}", f"{100 * xi:.4g}", f"{100 * xi_std:.2g}"]
        for r, (f, f_std, xi, xi_std) in enumerate(zip(*numbers, strict=True))
    ]
    if not measured.read_from:
        columns += ["explained [%]", "least, channel"]
        shares = zip(explained.around, explained.share.T, strict=True)
        rows = [[*row, *_explained(*share, explained.channel)] for row, share in zip(rows, shares, strict=True)]
    if np.any(complexities.is_complex):
        columns.append("MPC")
        rows = [[*row, f"{mpc:.3f}"] for row, mpc in zip(rows, complexities.mpc, strict=True)]
    if not measured.read_from:
        of_all = ["all", "", "", "", "", *_explained(explained.mean, explained.whole, explained.channel)]
        rows.append([*of_all, *[""] * (len(columns) - len(of_all))])
    return Table(title, columns, rows)


def _explained(mean: float, share: Reals, channel: tuple[str, ...]) -> tuple[str, str]:
    """Share over all channels, %, and the least one with its channel; dashes where a band holds no line."""
    if np.isnan(share).any():
        return "-", "-"
    least = int(np.argmin(share))
    return f"{100 * mean:.1f}", f"{100 * share[least]:.0f}, {channel[least]}"


def comparison_tables(comparison: Comparison, width: int) -> Iterator[Table]:
    """List every mode, followed by its shape, over the configurations: frequency and damping.

    Modes that do not fit beside each other into `width` characters come in further tables: a column that is cut says
    nothing.
    """
    mode_column = 16  # characters of "12345.6  12.34" with its frame
    longest_name = 24  # characters on one line
    names = min(max(len(name) for name in comparison.name), longest_name)
    fit = max(1, (width - names - 4) // mode_column)
    title = "The same modes in all configurations: frequency [Hz], damping [%]"
    for first in range(0, comparison.frequency.shape[1], fit):
        frequency, damping = (x[:, first : first + fit] for x in (comparison.frequency, comparison.damping))
        rows = [
            [
                name,
                *("-" if np.isnan(f) else f"{frequency_text(f, 1)}  {100 * x:.2f}" for f, x in zip(*row, strict=True)),
            ]
            for name, *row in zip(comparison.name, frequency, damping, strict=True)
        ]
        header = ("", *(f"{frequency_text(f, 0)} Hz" for f in np.nanmean(frequency, axis=0)))
        yield Table("" if first else title, header, rows, narrowest=names, whole=True)


def print_amplitude(result: Identified) -> None:
    """Print a configuration's modes over amplitude, where it has several force levels."""
    over = stored_amplitude(result)
    if over is not None:
        OUT.print(amplitude_table(over.dependence))
        print_lines(OUT, over.findings)
    elif result.configuration.force_levels:
        OUT.print(f"  {result.configuration.name}: with its own force_N, its modes over amplitude would be shown")


def amplitude_table(dependence: AmplitudeDependence) -> Table:
    """List every mode that two levels have over the force: motion, frequency and damping."""
    shown = np.flatnonzero(np.isfinite(dependence.softening))
    columns = [values[:, shown] for values in (dependence.motion, dependence.frequency, dependence.damping)]
    return Table(
        f"{dependence.name} over amplitude: motion at {dependence.point} [µm], frequency [Hz], damping [%]",
        ("force [N]", *(f"{frequency_text(f, 0)} Hz" for f in np.nanmean(columns[1], axis=0))),
        [
            [
                f"{force:g}",
                *(
                    f"{1e6 * x:.3g}  {frequency_text(f, 2)}  {100 * d:.3g}" if np.isfinite(f) else "-"
                    for x, f, d in zip(*row, strict=True)
                ),
            ]
            for force, *row in zip(dependence.force, *columns, strict=True)
        ],
    )


def print_changes(campaign: Campaign, results: Sequence[Identified]) -> None:
    """Compare configurations with their references, print what changed, and write it beside their modes."""
    changes, lost = compared(campaign, results)
    for change in changes:
        OUT.print(change_table(change))
        OUT.print(f"  {change_sentence(change)}")
    print_lines(OUT, lost)


@single_threaded
def pick_command(campaign: Path, configuration: str, output: Path) -> None:
    """Let the user choose the poles of one configuration, and say where they are."""
    OUT.print(f"Poles: {choose_poles(campaign, configuration, output)}")


def choose_poles(campaign_file: Path, configuration: str, output: Path) -> Path:
    """Let the user choose the poles of one configuration in its stabilisation chart and write poles.txt."""
    campaign = read_campaign(campaign_file)
    frf = read_measurement(campaign, configuration).frf
    options = campaign.identification
    lines = frf if options.band is None else frf.band(*options.band)
    diagram = stabilization(lines) if options.order is None else stabilization(lines, order=options.order)
    chosen = pick_poles(diagram)
    path = output / folder_name(configuration) / "poles.txt"
    write_poles(path, chosen)
    keep_choice(path, path.parent)
    return path
