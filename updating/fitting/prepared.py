"""Targets with their reduced models, made once for many fits."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from ema.modal.mac import mac
from ema.types.arrays import readonly
from ema.types.threads import single_threaded
from model import Modes, ReducedSystem, Stack, reduce, solve_modes
from model.modes.observation import Observed, observe
from updating.correlation.expansion import visible
from updating.correlation.pairing import pair
from updating.correlation.shape_class import shape_classes
from updating.errors import FitError
from updating.fitting.fit import G_F_BOUNDS, N_SNAPSHOT
from updating.fitting.target import Target

N_MODE = 22
"""Modes that are solved for pairing, the six rigid-body modes included."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Prepared:
    """A target with its reduced model; `prepare` makes it once for many fits.

    Attributes
    ----------
    target : Target
        What was measured.
    system : ReducedSystem
        The reduced stack; targets that differ by their pressure share it.
    observed : Observed
        The target's observation, tied to the system.
    used : (n_mode,) bool
        Modes that were measured and that the model has somewhere within the bounds of G_f.
    """

    target: Target
    system: ReducedSystem
    observed: Observed
    used: NDArray[np.bool_]

    def __post_init__(self) -> None:
        shape = self.target.frequency.shape
        object.__setattr__(self, "used", readonly("Prepared", "used", self.used, shape, bool))


@single_threaded
def prepare(
    targets: Sequence[Target],
    *,
    G_f_bounds: tuple[float, float] = G_F_BOUNDS,
    threshold: float = 0.8,
    n_snapshot: int = N_SNAPSHOT,
) -> tuple[Prepared, ...]:
    """Reduce the models of targets; those that differ by uniform pressure alone share one reduction.

    Parameters
    ----------
    targets : sequence of Target
        Their stacks carry the effects that later fits may use.
    G_f_bounds : (float, float)
        Range of G_f, Pa per Pa.
    threshold : float
        Smallest MAC that makes a pair, for targets with shapes.
    n_snapshot : int
        Values of G_f at which the reduction is exact.

    Raises
    ------
    FitError
        Two targets have one name, or no mode of one pairs anywhere within the bounds.
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
            own = target.stack.contact.pressure
            G_f_range = (G_f_bounds[0] * min(kin) / own, G_f_bounds[1] * max(kin) / own)
            system = reduce(target.stack, G_f_range=G_f_range, n_snapshot=n_snapshot, n_mode=N_MODE)
            systems.append((target.stack, system))
        one = Prepared(
            target=target,
            system=system,
            observed=observe(system, target.observation),
            used=np.isfinite(target.frequency),
        )
        if not target.shape_class:
            one = dataclasses.replace(one, used=_pairs(one, G_f_bounds, threshold))
        prepared.append(one)
    return tuple(prepared)


def solve_target(
    prepared: Prepared, values: Mapping[str, float], by: Collection[str]
) -> tuple[Modes, NDArray[np.int64]]:
    """Return elastic modes and the column of each measured mode; -1 where the model has none of its class."""
    modes = solve_every(prepared, values, by).elastic()
    return modes, partners(prepared, modes)


def solve_every(prepared: Prepared, values: Mapping[str, float], by: Collection[str]) -> Modes:
    """Return all modes, those of the rigid body first, for some values of the parameters."""
    target = prepared.target
    rest = {name: value for name, value in values.items() if name not in ("G_f", "d_f")}
    return solve_modes(
        prepared.system,
        G_f=values.get("G_f", target.stack.contact.G_f),
        d_f=values.get("d_f", 0.0),
        n_mode=N_MODE,
        observation=prepared.observed,
        parameters={"pressure": target.stack.contact.pressure, **rest},
        by=by,
    )


def partners(prepared: Prepared, modes: Modes) -> NDArray[np.int64]:
    """Return the column among elastic modes of each measured mode; -1 where there is none of its class."""
    target = prepared.target
    if target.shape_class:
        names = shape_classes(modes)
        return np.array([names.index(n) if n in names else -1 for n in target.shape_class], np.int64)
    likeness = np.where(visible(modes.shape), mac(target.shape, modes.shape), 0.0)
    return np.asarray(linear_sum_assignment(likeness, maximize=True)[1], np.int64)


def _pairs(prepared: Prepared, bounds: tuple[float, float], threshold: float) -> NDArray[np.bool_]:
    """Return the measured modes that pair where MAC values, those of subspaces for close modes, sum to most."""
    trials = [
        pair(prepared.target, solve_target(prepared, {"G_f": float(g)}, ())[0], threshold=threshold)
        for g in np.geomspace(*bounds, 13)
    ]
    best = max(trials, key=lambda p: float(np.sum(p.subspace_mac)))
    if best.measured.size == 0:
        message = (
            f"{prepared.target.name}: no measured mode reaches a MAC of {threshold:g} with the model for any G_f "
            f"between {bounds[0]:g} and {bounds[1]:g}; check point numbers, directions and signs"
        )
        raise FitError(message)
    return np.isin(np.arange(prepared.used.size), best.measured)


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
