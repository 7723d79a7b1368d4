"""Parameters over the torques, with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ema.plot import palette
from updating.diagnosis.answer_parts import Moved
from updating.diagnosis.matrices_answer import MatricesFit
from updating.fitting.estimate import ParameterEstimate
from updating.fitting.fit import Estimate
from updating.report.ledger_part import model_name
from updating.report.part import Picture, Section, Table, as_csv, svg
from updating.report.results import Results, Tested
from updating.results.text import Z95, ends

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_AXES = {"G_f": ("$G_f$ [Pa/Pa]", 1.0), "d_f": ("$d_f$ [10$^{-12}$ s/Pa]", 1e12)}


def parameter_section(results: Results) -> Section:
    """Show contact stiffness and damping of all configurations, and the effects' parameters."""
    fitted = [t for t in results.tested if t.opt is not None]
    pictures = (parameter_picture(fitted),) if len(fitted) > 1 else ()
    return Section(title="Parameters", text=_law(fitted), blocks=(*pictures, interval_table(results)))


def interval_table(results: Results) -> Table:
    """List all parameters with intervals: of each configuration alone, and of each model of the ledger."""
    rows = [
        _row(
            f"{t.name}, opt_{e.name[0]}",
            e,
            (e.value - Z95 * e.std, e.value + Z95 * e.std),
            "at its bound" if e.at_bound else "",
        )
        for t in results.tested
        for e in _estimates(t)
    ]
    rows += [
        _moved_row(t.name, own, at_bound=own.name in fit.at_bound)
        for t in results.tested
        if isinstance(fit := t.fit, MatricesFit)
        for own in fit.moved
    ]
    rows += [
        _row(
            f"all, {model_name(entry)}",
            p,
            (p.lower, p.upper),
            p.remark,
        )
        for entry in results.ledger
        for p in entry.shared
    ]
    table = Table(
        title="Parameters with 95 % intervals",
        header=("fitted to", "parameter", "unit", "value", "lower", "upper", "remark"),
        rows=tuple(rows),
        note="opt_G and opt_d, eq. (1), fit G_f and d_f of the base model to one configuration; an answer has its own "
        "numbers, for all configurations together. Intervals contain the scatter that the model leaves unexplained; "
        "they mean nothing at a bound.",
    )
    return table.without_empty_columns()


def _row(
    fitted_to: str, estimate: Estimate | ParameterEstimate, interval: tuple[float, float], remark: str
) -> tuple[str, ...]:
    unit = "" if estimate.unit == "1" else estimate.unit
    if estimate.at_bound:
        return fitted_to, estimate.name, unit, f"{estimate.value:.4g}", "", "", remark
    return fitted_to, estimate.name, unit, *ends(estimate.value, *interval), remark


def _moved_row(fitted_to: str, own: Moved, *, at_bound: bool) -> tuple[str, ...]:
    low, high = own.value - Z95 * own.std, own.value + Z95 * own.std
    unit = "" if own.unit == "1" else own.unit
    return fitted_to, own.label, unit, *ends(own.value, low, high), "at its bound" if at_bound else ""


def parameter_picture(fitted: Sequence[Tested]) -> Picture:
    """Draw G_f and d_f over torque or pressure with their 95 % intervals."""
    at, label = abscissa(fitted)
    return Picture(
        name="parameters",
        content=svg(parameter_figure(fitted)),
        form="svg",
        data=as_csv(
            ("configuration", label, "G_f [Pa/Pa]", "its std", "d_f [s/Pa]", "its std"),
            (
                (t.name, x, *(v for e in _estimates(t) for v in (e.value, e.std)))
                for t, x in zip(fitted, at, strict=True)
            ),
        ),
        alt="Contact parameters by configuration",
        caption="G_f by opt_G and d_f by opt_d, eq. (1), of each configuration alone, with 95 % intervals.",
    )


def parameter_figure(fitted: Sequence[Tested]) -> Figure:
    """Draw G_f and d_f of fitted configurations over torque, pressure or their number, with 95 % intervals."""
    from matplotlib.figure import Figure

    at, label = abscissa(fitted)
    figure = Figure(figsize=(7.5, 2.9), layout="constrained")
    for k, axes in enumerate(figure.subplots(1, 2)):
        own = [_estimates(t)[k] for t in fitted]
        name, factor = _AXES[own[0].name]
        axes.errorbar(
            at, [factor * e.value for e in own], [Z95 * factor * e.std for e in own], fmt="o", color=palette.BASE,
            markersize=5, capsize=4,
        )  # fmt: skip
        axes.set(xlabel=label, ylabel=name)
        top = max(factor * (e.value + Z95 * e.std) for e in own)
        axes.set_ylim(0.0, 1.15 * top if top > 0.0 else 1.0)
        axes.margins(x=0.15)
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def abscissa(fitted: Sequence[Tested]) -> tuple[NDArray[np.float64], str]:
    """Return what to draw over: torque or pressure where all state it and it varies, else the number."""
    for name, label, factor in (("torque", "torque [N m]", 1.0), ("pressure", "pressure [kPa]", 1e-3)):
        stated = [getattr(t, name) for t in fitted]
        if None not in stated and len(set(stated)) > 1:
            return factor * np.array(stated, dtype=float), label
    return np.arange(1.0, len(fitted) + 1.0), "configuration"


def _estimates(tested: Tested) -> tuple[Estimate, ...]:
    return () if tested.opt is None else (tested.opt.G_f, tested.opt.d_f)


def _law(fitted: Sequence[Tested]) -> tuple[str, ...]:
    """Say how contact stiffness G_f p grows with pressure, where there are two pressures at least."""
    known = [(t.opt.G_f, t.pressure) for t in fitted if t.opt is not None and t.pressure is not None]
    pressure = np.array([p for _, p in known])
    if np.unique(pressure).size < 2:
        return ()
    x = np.log(pressure) - np.mean(np.log(pressure))
    stiffness = np.log([e.value for e, _ in known]) + np.log(pressure)
    slope = float(x @ stiffness / (x @ x))
    std = float(np.sqrt(np.sum((x * [e.std / e.value for e, _ in known]) ** 2)) / (x @ x))
    return (
        f"Contact stiffness G_f p grows with pressure p as p to the power {slope:.3f} ± {Z95 * std:.2g} (95 %); the "
        "base model takes it as proportional, a power of 1.",
    )
