"""What a fit of several configurations is to meet: measured modes with their scatter, the stack, its reduced model."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from ema import Campaign, Configuration
from ema.modal.mac import mac, real_shape
from ema.types.modal_model import ModalModel
from ema.types.threads import single_threaded
from lamella_shared import arrays, readonly
from model import Modes, Observation, ReducedSystem, Stack, reduce, solve_modes
from model.modes.modes import Observed, observe
from updating.correlation.criteria import class_grid, shape_classes
from updating.correlation.pairing import N_MODE, pair
from updating.correlation.registration import register, visible
from updating.errors import FitError
from updating.fitting.fit import G_F_BOUNDS, N_SNAPSHOT


@dataclass(frozen=True, eq=False, kw_only=True)
class Target:
    """Measured modes of one configuration.

    Attributes
    ----------
    name : str
        The configuration, a unique name.
    specimen : str
        The stack that it was measured on: configurations of one stack have the same.
    stack : Stack
        Its model, at the configuration's pressure, with the effects that may be fitted.
    observation : Observation
        Where the model's shapes are sampled: the measured DOFs, or the grid that shapes are named from.
    frequency : (n_mode,) float
        Natural frequencies, Hz; NaN where a mode was not measured.
    damping : (n_mode,) float
        Damping ratios; NaN where unknown.
    covariance : (2 n_mode, 2 n_mode) float
        Covariance of ln(frequency) and damping ratio of each mode in turn.
    shape_class : tuple of str
        Class of each mode, by which it is paired; empty where modes are paired by MAC.
    shape : (n_dof, n_mode) float
        Real mode shapes of unit length, by which modes are paired and which are fitted; (0, n_mode) with classes.
    shape_std : (n_dof, n_mode) float
        Their standard deviations.
    """

    name: str
    specimen: str
    stack: Stack
    observation: Observation
    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]
    covariance: NDArray[np.float64]
    shape_class: tuple[str, ...]
    shape: NDArray[np.float64]
    shape_std: NDArray[np.float64]

    def __post_init__(self) -> None:
        n_mode = np.size(self.frequency)
        n_dof = 0 if self.shape_class else self.observation.node.size
        expected = {
            "frequency": (n_mode,),
            "damping": (n_mode,),
            "covariance": (2 * n_mode, 2 * n_mode),
            "shape": (n_dof, n_mode),
            "shape_std": (n_dof, n_mode),
        }
        for name, shape in expected.items():
            object.__setattr__(self, name, readonly("Target", name, getattr(self, name), shape))

    @property
    def node(self) -> NDArray[np.int64]:
        """Point number of each DOF."""
        return self.observation.node

    @property
    def direction(self) -> NDArray[np.float64]:
        """Direction of each DOF (n_dof, 3)."""
        return self.observation.direction


def model_file(campaign: Campaign, job: str) -> Path:
    """Return the file of the model's stack, which `job`, such as "a fit", needs.

    Raises
    ------
    FitError
        The campaign names none, or no file of the points, by which shapes are compared.
    """
    if campaign.stack is None:
        message = (
            f'{campaign.path}: {job} needs the model\'s stack; add stack = "stack.toml" under [structure]'
        )
        raise FitError(message)
    if campaign.points is None:
        message = (
            f"{campaign.path}: {job} compares shapes and needs the coordinates of the points; add file = "
            '"points.csv" and its unit under [points]'
        )
        raise FitError(message)
    return campaign.stack


def stack_in_state(stack: Stack, configuration: Configuration) -> Stack:
    """Put a configuration's pressure and height, where it states them, in place of those of the stack file."""
    if configuration.pressure is not None:
        stack = stack.with_contact(pressure=configuration.pressure)
    return stack if configuration.height is None else replace(stack, height=configuration.height)


def specimen_name(name: str, height: float, heights: Collection[float]) -> str:
    """Name the stack of a configuration: configurations of other heights (m) are other stacks."""
    return name if len(set(heights)) == 1 else f"{name}, {1e3 * height:g} mm"


def target_of_modes(
    stack: Stack, measured: ModalModel, *, specimen: str = "", tolerance: float = 0.01
) -> Target:
    """Return identified modes as a target, with the covariance and the shapes of the identification.

    The poles' covariance is carried over to ln(frequency) and damping ratio to first order.

    Parameters
    ----------
    stack : Stack
        The stack at the configuration's pressure.
    measured : ModalModel
        The identified modes.
    specimen : str
        Name of the stack; by default that of `stack`.
    tolerance : float
        Largest distance between a measured point and the stack, m.

    Raises
    ------
    PairingError
        Points of the measurement do not lie on the stack.
    """
    registration = register(stack, measured.geometry, measured.node, measured.direction, tolerance=tolerance)
    n_mode = measured.frequency.size
    slope = np.zeros((2 * n_mode, 2 * n_mode))
    for r, pole in enumerate(measured.free_pole):
        size, a, b = abs(pole), pole.real, pole.imag
        slope[2 * r : 2 * r + 2, 2 * r : 2 * r + 2] = [
            [a / size**2, b / size**2],
            [-(b**2) / size**3, a * b / size**3],
        ]
    length = np.linalg.norm(measured.shape, axis=0)
    return Target(
        name=measured.name,
        specimen=specimen or stack.name,
        stack=stack,
        observation=registration.observation,
        frequency=measured.frequency,
        damping=measured.damping,
        covariance=slope @ measured.covariance @ slope.T,
        shape_class=(),
        shape=real_shape(measured.shape / length),
        shape_std=measured.shape_std / length,
    )


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
        observation=class_grid(stack),
        frequency=np.asarray(frequency, float),
        damping=np.full(n_mode, np.nan) if damping is None else damping,
        covariance=np.zeros((2 * n_mode, 2 * n_mode)),
        shape_class=shape_class,
        shape=np.empty((0, n_mode)),
        shape_std=np.empty((0, n_mode)),
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
        The target's observation, tied to the system.
    used : (n_mode,) bool
        Modes that were measured and that the model has somewhere within the bounds of G_f.
    """

    target: Target
    system: ReducedSystem
    observed: Observed
    used: NDArray[np.bool_]


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
            pressure = target.stack.contact.pressure
            G_f_range = (G_f_bounds[0] * min(kin) / pressure, G_f_bounds[1] * max(kin) / pressure)
            system = reduce(target.stack, G_f_range=G_f_range, n_snapshot=n_snapshot, n_mode=N_MODE)
            systems.append((target.stack, system))
        model = Prepared(
            target=target,
            system=system,
            observed=observe(system, target.observation),
            used=np.isfinite(target.frequency),
        )
        if not target.shape_class:
            model = dataclasses.replace(model, used=_pairs(model, G_f_bounds, threshold))
        prepared.append(model)
    return tuple(prepared)


def solve_target(
    prepared: Prepared, values: Mapping[str, float], by: Collection[str]
) -> tuple[Modes, NDArray[np.int64]]:
    """Return elastic modes and the column of each measured mode; -1 where the model has none of its class."""
    modes = solve_all(prepared, values, by).elastic()
    return modes, partners(prepared, modes)


def solve_all(prepared: Prepared, values: Mapping[str, float], by: Collection[str]) -> Modes:
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
    return np.asarray(scipy.optimize.linear_sum_assignment(likeness, maximize=True)[1], np.int64)


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
