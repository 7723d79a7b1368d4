"""What may be wrong with a measurement that was made rightly: small functions that spoil the files of a campaign.

Each takes the folder of a campaign that `tests.independent.campaign.write_campaign` wrote, a generator of random
numbers, and how much; what it spoils is written over.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

SENSORS, RUNS, SHAKER = 2, 22, 45
BOTH = ("M1", "M2")
G = 9.80665
CORNERS = ((-1, -1), (-1, 1), (1, -1), (1, 1))
"""Signs of x and y; the shaker is at the first one's (x < 0) second (y > 0)."""

Corruption = Callable[[Path, np.random.Generator], None]
Array = NDArray[np.float64]


def _file(folder: Path, configuration: str, run: int) -> Path:
    return folder / configuration / f"run_{run + 1:02d}.csv"


def _edit(file: Path, change: Callable[[Array], Array]) -> None:
    """Change the table of a run: frequency, then real part, imaginary part and coherence of each sensor."""
    header = file.read_text(encoding="utf-8").splitlines()[0]
    table = change(np.loadtxt(file, delimiter=",", skiprows=1))
    np.savetxt(file, table, fmt="%.7g", delimiter=",", header=header, comments="")


def _functions(
    folder: Path,
    where: Sequence[str],
    change: Callable[[NDArray[np.complex128]], NDArray[np.complex128]],
    runs: Sequence[int] = range(RUNS),
    sensors: Sequence[int] = range(SENSORS),
) -> None:
    """Change the functions of some sensors in some runs."""

    def changed(table: Array) -> Array:
        for sensor in sensors:
            first = 1 + 3 * sensor
            value = change(table[:, first] + 1j * table[:, first + 1])
            table[:, first], table[:, first + 1] = value.real, value.imag
        return table

    for configuration in where:
        for run in runs:
            _edit(_file(folder, configuration, run), changed)


def _text(file: Path, change: Callable[[str], str]) -> None:
    before = file.read_text(encoding="utf-8")
    after = change(before)
    assert after != before, f"{file} holds nothing to change"
    file.write_text(after, encoding="utf-8")


def _points(folder: Path, change: Callable[[Array], Array]) -> None:
    """Change the list of points: number, x, y, z in mm."""
    _edit(folder / "points.csv", change)


def _a_run(rng: np.random.Generator) -> int:
    return int(rng.integers(RUNS))


def runs_from_other(folder: Path, rng: np.random.Generator, into: str, number: int, *, alternate: bool) -> None:
    """So many runs of a configuration come from the other one, every second one or the first ones."""
    other = BOTH[1 - BOTH.index(into)]
    for i in range(number):
        run = 2 * i % RUNS if alternate else i
        shutil.copyfile(_file(folder, other, run), _file(folder, into, run))


def same_files(folder: Path, rng: np.random.Generator, *, again: bool) -> None:
    """The files of one configuration stand in both; `again` written, with other bytes."""
    for run in range(RUNS):
        shutil.copyfile(_file(folder, "M1", run), _file(folder, "M2", run))
        if again:
            _edit(_file(folder, "M2", run), lambda table: table)


def run_twice(folder: Path, rng: np.random.Generator) -> None:
    """The file of one run stands in another's place, too."""
    first, second = rng.choice(RUNS, 2, replace=False)
    shutil.copyfile(_file(folder, "M1", first), _file(folder, "M1", second))


def runs_exchanged(folder: Path, rng: np.random.Generator, where: Sequence[str]) -> None:
    """Two runs were measured in each other's place."""
    first, second = (int(i) for i in rng.choice(RUNS, 2, replace=False))
    for configuration in where:
        one, other = _file(folder, configuration, first), _file(folder, configuration, second)
        kept = one.read_bytes()
        one.write_bytes(other.read_bytes())
        other.write_bytes(kept)


def channels_exchanged(folder: Path, rng: np.random.Generator, where: Sequence[str], runs: int) -> None:
    """Both channels of some runs were exchanged."""
    chosen = rng.choice(RUNS, runs, replace=False)
    for configuration in where:
        for run in chosen:
            _edit(_file(folder, configuration, run), lambda table: table[:, [0, 4, 5, 6, 1, 2, 3]])


