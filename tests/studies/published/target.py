"""What a fit of several configurations is to meet: the modes of a table, the stack, its reduced model."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.types.arrays import single_threaded
from lamella_shared import arrays
from model import Modes, ReducedSystem, Stack, reduce, solve_modes
from model.modes.modes import Observed, observe
from updating.correlation.pairing import N_MODE
from updating.correlation.shape_class import class_grid, shape_classes
from updating.errors import FitError
from updating.fitting.fit import G_F_BOUNDS, N_SNAPSHOT_WIDE


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"any": "frequency", "frequency": "damping"})
class Target:
    """Measured modes of one configuration, known by the classes of their shapes.

    Attributes
    ----------
    name : str
        The configuration, a unique name.
    specimen : str
        The stack that it was measured on: configurations of one stack have the same.
    stack : Stack
        Its model, at the configuration's pressure, with the effects that may be fitted.
    frequency : (n_mode,) float
        Natural frequencies, Hz; NaN where a mode was not measured.
    damping : (n_mode,) float
        Damping ratios; NaN where unknown.
    shape_class : tuple of str
        Class of each mode, by which it is paired.
    """

    name: str
    specimen: str
    stack: Stack
    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]
    shape_class: tuple[str, ...]


def target_of_table(
    stack: Stack,
    shape_class: tuple[str, ...],
    frequency: NDArray[np.float64],
    *,
    name: str,
    specimen: str = "",
    damping: NDArray[np.float64] | None = None,
) -> Target:
    """Return modes of a table, which are known by their classes and have no stated uncertainty, as a target.

    Parameters
    ----------
    stack : Stack
        The stack at the configuration's pressure.
    shape_class : tuple of str
        Class of each mode, such as "torsion 1".
    frequency : (n_mode,) float
        Natural frequencies, Hz; NaN where a mode was not measured.
    name, specimen : str
        The configuration, and its stack; by default `name` for both.
    damping : (n_mode,) float, optional
        Damping ratios.
    """
    n_mode = np.size(frequency)
    return Target(
        name=name,
        specimen=specimen or name,
        stack=stack,
        frequency=np.asarray(frequency, float),
        damping=np.full(n_mode, np.nan) if damping is None else damping,
        shape_class=shape_class,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"target.frequency": "used"})
class Prepared:
    """A target with its reduced model; `prepare` makes it once for many fits.

    Attributes
    ----------
    target : Target
        What was measured.
    system : ReducedSystem
        The reduced stack; targets that differ by their pressure share it.
    observed : Observed
        The grid that shapes are named from, tied to the system.
    used : (n_mode,) bool
        Modes that were measured and that the model has somewhere within the bounds of G_f.
    """

    target: Target
    system: ReducedSystem
    observed: Observed
    used: NDArray[np.bool_]


@single_threaded
def prepare(
    targets: Sequence[Target], *, G_f_bounds: tuple[float, float] = G_F_BOUNDS, n_snapshot: int = N_SNAPSHOT_WIDE
) -> tuple[Prepared, ...]:
    """Reduce the models of targets; those that differ by uniform pressure alone share one reduction.

    Parameters
    ----------
    targets : sequence of Target
        Their stacks carry the effects that later fits may use.
    G_f_bounds : (float, float)
        Range of G_f, Pa per Pa.
    n_snapshot : int
        Values of G_f at which the reduction is exact.

    Raises
    ------
    FitError
        Two targets have one name.
    """
    names = [target.name for target in targets]
    if not targets or len(set(names)) < len(names):
        message = f"a joint fit needs configurations with a name each, got {', '.join(names) or 'none'}"
        raise FitError(message)
    systems: list[tuple[Stack, ReducedSystem]] = []
    prepared = []
    for target in targets:
        system = next((s for stack, s in systems if _same_but_pressure(stack, target.stack)), None)
        if system is None:
            kin = [t.stack.contact.pressure for t in targets if _same_but_pressure(t.stack, target.stack)]
            pressure = target.stack.contact.pressure
            G_f_range = (G_f_bounds[0] * min(kin) / pressure, G_f_bounds[1] * max(kin) / pressure)
            system = reduce(target.stack, G_f_range=G_f_range, n_snapshot=n_snapshot, n_mode=N_MODE)
            systems.append((target.stack, system))
        observed = observe(system, class_grid(target.stack))
        used = np.isfinite(target.frequency)
        prepared.append(Prepared(target=target, system=system, observed=observed, used=used))
    return tuple(prepared)


def solve_target(
    prepared: Prepared, values: Mapping[str, float], by: Collection[str]
) -> tuple[Modes, NDArray[np.int64]]:
    """Return elastic modes and the column of each measured mode; -1 where the model has none of its class."""
    target = prepared.target
    rest = {name: value for name, value in values.items() if name not in ("G_f", "d_f")}
    modes = solve_modes(
        prepared.system,
        G_f=values.get("G_f", target.stack.contact.G_f),
        d_f=values.get("d_f", 0.0),
        n_mode=N_MODE,
        observation=prepared.observed,
        parameters={"pressure": target.stack.contact.pressure, **rest},
        by=by,
    ).elastic()
    names = shape_classes(modes)
    return modes, np.array([names.index(n) if n in names else -1 for n in target.shape_class], np.int64)


def _same_but_pressure(a: Stack, b: Stack) -> bool:
    """Whether one reduction serves both: the same stack under uniform pressures."""
    if a.pressing is not None or b.pressing is not None:
        return a is b
    skip = {"name", "contact", "pressing", "instruments", "effects", "effect_values"}
    same = all(
        getattr(a, f.name) is getattr(b, f.name) or getattr(a, f.name) == getattr(b, f.name)
        for f in dataclasses.fields(a)
        if f.name not in skip
    )
    effects = [e.name for e in a.effects] == [e.name for e in b.effects]
    values = dict(a.effect_values) == dict(b.effect_values) and a.instruments is b.instruments
    return same and effects and values and a.contact.normal_modulus == b.contact.normal_modulus
