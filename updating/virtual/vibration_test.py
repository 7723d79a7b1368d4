"""A vibration test that never was: what it is made of, and the file that states it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

import model
from ema.io.files import Section
from ema.types.frf import Geometry
from lamella_shared import Reals, read_form
from model import Contact, Effect, Instruments, Mesh, Observation, Stack
from updating.errors import FitError

STRUCTURE = ("young", "density", "length", "width", "height", "G_f", "d_f")
"""Deviations of the structure: one number for all configurations."""

ASSEMBLY = ("torque", "reassembly")
"""Deviations of each assembly: pressure by the error of the torque wrench, G_f by the scatter of reassembly."""


@dataclass(frozen=True, eq=False, kw_only=True)
class VirtualConfiguration:
    """One stack state to be tested: bolt torque (N m), pressure (Pa) and the contact parameters."""

    name: str
    torque: float
    pressure: float
    G_f: float
    d_f: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Averaging:
    """How the analyser estimates FRFs, H1 with coherence, from records of a burst-random force.

    Attributes
    ----------
    n_average : int
        Number of records.
    force_noise : float
        Noise of the force channel over the force, both as root mean squares over the band.
    response_noise : float
        Noise floor of the accelerometers over the root mean square response of all points and lines.
    """

    n_average: int
    force_noise: float
    response_noise: float


@dataclass(frozen=True, eq=False, kw_only=True)
class VirtualTest:
    """A test to be simulated.

    Attributes
    ----------
    name : str
        The campaign's name.
    source : Path
        The file that describes the test.
    stack_file : str
        The model's stack file, relative to that file.
    stack : Stack
        The nominal stack with the test's own, finer mesh.
    geometry : Geometry
        Measured points and the shaker's point, on the nominal stack.
    shaker : Observation
        Force DOF.
    band : (float, float)
        First and last frequency line, Hz.
    step : float
        Line spacing, Hz.
    noise : float
        Without averaging: standard deviation of the noise on each FRF as a ratio to that FRF's root mean
        square over the band.
    seed : int
        Seed of the noise and of what is drawn.
    configurations : tuple of VirtualConfiguration
        What is tested, as the operator believes.
    effects : tuple of Effect
        Physical effects that the user's stack file lacks.
    effect_values : mapping of str to float
        Values of their parameters; the others are nominal.
    deviation : mapping of str to tuple of float
        True values over nominal, less one: one value for names of `STRUCTURE`, one a configuration for
        names of `ASSEMBLY`.
    spread : mapping of str to float
        Standard deviations from which the seed draws further ones.
    sensor_mass : float
        Mass of each of the two roving accelerometers, kg.
    dummy_masses : bool
        Whether dummies of that mass stand on all points where no accelerometer is, so that all runs see the
        same structure.
    force_cell_mass : float
        Mass between the force cell's crystal and the stack, kg.
    stinger_stiffness : float
        Lateral stiffness of the stinger, N/m.
    averaging : Averaging or None
        How FRFs are estimated; None puts `noise` on them as they are.
    file_format : "uff" or "csv"
        What the FRFs are written to.
    """

    name: str
    source: Path
    stack_file: str
    stack: Stack
    geometry: Geometry
    shaker: Observation
    band: tuple[float, float]
    step: float
    noise: float
    seed: int
    configurations: tuple[VirtualConfiguration, ...]
    effects: tuple[Effect, ...] = ()
    effect_values: Mapping[str, float] = field(default_factory=dict)
    deviation: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    spread: Mapping[str, float] = field(default_factory=dict)
    sensor_mass: float = 0.0
    dummy_masses: bool = False
    force_cell_mass: float = 0.0
    stinger_stiffness: float = 0.0
    averaging: Averaging | None = None
    file_format: Literal["uff", "csv"] = "uff"

    def __post_init__(self) -> None:
        n = {**dict.fromkeys(STRUCTURE, 1), **dict.fromkeys(ASSEMBLY, len(self.configurations))}
        for name in (*self.deviation, *self.spread):
            if name not in n:
                raise FitError(f"deviation {name!r}: unknown; there are {', '.join(n)}")
            if name in self.deviation and name in self.spread:
                raise FitError(f"deviation {name!r}: either given or drawn from a spread, not both")
        for name, values in self.deviation.items():
            if len(values) != n[name]:
                raise FitError(f"deviation {name!r}: needs {n[name]} value(s), got {len(values)}")

    @property
    def frequency(self) -> Reals:
        """Frequency lines, Hz."""
        return np.arange(self.band[0], self.band[1] + self.step / 2, self.step)


@dataclass(frozen=True, eq=False, kw_only=True)
class Specimen:
    """What truly stands on the bench in one configuration.

    Attributes
    ----------
    configuration : VirtualConfiguration
        True pressure and contact parameters.
    stack : Stack
        The true stack with its effects and instruments.
    output : Observation
        The measured DOFs.
    shaker : Observation
        The force DOF.
    """

    configuration: VirtualConfiguration
    stack: Stack
    output: Observation
    shaker: Observation


def drawn_deviations(test: VirtualTest) -> dict[str, tuple[float, ...]]:
    """Return all deviations of a test: those given, and those that the seed draws, normally distributed."""
    draws = 1  # stream of random numbers of what is tested; noise has one of its own
    rng = np.random.default_rng([draws, test.seed])
    found = dict(test.deviation)
    for name in (*STRUCTURE, *ASSEMBLY):  # in an order of its own, so that the file's does not matter
        size = len(test.configurations) if name in ASSEMBLY else 1
        values = rng.standard_normal(size)
        if name in test.spread:
            found[name] = tuple(float(v) for v in test.spread[name] * values)
    return found


def specimens(test: VirtualTest) -> tuple[Specimen, ...]:
    """Return what truly stands on the bench, configuration by configuration."""
    deviation = drawn_deviations(test)

    def factor(name: str, i: int = 0) -> float:
        return 1.0 + deviation[name][i] if name in deviation else 1.0

    nominal = test.stack
    if nominal.outline is not None and {"length", "width"} & set(deviation):
        raise FitError("deviations of length and width need a rectangular plan; an outline has its own size")
    size = np.array([factor("length"), factor("width"), factor("height")])
    stack = replace(
        nominal,
        length=size[0] * nominal.length,
        width=size[1] * nominal.width,
        height=size[2] * nominal.height,
        material=replace(
            nominal.material,
            young=factor("young") * nominal.material.young,
            density=factor("density") * nominal.material.density,
        ),
    )
    location = size * test.geometry.coordinate
    at_shaker = test.geometry.node == test.shaker.node[0]
    stack = replace(stack, instruments=Instruments(shaker=tuple(location[at_shaker][0]), sensor=location[~at_shaker]))
    stack = _with_effects(test, stack)
    node = test.geometry.node[~at_shaker]
    output = Observation(
        node=node,
        location=model.sample_points(stack, location[~at_shaker])[0],
        direction=np.tile([0.0, 0.0, 1.0], (node.size, 1)),
    )
    shaker = replace(test.shaker, location=model.sample_points(stack, location[at_shaker])[0])
    found = []
    for i, given in enumerate(test.configurations):
        true = replace(
            given,
            torque=given.torque * factor("torque", i),
            pressure=given.pressure * factor("torque", i),
            G_f=given.G_f * factor("G_f") * factor("reassembly", i),
            d_f=given.d_f * factor("d_f"),
        )
        pressed = stack.with_contact(pressure=true.pressure, G_f=true.G_f, d_f=true.d_f)
        found.append(Specimen(configuration=true, stack=pressed, output=output, shaker=shaker))
    return tuple(found)


def _with_effects(test: VirtualTest, stack: Stack) -> Stack:
    """Add the effects at their strengths."""
    if not test.effects:
        return stack
    nominal = {p.name: p.nominal for effect in test.effects for p in effect.parameters}
    return stack.with_effects(*test.effects, **{**nominal, **test.effect_values})


def four_edge_points(stack: Stack, n_station: int) -> Geometry:
    """Return points on the four long edges of the stack with trace lines along, across and over the height.

    Points 1, 2, ... run along x, station by station; at each station the top edges at -y and +y come first, then the
    bottom edges. Eleven stations make the 44 points of the paper's test.
    """
    x = np.linspace(-0.5, 0.5, n_station) * stack.length
    corner = np.array([[-0.5, 0.5], [0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]]) * [stack.width, stack.height]
    coordinate = np.array([[xi, y, z] for xi in x for y, z in corner])
    node = np.arange(1, len(coordinate) + 1)
    along = [(4 * i + c, 4 * (i + 1) + c) for i in range(n_station - 1) for c in range(4)]
    around = [(4 * i + a, 4 * i + b) for i in range(n_station) for a, b in ((0, 1), (1, 3), (3, 2), (2, 0))]
    return Geometry(node=node, coordinate=coordinate, line=np.array(along + around) + 1)


def read_virtual_test(path: Path, effect_files: Iterable[Path] = ()) -> VirtualTest:
    """Read the description of a virtual test (TOML) and the stack file that it names.

    Parameters
    ----------
    path : Path
        The file.
    effect_files : iterable of Path
        Python files with effects of the user's own, beside those that the file names.

    Raises
    ------
    FitError
        The file is missing, is not TOML, or has a key that is unknown, missing or impossible.
    ModelError
        The stack file or an effect cannot be read, or there is no effect of a name.
    """
    given = read_form(path, VirtualTestFile, FitError)
    stack = replace(
        model.read_stack(path.parent / given.structure.stack),
        mesh=Mesh(n_x=given.structure.mesh[0], n_y=given.structure.mesh[1]),
    )
    geometry = _with_shaker(four_edge_points(stack, given.points.n_station), given.shaker.place_mm)
    effects, values = _effects(given.effect, path, effect_files)
    measurement = given.measurement
    try:
        return VirtualTest(
            name=given.campaign.name,
            source=path,
            stack_file=given.structure.stack,
            stack=stack,
            geometry=geometry,
            shaker=Observation(
                node=geometry.node[-1:],
                location=model.sample_points(stack, geometry.coordinate[-1:])[0],
                direction=np.array([[0.0, 0.0, 1.0]]),
            ),
            band=measurement.band_Hz,
            step=measurement.step_Hz,
            noise=0.0 if measurement.noise is None else measurement.noise,
            seed=measurement.seed,
            configurations=tuple(_in_si(c, stack.contact) for c in given.configuration),
            effects=effects,
            effect_values=values,
            deviation={
                name: tuple(value) if isinstance(value, list) else (value,) for name, value in given.deviation.items()
            },
            spread=given.spread,
            sensor_mass=1e-3 * measurement.sensor_mass_g,
            dummy_masses=measurement.dummy_masses,
            force_cell_mass=1e-3 * given.shaker.force_cell_mass_g,
            stinger_stiffness=given.shaker.stinger_N_m,
            averaging=_averaging(measurement),
            file_format=measurement.format,
        )
    except FitError as error:
        raise FitError(f"{path}: {error}") from error


def _with_shaker(edges: Geometry, place_mm: Sequence[float]) -> Geometry:
    """Return the sensors' points and, as the last one, that of the shaker."""
    return Geometry(
        node=np.append(edges.node, edges.node.size + 1),
        coordinate=np.vstack([edges.coordinate, [[1e-3 * c for c in place_mm]]]),
        line=edges.line,
    )


