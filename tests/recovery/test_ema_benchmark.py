"""Figures of the identification over seeded sets, printed as a table beside sdypy-EMA and SDynPy's PolyPy.

    pytest tests/recovery/test_ema_benchmark.py -m benchmark -s

SETS sets the number of seeded sets of each study (300 by default), PEER_SETS that of the peers (10). The peers are
given the true frequencies as guesses, without which they return no modes; order 60.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import os
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ema.frf import FRF, Quantity
from ema.geometry import Dofs, Geometry
from ema.identify import identify_frf
from ema.lscf import lscf_poles
from ema.modes import ModalModel

pytestmark = pytest.mark.benchmark

SETS = int(os.environ.get("SETS", "300"))
N = 44
LINES = np.arange(0.5, 2000.25, 0.5)
EXPONENT: dict[Quantity, int] = {"receptance": 0, "mobility": 1, "accelerance": 2}
SIX_F = np.array([152.0, 398.0, 611.0, 800.0, 1100.0, 1390.0])
SIX_Z = np.array([0.002, 0.005, 0.01, 0.02, 0.004, 0.04])
PEER_SETS = int(os.environ.get("PEER_SETS", "10"))
ROWS: list[tuple[str, ...]] = []
NONE = "has none"


@pytest.fixture(scope="module", autouse=True)
def table() -> Iterator[None]:
    ROWS.clear()
    yield
    print(
        f"\n\n{SETS} sets; peers {PEER_SETS} sets, given the true frequencies\n\n"
        "| figure | target | Lamella | sdypy-EMA | PolyPy |\n| --- | --- | --- | --- | --- |"
    )
    for row in ROWS:
        print("| " + " | ".join(row) + " |")


def report(figure: str, target: str, reached: str, *peers: str) -> None:
    ROWS.append((figure, target, reached, *(peers or (NONE, NONE))))


def sdypy_poles(value: NDArray, lines: NDArray, guess: NDArray) -> tuple[NDArray, NDArray]:
    """Frequencies and damping ratios that sdypy-EMA picks next to the guesses."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from sdypy.EMA import Model

        # its axis begins at 0 Hz in even steps
        axis = np.arange(0.0, lines[-1] + 0.25, 0.5)
        padded = np.zeros((len(value), axis.size), dtype=complex)
        padded[:, np.searchsorted(axis, lines - 0.1)] = value
        model = Model(padded, axis, lower=lines[0], upper=lines[-1], pol_order_high=60)
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            model.get_poles(show_progress=False)
            model.select_closest_poles(list(guess))
    return np.asarray(model.nat_freq), np.asarray(model.nat_xi)


def polypy(value: NDArray, lines: NDArray, order: int) -> NDArray:
    """Poles of the highest order that PolyPy finds, as a table with omega and zeta."""
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        import sdynpy

        output = sdynpy.coordinate_array(np.arange(1, len(value) + 1), 3)
        dofs = np.stack([output, np.broadcast_to(sdynpy.coordinate_array(1, 3), output.shape)], axis=1)
        kind = sdynpy.data.FunctionTypes.FREQUENCY_RESPONSE_FUNCTION
        model = sdynpy.modal.PolyPy(sdynpy.data_array(kind, lines, np.array(value), dofs))
        model.compute_poles(np.arange(2, order + 1))
    return np.asarray(model.pole_list[0])


def polypy_poles(value: NDArray, lines: NDArray, guess: NDArray) -> tuple[NDArray, NDArray]:
    """Frequencies and damping ratios of the damped poles of order 60 nearest to the guesses."""
    poles = polypy(value, lines, 60)
    poles = poles[poles["zeta"] > 0]
    nearest = [int(np.argmin(np.abs(poles["omega"] / (2 * np.pi) - g))) for g in guess]
    return poles["omega"][nearest] / (2 * np.pi), poles["zeta"][nearest]


Poles = Callable[[NDArray, NDArray, NDArray], tuple[NDArray, NDArray]]


