"""A virtual test: measurements simulated on a model, the files that a laboratory would hand over, and the truth."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import model
from ema import write_uff
from ema.types.frf import FRF, Dofs, Geometry
from lamella_shared import Booleans, Complexes, Integers, Reals, read_toml
from model import Formula, Observation, Observed, ReducedSystem, SolveError
from model.elements.equations import OMEGA, Product, Target
from model.reduction.reduced_equations import full
from updating.correlation.pairing import N_MODE
from updating.results.store import write_bytes, write_result
from updating.virtual.vibration_test import (
    Averaging,
    Specimen,
    VirtualConfiguration,
    VirtualTest,
    drawn_deviations,
    specimens,
)

_POWER: dict[Target, int] = {"K": 0, "C": 1, "M": 2}


@dataclass(frozen=True, eq=False, kw_only=True)
class Dynamics:
    """Dynamic stiffness of a stack, s**2 M + s C + K, with factors that may depend on frequency.

    Attributes
    ----------
    steady : mapping of target to (n, n)
        Parts of M, C and K that do not depend on frequency.
    following : tuple of (target, callable, matrix)
        Parts that do: the factor at a complex angular frequency s / i, which continues the factor on the real
        axis, times an (n, n) matrix.
    """

    steady: Mapping[Target, Reals]
    following: tuple[tuple[Target, Callable[[complex], complex], Reals], ...]

    def at(self, s: complex) -> Complexes:
        """Return the dynamic stiffness at the Laplace variable `s`, rad/s; (n, n) complex."""
        total: NDArray[Any] = s**2 * self.steady["M"] + s * self.steady["C"] + self.steady["K"]
        for target, factor, matrix in self.following:
            total = total + s ** _POWER[target] * factor(s / 1j) * matrix
        return np.asarray(total, dtype=complex)

    def slope(self, s: complex) -> Complexes:
        """Return the derivative of the dynamic stiffness by `s`; a difference would drown in the supports."""
        step = 1e-6  # relative, of the derivative that only steers the iteration
        total: NDArray[Any] = 2.0 * s * self.steady["M"] + self.steady["C"]
        h = step * abs(s)
        for target, factor, matrix in self.following:
            ends = [z ** _POWER[target] * factor(z / 1j) for z in (s + h, s - h)]
            total = total + (ends[0] - ends[1]) / (2.0 * h) * matrix
        return np.asarray(total, dtype=complex)

    def with_parts(self, rows: Reals, mass: float, stiffness: float = 0.0) -> Dynamics:
        """Return the dynamics with a mass, kg, and a spring to the ground, N/m, on each of the `rows` (k, n)."""
        square = rows.T @ rows
        steady = {**self.steady, "M": self.steady["M"] + mass * square, "K": self.steady["K"] + stiffness * square}
        return replace(self, steady=steady)


def dynamics(system: ReducedSystem, theta: Mapping[str, float]) -> Dynamics:
    """Return the dynamic stiffness of a reduced system at the parameters `theta`."""
    steady = {target: np.zeros((system.size, system.size)) for target in _POWER}
    following = []
    for term in system.terms:
        if OMEGA in theta and term.factor.derivative(theta, OMEGA) != 0.0:
            following.append((term.target, _continued(term.factor, theta), full(term.matrix)))
        else:
            steady[term.target] += term.factor(theta) * full(term.matrix)
    return Dynamics(steady=steady, following=tuple(following))


def _continued(factor: Any, theta: Mapping[str, float]) -> Callable[[complex], complex]:
    if isinstance(factor, Product):
        first, second = _continued(factor.first, theta), _continued(factor.second, theta)
        return lambda omega: first(omega) * second(omega)
    if isinstance(factor, Formula):
        return lambda omega: complex(factor.function({**theta, OMEGA: omega}))
    return lambda omega: complex(factor({**theta, OMEGA: omega.real}))


def poles(of: Dynamics, start: Complexes, vectors: Reals) -> tuple[Complexes, Complexes]:
    """Solve (s**2 M + s C + K) x = 0 for the poles next to given ones, by Newton's inverse iteration.

    Parameters
    ----------
    of : Dynamics
        Dynamic stiffness.
    start : (n_mode,) complex
        Poles to start from, rad/s.
    vectors : (n, n_mode) float
        Their vectors.

    Returns
    -------
    pole : (n_mode,) complex
    vector : (n, n_mode) complex

    Raises
    ------
    SolveError
        A pole does not converge.
    """
    most_steps = 40
    converged = 1e-11
    aside = 1e-13  # relative step aside
    rounded = 1e-6  # relative step that may be rounding beside stiff supports, if it does not fall any more
    found, shapes = np.empty(start.size, complex), np.empty(vectors.shape, complex)
    for r, given in enumerate(start):
        s, x = complex(given), vectors[:, r].astype(complex)
        v, last = x.conj(), np.inf  # real modes are their own left vectors
        for _ in range(most_steps):
            slope = of.slope(s)
            try:
                u = np.linalg.solve(of.at(s), slope @ x)  # at the pole nearly singular, and meant to be
            except np.linalg.LinAlgError:  # the pole to the last bit
                s *= 1.0 + aside
                u = np.linalg.solve(of.at(s), slope @ x)
            gain = (v @ u) / (v @ x)
            s, x = s - 1.0 / gain, u / gain
            step = abs(1.0 / gain)
            if step < converged * abs(s) or last <= step < rounded * abs(s):
                break
            last = step
        else:
            raise SolveError(f"the damped mode near {abs(given) / 2 / np.pi:.6g} Hz does not converge")
        found[r], shapes[:, r] = s, x
    return found, shapes


def receptance(of: Dynamics, frequency: Reals, rows: Reals, force: Reals) -> Complexes:
    """Return receptances, (n_output, n_frequency), to one force.

    Parameters
    ----------
    of : Dynamics
        The stack.
    frequency : (n_frequency,) float
        Lines, Hz.
    rows : (n_output, n) float
        Observed displacements in reduced coordinates.
    force : (n,) float
        The unit force in reduced coordinates.
    """
    return np.asarray(rows @ np.array([np.linalg.solve(of.at(s), force) for s in 2j * np.pi * frequency]).T)


def loaded_response(
    of: Dynamics, clean: Complexes, frequency: Reals, sensors: Observed, run: Integers, mass: float
) -> Complexes:
    """Return receptances of roving sensors that load the stack where they stand, run by run.

    With the unloaded receptances H_ss between the sensors' degrees of freedom of a run and H_sf to the force,
    the loaded ones are (I - omega**2 m H_ss)^-1 H_sf: a mass is a modification of low rank.

    Parameters
    ----------
    of : Dynamics
        The unloaded stack.
    clean : (n, n_frequency) complex
        Unloaded receptances to the one force, at the degrees of freedom of `sensors`.
    frequency : (n_frequency,) float
        Lines, Hz.
    sensors : Observed
        All degrees of freedom in which sensors move: x, y and z at each point.
    run : (n,) int
        Run of each of them.
    mass : float
        Mass of one sensor, kg.

    Returns
    -------
    (n, n_frequency) complex
    """
    lines_at_once = 128
    rows = sensors.reduced_rows
    groups = [np.flatnonzero(run == number) for number in np.unique(run)]
    value = clean.copy()
    for first in range(0, frequency.size, lines_at_once):
        omega = 2.0 * np.pi * frequency[first : first + lines_at_once]
        stiffness = np.stack([of.at(1j * line) for line in omega])
        flexibility = np.linalg.solve(stiffness, np.broadcast_to(rows.T, (omega.size, *rows.T.shape)))
        for group in groups:
            flexible = rows[group] @ flexibility[:, :, group]
            system = np.eye(group.size) - (omega**2 * mass)[:, None, None] * flexible
            here = value[group, first : first + omega.size].T[:, :, None]
            value[group, first : first + omega.size] = np.linalg.solve(system, here)[:, :, 0].T
    return value


@dataclass(frozen=True, eq=False, kw_only=True)
class TrueModes:
    """The true elastic modes of one configuration, damped, at the measured DOFs.

    Attributes
    ----------
    frequency, damping : (n_mode,) float
        abs(pole) / 2 pi, Hz, and -Re(pole) / abs(pole) of the stack with the shaker's parts and without
        accelerometers.
    shape : (n_dof, n_mode) float
        Mass-normalised shapes, 1/sqrt(kg), of the undamped stack.
    node : (n_dof,) int
        Point numbers.
    direction : (n_dof, 3) float
        Directions.
    run_frequency, run_damping : (n_run, n_mode) float
        The same with the accelerometers where they stand in each run.
    tested_frequency, tested_damping : (n_mode,) float
        Means over the runs: what one pole for all runs stands for.
    strength : (n_mode,) float
        Largest accelerance at resonance, (m/s2)/N; weak ones do not show in FRFs.
    """

    frequency: Reals
    damping: Reals
    shape: Reals
    node: Integers
    direction: Reals
    run_frequency: Reals
    run_damping: Reals
    tested_frequency: Reals
    tested_damping: Reals
    strength: Reals

    def visible(self, band: tuple[float, float]) -> Booleans:
        """Return which modes lie in a band, Hz, and show in its FRFs, (n_mode,)."""
        # of the strongest resonance; modes that move across the sensors or rest at the shaker are weaker
        visible = 0.01
        inside = (self.tested_frequency > band[0]) & (self.tested_frequency < band[1])
        return inside & (self.strength > visible * self.strength[inside].max(initial=0.0))


def simulate(test: VirtualTest) -> dict[str, tuple[FRF, TrueModes]]:
    """Compute the noisy FRFs and the true modes of every configuration.

    Two accelerometers rove: in run i they stand on the points 2i + 1 and 2i + 2 of the geometry, both in +z.
    The FRFs hold their mass in all three directions.

    With averaging, noise is drawn line by line: the spectra of force and response of every record get complex
    normal noise, and H1 and coherence are estimated from them. This is no approximation of what happens in
    time: the force is burst random that dies out within the record, so there is neither leakage nor need of
    a window, and the transform of white noise over a rectangular window is independent from line to line.
    """
    rng = np.random.default_rng(test.seed)
    simulated = {}
    for specimen in specimens(test):
        system = model.reduce(specimen.stack, n_mode=N_MODE)
        true = true_modes(test, specimen, system)
        clean = _clean(test, specimen, system)
        coherence = None
        if test.averaging is None:
            value = clean + _noise(rng, clean, test.noise)
        else:
            value, coherence = _estimated(rng, clean, runs_of(specimen), test.averaging)
        node = specimen.output.node
        simulated[specimen.configuration.name] = (
            FRF(
                frequency=test.frequency,
                value=value,
                quantity="accelerance",
                output=Dofs(node=node, direction=specimen.output.direction),
                input=Dofs(node=specimen.shaker.node, direction=specimen.shaker.direction),
                run=runs_of(specimen),
                source=tuple(f"virtual test, point {n}" for n in node),
                coherence=coherence,
            ),
            true,
        )
    return simulated


def true_modes(test: VirtualTest, specimen: Specimen, system: ReducedSystem) -> TrueModes:
    """Return the true modes of a specimen whose reduced equations are `system`."""
    c = specimen.configuration
    modes = model.solve_modes(system, G_f=c.G_f, d_f=c.d_f, n_mode=N_MODE, observation=specimen.output, by=()).elastic()
    bare = _with_shaker(test, specimen, system)
    start = 2.0 * np.pi * modes.frequency * (-modes.damping + 1j * np.sqrt(1.0 - modes.damping**2))
    pole, vector = poles(bare, start, modes.coordinate)
    drive = model.observe(system, specimen.shaker).reduced_rows @ modes.coordinate
    run = runs_of(specimen)
    run_pole = np.tile(pole, (run.max() + 1, 1))
    if test.sensor_mass > 0.0:
        rows = model.observe(system, _sensors(specimen)).reduced_rows
        if test.dummy_masses:
            run_pole[:] = poles(bare.with_parts(rows, test.sensor_mass), pole, vector.real)[0]
        for k, row in enumerate(run_pole if not test.dummy_masses else ()):
            moving = rows[np.repeat(run, 3) == k]
            row[:] = poles(bare.with_parts(moving, test.sensor_mass), pole, vector.real)[0]
    damping = -run_pole.real / np.abs(run_pole)
    frequency = np.abs(run_pole) / (2.0 * np.pi)
    return TrueModes(
        frequency=np.abs(pole) / (2.0 * np.pi),
        damping=-pole.real / np.abs(pole),
        shape=modes.shape,
        node=modes.node,
        direction=modes.direction,
        run_frequency=frequency,
        run_damping=damping,
        tested_frequency=frequency.mean(axis=0),
        tested_damping=damping.mean(axis=0),
        strength=np.abs(modes.shape).max(axis=0) * np.abs(drive[0]) / (2.0 * np.maximum(modes.damping, 1e-6)),
    )


def runs_of(specimen: Specimen) -> Integers:
    """Return the run in which each output is measured, (n_output,)."""
    return np.arange(specimen.output.node.size) // 2


def _sensors(specimen: Specimen) -> Observation:
    """All translations of the accelerometers: x, y, z of each point in turn."""
    output, n = specimen.output, specimen.output.node.size
    return Observation(
        node=np.repeat(output.node, 3),
        location=np.repeat(output.location, 3, axis=0),
        direction=np.tile(np.eye(3), (n, 1)),
    )


def _with_shaker(test: VirtualTest, specimen: Specimen, system: ReducedSystem) -> Dynamics:
    """Return the equations of motion with the shaker's moving parts."""
    at = specimen.shaker
    driven = Observation(node=np.repeat(at.node, 3), location=np.repeat(at.location, 3, axis=0), direction=np.eye(3))
    rows = model.observe(system, driven).reduced_rows
    of = dynamics(system, system.theta)
    return of.with_parts(rows, test.force_cell_mass).with_parts(rows[:2], 0.0, test.stinger_stiffness)


