"""A vibration test played on a model: noisy FRFs of two roving accelerometers, and the sealed truth beside them."""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

import model
from ema import write_uff
from ema.frf import FRF
from ema.geometry import Dofs, Geometry
from model import Mesh, Modes, Observation, Stack
from updating.errors import FitError
from updating.store import write_bytes, write_result


@dataclass(frozen=True, eq=False, kw_only=True)
class VirtualConfiguration:
    """One stack state to be tested: bolt torque (N m), pressure (Pa) and the true contact parameters."""

    name: str
    torque: float
    pressure: float
    G_f: float
    d_f: float


@dataclass(frozen=True, eq=False, kw_only=True)
class VirtualTest:
    """A test to be played.

    Attributes
    ----------
    name : str
        The campaign's name.
    source : Path
        The file that describes the test.
    stack_file : str
        The model's stack file, relative to that file.
    stack : Stack
        The stack with the test's own, finer mesh.
    geometry : Geometry
        Measured points and the shaker's point.
    shaker : Observation
        Force DOF.
    band : (float, float)
        First and last frequency line, Hz.
    step : float
        Line spacing, Hz.
    noise : float
        Standard deviation of the noise on each FRF as a ratio to that FRF's root mean square over the band.
    seed : int
        Seed of the noise.
    configurations : tuple of VirtualConfiguration
        What is tested.
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


@dataclass(frozen=True, eq=False, kw_only=True)
class Truth:
    """What a virtual test was played with, for those who score an identification or a fit afterwards.

    Attributes
    ----------
    configurations : tuple of VirtualConfiguration
        The true contact parameters.
    modes : tuple of Modes
        The true elastic modes of each configuration at the measured DOFs.
    band : (float, float)
        First and last frequency line, Hz.
    seed : int
        Seed of the noise.
    """

    configurations: tuple[VirtualConfiguration, ...]
    modes: tuple[Modes, ...]
    band: tuple[float, float]
    seed: int


def read_virtual_test(path: Path) -> VirtualTest:
    """Read the description of a virtual test (TOML) and the stack file that it names.

    Raises
    ------
    FitError
        The file is missing, is not TOML, or has a key that is unknown, missing or impossible.
    """
    try:
        given = _File.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        message = f"cannot read {path}: {error.strerror}"
        raise FitError(message) from error
    except tomllib.TOMLDecodeError as error:
        message = f"{path}: not valid TOML: {error}"
        raise FitError(message) from error
    except ValidationError as error:
        found = "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors())
        message = f"{path}: {found}"
        raise FitError(message) from error
    stack = replace(
        model.read_stack(path.parent / given.structure.stack),
        mesh=Mesh(n_x=given.structure.mesh[0], n_y=given.structure.mesh[1]),
    )
    edges = four_edge_points(stack, given.points.n_station)
    place = np.array([[1e-3 * c for c in given.shaker.place_mm]])
    geometry = Geometry(
        node=np.append(edges.node, edges.node.size + 1),
        coordinate=np.vstack([edges.coordinate, place]),
        line=edges.line,
    )
    return VirtualTest(
        name=given.campaign.name,
        source=path,
        stack_file=given.structure.stack,
        stack=stack,
        geometry=geometry,
        shaker=Observation(
            node=geometry.node[-1:],
            location=model.sample_points(stack, place)[0],
            direction=np.array([[0.0, 0.0, 1.0]]),
        ),
        band=given.measurement.band_Hz,
        step=given.measurement.step_Hz,
        noise=given.measurement.noise,
        seed=given.measurement.seed,
        configurations=tuple(
            VirtualConfiguration(
                name=c.name, torque=c.torque_Nm, pressure=1e3 * c.pressure_kPa, G_f=c.G_f, d_f=c.d_f_s_per_Pa
            )
            for c in given.configuration
        ),
    )


def write_virtual_test(test: VirtualTest, folder: Path) -> None:
    """Play a test and write its campaign: one universal file a run, the points, the campaign file, and the truth.

    Raises
    ------
    StoreError
        The folder cannot be written.
    """
    played = play(test)
    write_bytes(folder / "points.csv", _points_text(test.geometry).encode())
    for name, (frf, _) in played.items():
        (folder / name).mkdir(parents=True, exist_ok=True)
        for run in np.unique(frf.run):
            write_uff(folder / name / f"run_{run + 1:02d}.uff", test.geometry, _select(frf, frf.run == run))
    truth = Truth(
        configurations=test.configurations,
        modes=tuple(modes for _, modes in played.values()),
        band=test.band,
        seed=test.seed,
    )
    write_result(folder / "truth.json", truth, inputs=(test.source,), options={})
    write_bytes(folder / "campaign.toml", _campaign_text(test).encode())


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


def play(test: VirtualTest) -> dict[str, tuple[FRF, Modes]]:
    """Compute the noisy FRFs and the true modes of every configuration.

    Two accelerometers rove: in run i they stand on the points 2i + 1 and 2i + 2 of the geometry, both in +z.
    """
    rng = np.random.default_rng(test.seed)
    roving = test.geometry.node != test.shaker.node[0]
    node, location = test.geometry.node[roving], test.geometry.coordinate[roving]
    output = Observation(
        node=node,
        location=model.sample_points(test.stack, location)[0],
        direction=np.tile([0.0, 0.0, 1.0], (node.size, 1)),
    )
    frequency = np.arange(test.band[0], test.band[1] + test.step / 2, test.step)
    played = {}
    for c in test.configurations:
        system = model.reduce(test.stack.with_contact(pressure=c.pressure))
        clean = model.frf(
            system,
            G_f=c.G_f,
            d_f=c.d_f,
            frequency=frequency,
            output=output,
            input=test.shaker,
            quantity="accelerance",
        )
        played[c.name] = (
            FRF(
                frequency=frequency,
                value=clean + _noise(rng, clean, test.noise),
                quantity="accelerance",
                output=Dofs(node=node, direction=output.direction),
                input=Dofs(node=test.shaker.node, direction=test.shaker.direction),
                run=np.arange(node.size) // 2,
                source=tuple(f"virtual test, point {n}" for n in node),
            ),
            model.solve_modes(system, G_f=c.G_f, d_f=c.d_f, n_mode=22, observation=output).elastic(),
        )
    return played


def _noise(rng: np.random.Generator, clean: NDArray[np.complex128], level: float) -> NDArray[np.complex128]:
    """Complex white noise; `level` is its standard deviation over the root mean square of each FRF."""
    rms = np.sqrt(np.mean(np.abs(clean) ** 2, axis=-1, keepdims=True))
    real, imaginary = rng.standard_normal((2, *clean.shape))
    return level * rms * (real + 1j * imaginary) / np.sqrt(2)


def _select(frf: FRF, output: NDArray[np.bool_]) -> FRF:
    return replace(
        frf,
        value=frf.value[output],
        output=Dofs(node=frf.output.node[output], direction=frf.output.direction[output]),
        run=frf.run[output],
        source=tuple(s for s, chosen in zip(frf.source, output, strict=True) if chosen),
    )


def _points_text(geometry: Geometry) -> str:
    rows = (
        f"{n},{','.join(f'{1e3 * c:.3f}' for c in place)}"
        for n, place in zip(geometry.node, geometry.coordinate, strict=True)
    )
    return "\n".join(("node,x,y,z", *rows, ""))


def _campaign_text(test: VirtualTest) -> str:
    lines = ", ".join(f"[{a}, {b}]" for a, b in test.geometry.line)
    head = f"""[campaign]
