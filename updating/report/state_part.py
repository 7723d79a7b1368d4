"""A changed state beside its reference: shifts of modes, MAC, CoMAC, functions and shapes over each other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from ema import Change, change_csv, change_sentence
from ema.modal.change import KINDS, STATED_FREEDOM
from ema.plot import palette
from ema.types.frf import FRF
from ema.types.modal_model import ModalModel, frequency_text
from updating.correlation.plots import within_band
from updating.fitting.plots import ShapePair, beside_shape
from updating.report.chart import Chart, axis, charted, printed, single
from updating.report.frf_part import CHANGED, REFERENCE, frf_chart
from updating.report.modes_part import gallery_of, mac_picture
from updating.report.part import Gallery, Picture, Section, as_csv, png, svg
from updating.report.results import Tested
from updating.results.text import Table, uncertain

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def state_section(change: Change) -> Section:
    """Show what differs between a configuration and its reference."""
    pictures = (shift_picture(change), states_picture(change), comac_picture(change)) if change.mode.size else ()
    return Section(
        title=f"{change.name} against {', '.join(change.reference)}",
        text=(f"{change_sentence(change)}.",),
        blocks=(change_table(change), *pictures),
    )


def change_table(change: Change) -> Table:
    """List the modes of both states side by side."""
    f_half, d_half = half_intervals(change)
    angle = np.where(np.isnan(change.angle), "", [f"{a:.1f}" for a in np.rad2deg(change.angle)])
    return Table(
        title="Modes of the reference and of the changed state",
        header=(
            "mode", "f reference [Hz]", "f [Hz]", "shift [%]", "damping reference [%]", "damping [%]", "shift [%]",
            "MAC", "angle of shapes [°]", "changed",
        ),
        rows=tuple(
            (
                str(change.reference_mode[r] + 1), f"{change.reference_frequency[r]:.2f}", f"{change.frequency[r]:.2f}",
                uncertain(100 * np.expm1(change.frequency_shift[r]), 100 * f_half[r]),
                f"{100 * change.reference_damping[r]:.3g}", f"{100 * change.damping[r]:.3g}",
                uncertain(100 * np.expm1(change.damping_shift[r]), 100 * d_half[r]),
                f"{change.mac[r]:.3f}", str(angle[r]),
                ", ".join(name for name, changed in zip(KINDS, change.which[r], strict=True) if changed),
            )
            for r in range(change.mode.size)
        ),
        note="± is half of the interval in which the shift of one mode of an unchanged structure lies in 95 of 100 "
        "cases, by what assemblies scatter and what noise leaves. Changed: what all tests together call changed, with "
        f"at most {100 * change.level:g} % false alarms.",
    )  # fmt: skip


def half_intervals(change: Change) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return half of the 95 % intervals of the shifts of an unchanged structure, frequency and damping, (n_mode,)."""
    factor = -scipy.special.stdtrit(STATED_FREEDOM + change.freedom, 0.025)
    return factor * change.frequency_scatter, factor * change.damping_scatter


def shift_picture(change: Change) -> Picture:
    """Draw the shift of every frequency with what it scatters by."""
    shift = np.expm1(change.frequency_shift)
    return charted(
        f"change_{change.name}",
        shift_chart(change),
        change_csv(change),
        alt="Shifts of the frequencies: "
        + ", ".join(f"mode {r + 1} {100 * s:+.2g} %" for r, s in zip(change.reference_mode, shift, strict=True)),
        caption="Shift of each frequency against the reference. The bars are the interval in which an unchanged "
        "structure lies in 95 of 100 cases; modes that changed are in red.",
        width="half",
    )