def of_peers(figure: Callable[[Poles], str]) -> list[str]:
    """A figure of each peer; PolyPy is compared where SDynPy is installed."""
    there = importlib.util.find_spec("sdynpy") is not None
    return [figure(sdypy_poles), figure(polypy_poles) if there else "not installed"]


@dataclass(frozen=True, kw_only=True)
class Truth:
    frequency: NDArray
    damping: NDArray
    shape: NDArray
    pole: NDArray
    residue: NDArray
    clean: NDArray
    sigma: NDArray


def clean_functions(f: NDArray, z: NDArray, phi: NDArray, drive: int, quantity: Quantity) -> tuple:
    pole = 2 * np.pi * f * (-z + 1j * np.sqrt(1 - z**2))
    residue = phi * phi[drive] / (2j * pole.imag)
    s = 2j * np.pi * LINES
    value = residue @ (1 / (s - pole[:, None])) + residue.conj() @ (1 / (s - pole.conj()[:, None]))
    return pole, residue, value * s ** EXPONENT[quantity]


def noisy(
    rng: np.random.Generator,
    f: NDArray,
    z: NDArray,
    noise: float,
    *,
    phi: NDArray | None = None,
    drive: int = 0,
    quantity: Quantity = "accelerance",
) -> tuple[FRF, Truth]:
    if phi is None:
        phi = np.stack([np.cos(k * np.pi * np.linspace(0, 1, N)) for k in range(1, f.size + 1)], axis=1)
        phi = phi + 0.15 * rng.standard_normal(phi.shape)
    pole, residue, clean = clean_functions(f, z, phi, drive, quantity)
    sigma = noise * np.sqrt(np.mean(np.abs(clean) ** 2, axis=1))
    scatter = rng.standard_normal(clean.shape) + 1j * rng.standard_normal(clean.shape)
    value = clean + sigma[:, None] * scatter / np.sqrt(2)
    truth = Truth(frequency=f, damping=z, shape=phi, pole=pole, residue=residue, clean=clean, sigma=sigma)
    return block(value, quantity, drive), truth


def block(value: NDArray, quantity: Quantity, drive: int, run: NDArray | None = None) -> FRF:
    z = np.tile([0.0, 0.0, 1.0], (N, 1))
    return FRF(
        frequency=LINES,
        value=value[:, None],
        quantity=quantity,
        output=Dofs(node=np.arange(N), direction=z),
        input=Dofs(node=[drive], direction=z[:1]),
        run=np.zeros(N, dtype=int) if run is None else run,
        source=("generated",) * N,
    )


GEOMETRY = Geometry(
    node=np.arange(N), coordinate=np.outer(np.arange(N), [0.1, 0.0, 0.0]), line=np.zeros((0, 2))
)


def identified(frf: FRF, band: tuple[float, float] | None = None) -> ModalModel:
    return identify_frf(frf, GEOMETRY, name="set", band=band)


def cramer_rao(truth: Truth, quantity: Quantity) -> tuple[NDArray, NDArray]:
    """Bounds of f and damping with all residues and residual terms unknown, from full Jacobians."""
    s = 2j * np.pi * LINES
    power = s ** EXPONENT[quantity]
    p = truth.pole
    a = power[:, None] / (s[:, None] - p)
    b = power[:, None] / (s[:, None] - p.conj())
    linear = np.concatenate(
        [a + b, 1j * (a - b), np.outer(power, [1, 1j]), np.outer(power / s**2, [1, 1j])], 1
    )
    linear = np.concatenate([linear.real, linear.imag])
    q, _ = np.linalg.qr(linear / np.linalg.norm(linear, axis=0))
    information = np.zeros((2 * p.size, 2 * p.size))
    for row, sigma in zip(truth.residue, truth.sigma, strict=True):
        up, down = (
            row * power[:, None] / (s[:, None] - p) ** 2,
            row.conj() * power[:, None] / (s[:, None] - p.conj()) ** 2,
        )
        jacobian = np.concatenate([up + down, 1j * (up - down)], axis=1)
        jacobian = np.concatenate([jacobian.real, jacobian.imag])
        jacobian -= q @ (q.T @ jacobian)
        information += 2.0 / sigma**2 * jacobian.T @ jacobian
    covariance = np.linalg.inv(information)
    m = p.size
    size = np.abs(p)
    to_f = np.concatenate([np.diag(p.real / size), np.diag(p.imag / size)], axis=1) / (2 * np.pi)
    to_z = np.concatenate([np.diag(-(p.imag**2) / size**3), np.diag(p.real * p.imag / size**3)], axis=1)
    return (
        np.sqrt(np.diag(to_f @ covariance @ to_f.T))[:m],
        np.sqrt(np.diag(to_z @ covariance @ to_z.T))[:m],
    )


