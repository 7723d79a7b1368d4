"""What an effect does to the first modes of a stack: its signature over modes and pressures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lamella_shared import arrays
from model import Effect, Modes, Observed, ReducedSystem, Stack, observe, reduce, solve_modes
from updating.correlation.pairing import cross_orthogonality, track
from updating.correlation.shape_class import class_grid, shape_classes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PRESSURES = (160e3, 320e3)
"""Mean pressures of the paper's torques M1 and M2, Pa (Pirnat et al. 2013, Table 2)."""
CLASSES = {"T1": "torsion 1", "B1": "bending 1", "B2": "bending 2", "T2": "torsion 2"}
"""The modes that published tests of such stacks have in common."""

_N_MODE = 26


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"any": "pressure", "pressure mode": "base_frequency frequency base_damping damping likeness"})
class Signature:
    """Modes of a stack without and with an effect.

    Attributes
    ----------
    effect : str
        Its name.
    strength : mapping of str to float
        Values of its parameters.
    pressure : (n_pressure,) float
        Mean pressures, Pa.
    mode : tuple of str
        Names of the modes: T1, B1, B2, T2, or numbers where the stack is no bar.
    base_frequency, frequency : (n_pressure, n_mode) float
        Without and with the effect, Hz.
    base_damping, damping : (n_pressure, n_mode) float
        Damping ratios.
    likeness : (n_pressure, n_mode) float
        Mass cross-orthogonality of the mode with and without: 1 if the shape stays.
    """

    effect: str
    strength: Mapping[str, float]
    pressure: NDArray[np.float64]
    mode: tuple[str, ...]
    base_frequency: NDArray[np.float64]
    frequency: NDArray[np.float64]
    base_damping: NDArray[np.float64]
    damping: NDArray[np.float64]
    likeness: NDArray[np.float64]

    @property
    def frequency_change(self) -> NDArray[np.float64]:
        """Relative change of frequencies, (n_pressure, n_mode)."""
        return self.frequency / self.base_frequency - 1.0

    @property
    def damping_change(self) -> NDArray[np.float64]:
        """Change of damping ratios, (n_pressure, n_mode)."""
        return self.damping - self.base_damping


def signature(stack: Stack, effect: Effect) -> Signature:
    """Compute what an effect at its nominal strength does to the first modes at M1 and at M2.

    The strength grows in steps from neutral, and each mode is followed by its shape.

    Raises
    ------
    EffectError
        The stack lacks what the effect needs.
    PairingError
        There are not enough modes to follow.
    """
    strength = {p.name: p.nominal for p in effect.parameters}
    ranges = {
        p.name: (min(p.neutral, p.nominal), max(p.neutral, p.nominal))
        for p in effect.parameters
        if p.neutral != p.nominal
    }
    system = reduce(stack.with_effects(effect), n_mode=22, n_snapshot=5, ranges=ranges)
    grid = observe(system, class_grid(stack))
    by_pressure = [_at(system, effect, pressure, grid) for pressure in PRESSURES]
    names = by_pressure[0][0]
    columns = [np.array(values) for values in zip(*(values for _, values in by_pressure), strict=True)]
    return Signature(
        effect=effect.name,
        strength=strength,
        pressure=np.array(PRESSURES),
        mode=names,
        base_frequency=columns[0],
        frequency=columns[1],
        base_damping=columns[2],
        damping=columns[3],
        likeness=columns[4],
    )


def _at(
    system: ReducedSystem, effect: Effect, pressure: float, grid: Observed
) -> tuple[tuple[str, ...], tuple[NDArray[np.float64], ...]]:
    """Return names, frequencies without and with, damping without and with, and likeness."""
    n_step = 6  # from the base model to the stated strength, so that modes can be followed

    def solved(share: float) -> Modes:
        values = {p.name: p.neutral + share * (p.nominal - p.neutral) for p in effect.parameters}
        return solve_modes(
            system, G_f=system.theta["G_f"], d_f=system.theta["d_f"], n_mode=_N_MODE, observation=grid,
            parameters={**values, "pressure": pressure}, by=(),
        ).elastic()  # fmt: skip

    steps = [solved(share) for share in np.linspace(0.0, 1.0, n_step)]
    base, last = steps[0], steps[-1]
    names, columns = _chosen(system.stack, base)
    mass = system.matrix("M", {**system.theta, "pressure": pressure})
    end = track(steps, mass, n_mode=int(columns.max()) + 1).column[-1, columns]
    likeness = cross_orthogonality(base.coordinate[:, columns], last.coordinate[:, end], mass)
    return names, (
        base.frequency[columns],
        last.frequency[end],
        base.damping[columns],
        last.damping[end],
        np.diag(likeness),
    )


def _chosen(stack: Stack, base: Modes) -> tuple[tuple[str, ...], NDArray[np.intp]]:
    """Return the named modes of a bar-like stack, or the lowest ones of another."""
    least = 4  # modes shown where they have no names
    classes = shape_classes(base) if stack.outline is None else ()
    if all(name in classes for name in CLASSES.values()):
        return tuple(CLASSES), np.array([classes.index(name) for name in CLASSES.values()])
    return tuple(f"mode {r + 1}" for r in range(least)), np.arange(least)


def signature_figure(effect_signature: Signature) -> Figure:
    """Draw the changes of frequencies and damping ratios as bars, one group a mode, one bar a pressure."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 2.6), layout="constrained")
    width = 0.8 / effect_signature.pressure.size
    drawn = {
        "frequency [%]": 100.0 * effect_signature.frequency_change,
        "damping ratio [% points]": 100.0 * effect_signature.damping_change,
    }
    for axes, (label, change) in zip(figure.subplots(1, 2), drawn.items(), strict=True):
        for i, (pressure, values) in enumerate(zip(effect_signature.pressure, change, strict=True)):
            at = np.arange(len(effect_signature.mode)) + (i - (effect_signature.pressure.size - 1) / 2.0) * width
            axes.bar(at, values, width, label=f"{pressure / 1e3:g} kPa", color=("0.35", "#b3341f")[i % 2])
        axes.axhline(0.0, color="black", linewidth=0.6)
        axes.set_xticks(range(len(effect_signature.mode)), effect_signature.mode)
        axes.set_title(f"change of {label}", fontsize=9)
    figure.axes[0].legend(fontsize=8, frameon=False)
    values = ", ".join(f"{name} = {value:g}" for name, value in effect_signature.strength.items())
    figure.suptitle(f"{effect_signature.effect}: {values}", fontsize=9)
    return figure