def _clean(test: VirtualTest, specimen: Specimen, system: ReducedSystem) -> Complexes:
    """Return accelerances without noise, (n_output, 1, n_frequency), the mass of shaker and sensors included."""
    c, frequency = specimen.configuration, test.frequency
    if not (test.sensor_mass or test.force_cell_mass or test.stinger_stiffness):
        return model.frf(
            system, G_f=c.G_f, d_f=c.d_f, frequency=frequency, output=specimen.output, input=specimen.shaker
        )
    # Without attachment modes at the shaker, whose little flexibility would part these FRFs from the true poles.
    of, sensors = _with_shaker(test, specimen, system), model.observe(system, _sensors(specimen))
    if test.dummy_masses:
        of = of.with_parts(sensors.reduced_rows, test.sensor_mass)
    force = model.observe(system, specimen.shaker).reduced_rows[0]
    response = receptance(of, frequency, sensors.reduced_rows, force)
    if test.sensor_mass > 0.0 and not test.dummy_masses:
        run = np.repeat(runs_of(specimen), 3)
        response = loaded_response(of, response, frequency, sensors, run, test.sensor_mass)
    return -((2.0 * np.pi * frequency) ** 2) * response[2::3, None]


def _noise(rng: np.random.Generator, clean: Complexes, level: float) -> Complexes:
    """Complex white noise; `level` is its standard deviation over the root mean square of each FRF."""
    rms = np.sqrt(np.mean(np.abs(clean) ** 2, axis=-1, keepdims=True))
    return level * rms * _normal(rng, clean.shape)