name = {json.dumps(test.name, ensure_ascii=False)}

[structure]
stack = "{test.stack_file}"        # the model's stack file: planform, steel, contact, clamps

[points]
file = "points.csv"          # node,x,y,z with the origin in the centre of the stack, z in stacking direction
unit = "mm"
lines = [{lines}]            # trace lines, for drawing
"""
    parts = [
        f"""
[[configuration]]
name = "{c.name}"
torque_Nm = {c.torque:g}
pressure_kPa = {c.pressure / 1e3:g}
files = ["{c.name}/run_*.uff"]   # one universal file a run: two roving accelerometers over the shaker's force
"""
        for c in test.configurations
    ]
    return head + "".join(parts)


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Name(_Strict):
    name: str


class _Structure(_Strict):
    stack: str
    mesh: tuple[int, int]


class _Points(_Strict):
    n_station: Annotated[int, Field(ge=2)]


class _Shaker(_Strict):
    place_mm: tuple[float, float, float]


class _Measurement(_Strict):
    band_Hz: tuple[float, float]
    step_Hz: Annotated[float, Field(gt=0)]
    noise: Annotated[float, Field(ge=0)]
    seed: int


class _Configuration(_Strict):
    name: str
    torque_Nm: Annotated[float, Field(gt=0)]
    pressure_kPa: Annotated[float, Field(gt=0)]
    G_f: Annotated[float, Field(gt=0)]
    d_f_s_per_Pa: Annotated[float, Field(ge=0)]


class _File(_Strict):
    campaign: _Name
    structure: _Structure
    points: _Points
    shaker: _Shaker
    measurement: _Measurement
    configuration: Annotated[list[_Configuration], Field(min_length=1)]