def peer_errors(poles: Poles, noise: float) -> str:
    """Worst RMS error over the bound, and worst damping bias, of the sets of the coverage study."""
    rows = []
    for seed in range(PEER_SETS):
        frf, truth = noisy(np.random.default_rng([1, seed, round(1000 * noise)]), SIX_F, SIX_Z, noise)
        f, z = poles(frf.value[:, 0], LINES, SIX_F)
        bound_f, bound_z = cramer_rao(truth, "accelerance")
        rows.append(np.stack([(f - SIX_F) / bound_f, (z - SIX_Z) / bound_z, z / SIX_Z - 1.0]))
    data = np.array(rows)
    rms = np.sqrt(np.mean(data[:, :2] ** 2, axis=0)).max()
    return f"{rms:.3g} / {100 * np.abs(data[:, 2].mean(axis=0)).max():.3g} %"


def test_coverage_efficiency_and_bias() -> None:
    for noise in (0.01, 0.05):
        rows: list[NDArray] = []
        for seed in range(SETS):
            frf, truth = noisy(np.random.default_rng([1, seed, round(1000 * noise)]), SIX_F, SIX_Z, noise)
            model = identified(frf)
            assert model.frequency.size == SIX_F.size, (noise, seed, model.frequency)
            bound_f, bound_z = cramer_rao(truth, "accelerance")
            rows.append(
                np.stack(
                    [
                        (model.frequency - SIX_F) / model.frequency_std,
                        (model.damping - SIX_Z) / model.damping_std,
                        (model.frequency - SIX_F) / bound_f,
                        (model.damping - SIX_Z) / bound_z,
                        model.damping / SIX_Z - 1.0,
                    ]
                )
            )
        data = np.array(rows)  # (set, figure, mode)
        cover = np.mean(np.abs(data[:, :2]) < 1.96, axis=(0, 2))
        rms = np.sqrt(np.mean(data[:, 2:4] ** 2, axis=0))
        bias = np.abs(data[:, 4].mean(axis=0)).max()
        report(
            f"coverage of 95 % intervals of f, damping; {noise:.0%} noise",
            "93 to 97 %",
            " / ".join(f"{100 * c:.1f} %" for c in cover),
        )
        report(
            f"worst RMS error over the Cramer-Rao bound / worst damping bias; {noise:.0%} noise",
            "at most 1.2 / below 0.5 % at 5 %",
            f"{rms.max():.3f} / {100 * bias:.4f} %",
            *of_peers(lambda poles, noise=noise: peer_errors(poles, noise)),
        )
        assert np.all((cover > 0.93) & (cover < 0.97))
        assert rms.max() < 1.2
        assert bias < 0.005