def scaled(
    folder: Path, rng: np.random.Generator, factor: float, where: Sequence[str], sensor: int | None, runs: int
) -> None:
    """A sensor reads so many times too much in some runs; no sensor is all of them."""
    chosen = sorted(rng.choice(RUNS, runs, replace=False).tolist())
    sensors = range(SENSORS) if sensor is None else (sensor,)
    _functions(folder, where, lambda value: factor * value, chosen, sensors)


def noisy(folder: Path, rng: np.random.Generator, level: float, runs: int) -> None:
    """One sensor is loose: noise of so much of its root mean square."""
    chosen = rng.choice(RUNS, runs, replace=False).tolist()

    def change(value: NDArray[np.complex128]) -> NDArray[np.complex128]:
        size = level * np.sqrt(np.mean(np.abs(value) ** 2) / 2.0)
        return value + size * (rng.standard_normal(value.size) + 1j * rng.standard_normal(value.size))

    _functions(folder, BOTH, change, chosen, (0,))


def dead(folder: Path, rng: np.random.Generator) -> None:
    """One sensor was unplugged in one run."""
    _functions(folder, ("M1",), lambda value: 1e-5 * value[rng.permutation(value.size)], [_a_run(rng)], (1,))


def clipped(folder: Path, rng: np.random.Generator, share: float) -> None:
    """One function stops at a share of its largest value."""

    def change(value: NDArray[np.complex128]) -> NDArray[np.complex128]:
        size = np.maximum(np.abs(value), 1e-30)
        return value * np.minimum(1.0, share * size.max() / size)

    _functions(folder, ("M1",), change, [_a_run(rng)], (0,))


def delayed(folder: Path, rng: np.random.Generator, seconds: float, sensors: Sequence[int]) -> None:
    """Channels lag by a time, as filters or multiplexing make them."""
    frequency = np.loadtxt(_file(folder, "M1", 0), delimiter=",", skiprows=1)[:, 0]
    lag = np.exp(-2j * np.pi * frequency * seconds)
    _functions(folder, BOTH, lambda value: value * lag, sensors=sensors)


def integrated(folder: Path, rng: np.random.Generator, where: Sequence[str]) -> None:
    """The analyser gave mobility where the file says accelerance."""
    frequency = np.loadtxt(_file(folder, "M1", 0), delimiter=",", skiprows=1)[:, 0]
    _functions(folder, where, lambda value: 100.0 * value / (2j * np.pi * frequency))


def conjugated(folder: Path, rng: np.random.Generator, where: Sequence[str]) -> None:
    """The sign of the imaginary parts was lost."""
    _functions(folder, where, np.conj)


def stretched(folder: Path, rng: np.random.Generator, factor: float, where: Sequence[str]) -> None:
    """The frequency axis is wrong by a factor."""

    def change(table: Array) -> Array:
        table[:, 0] *= factor
        return table

    for configuration in where:
        for run in range(RUNS):
            _edit(_file(folder, configuration, run), change)


def warmed(folder: Path, rng: np.random.Generator, shift: float, runs: Sequence[int]) -> None:
    """All resonances of some runs of M1 are lower by a share."""

    def change(table: Array) -> Array:
        f = table[:, 0]
        return np.column_stack([f, *(np.interp(f * (1.0 + shift), f, column) for column in table.T[1:])])

    for run in runs:
        _edit(_file(folder, "M1", run), change)


def stated(folder: Path, rng: np.random.Generator, key: str, values: Sequence[float]) -> None:
    """Torque or pressure of M1 and M2 are stated as other values."""
    given = iter(values)
    _text(
        folder / "campaign.toml", lambda text: re.sub(rf"(?m)^{key} = .*$", lambda _: f"{key} = {next(given):g}", text)
    )


def stated_scaled(folder: Path, rng: np.random.Generator, factors: Sequence[float]) -> None:
    """The pressures of M1 and M2 are stated so many times too high."""
    stated(folder, rng, "pressure_kPa", [160.0 * factors[0], 320.0 * factors[1]])


def force_at(folder: Path, rng: np.random.Generator, x: int, y: int, z: int) -> None:
    """The point of the force is listed at another place: signs of its coordinates are changed."""

    def change(table: Array) -> Array:
        table[SHAKER - 1, 1:] *= (x, y, z)
        return table

    _points(folder, change)


def force_moved(folder: Path, rng: np.random.Generator, x: float) -> None:
    """The point of the force is listed so many mm farther along x."""

    def change(table: Array) -> Array:
        table[SHAKER - 1, 1] += x
        return table

    _points(folder, change)


