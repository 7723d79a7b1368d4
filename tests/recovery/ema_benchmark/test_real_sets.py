"""Measured sets: the share of the power that modes explain beside sdypy-EMA, and modes in random bands.

    pytest tests/recovery/ema_benchmark/test_real_sets.py -m benchmark -s

It reads the measurements that are there; what lies in the folder that REAL_SETS names is read, too: a campaign file in
each subfolder, as `lamella new` writes it. BANDS sets the number of random bands of each set (40 by default), each as a
random quantity and order. sdypy-EMA is given the frequencies that the sets' own pages list, or those of Lamella where
there are none.
"""

import contextlib
import gzip
import io
import os
import warnings
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from numpy.typing import NDArray

from ema import read_campaign, read_measurement
from ema.identification.identify import identify_frf
from ema.io.uff import read_uff_functions
from ema.quality.explained import explained_power
from ema.types.errors import EmaError
from ema.types.frf import FRF, Dofs, Geometry, Quantity
from ema.types.modal_model import ModalModel

REALDATA = Path(__file__).parents[3].parent / "shared/realdata"
OWN = os.environ.get("REAL_SETS")
BANDS = int(os.environ.get("BANDS", "40"))
QUANTITIES: tuple[Quantity, ...] = ("receptance", "mobility", "accelerance")
SAME = 2e-3
"""Relative distance of frequencies that are one mode, or half a bandwidth if that is more."""
CLEAR_OF_ENDS = 4.0
"""Bandwidths that a mode keeps to the ends of a random band, so that it is surely inside or outside."""
pytestmark = [
    pytest.mark.benchmark,
    pytest.mark.skipif(not REALDATA.exists() and OWN is None, reason=f"no measurements at {REALDATA}"),
]


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A measured set, the band in which it is looked at, and its frequencies by others, Hz."""

    name: str
    frf: FRF
    band: tuple[float, float]
    frequency: tuple[float, ...] = ()


def block(frequency: NDArray, value: NDArray) -> FRF:
    """Accelerances (n_function, n_frequency) of as many points to one force."""
    n = len(value)
    axis = np.tile([0.0, 0.0, 1.0], (n, 1))
    return FRF(
        frequency=frequency,
        value=value[:, None],
        quantity="accelerance",
        output=Dofs(node=np.arange(1, n + 1), direction=axis),
        input=Dofs(node=np.array([n + 1]), direction=axis[:1]),
        run=np.zeros(n, dtype=int),
        source=("measured",) * n,
    )


def hammer_on_a_beam() -> Measured:
    tables = []
    for file in sorted((REALDATA / "beam-freefree-modelab").glob("*.gz")):
        with gzip.open(file, "rt", encoding="latin-1") as text:
            tables.append(np.loadtxt(text, skiprows=9))
    value = np.array([table[:, 1] + 1j * table[:, 2] for table in tables])
    found = (111.99, 306.86, 596.37, 974.14)
    return Measured(name="beam, hammer", frf=block(tables[0][:, 0], value), band=(65, 1000), frequency=found)


def beam_in_a_universal_file() -> Measured:
    functions, _ = read_uff_functions(REALDATA / "beam-uff-pyuff/beam.uff")
    value = np.array([f.value for f in functions if f.kind == "frf"])
    frequency = np.linspace(0.0, 6399.9, value.shape[1])
    found = (52.56, 144.63, 283.12, 468.28, 698.45, 972.96)
    return Measured(name="beam, three points", frf=block(frequency, value), band=(30, 1100), frequency=found)


def building() -> Measured:
    with zipfile.ZipFile(REALDATA / "building-3storey-iqs/experimental_building_frf.zip") as archive:
        name = next(n for n in archive.namelist() if n.endswith(".npz"))
        value = np.load(io.BytesIO(archive.read(name)))["data"].T
    frequency = 0.0625 * np.arange(value.shape[1])
    return Measured(name="building", frf=block(frequency, value), band=(10, 97), frequency=(21.42, 50.01, 68.29))


def ruler() -> Measured:
    value = scipy.io.loadmat(REALDATA / "ruler-freefree-pydvma/ruler_grid_acc_3.mat")["yspec"].T
    frequency = np.linspace(0.0, 10000.0, value.shape[1])
    found = (39.4, 108.5, 212.4, 352.3, 517.6, 551.1)
    return Measured(name="ruler", frf=block(frequency, value), band=(20, 620), frequency=found)


def five_blows() -> Measured:
    records = [np.load(REALDATA / f"impact-repeats-pyfrf/measurements_{k}.npy") for k in range(1, 6)]
    force, response = (np.fft.rfft([record[row] for record in records]) for row in (1, 2))
    value = np.sum(response * force.conj(), axis=0) / np.sum(np.abs(force) ** 2, axis=0)
    found = (810.4, 900.1, 2640.0, 3670.0, 4126.0, 4393.0)
    return Measured(
        name="five blows", frf=block(np.arange(value.size) * 1.0, value[None]), band=(300, 5000), frequency=found
    )


def own() -> Iterator[Measured]:
    for file in sorted(Path(OWN).glob("*/campaign.toml")) if OWN else ():
        campaign = read_campaign(file)
        for configuration in campaign.configurations:
            frf = read_measurement(campaign, configuration.name).frf
            whole = float(frf.frequency[frf.frequency > 0][0]), float(frf.frequency[-1])
            yield Measured(name=configuration.name, frf=frf, band=campaign.identification.band or whole)


@pytest.fixture(scope="module")
def sets() -> list[Measured]:
    public = (hammer_on_a_beam, beam_in_a_universal_file, building, ruler, five_blows)
    return [*(make() for make in public if REALDATA.exists()), *own()]


def identified(measured: Measured, band: tuple[float, float], **options) -> ModalModel:
    nodes = np.union1d(measured.frf.output.node, measured.frf.input.node)
    geometry = Geometry(node=nodes, coordinate=np.outer(nodes, [1.0, 0, 0]), line=np.empty((0, 2), dtype=int))
    return identify_frf(measured.frf, geometry, name=measured.name, band=band, **options)


def share_of_sdypy(frf: FRF, band: tuple[float, float], frequency: NDArray) -> float:
    """Share of the power that sdypy-EMA explains, given the frequencies; the mean over the functions."""
    lines = frf.band(0.0, band[1]).convert("accelerance")
    value = lines.value.reshape(-1, lines.frequency.size)
    with (
        warnings.catch_warnings(),
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()),
    ):
        warnings.simplefilter("ignore")
        from sdypy.EMA import Model

        model = Model(value, lines.frequency, lower=band[0], upper=band[1], pol_order_high=60)
        model.get_poles(show_progress=False)
        window = min(50.0, 0.45 * float(np.min(np.diff(frequency), initial=np.inf)))
        model.select_closest_poles(list(frequency), f_window=window)
        rebuilt, _ = model.get_constants()
    inside = lines.frequency >= band[0]
    rebuilt = rebuilt[:, -lines.frequency.size :][:, -np.count_nonzero(inside) :]
    power = np.sum(np.abs(value[:, inside]) ** 2, axis=1)
    return float(np.mean(1.0 - np.sum(np.abs(value[:, inside] - rebuilt) ** 2, axis=1) / power))


def random_bands(measured: Measured, model: ModalModel) -> Iterator[tuple[tuple[float, float], NDArray]]:
    """Bands that hold a third of the lines or more, and a mode, with the modes that each holds."""
    rng = np.random.default_rng(0)
    lower, upper = measured.band
    clear = CLEAR_OF_ENDS * 2.0 * model.damping * model.frequency
    while True:
        ends = np.sort(rng.uniform(lower, upper, 2))
        near = np.abs(model.frequency[:, None] - ends) < clear[:, None]
        inside = model.frequency[(model.frequency > ends[0]) & (model.frequency < ends[1])]
        if ends[1] - ends[0] > (upper - lower) / 3.0 and inside.size and not near.any():
            yield (float(ends[0]), float(ends[1])), inside


def compared(found: ModalModel, wanted: NDArray) -> tuple[int, int, int]:
    """Count the wanted modes that were found, those listed as peaks without a mode, and modes beyond the wanted."""
    reach = np.maximum(SAME * found.frequency, found.damping * found.frequency)
    same = np.abs(found.frequency - wanted[:, None]) < reach
    listed = [any(abs(p.frequency - f) < 0.02 * f for p in found.unexplained) for f in wanted]
    n_same = int(same.any(axis=1).sum())
    return n_same, int(np.sum(listed & ~same.any(axis=1))), int(np.sum(~same.any(axis=0)))


def test_real_sets(sets):
    print("\n\n| set | modes | explained | sdypy-EMA | in bands, same | listed | lost | extra |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    shares, same, wanted_in_all = [], 0, 0
    for measured in sets:
        model = identified(measured, measured.band)
        frf = replace(measured, frf=measured.frf).frf
        whole = explained_power(frf, model).mean
        given = np.array(measured.frequency or model.frequency)
        peer = share_of_sdypy(frf, measured.band, given)
        shares.append((whole, peer))
        count = np.zeros(4, dtype=int)
        rng = np.random.default_rng(1)
        for (band, wanted), _ in zip(random_bands(measured, model), range(BANDS), strict=False):
            other = replace(measured, frf=frf.convert(QUANTITIES[rng.integers(3)]))
            try:
                found = identified(other, band, order=int(rng.integers(40, 81)))
                n_same, n_listed, extra = compared(found, wanted)
            except EmaError as error:
                print(f"{measured.name}, {band[0]:.5g}-{band[1]:.5g} Hz: {error}")
                n_same = n_listed = extra = 0
            count += n_same, n_listed, wanted.size - n_same - n_listed, extra
        same, wanted_in_all = same + count[0], wanted_in_all + count[:3].sum()
        in_bands = " | ".join(map(str, count))
        print(f"| {measured.name} | {model.frequency.size} | {whole:.4f} | {peer:.4f} | {in_bands} |", flush=True)
    assert all(ours > theirs for ours, theirs in shares)
    assert same >= 0.9 * wanted_in_all