def _in_si(given: _Configuration, contact: Contact) -> VirtualConfiguration:
    return VirtualConfiguration(
        name=given.name,
        torque=given.torque_Nm,
        pressure=1e3 * given.pressure_kPa,
        G_f=contact.G_f if given.G_f is None else given.G_f,
        d_f=contact.d_f if given.d_f_s_per_Pa is None else given.d_f_s_per_Pa,
    )


def _averaging(given: _Measurement) -> Averaging | None:
    if given.averages is None:
        return None
    return Averaging(n_average=given.averages, force_noise=given.force_noise, response_noise=given.response_noise)


def _effects(
    given: tuple[_Effect, ...], path: Path, effect_files: Iterable[Path]
) -> tuple[tuple[Effect, ...], Mapping[str, float]]:
    """Return the effects of the file and their values."""
    effects = model.find_effects([e.name for e in given], model.catalogue(effect_files))
    values: dict[str, float] = {}
    for entry, effect in zip(given, effects, strict=True):
        allowed = [p.name for p in effect.parameters]
        for name, value in entry.values.items():
            if name not in allowed:
                raise FitError(f"{path}: effect {effect.name}: no parameter {name!r}; it has {', '.join(allowed)}")
            values[name] = value
    return effects, values


class _Name(Section):
    name: str