def force_named(folder: Path, rng: np.random.Generator, point: int) -> None:
    """The campaign says that the force acts at another point of the list."""
    _text(folder / "campaign.toml", lambda text: text.replace(f'"{SHAKER}+z"', f'"{point}+z"'))


def force_turned(folder: Path, rng: np.random.Generator) -> None:
    """The direction of the force is stated the other way round."""
    _text(folder / "campaign.toml", lambda text: text.replace(f'"{SHAKER}+z"', f'"{SHAKER}-z"'))


def force_turned_in(folder: Path, rng: np.random.Generator, runs: int) -> None:
    """The force cell was turned in some runs: both functions have the other sign."""
    scaled(folder, rng, -1.0, ("M1",), None, runs)


def points_exchanged(folder: Path, rng: np.random.Generator, first: int, second: int) -> None:
    """Two points of the list have each other's coordinates."""

    def change(table: Array) -> Array:
        table[[first - 1, second - 1], 1:] = table[[second - 1, first - 1], 1:]
        return table

    _points(folder, change)


def points_moved(folder: Path, rng: np.random.Generator, x: float, y: float) -> None:
    """All points are listed so many mm off."""

    def change(table: Array) -> Array:
        table[:, 1] = np.clip(table[:, 1] + x, -232.5, 232.5)
        table[:, 2] = np.clip(table[:, 2] + y, -31.2, 31.2)
        return table

    _points(folder, change)


def points_mirrored(folder: Path, rng: np.random.Generator, axis: int, *, force: bool) -> None:
    """An axis of the points is turned round, of the force's point as well or not."""

    def change(table: Array) -> Array:
        table[: SHAKER if force else SHAKER - 1, 1 + axis] *= -1.0
        return table

    _points(folder, change)


def points_shifted_by_one(folder: Path, rng: np.random.Generator) -> None:
    """All coordinates slipped by a row."""

    def change(table: Array) -> Array:
        table[: SHAKER - 1, 1:] = np.roll(table[: SHAKER - 1, 1:], 1, axis=0)
        return table

    _points(folder, change)


def stack_says(folder: Path, rng: np.random.Generator, key: str, factor: float) -> None:
    """A number of the stack file is wrong by a factor."""

    def change(text: str) -> str:
        return re.sub(rf"(?m)^({key} = )([-\d.e]+)", lambda found: f"{found[1]}{float(found[2]) * factor:g}", text)

    _text(folder / "stack.toml", change)


def clamps_moved(folder: Path, rng: np.random.Generator, x: float) -> None:
    """All clamps sit so many mm farther along x than the file says."""

    def change(text: str) -> str:
        return re.sub(r"(?m)^(x_mm = )([-\d.]+)", lambda found: f"{found[1]}{float(found[2]) - x:g}", text)

    _text(folder / "stack.toml", change)


def unit_said(folder: Path, rng: np.random.Generator, unit: str) -> None:
    """The campaign states another unit."""
    _text(folder / "campaign.toml", lambda text: text.replace('"(m/s2)/N"', f'"{unit}"'))


def windowed(folder: Path, rng: np.random.Generator, rate: float) -> None:
    """An exponential window that nobody stated: every free vibration decays faster, in 1/s."""

    def change(table: Array) -> Array:
        f, step = table[:, 0], table[1, 0] - table[0, 0]
        wide = np.arange(-200, 201) * step * 2.0 * np.pi
        kernel = rate / np.pi / (wide**2 + rate**2)
        kernel /= kernel.sum()
        for first in (1, 4):
            value = (table[:, first] + 1j * table[:, first + 1]) / f**2
            value = np.convolve(np.pad(value, 200, mode="edge"), kernel, mode="valid") * f**2
            table[:, first], table[:, first + 1] = value.real, value.imag
        return table

    for configuration in BOTH:
        for run in range(RUNS):
            _edit(_file(folder, configuration, run), change)


def hum(folder: Path, rng: np.random.Generator, size: float) -> None:
    """Multiples of 50 Hz stand in every function, so many times its median."""
    frequency = np.loadtxt(_file(folder, "M1", 0), delimiter=",", skiprows=1)[:, 0]
    line = np.isclose(frequency % 50.0, 0.0)

    def change(value: NDArray[np.complex128]) -> NDArray[np.complex128]:
        phase = np.exp(2j * np.pi * rng.random(int(line.sum())))
        value[line] += size * np.median(np.abs(value)) * phase
        return value

    _functions(folder, BOTH, change)


