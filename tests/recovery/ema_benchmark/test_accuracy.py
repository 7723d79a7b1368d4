"""Intervals, efficiency and bias of the identification, and how little the band and the quantity matter."""

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from ema.types.frf import FRF

pytestmark = pytest.mark.benchmark


def cramer_rao(sets, truth) -> tuple[NDArray, NDArray]:
    """Bounds of f and damping with all residues and residual terms unknown, from full Jacobians."""
    s = 2j * np.pi * sets.lines
    power = s**2
    p = truth.pole
    a = power[:, None] / (s[:, None] - p)
    b = power[:, None] / (s[:, None] - p.conj())
    linear = np.concatenate([a + b, 1j * (a - b), np.outer(power, [1, 1j]), np.outer(power / s**2, [1, 1j])], 1)
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
    return (np.sqrt(np.diag(to_f @ covariance @ to_f.T))[:m], np.sqrt(np.diag(to_z @ covariance @ to_z.T))[:m])


def peer_errors(sets, count: int, poles, noise: float) -> str:
    """Worst RMS error over the bound, and worst damping bias, of the sets of the coverage study."""
    rows = []
    for seed in range(count):
        frf, truth = sets.noisy(
            np.random.default_rng([1, seed, round(1000 * noise)]), sets.frequency, sets.damping, noise
        )
        f, z = poles(frf.value[:, 0], sets.lines, sets.frequency)
        bound_f, bound_z = cramer_rao(sets, truth)
        rows.append(np.stack([(f - sets.frequency) / bound_f, (z - sets.damping) / bound_z, z / sets.damping - 1.0]))
    data = np.array(rows)
    rms = np.sqrt(np.mean(data[:, :2] ** 2, axis=0)).max()
    return f"{rms:.3g} / {100 * np.abs(data[:, 2].mean(axis=0)).max():.3g} %"


def test_coverage_efficiency_and_bias(sets, peers, report):
    for noise in (0.01, 0.05):
        rows: list[NDArray] = []
        for seed in range(sets.count):
            frf, truth = sets.noisy(
                np.random.default_rng([1, seed, round(1000 * noise)]), sets.frequency, sets.damping, noise
            )
            model = sets.identified(frf)
            assert model.frequency.size == sets.frequency.size, (noise, seed, model.frequency)
            bound_f, bound_z = cramer_rao(sets, truth)
            rows.append(
                np.stack(
                    [
                        (model.frequency - sets.frequency) / model.frequency_std,
                        (model.damping - sets.damping) / model.damping_std,
                        (model.frequency - sets.frequency) / bound_f,
                        (model.damping - sets.damping) / bound_z,
                        model.damping / sets.damping - 1.0,
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
            *peers.of(lambda poles, noise=noise: peer_errors(sets, peers.count, poles, noise)),
        )
        assert np.all((cover > 0.93) & (cover < 0.97))
        assert rms.max() < 1.2
        assert bias < 0.005


def random_bands(sets, n: int) -> Iterator[tuple[FRF, float, float, tuple[float, float]]]:
    """Sets of 0.1 % noise, a mode of theirs, and a band with 5 to 100 half bandwidths on each side of it."""
    for seed in range(n):
        rng = np.random.default_rng([4, seed])
        frf, _ = sets.noisy(rng, sets.frequency, sets.damping, 0.001)
        for f, z in zip(sets.frequency, sets.damping, strict=True):
            reach = f * z * 10 ** rng.uniform(np.log10(5.0), 2.0, 2)
            yield frf, f, z, (max(1.0, f - reach[0]), min(2000.0, f + reach[1]))


def peer_bands(sets, count: int, poles) -> str:
    worst_f = worst_z = 0.0
    failed = total = 0
    for frf, f, z, band in random_bands(sets, max(count // 5, 1)):
        part = frf.band(*band)
        total += 1
        try:
            found, damping = poles(part.value[:, 0], part.frequency, np.array([f]))
        except Exception:
            failed += 1
            continue
        worst_f, worst_z = (max(worst_f, abs(found[0] / f - 1.0)), max(worst_z, abs(damping[0] / z - 1.0)))
    return f"{100 * worst_f:.2g} %, {100 * worst_z:.2g} %, {failed} of {total} bands failed"


def test_any_band(sets, peers, report):
    worst_f = worst_z = 0.0
    n = max(sets.count // 6, 1)
    for frf, f, z, band in random_bands(sets, n):
        model = sets.identified(frf, band)
        k = int(np.argmin(np.abs(model.frequency - f)))
        worst_f = max(worst_f, abs(model.frequency[k] / f - 1.0))
        worst_z = max(worst_z, abs(model.damping[k] / z - 1.0))
    report(
        f"same mode from {6 * n} random bands, 0.1 % noise: worst f, damping",
        "0.01 %, 2 %",
        f"{100 * worst_f:.5f} %, {100 * worst_z:.3f} %",
        *peers.of(lambda poles: peer_bands(sets, peers.count, poles)),
    )
    assert worst_f < 1e-4
    assert worst_z < 0.02


def test_scaled_shapes(sets, report):
    for quantity in ("receptance", "mobility", "accelerance"):
        worst = 0.0
        for seed in range(10):
            frf, truth = sets.noisy(
                np.random.default_rng([5, seed]), sets.frequency, sets.damping, 0.001, quantity=quantity
            )
            model = sets.identified(frf)
            assert model.scaled.all()
            sign = np.sign(np.sum(model.shape.real * truth.shape, axis=0))
            error = np.linalg.norm(model.shape * sign - truth.shape, axis=0)
            worst = max(worst, float(np.max(error / np.linalg.norm(truth.shape, axis=0))))
        figure = f"scaled shapes against truth, {quantity}, 0.1 % noise"
        report(figure, "within 1 %", f"{100 * worst:.3f} %", "not compared", "not compared")
        assert worst < 0.01
