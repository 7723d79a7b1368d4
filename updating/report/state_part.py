"""A changed state beside its reference, and where on the stack the model fails."""

from __future__ import annotations

from contextlib import closing
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from ema import Change, change_csv, change_sentence
from ema.plot import palette
from ema.plot.figures import within_band
from ema.types.frf import FRF
from ema.types.modal_model import ModalModel, frequency_text
from lamella_shared import Complexes, Integers, Reals, csv_text
from model import Stack, catalogue
from model.stack.effect import Family
from updating.correlation.localization import ENERGY_KINDS, ErrorMap, map_error, regions, stiffness_index
from updating.correlation.registration import register
from updating.diagnosis.answer import Diagnosis
from updating.fitting.fit import Fit, reduced_about
from updating.fitting.plots import ShapePair, beside_shape
from updating.report.frf_part import CHANGED, REFERENCE, frf_chart
from updating.report.modes_part import gallery_of, mac_picture
from updating.report.part import (
    Chart,
    Gallery,
    Picture,
    Section,
    axis,
    charted,
    fewer_colours,
    png,
    printed,
    single,
    svg,
)
from updating.report.results import Tested
from updating.results.campaign import change_table, half_intervals
from updating.results.text import Table

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


def shift_picture(change: Change) -> Picture:
    """Draw the shift of every frequency with what it scatters by."""
    shift = np.expm1(change.frequency_shift)
    return charted(
        f"change_{change.name}",
        shift_chart(change),
        data=change_csv(change),
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
        data=csv_text(
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


def common_lines(tested: Tested, reference: Tested) -> tuple[FRF, Complexes] | None:
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
    mean = mean_chart(tested, reference, common)
    return Picture(
        name=f"beside_{tested.name}",
        content=png(printed(mean, (7.0, 3.4))),
        form="png",
        data=mean.csv,
        alt=f"Functions of {tested.name} over those of {reference.name}",
        caption=f"Functions of {tested.name} (changed) over those of {reference.name} (reference), each by itself; a "
        "print shows the root mean square of all.",
        chart=frf_chart(tested.measured, lines, curves, list(order)),
        choices=tuple(f"{lines.output.name(o)} over {lines.input.name(0)}" for o in order),
    )


def mean_chart(tested: Tested, reference: Tested, common: tuple[FRF, Complexes]) -> Chart:
    """Return the root mean square of all functions of both states, as `common_lines` has these, as a chart."""
    lines, before = common
    shown = ((tested.name, lines.value[:, 0], palette.MEASURED), (reference.name, before, palette.BASE))
    traces = [
        {
            "type": "scatter", "mode": "lines", "name": name, "x": single(lines.frequency),
            "y": single(np.sqrt(np.mean(np.abs(functions) ** 2, axis=0))), "line": {"color": color},
        }
        for name, functions, color in shown
    ]  # fmt: skip
    return Chart(
        traces=traces,
        layout={
            "xaxis": axis("frequency [Hz]"),
            "yaxis": axis("root mean square of all functions", type="log", exponentformat="power"),
        },
    )


_KIND_OF_FAMILY: dict[Family, str] = {
    "pressure field": "tangential contact",
    "contact law": "tangential contact",
    "treatments": "tangential contact",
    "steel": "lamina membrane",
}
"""What effects of a family change; masses and supports are no stiffness of the stack."""
_NOTHING = 2e-3
"""Relative stiffness error, twice the 0.1 % of a frequency that no model meets, below which nothing is located."""
_LOCAL = 0.1
"""Contrast above which an error counts as local: five times that of a kind that is wrong everywhere, half that of a
soft zone (see `updating.correlation.localization`)."""
_LIMITS = (
    "The map says where, never which effect it is: missing mass lights up like wrong stiffness. Points on the outside "
    "do not show how deep a fault lies, and a region that no measured mode strains stays pale."
)


def kind_of_answer(diagnosis: Diagnosis | None) -> str | None:
    """Return the kind of stiffness that the first effect of an answer changes; None where it is not one kind."""
    known = catalogue()
    effects = [known[e] for e in (diagnosis.set[0] if diagnosis is not None and diagnosis.set else ()) if e in known]
    return _KIND_OF_FAMILY.get(effects[0].family) if effects else None


def location_section(tested: Tested, fit: Fit, shown: str | None = None) -> Section:
    """Show where a fit fails, if there is an error to locate, in one kind of stiffness: by default the likeliest."""
    errors = error_map(tested, fit)
    title, text = f"Where the base model of {tested.name} fails", location_text(errors)
    if _size(errors) < _NOTHING:
        return Section(title=title, text=(text,))
    kind = most_likely_kind(errors)
    return Section(
        title=title, text=(text, _LIMITS), blocks=(map_picture(tested, fit, errors, shown or kind), kind_table(errors))
    )


def location_text(errors: ErrorMap) -> str:
    """Say how much of an error there is, which kind of stiffness is the likeliest, and where."""
    size = _size(errors)
    if size < _NOTHING:
        return (
            f"Nothing to locate: the shapes and frequencies of {errors.frequency.size} modes ask for a change of "
            f"stiffness by {100 * size:.2g} % in the mean, less than the {100 * _NOTHING:g} % that no model meets."
        )
    return _sentence(errors, most_likely_kind(errors), size)


def _size(errors: ErrorMap) -> float:
    return float(np.sqrt(errors.total.mean()))


def error_map(tested: Tested, fit: Fit) -> ErrorMap:
    """Map the error of the fitted model against the lowest paired modes."""
    most_modes = 6  # the lowest half a dozen locate best
    system = reduced_about(fit.stack, 6 + fit.modes.frequency.size)
    measured = tested.measured
    registration = register(fit.stack, measured.geometry, measured.node, measured.direction)
    return map_error(
        system,
        measured,
        registration.observation,
        regions(fit.stack),
        G_f=fit.G_f.value,
        modes=fit.pairing.measured[:most_modes],
    )


def most_likely_kind(errors: ErrorMap) -> str:
    """Return the kind of stiffness that explains most of the error by a change that is possible, below 100 %."""
    possible = np.abs(errors.change[:-1]) < 1.0
    return ENERGY_KINDS[int(np.argmax(np.where(possible, errors.explained[:-1], -1.0)))]


_SCALAR_BAR = {
    "color": "black",
    "n_labels": 3,
    "fmt": "%.2g",
    "height": 0.13,
    "width": 0.5,
    "position_x": 0.25,
    "position_y": 0.03,
    "title_font_size": 15,
    "label_font_size": 13,
}

LEAST_SCALE = 2.0
"""End of a flat map's colour scale over its mean, so that it looks flat."""


def error_map_picture(error_map: ErrorMap, stack: Stack, kind: str, *, size: tuple[int, int] = (1200, 460)) -> bytes:
    """Draw the error of one kind of stiffness on the stack, `ErrorMap.relative`, as a PNG.

    The stack is seen from two opposite corners, its clamps as rods.

    Parameters
    ----------
    error_map : ErrorMap
        Of the stack.
    stack : Stack
        The stack.
    kind : str
        One of `ENERGY_KINDS` but the mass.
    size : tuple of int
        Width and height of the picture, px.
    """
    views = {"front, from above": (-0.5, -1.0, 0.6), "back, from below": (0.5, 1.0, -0.6)}
    label, where = "error over its mean", error_map.regions
    value = error_map.relative[stiffness_index(kind)]
    import pyvista as pv
    from PIL import Image

    grid: Any = pv.RectilinearGrid(where.x, where.y, where.z)
    grid.cell_data[label] = value.ravel(order="F")
    with pv.vtk_verbosity("off"):  # VTK warns when there is no display, though it then renders without one
        plotter: Any = pv.Plotter(shape=(1, 2), off_screen=True, window_size=list(size), border=False)
    plotter.set_background("white")
    for column, (view, direction) in enumerate(views.items()):
        plotter.subplot(0, column)
        plotter.add_mesh(
            grid,
            scalars=label,
            clim=(0.0, max(float(value.max()), LEAST_SCALE * float(value.mean()))),
            cmap=palette.PLACE,
            lighting=False,  # shadows would read as large values
            show_edges=True,
            edge_color=palette.QUIET,
            show_scalar_bar=column == 0,
            scalar_bar_args={"title": f"{label}\n", **_SCALAR_BAR},  # the empty line keeps it off the numbers
        )
        for clamp in stack.clamps:
            ends = np.array([[clamp.x, clamp.y, sign * 0.8 * stack.height] for sign in (-1.0, 1.0)])
            plotter.add_mesh(pv.lines_from_points(ends), color=palette.MODES, line_width=4)
        # one line, for VTK's touch each other, and at a place, for in a corner long text is smaller than short
        heading = f"{kind}: {view}" if column == 0 else view
        plotter.add_text(heading, position=(8.0, size[1] - 30.0), font_size=10, color=palette.INK)
        plotter.add_axes(color=palette.INK, viewport=(0.8, 0.0, 1.0, 0.3))
        plotter.view_vector(direction, viewup=(0.0, 0.0, 1.0))
        plotter.camera.zoom(1.3)
    with closing(plotter):
        image = plotter.screenshot(return_img=True)
    buffer = BytesIO()
    Image.fromarray(image).save(buffer, format="png", optimize=True)
    return buffer.getvalue()


def map_picture(tested: Tested, fit: Fit, errors: ErrorMap, kind: str) -> Picture:
    """Draw the error of one kind of stiffness on the stack."""
    edges = errors.regions.x, errors.regions.y, errors.regions.z
    centre = np.meshgrid(*((e[1:] + e[:-1]) / 2.0 for e in edges), indexing="ij")
    columns = [*(c.ravel() for c in centre), *(value.ravel() for value in errors.relative)]
    return Picture(
        name=f"error_map_{tested.name}",
        content=fewer_colours(error_map_picture(errors, fit.stack, kind)),
        form="png",
        data=csv_text(
            ("x [m]", "y [m]", "z [m]", *(f"{k}: error over its mean" for k in ENERGY_KINDS[:-1])),
            zip(*columns, strict=True),
        ),
        alt="Error over the stack",
        caption=f"Where the base model of {tested.name} fails: error of the {kind} by region over its mean, for the "
        f"energy with which the modes strain the region.{_peak(errors, kind)} Rods: clamps.",
        width="half",
        chart=map_chart(tested, fit, errors, kind).json,
    )


def _peak(errors: ErrorMap, kind: str) -> str:
    """Say where the error of a kind is largest, or that it is spread over the stack."""
    if errors.contrast[ENERGY_KINDS.index(kind)] < _LOCAL:
        return " It is spread as the strain energy is; no one place stands out."
    low, high = errors.peak(kind)
    return f" Largest between x = {round(1e3 * low[0])} and {round(1e3 * high[0])} mm."


def map_chart(tested: Tested, fit: Fit, errors: ErrorMap, kind: str) -> Chart:
    """Return the error of one kind of stiffness on the stack, to be turned, with the clamps and the measured points."""
    corner, triangle, box = _surface(errors.regions.x, errors.regions.y, errors.regions.z)
    value = errors.relative[stiffness_index(kind)].ravel()
    geometry, stack = tested.measured.geometry, fit.stack
    seen = np.isin(geometry.node, tested.measured.node)
    mm = 1e3 * corner
    ends = np.array([[[c.x, c.y, s * 0.8 * stack.height] for s in (-1.0, 1.0)] for c in stack.clamps])
    rods = 1e3 * np.insert(ends.reshape(-1, 2, 3), 2, np.nan, axis=1).reshape(-1, 3)
    points = 1e3 * geometry.coordinate[seen]
    traces = [
        {
            "type": "mesh3d", "x": single(mm[:, 0]), "y": single(mm[:, 1]), "z": single(mm[:, 2]),
            "i": triangle[:, 0], "j": triangle[:, 1], "k": triangle[:, 2], "intensity": single(value[box]),
            "intensitymode": "cell", "colorscale": palette.PLACE, "cmin": 0.0, "flatshading": True,
            "cmax": max(float(value.max()), LEAST_SCALE * float(value.mean())),
            "lighting": {"ambient": 1.0, "diffuse": 0.0, "specular": 0.0}, "hoverinfo": "skip",
            "colorbar": {
                "title": {"text": "error over its mean", "side": "bottom"}, "orientation": "h", "thickness": 10,
                "len": 0.7, "y": -0.02, "yanchor": "bottom",
            },
        },
        {
            "type": "scatter3d", "mode": "lines", "name": "clamps", "hoverinfo": "name", "showlegend": False,
            **dict(zip("xyz", (single(x) for x in rods.T), strict=True)), "line": {"color": palette.MODES, "width": 6},
        },
        {
            "type": "scatter3d", "mode": "markers", "name": "point", "showlegend": False,
            **dict(zip("xyz", (single(x) for x in points.T), strict=True)),
            "text": [str(n) for n in geometry.node[seen]],
            "marker": {"size": 3, "color": palette.MEASURED}, "hovertemplate": "point %{text}<extra></extra>",
        },
    ]  # fmt: skip
    axes = {
        f"{a}axis": {"title": {"text": f"{a} [mm]"}, "nticks": n, "showspikes": False}
        for a, n in (("x", 4), ("y", 2), ("z", 3))  # few along the short sides, where numbers would overlap
    }
    view = {"eye": {"x": -1.45, "y": -3.2, "z": 1.55}, "center": {"x": -0.15, "y": 0.0, "z": -0.1}}
    scene = {**axes, "aspectmode": "data", "camera": view, "dragmode": "turntable"}
    return Chart(traces=traces, layout={"scene": scene, "margin": {"l": 0, "r": 0, "t": 0, "b": 0}})


def _surface(x: Reals, y: Reals, z: Reals) -> tuple[Reals, Integers, Integers]:
    """Return the outside of a block of boxes: corners (n, 3), triangles (m, 3), and the box of each triangle (m,)."""
    edges = (x, y, z)
    shape = tuple(e.size - 1 for e in edges)
    box = np.arange(np.prod(shape)).reshape(shape)
    corners: list[Reals] = []
    boxes: list[Integers] = []
    for a in range(3):
        b, c = (k for k in range(3) if k != a)
        for side in (0, -1):
            face = np.take(box, side, axis=a)
            for j, k in np.ndindex(face.shape):
                quad = np.empty((4, 3))
                quad[:, a] = edges[a][side]
                quad[:, b] = edges[b][[j, j + 1, j + 1, j]]
                quad[:, c] = edges[c][[k, k, k + 1, k + 1]]
                corners.append(quad)
                boxes.append(np.full(2, face[j, k]))
    first = 4 * np.arange(len(corners))[:, None]
    triangle = np.stack([first + np.array(half) for half in ((0, 1, 2), (0, 2, 3))], axis=1).reshape(-1, 3)
    return np.concatenate(corners), triangle, np.concatenate(boxes)


def kind_table(errors: ErrorMap) -> Table:
    """List what each kind of stiffness, and the mass, would explain."""
    return Table(
        title="What a common change of one kind would explain",
        header=("kind", "explained [%]", "by a change of [%]", "contrast of its map"),
        rows=tuple(
            (
                kind,
                f"{100 * errors.explained[i]:.0f}",
                f"{100 * errors.change[i]:+.3g}" if abs(errors.change[i]) <= 1.0 else "more than 100",
                "" if kind == "mass" else f"{errors.contrast[i]:.2f}",
            )
            for i, kind in enumerate(ENERGY_KINDS)
        ),
        note="Shares overlap: less stiffness and more mass look alike. A change of more than 100 % cannot be. "
        "Contrast: 0 where the error is spread as the strain energy, towards 1 where it sits in one place.",
    )


def _sentence(errors: ErrorMap, kind: str, size: float) -> str:
    # Share that a common change explains where it is what is wrong (0.96 to 1 in simulated stacks) and not mass
    # (0.85).
    explained = 0.9
    i = ENERGY_KINDS.index(kind)
    low, high = errors.peak(kind)
    text = (
        f"The shapes and frequencies of {errors.frequency.size} modes ask for a change of stiffness by about "
        f"{100 * size:.2g} %. "
        + (
            "A change of one kind of stiffness throughout does not explain that; the best that can be, "
            if errors.explained[i] < explained
            else "Best explained is that by a common change: "
        )
        + f"the {kind} by {100 * errors.change[i]:+.2g} %, explains {100 * errors.explained[i]:.0f} % of it."
    )
    if errors.contrast[i] < _LOCAL:
        return f"{text} Its error is spread over the stack as the strain energy is; no one place stands out."
    places = (f"{a} = {round(1e3 * lo)} and {round(1e3 * hi)} mm" for a, lo, hi in zip("xyz", low, high, strict=True))
    return f"{text} Its error is largest between {', '.join(places)}."