def shift_chart(change: Change) -> Chart:
    """Return the shift of every frequency with what it scatters by as a chart."""
    shift, (half, _) = np.expm1(change.frequency_shift), half_intervals(change)
    traces = [
        {
            "type": "scatter", "mode": "markers", "name": name, "x": np.array(_labels(change))[which].tolist(),
            "y": single(100 * shift[which]), "marker": {"color": color, "size": 9},
            "error_y": {"type": "data", "array": single(100 * half[which])},
        }
        for which, name, color in (
            (~change.which[:, 0], "within the scatter", palette.QUIET), (change.which[:, 0], "changed", palette.ACCENT),
        )
    ]  # fmt: skip
    kind = {"type": "category", "categoryorder": "array", "categoryarray": _labels(change)}
    return Chart(
        traces=traces,
        layout={
            "xaxis": axis("mode, frequency of the reference [Hz]", **kind),
            "yaxis": axis("shift of the frequency [%]", zeroline=True),
        },
    )


def states_picture(change: Change) -> Picture:
    """Draw the MAC of the reference's modes with those of the state."""
    rows, columns = change.matrix_row, change.matrix_column
    return mac_picture(
        f"change_mac_{change.name}",
        change.mac_matrix,
        (rows, columns),
        (change.reference[0], change.name),
        alt="MAC matrix of the reference's and the state's modes",
        caption=f"MAC of the modes of {change.reference[0]} (rows) with those of {change.name}: 1 "
        "where two shapes are alike, 0 where they share nothing.",
    )


def comac_picture(change: Change) -> Picture:
    """Draw 1 - CoMAC of the matched modes over the measured points."""
    return Picture(
        name=f"change_comac_{change.name}",
        content=svg(comac_figure(change)),
        form="svg",
        data=as_csv(
            ("point", "direction x", "direction y", "direction z", "x [m]", "y [m]", "z [m]", "CoMAC"),
            ((n, *d, *p, c) for n, d, p, c in zip(change.node.tolist(), change.direction, change.location, change.comac,
                                                  strict=True)),
        ),
        alt="1 - CoMAC over the measured points",
        caption="1 - CoMAC of the matched modes at every point, 0 where shapes agree. It is large where shapes "
        "changed, and where they are small: it hints at a place, and is no proof of one.",
        width="half",
    )  # fmt: skip


def comac_figure(change: Change) -> Figure:
    """Draw 1 - CoMAC as discs over the two axes along which the points extend most."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.0, 3.6), layout="constrained")
    axes = figure.subplots()
    known = np.all(np.isfinite(change.location), axis=1)
    place, value = 1e3 * change.location[known], 1.0 - change.comac[known]
    if not known.any():
        axes.bar(np.arange(change.node.size), 1.0 - change.comac, color=palette.ACCENT)
        axes.set(xlabel="point, in the order of the measurement", ylabel="1 - CoMAC")
        return figure
    first, second = np.sort(np.argsort(-np.ptp(place, axis=0), kind="stable")[:2])
    largest = max(float(value.max()), 1e-12)
    discs = axes.scatter(
        place[:, first], place[:, second], c=value, s=20.0 + 160.0 * value / largest, cmap=palette.CHANGE, vmin=0.0,
        edgecolors=palette.QUIET, linewidths=0.5,
    )  # fmt: skip
    if np.ptp(place[:, second]) > 0.2 * np.ptp(place[:, first]):
        axes.set_aspect("equal")
    axes.set(xlabel=f"{'xyz'[first]} [mm]", ylabel=f"{'xyz'[second]} [mm]")
    figure.colorbar(discs, label="1 - CoMAC")
    return figure


def _labels(change: Change) -> list[str]:
    return [
        f"{r + 1}: {frequency_text(f, 1)}"
        for r, f in zip(change.reference_mode, change.reference_frequency, strict=True)
    ]


Vector = NDArray[np.float64]


def beside_section(tested: Tested, change: Change, reference: Tested) -> Section:
    """Show functions and shapes of a state over those of its reference.

    Parameters
    ----------
    tested : Tested
        The state.
    change : Change
        What differs, and which modes are the same.
    reference : Tested
        The first configuration of its reference.
    """
    title = f"{tested.name} beside {reference.name}"
    here, there = tested.measured, reference.measured
    if not (np.array_equal(here.node, there.node) and np.allclose(here.direction, there.direction)):
        return Section(title=title, text=("They were measured at other points: shapes are not laid over each other.",))
    functions = functions_picture(tested, reference)
    shapes = shapes_beside(tested, change, reference)
    return Section(title=title, blocks=tuple(block for block in (functions, shapes) if block is not None))


def shape_pairs_beside(measured: ModalModel, change: Change, reference: ModalModel) -> tuple[ShapePair, ...]:
    """Return the shape of every mode that both states have, with that of the reference."""
    return tuple(
        beside_shape(
            measured, int(r), (float(reference.frequency[q]), float(change.mac[k]), reference.shape[:, int(q)].real)
        )
        for k, (r, q) in enumerate(zip(change.mode, change.reference_mode, strict=True))
    )


def shapes_beside(tested: Tested, change: Change, reference: Tested) -> Gallery | None:
    """Return the shapes that turn and move; None without a mode that both have, or without coordinates."""
    measured = tested.measured
    if not change.mode.size or not np.isin(measured.node, measured.geometry.node).any():
        return None
    pairs = shape_pairs_beside(measured, change, reference.measured)
    return gallery_of(f"{tested.name}_beside", pairs, None, names=(tested.name, reference.name))


def common_lines(tested: Tested, reference: Tested) -> tuple[FRF, NDArray[np.complex128]] | None:
    """Return the functions of a state within its band and the reference's there; None where lines differ."""
    if not (tested.has_functions and reference.has_functions):
        return None
    lines, before = (within_band(state.frf(), tested.measured) for state in (tested, reference))
    if lines.frequency.shape != before.frequency.shape or not np.allclose(lines.frequency, before.frequency):
        return None
    if lines.value.shape != before.value.shape or not np.array_equal(lines.output.node, before.output.node):
        return None
    return lines, before.value[:, 0]