def _normal(rng: np.random.Generator, shape: tuple[int, ...]) -> Complexes:
    """Complex normal numbers of unit variance."""
    real, imaginary = rng.standard_normal((2, *shape))
    return np.asarray((real + 1j * imaginary) / np.sqrt(2))


def _estimated(
    rng: np.random.Generator, clean: Complexes, run: Integers, averaging: Averaging
) -> tuple[Complexes, Reals]:
    """H1 and coherence, (n_output, 1, n_frequency), from records of unit force; a run's outputs share its records."""
    floor = averaging.response_noise * np.sqrt(np.mean(np.abs(clean) ** 2))
    value, coherence = np.empty_like(clean), np.empty(clean.shape)
    n_line = clean.shape[-1]
    for k in np.unique(run):
        of = run == k
        force = _normal(rng, (averaging.n_average, 1, n_line))
        response = clean[None, of, 0] * force
        response = response + floor * _normal(rng, response.shape)
        force = force + averaging.force_noise * _normal(rng, force.shape)
        cross = np.mean(response * force.conj(), axis=0)
        power = np.mean(np.abs(force) ** 2, axis=0)
        value[of, 0] = cross / power
        coherence[of, 0] = np.abs(cross) ** 2 / power / np.mean(np.abs(response) ** 2, axis=0)
    return value, coherence


