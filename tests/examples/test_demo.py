"""The shipped campaign from FRF files to a fit, against the truth that it was simulated from."""

import json
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from ema import ModalModel, mac
from updating import Fit, read_result
from updating.commands.fit import fit_campaign
from updating.commands.terminal import Run

TRUTH = Path(__file__).parents[2] / "data/demo_stack/truth.json"


@pytest.fixture(scope="module")
def truth():
    result = json.loads(TRUTH.read_text(encoding="utf-8"))["result"]
    return {c["name"]: (c, m) for c, m in zip(result["configurations"], result["modes"], strict=True)}, result["band"]


def test_every_true_mode_of_the_band_is_identified_and_no_other(demo, truth):
    simulated, band = truth
    for measured in (found.modal_model for found, _ in demo[1]):
        frequency = np.array(simulated[measured.name][1]["frequency"])
        # In-plane modes move the 44 points along x and y only, which uniaxial accelerometers do not see.
        seen = np.max(np.abs(simulated[measured.name][1]["shape"]), axis=0) > 1e-3
        true = frequency[seen & (frequency > band[0]) & (frequency < band[1])]
        np.testing.assert_allclose(measured.frequency, true, rtol=5e-4)


def test_damping_and_shapes_are_those_of_the_truth(demo, truth):
    for measured in (found.modal_model for found, _ in demo[1]):
        modes = truth[0][measured.name][1]
        nearest = [int(np.argmin(np.abs(np.array(modes["frequency"]) - f))) for f in measured.frequency]
        np.testing.assert_allclose(measured.damping, np.array(modes["damping"])[nearest], rtol=0.03)
        assert np.min(np.diag(mac(measured.shape, np.array(modes["shape"])[:, nearest]))) > 0.999


def test_the_fit_finds_the_contact_parameters(demo, truth):
    for _, fitted in demo[1]:
        true = truth[0][fitted.name][0]
        assert fitted.G_f.value == pytest.approx(true["G_f"], rel=2e-3)
        assert fitted.d_f.value == pytest.approx(true["d_f"], rel=1e-2)
        assert fitted.error < 1e-3
        assert fitted.pairing.unpaired_measured.size == 0


def test_results_on_disk_are_those_that_were_returned(write_small_campaign, tmp_path):
    folder = tmp_path / "out"
    for found, fitted in fit_campaign(
        Run(campaign=write_small_campaign(tmp_path, 1), output=folder, console=Console(quiet=True))
    ):
        measured = found.modal_model
        again = read_result(folder / measured.name / "modal_model.json", ModalModel)
        np.testing.assert_array_equal(again.pole, measured.pole)
        np.testing.assert_array_equal(again.shape, measured.shape)
        fit_again = read_result(folder / measured.name / "fit.json", Fit)
        assert fit_again.G_f.value == fitted.G_f.value
        np.testing.assert_array_equal(fit_again.pairing.mac, fitted.pairing.mac)
