"""The files of a virtual test: what a laboratory would hand over, and the sealed truth."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ema import write_uff
from ema.types.frf import FRF
from ema.types.geometry import Geometry
from model.stack.stack_file import read_toml
from updating.results.store import write_bytes, write_result
from updating.virtual.measurement import TrueModes, simulate
from updating.virtual.vibration_test import VirtualConfiguration, VirtualTest, drawn_deviations, specimens

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
            + (_run_tables(c.name, simulated[c.name][0]) if csv else _file_list(c.name))
            for c in test.configurations
        )
    )


def _file_list(name: str) -> str:
    what = "one universal file a run: two roving accelerometers over the shaker's force"
    return f'files = ["{name}/run_*.uff"]   # {what}\n'


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