class _Structure(Section):
    stack: str
    mesh: tuple[int, int]


class _Points(Section):
    n_station: Annotated[int, Field(ge=2, le=1000)]


_Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]


class _Shaker(Section):
    place_mm: tuple[_Coordinate, _Coordinate, _Coordinate]
    force_cell_mass_g: Annotated[float, Field(ge=0)] = 0.0
    stinger_N_m: Annotated[float, Field(ge=0)] = 0.0


class _Measurement(Section):
    band_Hz: tuple[float, float]
    step_Hz: Annotated[float, Field(gt=0)]
    seed: Annotated[int, Field(ge=0)]
    noise: Annotated[float, Field(ge=0)] | None = None
    averages: Annotated[int, Field(ge=2)] | None = None
    force_noise: Annotated[float, Field(ge=0)] = 0.0
    response_noise: Annotated[float, Field(ge=0)] = 0.0
    sensor_mass_g: Annotated[float, Field(ge=0)] = 0.0
    dummy_masses: bool = False
    format: Literal["uff", "csv"] = "uff"

    @model_validator(mode="after")
    def _one_kind_of_noise(self) -> _Measurement:
        if (self.noise is None) == (self.averages is None):
            raise ValueError("give either 'noise', of the FRFs, or 'averages' with 'force_noise' and 'response_noise'")
        if self.averages is None and (self.force_noise or self.response_noise):
            raise ValueError("'force_noise' and 'response_noise' belong to 'averages'")
        if not 0 < self.band_Hz[0] < self.band_Hz[1]:
            raise ValueError(f"band_Hz must be [lower, upper] with 0 < lower < upper, found {list(self.band_Hz)}")
        return self


class _Configuration(Section):
    name: str
    torque_Nm: Annotated[float, Field(gt=0)]
    pressure_kPa: Annotated[float, Field(gt=0)]
    G_f: Annotated[float, Field(gt=0)] | None = None
    d_f_s_per_Pa: Annotated[float, Field(ge=0)] | None = None


class _Effect(Section):
    name: str
    values: dict[str, float] = Field(default_factory=dict)


class VirtualTestFile(Section):
    """The form of the whole file."""

    campaign: _Name
    structure: _Structure
    points: _Points
    shaker: _Shaker
    measurement: _Measurement
    configuration: Annotated[tuple[_Configuration, ...], Field(min_length=1)]
    effect: tuple[_Effect, ...] = ()
    deviation: dict[str, float | list[float]] = Field(default_factory=dict)
    spread: dict[str, Annotated[float, Field(ge=0)]] = Field(default_factory=dict)
