"""Whole vibration tests simulated on a second model, as FRFs in a campaign folder or as modes with their scatter.

A stack that deviates from its file by tolerances is assembled once and tightened to each torque. One force, two sensors
that rove from run to run and load the stack where they sit, noise on both; perhaps something planted, perhaps a fault.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from tests.independent.bench import Array, Bench, BenchModes, Clamp, SecondModel, read_bench
from tests.independent.effects import LACKING, OTHER_FORM, SAME, draw_strength

STACK = Path(__file__).parents[2] / "data" / "hidden_effect" / "stack.toml"
N_STATION = 11
SENSORS = 2
SHAKER = 45
SHAKER_PLACE = (-0.210, 0.020)
"""Along x and y, m; it drives the lower face."""
AVERAGES = 10
RIGID = 1.0
"""Hz, below which a mode is one of the rigid body."""
LEAST_DAMPING = 1e-4
"""Of modes that shear no contact; air and cords give them so much."""
VISIBLE = 0.3
"""Peak of a mode over what the others give at its frequency, in the mean over the points, from which one sees it."""

Kind = Literal["null", "single", "pair", "lacking", "disturbed"]
KINDS: tuple[Kind, ...] = ("null", "single", "pair", "lacking", "disturbed")
DISTURBANCES = (
    "sensor_turned",
    "channels_exchanged",
    "points_shifted",
    "clamps_off",
    "length_wrong",
    "pressure_wrong",
    "gain_off",
)
"""One sensor upside down in one run; both channels of a run exchanged; all points 5 mm off along x; all clamps 5 mm
off; the stack 1 % longer than its file says; the last pressure stated 20 % too low; one sensor 5 % too sensitive."""


@dataclass(frozen=True, kw_only=True)
class Configuration:
    """A bolt torque, N m, and the pressure that the campaign file states for it, Pa."""

    name: str
    torque: float
    pressure: float


@dataclass(frozen=True, kw_only=True)
class Tolerances:
    """Standard deviations of what is true about what the files say: relative, and in m where a place or a size."""

    young: float = 0.01
    density: float = 0.005
    G_f: float = 0.15
    d_f: float = 0.2
    pressure: float = 0.02
    reassembly: float = 0.02
    length: float = 2e-4
    width: float = 1e-4
    height: float = 2e-4
    clamp_place: float = 2e-3
    point_place: float = 1e-3
    gain: float = 0.002


@dataclass(frozen=True, kw_only=True)
class Plan:
    """A test to be simulated.

    Attributes
    ----------
    seed : int
        Of all that `simulate` draws.
    band, step : Hz
        Of the FRFs.
    planted : dict
        Effects by key.
    sensor_mass : float
        kg of each of the two sensors.
    dummies : bool
        Whether masses like the sensors' sit on all points that are not measured.
    force_noise, response_noise : float
        Relative to the FRF, common to a run, and relative to the r.m.s. of a channel.
    n_mode : int
        Modes that make the FRFs, the rigid-body ones among them.
    shaker : (float, float)
        Its place along x and y, m.
    disturbances : tuple of str
        Of `DISTURBANCES`.
    """

    seed: int
    model_key: str
    kind: Kind
    planted: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    stack: Path = STACK
    configurations: tuple[Configuration, ...] = (
        Configuration(name="M1", torque=1.5, pressure=160e3),
        Configuration(name="M2", torque=3.0, pressure=320e3),
    )
    band: tuple[float, float] = (100.0, 1600.0)
    step: float = 0.5
    tolerances: Tolerances = field(default_factory=Tolerances)
    sensor_mass: float = 2e-3
    dummies: bool = False
    force_noise: float = 5e-4
    response_noise: float = 1e-3
    n_mode: int = 46
    shaker: tuple[float, float] = SHAKER_PLACE
    disturbances: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Simulated:
    """What was measured, and what is true.

    Attributes
    ----------
    frequency : (n_line,) float
        Hz.
    frf : list of (n_run, 2, n_line) complex
        Accelerance of the two sensors in each run, (m/s2)/N, for each configuration; faults are in it.
    noise : list of (n_run, 2, n_line) float
        Standard deviation of its real and imaginary parts.
    bench : list of Bench
        The true stack at each torque.
    modes : list of BenchModes
        True ones without sensors.
    point : (45, 3) float
        True places of the points, the last one the shaker's, m.
    nominal : (45, 3) float
        Places of the points that the file states, m.
    factor : (44,) float
        What each point's reading is over the true one: gain and sign of its sensor.
    row : (44,) int
        Which point the files' reading of each point is.
    """

    plan: Plan
    frequency: Array
    frf: list[NDArray[np.complex128]]
    noise: list[Array]
    bench: list[Bench]
    modes: list[BenchModes]
    point: Array
    nominal: Array
    factor: Array
    row: NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class TableNoise:
    """Scatter of identified modes: relative, of shapes relative to their length over the points."""

    frequency: float = 1e-4
    damping: float = 0.02
    shape: float = 5e-3


@dataclass(frozen=True, kw_only=True)
class ModalTable:
    """Modes of one configuration as an identification gives them, with standard deviations.

    Attributes
    ----------
    frequency, damping : (n,) float
        Hz and ratio.
    shape : (44, n) float
        Displacement along z in 1/sqrt(kg), unit modal mass.
    """

    configuration: Configuration
    frequency: Array
    damping: Array
    shape: Array
    frequency_std: Array
    damping_std: Array
    shape_std: Array


def draw(seed: int, kind: Kind, model_key: str) -> Plan:
    """Return a test of a kind with all that is planted or disturbed drawn from the seed."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    known = sorted({**SAME, **OTHER_FORM})
    if kind == "single":
        keys = [known[rng.integers(len(known))]]
    elif kind == "pair":
        keys = [known[i] for i in rng.choice(len(known), 2, replace=False)]
    elif kind == "lacking":
        keys = [sorted(LACKING)[rng.integers(len(LACKING))]]
    else:
        keys = []
    planted = {key: draw_strength(rng, key) for key in keys}
    faults = (DISTURBANCES[rng.integers(len(DISTURBANCES))],) if kind == "disturbed" else ()
    sensor = float(np.exp(rng.uniform(np.log(0.3e-3), np.log(5e-3))))
    return Plan(
        seed=seed,
        model_key=model_key,
        kind=kind,
        planted=planted,
        disturbances=faults,
        sensor_mass=sensor,
        force_noise=float(np.exp(rng.uniform(np.log(2e-4), np.log(2e-3)))),
        response_noise=float(np.exp(rng.uniform(np.log(3e-4), np.log(3e-3)))),
    )