_HEADER = ("re", "im", "coherence")


@dataclass(frozen=True, eq=False, kw_only=True)
class Truth:
    """What a virtual test was simulated with, for those who score an identification, a fit or a diagnosis afterwards.

    Attributes
    ----------
    configurations : tuple of VirtualConfiguration
        True torques, pressures and contact parameters.
    modes : tuple of TrueModes
        The true elastic modes of each configuration at the measured DOFs.
    band : (float, float)
        First and last frequency line, Hz.
    seed : int
        Seed of the noise and of what was drawn.
    effects : tuple of str
        Physical effects that the stack file lacks.
    effect_values : mapping of str to float
        Values of all parameters of the effects, those of the shaker's own parts too.
    deviation : mapping of str to tuple of float
        True values over nominal, less one, given or drawn.
    """

    configurations: tuple[VirtualConfiguration, ...]
    modes: tuple[TrueModes, ...]
    band: tuple[float, float]
    seed: int
    effects: tuple[str, ...]
    effect_values: Mapping[str, float]
    deviation: Mapping[str, tuple[float, ...]]


def write_virtual_test(test: VirtualTest, folder: Path) -> None:
    """Simulate a test and write its campaign: FRF files, points, stack file, campaign file, and the truth.

    Raises
    ------
    StoreError
        The folder cannot be written.
    """
    simulated = simulate(test)
    write_bytes(folder / "points.csv", _points_text(test.geometry).encode())
    for name, (frf, _) in simulated.items():
        (folder / name).mkdir(parents=True, exist_ok=True)
        for run in np.unique(frf.run):
            path = folder / name / f"run_{run + 1:02d}.{test.file_format}"
            if test.file_format == "uff":
                write_uff(path, test.geometry, frf.outputs(frf.run == run))
            else:
                write_bytes(path, _table_text(frf.outputs(frf.run == run)).encode())
    bench = specimens(test)
    truth = Truth(
        configurations=tuple(specimen.configuration for specimen in bench),
        modes=tuple(true for _, true in simulated.values()),
        band=test.band,
        seed=test.seed,
        effects=tuple(effect.name for effect in test.effects),
        effect_values=dict(bench[0].stack.effect_values),
        deviation=drawn_deviations(test),
    )
    write_result(folder / "truth.json", truth, inputs=(test.source,), options={})
    stack_file = test.source.parent / test.stack_file
    for source, name in _stack_files(stack_file):
        if source.resolve() != (folder / name).resolve():
            write_bytes(folder / name, source.read_bytes())
    write_bytes(folder / "campaign.toml", _campaign_text(test, simulated).encode())


