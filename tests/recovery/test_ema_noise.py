"""Intervals hold where the noise depends on frequency and the coherence says so.

A shaker's force drops where the structure gives way, so that the noise over the force rises there; a second
source of noise is confined to the upper end of the band.
"""

import numpy as np
import pytest

from ema.identification.functions import coherence_weight
from ema.identification.identify import identify_frf
from ema.types.frf import FRF, Dofs, Geometry

FREQUENCY = np.arange(100.0, 700.0, 0.5)
MODES = np.array([180.0, 330.0, 560.0])
DAMPING = np.array([0.012, 0.006, 0.01])
N, N_AVERAGE = 6, 20
GEOMETRY = Geometry(node=np.arange(N), coordinate=np.outer(np.arange(N), [0.1, 0, 0]), line=np.empty((0, 2)))


def truth():
    pole = 2 * np.pi * MODES * (-DAMPING + 1j * np.sqrt(1 - DAMPING**2))
    shape = np.cos(np.pi * np.outer(np.linspace(0, 1, N), [1, 2, 3])) + 0.2
    residue = shape * shape[0] / (2j * pole.imag)
    s = 2j * np.pi * FREQUENCY
    return s**2 * (residue @ (1 / (s - pole[:, None])) + residue.conj() @ (1 / (s - pole.conj()[:, None])))


def noise_level():
    """Noise over force, relative: ten times higher around the first mode, thirty above 500 Hz."""
    dropout = 9 / (1 + ((FREQUENCY - MODES[0]) / 6) ** 2)
    return 1 + dropout + 29 / (1 + np.exp((500 - FREQUENCY) / 10))


def averaged(rng):
    """Return H1 and coherence of blocks with random force and the noise above on the responses."""
    clean = truth()
    level = 0.02 * np.sqrt(np.mean(np.abs(clean) ** 2, axis=1))[:, None] * noise_level()

    def normal(*shape):
        return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)

    force = normal(N_AVERAGE, 1, FREQUENCY.size)
    response = clean * force + level * normal(N_AVERAGE, N, FREQUENCY.size)
    cross = np.mean(response * force.conj(), axis=0)
    g_ff, g_xx = np.mean(np.abs(force) ** 2, axis=0), np.mean(np.abs(response) ** 2, axis=0)
    return cross / g_ff, np.abs(cross) ** 2 / (g_ff * g_xx)


def frf(value, coherence):
    up = np.tile([0.0, 0.0, 1.0], (N, 1))
    return FRF(
        frequency=FREQUENCY,
        value=value[:, None],
        quantity="accelerance",
        output=Dofs(node=np.arange(N), direction=up),
        input=Dofs(node=[0], direction=up[:1]),
        run=np.zeros(N, dtype=int),
        source=("generated",) * N,
        coherence=None if coherence is None else coherence[:, None],
    )


def scores(n_set, *, with_coherence):
    """Return errors of f and damping over their standard deviations (n_set, 2, n_mode), and the errors of f."""
    score, error = [], []
    for seed in range(n_set):
        value, coherence = averaged(np.random.default_rng([11, seed]))
        model = identify_frf(frf(value, coherence if with_coherence else None), GEOMETRY, name="set")
        assert model.frequency.size == MODES.size
        off = np.stack([model.frequency - MODES, model.damping - DAMPING])
        score.append(off / np.stack([model.frequency_std, model.damping_std]))
        error.append(off[0])
    return np.array(score), np.array(error)


def test_weights_follow_the_noise():
    value, coherence = averaged(np.random.default_rng(12))
    weight = coherence_weight(value, coherence)
    np.testing.assert_allclose(np.mean(np.log(weight), axis=1), 0, atol=1e-12)
    found, expected = np.mean(np.log(weight), axis=0), -2 * np.log(noise_level())
    blocks = [np.mean((v - v.mean()).reshape(-1, 25), axis=1) for v in (found, expected)]
    # the mean of 25 lines, 20 averages and 6 channels scatters by 2 %; smoothing blurs the drop-out
    np.testing.assert_allclose(*blocks, atol=0.25)
    assert np.ptp(blocks[1]) > 6


@pytest.mark.parametrize("damage", [np.nan, 1.5, -0.1])
def test_impossible_coherences_weigh_nothing(damage):
    value, coherence = averaged(np.random.default_rng(12))
    coherence[2, 7] = damage
    weight = coherence_weight(value, coherence)
    np.testing.assert_array_equal(weight[2], 1.0)
    assert np.ptp(weight[1]) > 0


def test_a_coherence_that_is_not_that_of_the_noise_is_not_used():
    # the same coherence everywhere says that the noise is that of the function, which it is not
    rng = np.random.default_rng(13)
    clean = truth()
    level = 0.01 * np.sqrt(np.mean(np.abs(clean) ** 2, axis=1, keepdims=True))
    value = clean + level * (rng.standard_normal(clean.shape) + 1j * rng.standard_normal(clean.shape))
    plain = identify_frf(frf(value, None), GEOMETRY, name="set")
    misled = identify_frf(frf(value, np.full(clean.shape, 0.99)), GEOMETRY, name="set")
    np.testing.assert_array_equal(misled.frequency, plain.frequency)
    np.testing.assert_array_equal(misled.frequency_std, plain.frequency_std)


def test_the_coherence_sharpens_the_modes_in_quiet_lines():
    score, error = scores(8, with_coherence=True)
    score_alike, error_alike = scores(8, with_coherence=False)
    # 32 squares of standard normal numbers have a mean within 1 +- 0.25 (one standard deviation)
    assert 0.5 < np.mean(score[..., :2] ** 2) < 1.6
    assert np.mean(score_alike[..., :2] ** 2) < 0.5
    # the slope of the noise counts without coherences too, which takes most of what they bring; they add its step
    assert np.std(error[:, 1]) < np.std(error_alike[:, 1])


@pytest.mark.benchmark
def test_coverage_with_and_without_coherence(capsys):
    weighted, error = scores(300, with_coherence=True)
    alike, error_alike = scores(300, with_coherence=False)
    cover, cover_alike = (np.mean(np.abs(s) < 1.96, axis=(0, 1)) for s in (weighted, alike))
    ratio = np.std(error_alike, axis=0) / np.std(error, axis=0)
    with capsys.disabled():
        print("\nnoise that depends on frequency, 300 sets, by mode: coverage of the 95 % intervals")
        print(f"  with coherence    {' / '.join(f'{100 * c:.1f} %' for c in cover)}")
        print(f"  without           {' / '.join(f'{100 * c:.1f} %' for c in cover_alike)}")
        print(f"  error of f without coherence over with it {' / '.join(f'{r:.2f}' for r in ratio)}")
    assert 0.93 < np.mean(np.abs(weighted) < 1.96) < 0.97
    assert np.all((cover > 0.92) & (cover < 0.98))
    # a slope stands for the noise without coherences, which is too much for one mode and too little for another
    assert not np.all((cover_alike > 0.92) & (cover_alike < 0.98))