def functions_picture(tested: Tested, reference: Tested) -> Picture | None:
    """Draw every function of both states; None where they have not the same lines."""
    common = common_lines(tested, reference)
    if common is None:
        return None
    lines, before = common
    curves = {CHANGED: lines.value[:, 0], REFERENCE: before}
    order = range(lines.output.node.size)
    mean = {tested.name: _mean(curves[CHANGED]), reference.name: _mean(before)}
    return Picture(
        name=f"beside_{tested.name}",
        content=png(printed(_mean_chart(lines.frequency, mean), (7.0, 3.4))),
        form="png",
        data=as_csv(("frequency [Hz]", *mean), zip(lines.frequency, *mean.values(), strict=True)),
        alt=f"Functions of {tested.name} over those of {reference.name}",
        caption=f"Functions of {tested.name} (changed) over those of {reference.name} (reference), each by itself; a "
        "print shows the root mean square of all.",
        chart=frf_chart(tested.measured, lines, curves, list(order)),
        choices=tuple(f"{lines.output.name(o)} over {lines.input.name(0)}" for o in order),
    )


def mean_chart(tested: Tested, reference: Tested) -> Chart | None:
    """Return the root mean square of all functions of both states as a chart; None where lines differ."""
    common = common_lines(tested, reference)
    if common is None:
        return None
    lines, before = common
    return _mean_chart(lines.frequency, {tested.name: _mean(lines.value[:, 0]), reference.name: _mean(before)})


def _mean(functions: NDArray[np.complex128]) -> Vector:
    return np.sqrt(np.mean(np.abs(functions) ** 2, axis=0))


def _mean_chart(frequency: Vector, mean: Mapping[str, Vector]) -> Chart:
    traces = [
        {
            "type": "scatter", "mode": "lines", "name": name, "x": single(frequency), "y": single(value),
            "line": {"color": color},
        }
        for (name, value), color in zip(mean.items(), (palette.MEASURED, palette.BASE), strict=True)
    ]  # fmt: skip
    return Chart(
        traces=traces,
        layout={
            "xaxis": axis("frequency [Hz]"),
            "yaxis": axis("root mean square of all functions", type="log", exponentformat="power"),
        },
    )