def nominal_points(bench: Bench, shaker: tuple[float, float] = SHAKER_PLACE) -> Array:
    """Return the places (45, 3), m: eleven stations on the four long edges, then the shaker's point."""
    half = np.array([bench.length, bench.width, bench.height]) / 2.0
    corner = np.array([[-1.0, 1.0], [1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) * half[1:]
    edges = [[x, *one] for x in np.linspace(-half[0], half[0], N_STATION) for one in corner]
    return np.array([*edges, [*shaker, -half[2]]])


def simulate(plan: Plan, second_model: SecondModel) -> Simulated:
    """Return the test as simulated on a second model."""
    rng = np.random.default_rng([plan.seed, KINDS.index(plan.kind), 1])
    stated = read_bench(plan.stack)
    nominal = nominal_points(stated, plan.shaker)
    stack, point = deviating(plan, stated, nominal, rng)
    benches = [tightened(plan, stack, i, rng) for i in range(len(plan.configurations))]
    modes = [_damped(second_model.modes(bench, plan.n_mode)) for bench in benches]
    frequency = np.arange(plan.band[0], plan.band[1] + plan.step / 2.0, plan.step)
    gain = 1.0 + plan.tolerances.gain * rng.standard_normal(SENSORS)
    if "gain_off" in plan.disturbances:
        gain[1] *= 1.05
    measured = [_measured(plan, one, point, frequency, gain, rng) for one in modes]
    first = SENSORS * int(rng.integers((len(nominal) - 1) // SENSORS))
    sign, row = np.ones(len(nominal) - 1), np.arange(len(nominal) - 1)
    if "sensor_turned" in plan.disturbances:
        sign[first] = -1.0
    if "channels_exchanged" in plan.disturbances:
        row[first], row[first + 1] = first + 1, first
    for values in (array for pair in measured for array in pair):
        values[:] = values.reshape(len(row), -1)[row].reshape(values.shape)
    measured = [(frf * sign.reshape(-1, SENSORS, 1), noise) for frf, noise in measured]
    return Simulated(
        plan=plan,
        frequency=frequency,
        frf=[frf for frf, _ in measured],
        noise=[noise for _, noise in measured],
        bench=benches,
        modes=modes,
        point=point,
        nominal=nominal,
        factor=sign * np.tile(gain, len(sign) // SENSORS),
        row=row,
    )


def deviating(plan: Plan, stated: Bench, nominal: Array, rng: np.random.Generator) -> tuple[Bench, Array]:
    """Return the true stack and the true places of the points."""
    spread, faults = plan.tolerances, plan.disturbances
    sizes = {
        name: getattr(stated, name) + getattr(spread, name) * rng.standard_normal()
        for name in ("length", "width", "height")
    }
    sizes["length"] *= 1.01 if "length_wrong" in faults else 1.0
    factors = {
        name: getattr(stated, name) * np.exp(getattr(spread, name) * rng.standard_normal())
        for name in ("young", "density", "G_f", "d_f")
    }
    size, was = np.array([*sizes.values()]), np.array([stated.length, stated.width, stated.height])
    error = spread.point_place * rng.standard_normal(nominal.shape) * [1.0, 1.0, 0.0]
    error[:, 0] += 5e-3 if "points_shifted" in faults else 0.0
    point = np.clip(nominal * (size / was) + error, -size / 2.0, size / 2.0)
    off = 5e-3 if "clamps_off" in faults else 0.0
    clamps = tuple(_moved(clamp, spread.clamp_place, off, rng) for clamp in stated.clamps)
    x, y, z = (float(value) for value in point[-1])
    bench = dataclasses.replace(stated, **sizes, **factors, clamps=clamps, planted=plan.planted, shaker=(x, y, z))
    return bench, point


def _moved(clamp: Clamp, spread: float, off: float, rng: np.random.Generator) -> Clamp:
    """Return a clamp at its true place."""
    x, y = spread * rng.standard_normal(2) * [1.0, 0.25]
    return dataclasses.replace(clamp, x=clamp.x + x + off, y=clamp.y + y)


def tightened(plan: Plan, bench: Bench, index: int, rng: np.random.Generator) -> Bench:
    """Return the true stack as assembled at a torque."""
    spread, stated = plan.tolerances, plan.configurations[index].pressure
    wrong = "pressure_wrong" in plan.disturbances and index == len(plan.configurations) - 1
    pressure, contact = np.exp([spread.pressure, spread.reassembly] * rng.standard_normal(2))
    return dataclasses.replace(bench, pressure=stated * pressure * (1.25 if wrong else 1.0), G_f=bench.G_f * contact)


def _damped(modes: BenchModes) -> BenchModes:
    """Return the modes with at least the damping that everything has."""
    least = np.where(modes.frequency < RIGID, 0.0, LEAST_DAMPING)
    return dataclasses.replace(modes, damping=np.maximum(modes.damping, least))


@dataclass(frozen=True, kw_only=True)
class _Loaded:
    """Modes with sensors on: angular frequency and damping (n,), shape along z at two sensors (2, n), shaker (n,)."""

    omega: Array
    damping: Array
    sensor: Array
    shaker: Array

    def frf(self, frequency: Array) -> NDArray[np.complex128]:
        """Return the accelerance (2, n_line)."""
        omega = 2.0 * np.pi * frequency[:, None]
        dynamic = self.omega**2 - omega**2 + 2j * self.damping * self.omega * omega
        return (-(omega**2) * self.shaker / dynamic @ self.sensor.T).T


def _loaded(modes: BenchModes, shape: Array, run: int, mass: float, dummies: bool) -> _Loaded:
    """Return the modes with the sensors of a run on; shape (45, 3, n) of the modes without."""
    here = np.arange(run * SENSORS, (run + 1) * SENSORS)
    loading = shape[: SHAKER - 1] if dummies else shape[here]
    row = loading.reshape(-1, shape.shape[-1])
    omega = 2.0 * np.pi * modes.frequency
    value, turn = la.eigh(np.diag(omega**2), np.eye(len(omega)) + mass * row.T @ row)
    _, one = linear_sum_assignment(-np.abs(turn))  # in the order and with the signs of the modes without
    turn, turned = turn[:, one] * np.sign(np.diag(turn[:, one])), np.sqrt(np.maximum(value[one], 0.0))
    lost = np.einsum("ir,i,ir->r", turn, 2.0 * modes.damping * omega, turn)
    damping = np.divide(lost, 2.0 * turned, out=np.zeros_like(lost), where=turned > 2.0 * np.pi * RIGID)

    return _Loaded(omega=turned, damping=damping, sensor=shape[here, 2] @ turn, shaker=shape[SHAKER - 1, 2] @ turn)


def _runs(plan: Plan, modes: BenchModes, point: Array) -> list[_Loaded]:
    """Return the modes of each run."""
    shape = modes.shape_at(point)
    count = range((len(point) - 1) // SENSORS)
    return [_loaded(modes, shape, run, plan.sensor_mass, plan.dummies) for run in count]


def _measured(
    plan: Plan, modes: BenchModes, point: Array, frequency: Array, gain: Array, rng: np.random.Generator
) -> tuple[NDArray[np.complex128], Array]:
    """Return the FRFs of all runs of a configuration and the standard deviation of their parts."""
    true = np.stack([one.frf(frequency) for one in _runs(plan, modes, point)]) * gain[:, None]
    force = _complex(rng, (len(true), 1, len(frequency)))
    response = _complex(rng, true.shape)
    level = plan.response_noise * np.sqrt(np.mean(np.abs(true) ** 2, axis=2, keepdims=True))
    noise = np.sqrt((plan.force_noise * np.abs(true)) ** 2 + level**2) / np.sqrt(2.0)
    return true * (1.0 + plan.force_noise * force) + level * response, noise


def _complex(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.complex128]:
    """Return complex noise of unit variance."""
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2.0)


def modal_tables(simulated: Simulated, noise: TableNoise | None = None) -> list[ModalTable]:
    """Return the visible modes in the band of each configuration, run by run loaded, without FRFs between.

    Frequencies and damping are means over the runs; each point's shape is of its own run.
    """
    noise = noise or TableNoise()
    rng = np.random.default_rng([simulated.plan.seed, KINDS.index(simulated.plan.kind), 2])
    pairs = zip(simulated.plan.configurations, simulated.modes, strict=True)
    return [_table(simulated, configuration, modes, noise, rng) for configuration, modes in pairs]


def _table(
    simulated: Simulated, configuration: Configuration, modes: BenchModes, noise: TableNoise, rng: np.random.Generator
) -> ModalTable:
    """Return the modes of one configuration."""
    plan = simulated.plan
    runs = _runs(plan, modes, simulated.point)
    keep = visible(modes, simulated.point, plan.band)
    omega = np.array([run.omega[keep] for run in runs])
    shape = np.concatenate([run.sensor[:, keep] for run in runs])
    shape = (simulated.factor[:, None] * shape)[simulated.row]
    frequency, damping = omega.mean(axis=0) / (2.0 * np.pi), np.array([run.damping[keep] for run in runs])
    n, count = int(keep.sum()), len(runs)
    roving = omega.std(axis=0) / (2.0 * np.pi * np.sqrt(count))
    std = np.hypot(noise.frequency * frequency, roving)
    size = noise.shape * np.linalg.norm(shape, axis=0) / np.sqrt(len(shape))
    mean_damping = damping.mean(axis=0)
    return ModalTable(
        configuration=configuration,
        frequency=frequency + noise.frequency * frequency * rng.standard_normal(n),
        damping=mean_damping * (1.0 + noise.damping * rng.standard_normal(n)),
        shape=shape + size * rng.standard_normal(shape.shape),
        frequency_std=std,
        damping_std=noise.damping * mean_damping,
        shape_std=np.broadcast_to(size, shape.shape).copy(),
    )


def visible(modes: BenchModes, point: Array, band: tuple[float, float]) -> NDArray[np.bool_]:
    """Return which modes lie in the band and stand out of the others at their own frequency."""
    shape = modes.shape_at(point)[:, 2]
    residue = shape[: SHAKER - 1] * shape[SHAKER - 1]
    omega = 2.0 * np.pi * modes.frequency
    seen = (modes.frequency > band[0]) & (modes.frequency < band[1])
    for r in np.flatnonzero(seen):
        dynamic = omega**2 - omega[r] ** 2 + 2j * modes.damping * omega * omega[r]
        each = residue * omega[r] ** 2 / dynamic
        rest = np.delete(each, r, axis=1).sum(axis=1)
        seen[r] = np.linalg.norm(each[:, r]) > VISIBLE * np.linalg.norm(rest)
    return seen


def write_campaign(simulated: Simulated, folder: Path) -> Path:
    """Write the campaign with its stack file, points, FRFs and `truth.json`; return the campaign file."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(simulated.plan.stack, folder / "stack.toml")
    write_points(simulated, folder / "points.csv")
    for i, configuration in enumerate(simulated.plan.configurations):
        (folder / configuration.name).mkdir(exist_ok=True)
        for run, (frf, noise) in enumerate(zip(simulated.frf[i], simulated.noise[i], strict=True)):
            _write_run(folder / _run_file(configuration, run), simulated.frequency, frf, noise)
    file = folder / "campaign.toml"
    plan = simulated.plan
    text = campaign_text(simulated, name=f"{plan.kind} {plan.seed} of {plan.model_key}")
    file.write_text(text, encoding="utf-8")
    (folder / "truth.json").write_text(json.dumps(truth(simulated)), encoding="utf-8")
    return file


def write_points(simulated: Simulated, file: Path) -> None:
    """Write the points where the file of a laboratory has them, mm."""
    rows = [f"{node},{','.join(f'{1e3 * c:.3f}' for c in place)}" for node, place in enumerate(simulated.nominal, 1)]
    file.write_text("\n".join(["node,x,y,z", *rows]) + "\n", encoding="utf-8")


def _run_file(configuration: Configuration, run: int, suffix: str = "csv") -> str:
    return f"{configuration.name}/run_{run + 1:02d}.{suffix}"


def _write_run(file: Path, frequency: Array, frf: NDArray[np.complex128], noise: Array) -> None:
    """Write real part, imaginary part and coherence of each sensor."""
    power = np.abs(frf) ** 2
    coherence = power / (power + 2.0 * AVERAGES * noise**2)
    columns = np.stack([frf.real, frf.imag, coherence], axis=1).reshape(-1, len(frequency))
    header = ",".join(["Hz", *(f"{s} {what}" for s in (1, 2) for what in ("re", "im", "coherence"))])
    line = ["%.4f", *["%.6e", "%.6e", "%.6f"] * SENSORS]
    np.savetxt(file, np.vstack([frequency, columns]).T, fmt=line, delimiter=",", header=header, comments="")


def campaign_text(simulated: Simulated, *, name: str, suffix: Literal["csv", "uff"] = "csv") -> str:
    """Return the campaign file."""
    plan = simulated.plan
    text = f"""[campaign]
name = "{name}"

[structure]
stack = "stack.toml"

[points]
file = "points.csv"
unit = "mm"
lines = {_trace_lines()}

[measurement]
format = "{suffix}"
unit = "(m/s2)/N"
"""
    if suffix == "csv":
        text += """
[measurement.table]
layout = "real-imaginary"
header_rows = 1
columns = [[2, 3], [5, 6]]
coherence_columns = [4, 7]
"""
    for i, one in enumerate(plan.configurations):
        text += f'\n[[configuration]]\nname = "{one.name}"\ntorque_Nm = {one.torque:g}\n'
        text += f"pressure_kPa = {1e-3 * one.pressure:g}\n"
        for run in range(len(simulated.frf[i])):
            nodes = ", ".join(f'"{node}+z"' for node in (SENSORS * run + 1, SENSORS * run + 2))
            text += f'\n[[configuration.run]]\nfiles = ["{_run_file(one, run, suffix)}"]\n'
            text += f'output = [{nodes}]\ninput = ["{SHAKER}+z"]\n'
    return text


def _trace_lines() -> list[list[int]]:
    """Return the lines that draw the four edges and the sections between them."""
    along = [[node, node + 4] for node in range(1, SHAKER - 4)]
    corners = ((0, 1), (1, 3), (3, 2), (2, 0))
    around = [[first + a, first + b] for first in range(1, SHAKER, 4) for a, b in corners]
    return along + around


def truth(simulated: Simulated) -> dict[str, object]:
    """Return what is true as plain values, SI: shapes (44, n) along z at the nominal points, without sensor mass."""
    plan = simulated.plan
    found = []
    for configuration, bench, modes in zip(plan.configurations, simulated.bench, simulated.modes, strict=True):
        half = np.array([bench.length, bench.width, bench.height]) / 2.0
        place = np.clip(simulated.nominal[: SHAKER - 1], -half, half)
        keep = (modes.frequency > plan.band[0]) & (modes.frequency < plan.band[1])
        found.append(
            {
                "name": configuration.name,
                "frequency": modes.frequency[keep].tolist(),
                "damping": modes.damping[keep].tolist(),
                "visible": visible(modes, simulated.point, plan.band)[keep].tolist(),
                "shape": modes.shape_at(place)[:, 2, keep].tolist(),
                "bench": dataclasses.asdict(bench),
            }
        )
    given = dataclasses.asdict(plan) | {"stack": plan.stack.name}
    return {"plan": given, "configurations": found, "point": simulated.point.tolist()}