def _stack_files(stack_file: Path) -> Iterator[tuple[Path, str]]:
    """Yield the stack file and the files that it names, each with its place beside the campaign."""
    yield stack_file, stack_file.name

    def texts(value: Any) -> Iterator[str]:
        if isinstance(value, str):
            yield value
        elif isinstance(value, dict | list):
            for part in value.values() if isinstance(value, dict) else value:
                yield from texts(part)

    for text in texts(read_toml(stack_file)):
        if Path(text).suffix and (stack_file.parent / text).is_file():
            yield stack_file.parent / text, text


def _points_text(geometry: Geometry) -> str:
    rows = (
        f"{n},{','.join(f'{1e3 * c:.3f}' for c in location)}"
        for n, location in zip(geometry.node, geometry.coordinate, strict=True)
    )
    return "\n".join(("node,x,y,z", *rows, ""))


def _table_text(frf: FRF) -> str:
    """Frequency, then real part, imaginary part and, where there is one, coherence of each function."""
    columns, head = [np.char.mod("%.10g", frf.frequency)], ["Hz"]
    for i in range(frf.output.node.size):
        parts = [np.char.mod("%.4e", part) for part in (frf.value[i, 0].real, frf.value[i, 0].imag)]
        if frf.coherence is not None:
            parts.append(np.char.mod("%.5f", frf.coherence[i, 0]))
        columns += parts
        head += [f"{frf.output.name(i)} {what}" for what in _HEADER[: len(parts)]]
    rows = (",".join(row) for row in zip(*columns, strict=True))
    return "\n".join((",".join(head), *rows, ""))