CORRUPTIONS: dict[str, Corruption] = {
    "none": lambda folder, rng: None,
    # runs of another state, or the same data twice
    "half of M1 from M2": partial(runs_from_other, into="M1", number=11, alternate=False),
    "every second of M1 from M2": partial(runs_from_other, into="M1", number=11, alternate=True),
    "three runs of M1 from M2": partial(runs_from_other, into="M1", number=3, alternate=True),
    "one run of M2 from M1": partial(runs_from_other, into="M2", number=1, alternate=True),
    "19 runs of M2 from M1": partial(runs_from_other, into="M2", number=19, alternate=False),
    "the same files in both": partial(same_files, again=False),
    "the same files in both, written again": partial(same_files, again=True),
    "one run twice": run_twice,
    "runs exchanged in M1": partial(runs_exchanged, where=("M1",)),
    "runs exchanged in both": partial(runs_exchanged, where=BOTH),
    "half of M1 0.3 % lower": partial(warmed, shift=0.003, runs=range(0, 22, 2)),
    "half of M1 3 % lower": partial(warmed, shift=0.03, runs=range(0, 22, 2)),
    "one run of M1 1 % lower": partial(warmed, shift=0.01, runs=(4,)),
    # signs, gains, places of sensors
    "one function turned": partial(scaled, factor=-1.0, where=("M1",), sensor=0, runs=1),
    "one point turned in both": partial(scaled, factor=-1.0, where=BOTH, sensor=1, runs=1),
    "sensor 2 turned everywhere": partial(scaled, factor=-1.0, where=BOTH, sensor=1, runs=22),
    "sensor 1 turned everywhere": partial(scaled, factor=-1.0, where=BOTH, sensor=0, runs=22),
    "sensor 2 turned in M1": partial(scaled, factor=-1.0, where=("M1",), sensor=1, runs=22),
    "all sensors turned": partial(scaled, factor=-1.0, where=BOTH, sensor=None, runs=22),
    "all sensors turned in M2": partial(scaled, factor=-1.0, where=("M2",), sensor=None, runs=22),
    "force turned in one run": partial(force_turned_in, runs=1),
    "force turned in four runs": partial(force_turned_in, runs=4),
    "one function twice as large": partial(scaled, factor=2.0, where=("M1",), sensor=0, runs=1),
    "one point twice as large in both": partial(scaled, factor=2.0, where=BOTH, sensor=0, runs=1),
    "one point 5 % larger in both": partial(scaled, factor=1.05, where=BOTH, sensor=0, runs=1),
    "one point 20 % smaller in both": partial(scaled, factor=0.8, where=BOTH, sensor=1, runs=1),
    "one point ten times as large": partial(scaled, factor=10.0, where=BOTH, sensor=1, runs=1),
    "sensor 2 by 5 % larger": partial(scaled, factor=1.05, where=BOTH, sensor=1, runs=22),
    "sensor 2 by 30 % larger": partial(scaled, factor=1.3, where=BOTH, sensor=1, runs=22),
    "sensor 2 ten times as large": partial(scaled, factor=10.0, where=BOTH, sensor=1, runs=22),
    "sensor 2 in g": partial(scaled, factor=1.0 / G, where=BOTH, sensor=1, runs=22),
    "sensor 2 by 10 % larger in M2": partial(scaled, factor=1.1, where=("M2",), sensor=1, runs=22),
    "channels of one run exchanged": partial(channels_exchanged, where=("M1",), runs=1),
    "channels of a run exchanged in both": partial(channels_exchanged, where=BOTH, runs=1),
    "channels of all runs exchanged": partial(channels_exchanged, where=BOTH, runs=22),
    "noise of 5 % on one sensor": partial(noisy, level=0.05, runs=1),
    "noise of 50 % on two": partial(noisy, level=0.5, runs=2),
    "one sensor dead": dead,
    "one function clipped at half": partial(clipped, share=0.5),
    "one function clipped at a tenth": partial(clipped, share=0.1),
    # analyser
    "all in g": partial(scaled, factor=1.0 / G, where=BOTH, sensor=None, runs=22),
    "M2 in g": partial(scaled, factor=1.0 / G, where=("M2",), sensor=None, runs=22),
    "force in lbf": partial(scaled, factor=4.448, where=BOTH, sensor=None, runs=22),
    "force in lbf in M1": partial(scaled, factor=4.448, where=("M1",), sensor=None, runs=22),
    "one run in g": partial(scaled, factor=1.0 / G, where=("M1",), sensor=None, runs=1),
    "unit stated as g": partial(unit_said, unit="g/N"),
    "unit stated as mobility": partial(unit_said, unit="(m/s)/N"),
    "mobility for accelerance": partial(integrated, where=BOTH),
    "mobility for accelerance in M1": partial(integrated, where=("M1",)),
    "imaginary parts turned": partial(conjugated, where=BOTH),
    "imaginary parts turned in M1": partial(conjugated, where=("M1",)),
    "frequencies 2 % too high": partial(stretched, factor=1.02, where=BOTH),
    "frequencies of M2 2 % too high": partial(stretched, factor=1.02, where=("M2",)),
    "sensor 2 lags by 0.1 ms": partial(delayed, seconds=1e-4, sensors=(1,)),
    "all lag by 0.2 ms": partial(delayed, seconds=2e-4, sensors=(0, 1)),
    "window of 3 1/s": partial(windowed, rate=3.0),
    "hum": partial(hum, size=3.0),
    # what is stated of the torques
    "pressures exchanged": partial(stated, key="pressure_kPa", values=(320.0, 160.0)),
    "torques and pressures exchanged": lambda folder, rng: (
        stated(folder, rng, "pressure_kPa", (320.0, 160.0)),
        stated(folder, rng, "torque_Nm", (3.0, 1.5)),
    )[0],
    "torques exchanged": partial(stated, key="torque_Nm", values=(3.0, 1.5)),
    "pressure of M2 20 % too low": partial(stated_scaled, factors=(1.0, 0.8)),
    "pressure of M2 20 % too high": partial(stated_scaled, factors=(1.0, 1.2)),
    "pressure of M1 40 % too high": partial(stated_scaled, factors=(1.4, 1.0)),
    "both pressures 20 % too high": partial(stated_scaled, factors=(1.2, 1.2)),
    "the same pressure in both": partial(stated, key="pressure_kPa", values=(160.0, 160.0)),
    "pressures in the wrong unit": partial(stated_scaled, factors=(1e-3, 1e-3)),
    # points
    "force at the other end": partial(force_at, x=-1, y=1, z=1),
    "force at the other side": partial(force_at, x=1, y=-1, z=1),
    "force at the opposite corner": partial(force_at, x=-1, y=-1, z=1),
    "force on the other face": partial(force_at, x=1, y=1, z=-1),
    "force 60 mm off": partial(force_moved, x=60.0),
    "force 10 mm off": partial(force_moved, x=10.0),
    "force said to be at point 3": partial(force_named, point=3),
    "force said to be at point 44": partial(force_named, point=44),
    "force stated the other way round": force_turned,
    "points 21 and 25 exchanged": partial(points_exchanged, first=21, second=25),
    "points 1 and 44 exchanged": partial(points_exchanged, first=1, second=44),
    "points 9 and 10 exchanged": partial(points_exchanged, first=9, second=10),
    "all points 5 mm off": partial(points_moved, x=5.0, y=0.0),
    "all points 30 mm off": partial(points_moved, x=30.0, y=0.0),
    "all points 5 mm off along y": partial(points_moved, x=0.0, y=5.0),
    "x turned round": partial(points_mirrored, axis=0, force=False),
    "y turned round": partial(points_mirrored, axis=1, force=False),
    "x turned round, of the force too": partial(points_mirrored, axis=0, force=True),
    "coordinates slipped by a row": points_shifted_by_one,
    # the stack
    "length 1 % too long": partial(stack_says, key="length_mm", factor=1.01),
    "density 5 % too high": partial(stack_says, key="density_kg_m3", factor=1.05),
    "Young's modulus 5 % too low": partial(stack_says, key="young_GPa", factor=0.95),
    "clamps of twice the mass": partial(stack_says, key="mass_kg", factor=2.0),
    "clamps 5 mm off": partial(clamps_moved, x=5.0),
    "clamps 20 mm off": partial(clamps_moved, x=20.0),
}
"""By name, in the order in which a study tries them."""


def spoil(folder: Path, name: str, seed: int) -> None:
    """Spoil the campaign in a folder in one way."""
    CORRUPTIONS[name](folder, np.random.default_rng([seed, list(CORRUPTIONS).index(name)]))
