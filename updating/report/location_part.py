"""Where the model fails: the error in constitutive relation on the stack, and what it can and cannot say."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.plot import palette
from model import catalogue
from model.stack.effect import Family
from updating.correlation.localization import ENERGY_KINDS, ErrorMap, map_error, regions, stiffness_index
from updating.correlation.plots import LEAST_SCALE, error_map_picture
from updating.correlation.registration import register
from updating.diagnosis.answer import Diagnosis
from updating.fitting.fit import Fit, reduced_about
from updating.report.chart import Chart, single
from updating.report.part import Picture, Section, as_csv, fewer_colours
from updating.report.results import Tested
from updating.results.text import Table

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


def map_picture(tested: Tested, fit: Fit, errors: ErrorMap, kind: str) -> Picture:
    """Draw the error of one kind of stiffness on the stack."""
    edges = errors.regions.x, errors.regions.y, errors.regions.z
    centre = np.meshgrid(*((e[1:] + e[:-1]) / 2.0 for e in edges), indexing="ij")
    columns = [*(c.ravel() for c in centre), *(value.ravel() for value in errors.relative)]
    return Picture(
        name=f"error_map_{tested.name}",
        content=fewer_colours(error_map_picture(errors, fit.stack, kind)),
        form="png",
        data=as_csv(
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


def _surface(
    x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the outside of a block of boxes: corners (n, 3), triangles (m, 3), and the box of each triangle (m,)."""
    edges = (x, y, z)
    shape = tuple(e.size - 1 for e in edges)
    box = np.arange(np.prod(shape)).reshape(shape)
    corners: list[NDArray[np.float64]] = []
    boxes: list[NDArray[np.int64]] = []
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
