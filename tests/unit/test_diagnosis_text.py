"""What a diagnosis says in words."""

import numpy as np

from updating.diagnosis.ranking import Ranked
from updating.diagnosis.sensor_gain import SensorGain
from updating.diagnosis.text import _change, _misread


def ranked(error, held_out):
    return Ranked(
        effects=("clamp_mass",),
        score=1.0,
        misfit=1.0,
        distance=0.0,
        probability=1.0,
        parameter=(),
        frequency_error=error,
        held_out_error=held_out,
    )


def test_an_error_that_falls():
    assert _change(ranked(0.0123, 0.02), ranked(0.0001, 0.00025)) == (
        "the mean frequency error falls from 1.2 % to 0.010 % "
        "(from 2.0 % to 0.025 % for a mode that is predicted from all others)"
    )


def test_an_error_that_cannot_be_predicted():
    assert (
        _change(ranked(0.12, np.nan), ranked(0.01, 0.01))
        == "the mean frequency error falls from 12 % to 1.0 %"
    )


def test_an_error_that_was_small_does_not_fall():
    assert "falls" not in _change(ranked(3.7e-5, 1e-4), ranked(5.2e-5, 1e-4))


def test_a_sensor_that_reads_otherwise_is_told():
    gains = [
        SensorGain(sensor=2, excess=-0.012, std=0.002),
        SensorGain(sensor=3, excess=0.004, std=0.002),
    ]
    assert _misread(gains) == [
        "Sensor 2 of each run reads 1.2 % lower than sensor 1 (standard deviation 0.20 %): check its calibration. "
        "It is taken into account."
    ]
