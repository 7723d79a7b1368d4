"""The file that describes a virtual test (TOML): its keys, and what is said when they are wrong."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

import model
from ema.io.files import Section, read_form
from ema.types.geometry import Geometry
from model import Contact, Effect, Mesh, Observation
from updating.errors import FitError
from updating.virtual.vibration_test import Averaging, VirtualConfiguration, VirtualTest, four_edge_points


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
                name: tuple(value) if isinstance(value, list) else (value,)
                for name, value in given.deviation.items()
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
        message = f"{path}: {error}"
        raise FitError(message) from error


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
    return Averaging(
        n_average=given.averages, force_noise=given.force_noise, response_noise=given.response_noise
    )


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
                message = f"{path}: effect {effect.name}: no parameter {name!r}; it has {', '.join(allowed)}"
                raise FitError(message)
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
            message = (
                "give either 'noise', of the FRFs, or 'averages' with 'force_noise' and 'response_noise'"
            )
            raise ValueError(message)
        if self.averages is None and (self.force_noise or self.response_noise):
            message = "'force_noise' and 'response_noise' belong to 'averages'"
            raise ValueError(message)
        if not 0 < self.band_Hz[0] < self.band_Hz[1]:
            message = f"band_Hz must be [lower, upper] with 0 < lower < upper, found {list(self.band_Hz)}"
            raise ValueError(message)
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