def random_set(seed: int) -> tuple[FRF, Truth, NDArray]:
    """4 to 10 modes, damping 0.1 to 3 %, noise 0.01 to 5 %, half the sets with rough shapes; and which count."""
    rng = np.random.default_rng([2, seed])
    m = int(rng.integers(4, 11))
    f = np.sort(rng.uniform(60.0, 1900.0, m))
    z = 10 ** rng.uniform(-3.0, np.log10(0.03), m)
    noise = 10 ** rng.uniform(-4.0, np.log10(0.05))
    if rng.random() < 0.5:
        phi = rng.standard_normal((N, m))
    else:
        x = np.linspace(0, 1, N)
        phi = np.stack([np.cos((k + 1) * np.pi * x + rng.uniform(0, 0.5)) for k in range(m)], axis=1)
    frf, truth = noisy(rng, f, z, noise, phi=phi, drive=int(rng.integers(N)))
    peak = np.abs(truth.pole.imag**2 * truth.residue / truth.pole.real)
    strong = np.sum(peak >= 2.0 * truth.sigma[:, None], axis=0) >= 5
    gap = np.abs(f[:, None] - f) + np.where(np.eye(m) > 0, np.inf, 0.0)
    apart = np.all(gap >= 3.0 * np.maximum(f * z, (f * z)[:, None]), axis=1)
    return frf, truth, strong & apart


def test_missed_and_invented_modes() -> None:
    missed = invented = wrong = 0
    for seed in range(SETS):
        frf, truth, counted = random_set(seed)
        model = identified(frf)
        half_bandwidth = truth.frequency * truth.damping
        distance = np.abs(model.frequency[:, None] - truth.frequency) / half_bandwidth
        partner = {
            int(np.argmin(distance[:, k])) for k in np.flatnonzero(counted) if distance[:, k].min() < 1.0
        }
        lost = np.count_nonzero(counted) - len(partner)
        # A pole near a true mode that is too weak or too close to count is no invention.
        extra = [
            j
            for j in range(model.frequency.size)
            if j not in partner and not np.any(distance[j, ~counted] < 3)
        ]
        missed += lost > 0
        invented += bool(extra)
        wrong += lost > 0 or bool(extra)
        if lost or extra:
            print(
                f"set {seed}: lost {lost}, invented {model.frequency[extra]}, true {truth.frequency.round(2)}"
            )
    report(
        f"sets with missed / invented modes, of {SETS}",
        "neither in 97 %",
        f"{missed} / {invented}; {1 - wrong / SETS:.1%} right",
    )
    assert wrong <= 0.03 * SETS


PAIR_DAMPING = (0.0005, 0.001, 0.002, 0.005, 0.01)
PAIR_F = np.array([152.0, 398.0, 800.0, 802.4, 1100.0, 1390.0])


def pair_set(damping: float, seed: int) -> FRF:
    z = np.array([0.002, 0.005, damping, damping, 0.004, 0.02])
    return noisy(np.random.default_rng([3, seed]), PAIR_F, z, 0.01, drive=2)[0]


