"""The shipped campaign from FRF files to the report, against the truth that it was simulated from."""

import html.parser
import json
from pathlib import Path

import numpy as np
import pytest

from ema import ModalModel, mac
from updating import Fit, read_result, write_report
from updating.results.text import Z95, uncertain

TRUTH = Path(__file__).parents[2] / "data/demo_stack/truth.json"


@pytest.fixture(scope="module")
def truth():
    result = json.loads(TRUTH.read_text(encoding="utf-8"))["result"]
    return {
        c["name"]: (c, m) for c, m in zip(result["configurations"], result["modes"], strict=True)
    }, result["band"]


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


def test_results_on_disk_are_those_that_were_returned(demo):
    folder, results = demo
    for found, fitted in results:
        measured = found.modal_model
        again = read_result(folder / measured.name / "modal_model.json", ModalModel)
        np.testing.assert_array_equal(again.pole, measured.pole)
        np.testing.assert_array_equal(again.shape, measured.shape)
        fit_again = read_result(folder / measured.name / "fit.json", Fit)
        assert fit_again.G_f.value == fitted.G_f.value
        np.testing.assert_array_equal(fit_again.pairing.mac, fitted.pairing.mac)


class Links(html.parser.HTMLParser):
    """Everything that a page would load."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attrs):
        wanted = {"src", "href", "data", "srcset"}
        self.found += [value for name, value in attrs if name in wanted]


def test_the_report_holds_everything_that_it_shows(demo):
    text = write_report(demo[0]).read_text(encoding="utf-8")
    links = Links()
    links.feed(text)
    assert len(links.found) > 10
    assert all(link.startswith(("data:image/", "#")) for link in links.found)
    assert "@import" not in text
    for found, fitted in demo[1]:
        measured = found.modal_model
        assert uncertain(measured.frequency[0], Z95 * measured.frequency_std[0]) in text
        assert f"{fitted.modes.frequency[fitted.pairing.model[0]]:.2f}" in text
