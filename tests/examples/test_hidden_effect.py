"""The shipped campaigns with a hidden effect: identified, every planted frequency lies in its interval."""

import json
from pathlib import Path

import numpy as np
import pytest

import ema

DATA = Path(__file__).parents[2] / "data/hidden_effect"
NAMES = "abcdefgh"
VISIBLE = 0.02  # of the strongest resonance in the band


def planted(truth, configuration):
    """Return the planted frequencies, Hz, of the band that show in the FRFs."""
    modes = dict(zip([c["name"] for c in truth["configurations"]], truth["modes"], strict=True))[configuration]
    frequency, strength = np.array(modes["tested_frequency"]), np.array(modes["strength"])
    inside = (frequency > truth["band"][0]) & (frequency < truth["band"][1])
    return frequency[inside & (strength > VISIBLE * strength[inside].max())]


def deviations(name):
    """Return (identified - planted) / standard deviation of every planted mode of a campaign."""
    truth = json.loads((DATA / name / "truth.json").read_text(encoding="utf-8"))["result"]
    found = []
    for identified in ema.identify(ema.read_campaign(DATA / name / "campaign.toml")):
        measured = identified.modal_model
        for frequency in planted(truth, measured.name):
            near = int(np.argmin(np.abs(measured.frequency - frequency)))
            found.append((measured.frequency[near] - frequency) / measured.frequency_std[near])
    return found


@pytest.mark.parametrize("name", NAMES)
def test_a_campaign_is_small_and_keeps_its_secret(name):
    files = [path for path in (DATA / name).rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 3e6
    truth = json.loads((DATA / name / "truth.json").read_text(encoding="utf-8"))["result"]
    given = "".join((DATA / name / f).read_text(encoding="utf-8") for f in ("campaign.toml", "stack.toml"))
    assert not any(effect in given for effect in truth["effects"])


def test_one_campaign_has_none_one_a_pair_and_six_one_effect():
    count = [len(json.loads((DATA / n / "truth.json").read_text(encoding="utf-8"))["result"]["effects"]) for n in NAMES]
    assert sorted(count) == [0, 1, 1, 1, 1, 1, 1, 2]


@pytest.mark.slow
def test_planted_frequencies_lie_within_their_intervals():
    z = np.array([value for name in NAMES for value in deviations(name)])
    assert z.size > 70
    assert np.mean(np.abs(z) < 1.96) >= 0.93
