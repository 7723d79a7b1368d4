"""FRFs from several forces at once: exact without noise, the bias of H1 and Hv, coherences, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from ema.campaign.estimate import Averaging, estimate_frf, estimate_frf_matrix
from ema.campaign.reading import frfs_from_records
from ema.io.measured_function import MeasuredFunction
from ema.types.errors import MeasurementError

RATE = 1000.0
SYSTEMS = [[signal.butter(2, band, "bandpass", fs=RATE) for band in row] for row in
           [[(80, 120), (100, 200)], [(60, 90), (150, 180)], [(120, 160), (70, 110)]]]  # fmt: skip
RANDOM = {"window": "hann", "block_s": 1.0, "overlap": 0.5}


def shaken(rng, n_sample=200_000, *, shared=0.0, force_noise=0.0, response_noise=0.0):
    """Two forces, some of the second in the first, and three responses."""
    force = rng.normal(size=(2, n_sample))
    force[0] += shared * force[1]
    response = np.array(
        [sum(signal.lfilter(*s, f) for s, f in zip(row, force, strict=True)) for row in SYSTEMS]
    )
    response += response_noise * response.std(axis=1, keepdims=True) * rng.normal(size=response.shape)
    force += force_noise * rng.normal(size=force.shape)
    return force[:, None], response[:, None]


def truth(frequency):
    return np.array([[signal.freqz(*s, worN=frequency, fs=RATE)[1] for s in row] for row in SYSTEMS])


@pytest.mark.parametrize("estimator", ["H1", "Hv"])
@pytest.mark.parametrize("shared", [0.0, 2.0])
def test_forces_are_told_apart_even_where_they_share_much(estimator, shared):
    estimate = estimate_frf_matrix(
        *shaken(np.random.default_rng(1), shared=shared), RATE, Averaging(estimator=estimator, **RANDOM)
    )
    true = truth(estimate.frequency)
    band = slice(60, 200)  # leakage of the sharp flanks is what is left
    assert np.abs(estimate.value - true)[..., band].max() < 0.08
    # the first force is one part its own and four parts of the second
    np.testing.assert_allclose(estimate.independent[0, 1:-1].mean(), 1 / (1 + shared**2), atol=0.02)
    assert estimate.multiple_coherence[:, band].mean() > 0.99


def test_whole_transients_without_noise_are_exact():
    rng = np.random.default_rng(2)
    force = np.zeros((2, 4, 2048))
    force[:, :, 20:30] = rng.normal(size=(2, 4, 10))
    response = np.array(
        [sum(signal.lfilter(*s, f) for s, f in zip(row, force, strict=True)) for row in SYSTEMS]
    )
    for estimator in ("H1", "Hv"):
        estimate = estimate_frf_matrix(force, response, RATE, Averaging(window="boxcar", estimator=estimator))
        np.testing.assert_allclose(estimate.value, truth(estimate.frequency), atol=1e-5)
        # none of the two forces alone explains the responses
        assert estimate.partial_coherence[:, :, 150:350].min() > 0.99


def test_bias_of_the_estimators_with_noise():
    band = slice(85, 115)

    def ratio(estimator, **noise):
        data = shaken(np.random.default_rng(3), **noise)
        estimate = estimate_frf_matrix(*data, RATE, Averaging(estimator=estimator, **RANDOM))
        return np.mean(np.abs(estimate.value[0, 0, band] / truth(estimate.frequency)[0, 0, band]))

    assert ratio("H1", response_noise=0.7) == pytest.approx(1.0, abs=0.02)
    # noise of 0.7 of the force adds 0.49 to its spectrum, which H1 divides by; of a larger response Hv sees less of it
    assert ratio("H1", force_noise=0.7) == pytest.approx(1 / 1.49, abs=0.02)
    assert 1 / 1.49 < ratio("Hv", force_noise=0.7) < 1.05


def test_partial_coherence_tells_the_scatter_of_functions_of_forces_that_share_much():
    data = shaken(np.random.default_rng(3), 400_000, response_noise=0.3, shared=3.0)
    estimate = estimate_frf_matrix(*data, RATE, Averaging(**RANDOM))
    band = slice(85, 115)
    partial = estimate.partial_coherence[0, :, band]
    # Bendat and Piersol, Random Data, table 9.6, of real and imaginary part together
    predicted = np.sqrt((1 - partial) / partial / estimate.n_average)
    error = np.abs(estimate.value[0, :, band] / truth(estimate.frequency)[0, :, band] - 1)
    assert np.sqrt(np.mean(error**2) / np.mean(predicted**2)) == pytest.approx(1.0, abs=0.3)


def test_one_force_is_the_special_case():
    force, response = shaken(np.random.default_rng(4), response_noise=0.3)
    for estimator in ("H1", "Hv"):
        averaging = Averaging(estimator=estimator, **RANDOM)
        several = estimate_frf_matrix(force[:1], response, RATE, averaging)
        one = estimate_frf(force[0], response, RATE, averaging)
        np.testing.assert_allclose(several.value[:, 0], one.value, rtol=1e-6)
        np.testing.assert_allclose(several.multiple_coherence, one.coherence, atol=1e-9)
        np.testing.assert_allclose(several.partial_coherence[:, 0], one.coherence, atol=1e-9)


def refusal(force, response, **averaging):
    with pytest.raises(MeasurementError) as error:
        estimate_frf_matrix(force, response, RATE, Averaging(**averaging))
    return str(error.value)


def test_what_does_not_tell_forces_apart_is_refused():
    force, response = shaken(np.random.default_rng(5), 20_000)
    assert "2 averages do not tell the parts of 2 forces" in refusal(
        force, response, window="hann", block_s=10.0
    )
    same = np.stack([force[0], 2 * force[0]])
    assert "the 2 forces are the same up to a factor" in refusal(same, response, **RANDOM)
    assert "force 2 of 2 is zero" in refusal(force * [[[1]], [[0]]], response, **RANDOM)
    assert "H2 is not defined for 2 forces" in refusal(force, response, estimator="H2", **RANDOM)


def channels(kinds, value):
    return tuple(
        MeasuredFunction(
            kind=kind,
            abscissa=np.arange(value.shape[1]) / RATE,
            value=own,
            quantity=None if kind == "force" else "accelerance",
            output=(k, 3),
            input=None,
            source=f"run.uff: data set {k}",
        )
        for k, (kind, own) in enumerate(zip(kinds, value, strict=True), start=1)
    )


def test_records_of_two_shakers_give_each_response_over_each_force():
    force, response = shaken(np.random.default_rng(6), 100_000, shared=2.0)
    value = np.concatenate([force, response])[:, 0]
    kinds = ("force", "force", "response", "response", "response")
    notes = []
    found = frfs_from_records([(Path("run.uff"), channels(kinds, value))], Averaging(**RANDOM), notes)
    assert [(f.output, f.input) for f, *_ in found] == [((o, 3), (i, 3)) for o in (3, 4, 5) for i in (1, 2)]
    band = slice(60, 200)
    np.testing.assert_allclose(found[3][0].value[band], truth(found[3][0].abscissa)[1, 1, band], atol=0.1)
    assert found[3][1].kind == "coherence"
    assert "2 forces at once, 199 averages: of its power they explain 1.00" in notes[0]
    assert "80 % of a force is in the others, too" in notes[1]


def test_the_positions_of_several_forces_may_be_stated():
    force, response = shaken(np.random.default_rng(6), 100_000)
    value = np.concatenate([response[:1], force, response[1:]])[:, 0]
    averaging = Averaging(force=(2, 3), **RANDOM)
    found = frfs_from_records([(Path("run.csv"), channels(("response",) * 5, value))], averaging, [])
    assert [(f.output, f.input) for f, *_ in found] == [((o, 3), (i, 3)) for o in (1, 4, 5) for i in (2, 3)]
