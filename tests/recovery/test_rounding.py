"""The same input gives the same numbers, whatever the last digit of the data is and however many threads there are."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ema
from ema.identification.identify import identify_frf

DATA = Path(__file__).parents[2] / "data/demo_stack"
BOUND = 1e-10


def assert_same(first, second, name):
    first, second = np.asarray(first), np.asarray(second)
    np.testing.assert_allclose(second, first, rtol=BOUND, atol=BOUND * np.abs(first).max(), err_msg=name)


@pytest.mark.slow
def test_the_last_digit_of_the_data_does_not_decide():
    """A pole that wanders off in the fit of a single run left the others, and the shapes, to rounding."""
    campaign = ema.read_campaign(DATA / "campaign.toml")
    measurement = ema.read_measurement(campaign, "M1")
    frf, rng = measurement.frf, np.random.default_rng(0)
    digit = replace(frf, value=frf.value * (1.0 + 1e-15 * rng.standard_normal(frf.value.shape)))
    first, second = (
        identify_frf(f, measurement.geometry, name="M1", band=campaign.identification.band) for f in (frf, digit)
    )
    for name in ("frequency", "frequency_std", "damping", "run_pole", "shape", "shape_std"):
        assert_same(getattr(first, name), getattr(second, name), name)


IDENTIFIED_AND_FITTED = """
import dataclasses, sys
from pathlib import Path
import ema, model, updating
from updating.results.store import write_result
data, output = map(Path, sys.argv[1:])
campaign = ema.read_campaign(data / "campaign.toml")
first = campaign.configurations[0]
every_third = tuple(first.files[0].files[::3])
first = dataclasses.replace(first, files=(dataclasses.replace(first.files[0], files=every_third),))
options = dataclasses.replace(campaign.identification, band=(150.0, 700.0), order=40)
(found,) = ema.identify(dataclasses.replace(campaign, configurations=(first,), identification=options))
stack = dataclasses.replace(model.read_stack(campaign.stack), n_lamina=60, mesh=model.Mesh(n_x=10, n_y=2))
fit = updating.fit(stack.with_contact(pressure=first.pressure), found.modal_model)
write_result(output / "modal_model.json", found.modal_model, inputs=(), options={})
write_result(output / "fit.json", fit, inputs=(), options={})
"""


def test_the_number_of_threads_does_not_decide(tmp_path):
    runs = [
        subprocess.Popen(
            [sys.executable, "-c", IDENTIFIED_AND_FITTED, str(DATA), str(tmp_path / threads)],
            env=os.environ | {"OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads},
        )
        for threads in ("1", "2")
    ]
    assert [run.wait() for run in runs] == [0, 0]
    for name in ("modal_model.json", "fit.json"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()
