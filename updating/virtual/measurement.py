"""Playing a virtual test: true modes, and FRFs with sensors' mass and noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import model
from ema.types.frf import FRF
from ema.types.geometry import Dofs
from model import Observation, ReducedSystem
from updating.virtual.dynamics import Dynamics, dynamics, loaded_response, poles, receptance
from updating.virtual.vibration_test import Averaging, Specimen, VirtualTest, specimens

N_MODE = 22
"""Modes that are computed, the rigid-body modes included."""
_VISIBLE = (
    0.01  # of the strongest resonance; modes that move across the sensors or rest at the shaker are weaker
)


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

    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]
    shape: NDArray[np.float64]
    node: NDArray[np.int64]
    direction: NDArray[np.float64]
    run_frequency: NDArray[np.float64]
    run_damping: NDArray[np.float64]
    tested_frequency: NDArray[np.float64]
    tested_damping: NDArray[np.float64]
    strength: NDArray[np.float64]

    def visible(self, band: tuple[float, float]) -> NDArray[np.bool_]:
        """Return which modes lie in a band, Hz, and show in its FRFs, (n_mode,)."""
        inside = (self.tested_frequency > band[0]) & (self.tested_frequency < band[1])
        return inside & (self.strength > _VISIBLE * self.strength[inside].max(initial=0.0))


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
    modes = model.solve_modes(
        system, G_f=c.G_f, d_f=c.d_f, n_mode=N_MODE, observation=specimen.output, by=()
    ).elastic()
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
            own = rows[np.repeat(run, 3) == k]
            row[:] = poles(bare.with_parts(own, test.sensor_mass), pole, vector.real)[0]
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


def runs_of(specimen: Specimen) -> NDArray[np.int64]:
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


def _driving_point(specimen: Specimen) -> Observation:
    """All translations of the driving point."""
    at = specimen.shaker
    return Observation(
        node=np.repeat(at.node, 3), location=np.repeat(at.location, 3, axis=0), direction=np.eye(3)
    )


def _with_shaker(test: VirtualTest, specimen: Specimen, system: ReducedSystem) -> Dynamics:
    """Return the equations of motion with the shaker's moving parts."""
    rows = model.observe(system, _driving_point(specimen)).reduced_rows
    of = dynamics(system, system.theta)
    return of.with_parts(rows, test.force_cell_mass).with_parts(rows[:2], 0.0, test.stinger_stiffness)


def _clean(test: VirtualTest, specimen: Specimen, system: ReducedSystem) -> NDArray[np.complex128]:
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


def _noise(rng: np.random.Generator, clean: NDArray[np.complex128], level: float) -> NDArray[np.complex128]:
    """Complex white noise; `level` is its standard deviation over the root mean square of each FRF."""
    rms = np.sqrt(np.mean(np.abs(clean) ** 2, axis=-1, keepdims=True))
    return level * rms * _normal(rng, clean.shape)


def _normal(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.complex128]:
    """Complex normal numbers of unit variance."""
    real, imaginary = rng.standard_normal((2, *shape))
    return np.asarray((real + 1j * imaginary) / np.sqrt(2))


def _estimated(
    rng: np.random.Generator, clean: NDArray[np.complex128], run: NDArray[np.int64], averaging: Averaging
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
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
        own = np.mean(np.abs(force) ** 2, axis=0)
        value[of, 0] = cross / own
        coherence[of, 0] = np.abs(cross) ** 2 / own / np.mean(np.abs(response) ** 2, axis=0)
    return value, coherence