def _campaign_text(test: VirtualTest, simulated: Mapping[str, tuple[FRF, TrueModes]]) -> str:
    lines = ", ".join(f"[{a}, {b}]" for a, b in test.geometry.line)
    head = f"""[campaign]
name = {json.dumps(test.name, ensure_ascii=False)}

[structure]
stack = "{Path(test.stack_file).name}"        # the model's stack file: planform, steel, contact, clamps

[points]
file = "points.csv"          # node,x,y,z with the origin in the centre of the stack, z in stacking direction
unit = "mm"
lines = [{lines}]            # trace lines, for drawing
"""
    csv = test.file_format == "csv"
    what = "one universal file a run: two roving accelerometers over the shaker's force"
    return (
        head
        + (_table_section(test) if csv else "")
        + "".join(
            f"""
[[configuration]]
name = "{c.name}"
torque_Nm = {c.torque:g}
pressure_kPa = {c.pressure / 1e3:g}
"""
            + (_run_tables(c.name, simulated[c.name][0]) if csv else f'files = ["{c.name}/run_*.uff"]   # {what}\n')
            for c in test.configurations
        )
    )


def _table_section(test: VirtualTest) -> str:
    coherent = test.averaging is not None
    columns, coherence = ("[[2, 3], [5, 6]]", "[4, 7]") if coherent else ("[[2, 3], [4, 5]]", "[]")
    return f"""
[measurement]
format = "csv"
unit = "(m/s2)/N"

[measurement.table]
layout = "real-imaginary"
header_rows = 1
columns = {columns}  # of the two accelerometers
coherence_columns = {coherence}
"""


def _run_tables(name: str, frf: FRF) -> str:
    return "".join(
        f"""
[[configuration.run]]
files = ["{name}/run_{run + 1:02d}.csv"]
output = [{", ".join(f'"{frf.output.name(int(i))}"' for i in np.flatnonzero(frf.run == run))}]
input = ["{frf.input.name(0)}"]
"""
        for run in np.unique(frf.run)
    )
