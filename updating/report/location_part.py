"""Where the model fails: the error in constitutive relation on the stack, and what it can and cannot say."""

from __future__ import annotations

import numpy as np

from model import reduce
from updating.correlation.correlation_plot import error_map_picture
from updating.correlation.energy import KINDS, regions
from updating.correlation.localization import ErrorMap, map_error
from updating.correlation.registration import register
from updating.fitting.fit import Fit
from updating.report.part import Picture, Section, Table, as_csv, fewer_colours
from updating.report.results import Tested

_MOST_MODES = 6  # the lowest half a dozen locate best
_NOTHING = 2e-3
"""Relative stiffness error, twice the 0.1 % of a frequency that no model meets, below which nothing is located."""
_LOCAL = 0.1
"""Contrast above which an error counts as local: five times that of a kind that is wrong everywhere, half that of a
soft zone (see `updating.correlation.localization`)."""
_EXPLAINED = 0.9
"""Share that a common change explains where it is what is wrong (0.96 to 1 in simulated stacks) and not mass (0.85)."""
_LIMITS = (
    "The map says where, never which effect it is: missing mass lights up like wrong stiffness. Points on the outside "
    "do not show how deep a fault lies, and a region that no measured mode strains stays pale."
)


def location_section(tested: Tested, fit: Fit) -> Section:
    """Show the error map of a fit, if there is an error to locate."""
    found = error_map(tested, fit)
    kind = most_likely_kind(found)
    size = float(np.sqrt(found.total.mean()))
    title = f"Where the model of {tested.name} fails"
    if size < _NOTHING:
        text = (
            f"Nothing to locate: the shapes and frequencies of {found.frequency.size} modes ask for a change of "
            f"stiffness by {100 * size:.2g} % in the mean, less than the {100 * _NOTHING:g} % that no model meets."
        )
        return Section(title=title, text=(text,))
    return Section(
        title=title,
        text=(_sentence(found, kind, size), _LIMITS),
        blocks=(map_picture(tested, fit, found, kind), kind_table(found)),
    )


def error_map(tested: Tested, fit: Fit) -> ErrorMap:
    """Map the error of the fitted model against the lowest paired modes."""
    value = fit.G_f.value
    system = reduce(fit.stack, G_f_range=(value, 1.01 * value), n_snapshot=1)
    measured = tested.measured
    registration = register(fit.stack, measured.geometry, measured.node, measured.direction)
    return map_error(
        system,
        measured,
        registration.observation,
        regions(fit.stack),
        G_f=value,
        modes=fit.pairing.measured[:_MOST_MODES],
    )


def most_likely_kind(found: ErrorMap) -> str:
    """Return the kind of stiffness that explains most of the error with a change that can be."""
    possible = np.abs(found.change[:-1]) < 1.0
    return KINDS[int(np.argmax(np.where(possible, found.explained[:-1], -1.0)))]


def map_picture(tested: Tested, fit: Fit, found: ErrorMap, kind: str) -> Picture:
    """Draw the error of one kind of stiffness on the stack."""
    edges = found.regions.x, found.regions.y, found.regions.z
    centre = np.meshgrid(*((e[1:] + e[:-1]) / 2.0 for e in edges), indexing="ij")
    columns = [*(c.ravel() for c in centre), *(value.ravel() for value in found.relative)]
    return Picture(
        name=f"error_map_{tested.name}",
        content=fewer_colours(error_map_picture(found, fit.stack, kind)),
        form="png",
        data=as_csv(
            ("x [m]", "y [m]", "z [m]", *(f"{k}: error over its mean" for k in KINDS[:-1])),
            zip(*columns, strict=True),
        ),
        alt="Error over the stack",
        caption=f"Error of the {kind} by region over its mean, for the energy with which the modes strain the region. "
        "One colour throughout means wrong everywhere alike. Rods: clamps.",
    )


def kind_table(found: ErrorMap) -> Table:
    """List what each kind of stiffness, and the mass, would explain."""
    return Table(
        title="What a common change of one kind would explain",
        header=("kind", "explained [%]", "by a change of [%]", "contrast of its map"),
        rows=tuple(
            (
                kind,
                f"{100 * found.explained[i]:.0f}",
                f"{100 * found.change[i]:+.3g}",
                "" if kind == "mass" else f"{found.contrast[i]:.2f}",
            )
            for i, kind in enumerate(KINDS)
        ),
        note="Shares overlap: less stiffness and more mass look alike. A change far beyond 100 % cannot be. Contrast: "
        "0 where the error is spread as the strain energy, towards 1 where it sits in one place.",
    )


def _sentence(found: ErrorMap, kind: str, size: float) -> str:
    i = KINDS.index(kind)
    low, high = found.peak(kind)
    text = (
        f"The shapes and frequencies of {found.frequency.size} modes ask for a change of stiffness by about "
        f"{100 * size:.2g} %. "
        + (
            "A change of one kind of stiffness throughout does not explain that; the best that can be, "
            if found.explained[i] < _EXPLAINED
            else "Best explained is that by a common change: "
        )
        + f"the {kind} by {100 * found.change[i]:+.2g} %, explains {100 * found.explained[i]:.0f} % of it."
    )
    if found.contrast[i] < _LOCAL:
        return f"{text} Its error is spread over the stack as the strain energy is; no one place stands out."
    return (
        f"{text} Its error is largest between x = {1e3 * low[0]:.0f} and {1e3 * high[0]:.0f} mm, "
        f"y = {1e3 * low[1]:.0f} and {1e3 * high[1]:.0f} mm, z = {1e3 * low[2]:.0f} and {1e3 * high[2]:.0f} mm."
    )