def peer_pairs(poles: Poles) -> str:
    right = total = 0
    for damping in PAIR_DAMPING:
        for seed in range(max(PEER_SETS // len(PAIR_DAMPING), 1)):
            found, _ = poles(pair_set(damping, seed).value[:, 0], LINES, PAIR_F)
            right += bool(np.all(np.abs(found[2:4] / PAIR_F[2:4] - 1.0) < 2e-4))
            total += 1
    return f"{right} of {total}"


def test_close_pair() -> None:
    right, worst = 0, 0.0
    dampings, f = PAIR_DAMPING, PAIR_F
    per_damping = max(SETS // len(dampings), 1)
    for damping in dampings:
        for seed in range(per_damping):
            frf = pair_set(damping, seed)
            found = identified(frf).frequency
            pair = found[(found > 780.0) & (found < 822.0)]
            good = pair.size == 2 and bool(np.all(np.abs(pair / f[2:4] - 1.0) < 2e-4))
            right += good
            if pair.size == 2:
                worst = max(worst, float(np.max(np.abs(pair / f[2:4] - 1.0))))
    total = per_damping * len(dampings)
    report(
        f"pair 800 / 802.4 Hz, damping 0.05 to 1 %, of {total}",
        "two modes within 0.02 % in 98 %",
        f"{right / total:.1%}; worst {100 * worst:.5f} %",
        *of_peers(peer_pairs),
    )
    assert right >= 0.98 * total


def random_bands(n: int) -> Iterator[tuple[FRF, float, float, tuple[float, float]]]:
    """Sets of 0.1 % noise, a mode of theirs, and a band with 5 to 100 half bandwidths on each side of it."""
    for seed in range(n):
        rng = np.random.default_rng([4, seed])
        frf, _ = noisy(rng, SIX_F, SIX_Z, 0.001)
        for f, z in zip(SIX_F, SIX_Z, strict=True):
            reach = f * z * 10 ** rng.uniform(np.log10(5.0), 2.0, 2)
            yield frf, f, z, (max(1.0, f - reach[0]), min(2000.0, f + reach[1]))


def peer_bands(poles: Poles) -> str:
    worst_f = worst_z = 0.0
    failed = total = 0
    for frf, f, z, band in random_bands(max(PEER_SETS // 5, 1)):
        part = frf.band(*band)
        total += 1
        try:
            found, damping = poles(part.value[:, 0], part.frequency, np.array([f]))
        except Exception:
            failed += 1
            continue
        worst_f, worst_z = (
            max(worst_f, abs(found[0] / f - 1.0)),
            max(worst_z, abs(damping[0] / z - 1.0)),
        )
    return f"{100 * worst_f:.2g} %, {100 * worst_z:.2g} %, {failed} of {total} bands failed"


def test_any_band() -> None:
    worst_f = worst_z = 0.0
    n = max(SETS // 6, 1)
    for frf, f, z, band in random_bands(n):
        model = identified(frf, band)
        k = int(np.argmin(np.abs(model.frequency - f)))
        worst_f = max(worst_f, abs(model.frequency[k] / f - 1.0))
        worst_z = max(worst_z, abs(model.damping[k] / z - 1.0))
    report(
        f"same mode from {6 * n} random bands, 0.1 % noise: worst f, damping",
        "0.01 %, 2 %",
        f"{100 * worst_f:.5f} %, {100 * worst_z:.3f} %",
        *of_peers(peer_bands),
    )
    assert worst_f < 1e-4
    assert worst_z < 0.02


def test_scaled_shapes() -> None:
    for quantity in EXPONENT:
        worst = 0.0
        for seed in range(10):
            frf, truth = noisy(np.random.default_rng([5, seed]), SIX_F, SIX_Z, 0.001, quantity=quantity)
            model = identified(frf)
            assert model.scaled.all()
            sign = np.sign(np.sum(model.shape.real * truth.shape, axis=0))
            error = np.linalg.norm(model.shape * sign - truth.shape, axis=0)
            worst = max(worst, float(np.max(error / np.linalg.norm(truth.shape, axis=0))))
        figure = f"scaled shapes against truth, {quantity}, 0.1 % noise"
        report(figure, "within 1 %", f"{100 * worst:.3f} %", "not compared", "not compared")
        assert worst < 0.01


def test_roving_shift() -> None:
    flagged = alarms = quiet = 0
    n = max(SETS // 3, 1)
    run = np.arange(N) // 2
    for seed in range(n):
        for shift in (0.0, 0.001):
            rng = np.random.default_rng([6, seed])
            _, truth = noisy(rng, SIX_F, SIX_Z, 0.01)
            odd = int(rng.integers(run.max() + 1))
            _, _, moved = clean_functions(SIX_F * (1 - shift), SIX_Z, truth.shape, 0, "accelerance")
            scatter = rng.standard_normal(moved.shape) + 1j * rng.standard_normal(moved.shape)
            value = np.where((run == odd)[:, None], moved, truth.clean)
            model = identified(
                block(value + truth.sigma[:, None] * scatter / np.sqrt(2), "accelerance", 0, run)
            )
            disagrees = model.disagreeing_runs().any(axis=1)
            if shift:
                flagged += disagrees[odd]
                alarms += np.delete(disagrees, odd).any()
            else:
                quiet += disagrees.any()
    report(f"shift of 0.1 % in one of 22 runs, {n} sets", "flagged in 95 %", f"{flagged / n:.1%}")
    report("other runs flagged: with / without a shift", "at most 5 %", f"{alarms / n:.1%} / {quiet / n:.1%}")
    assert flagged >= 0.95 * n
    assert max(alarms, quiet) <= 0.05 * n


def polypy_seconds(value: NDArray) -> str:
    if importlib.util.find_spec("sdynpy") is None:
        return "not installed"
    polypy(value, LINES, 4)  # the import takes seconds
    start = time.perf_counter()
    polypy(value, LINES, 100)
    return f"{time.perf_counter() - start:.2f} s"


ALONE = """
import re, sys, time
import numpy as np
import ema
value = np.load(sys.argv[1])
n = len(value)
up = np.tile([0.0, 0.0, 1.0], (n, 1))
frf = ema.FRF(
    frequency=np.arange(0.5, 2000.25, 0.5), value=value[:, None], quantity="accelerance",
    output=ema.Dofs(node=np.arange(n), direction=up), input=ema.Dofs(node=[0], direction=up[:1]),
    run=np.zeros(n, dtype=int), source=("generated",) * n,
)
geometry = ema.Geometry(node=np.arange(n), coordinate=np.outer(np.arange(n), [0.1, 0, 0]), line=np.zeros((0, 2)))
start = time.perf_counter()
assert ema.identify_frf(frf, geometry, name="set").frequency.size == 6
seconds = time.perf_counter() - start
# the peak that getrusage tells would be that of the process this one was started from
print(seconds, int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1]) / 1024)
"""


def whole_identification(value: NDArray, folder: Path) -> tuple[float, float]:
    """Seconds and peak memory (MB) of a process that imports Lamella, loads the functions and identifies."""
    np.save(folder / "value.npy", value)
    command = [sys.executable, "-c", ALONE, str(folder / "value.npy")]
    seconds, peak = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
    return float(seconds), float(peak)


def test_speed_beside_sdypy(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from sdypy.EMA import Model
    frf, truth = noisy(np.random.default_rng(7), SIX_F, SIX_Z, 0.01)
    value = frf.value[:, 0]
    ours, theirs = [], []
    for _ in range(5):
        start = time.perf_counter()
        poles = lscf_poles(LINES, value[:, None], 100)[-1]
        ours.append(time.perf_counter() - start)
        padded = np.concatenate([np.zeros((N, 1)), value, np.zeros((N, 1))], axis=1)
        axis = 0.5 * np.arange(padded.shape[1])
        model = Model(padded, axis, lower=0.5, upper=axis[-1], pol_order_high=100)
        start = time.perf_counter()
        model.get_poles(show_progress=False)
        theirs.append(time.perf_counter() - start)
    peer = np.asarray(model.all_poles[-1])
    difference = max(
        float(np.min(np.abs(peer - p)) / np.abs(p))
        for p in poles[[int(np.argmin(np.abs(poles - q))) for q in truth.pole]]
    )
    ratio = min(theirs) / min(ours)
    report(
        "poles at order 100",
        "2.5 x faster than sdypy-EMA, same to 1e-8",
        f"{min(ours):.2f} s, {ratio:.2f} x faster, {difference:.1e}",
        f"{min(theirs):.2f} s",
        polypy_seconds(value),
    )
    seconds, peak = whole_identification(value, tmp_path)
    report(
        "whole identification, intervals included",
        "10 s, 300 MB",
        f"{seconds:.2f} s, {peak:.0f} MB in a process of its own",
        "not automatic",
        "not automatic",
    )
    assert ratio >= 2.5
    assert difference < 1e-8
    assert seconds < 10.0
    assert peak < 300.0
