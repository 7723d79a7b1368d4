"""The shipped campaigns with a hidden effect, from their FRFs to the verdict; part of `make blind`."""

import json
from pathlib import Path

import pytest

import ema
import model
from updating import diagnose

DATA = Path(__file__).parents[2] / "data/hidden_effect"
BENCH = {"stinger_mass"}  # every played test has a force cell of 5 g, which the stack files do not tell


@pytest.mark.blind
@pytest.mark.parametrize("name", "abcdefgh")
def test_the_hidden_effect_is_named(name, capsys):
    truth = json.loads((DATA / name / "truth.json").read_text(encoding="utf-8"))["result"]
    campaign = ema.read_campaign(DATA / name / "campaign.toml")
    tested = [
        (configuration.name, configuration.pressure, identified.modal_model)
        for configuration, identified in zip(campaign.configurations, ema.identify(campaign), strict=True)
    ]
    found = diagnose(model.read_stack(campaign.stack), tested, model.catalogue())
    with capsys.disabled():
        print(f"\n{name}: planted {truth['effect_values']}")
        print("\n".join(found.sentences), flush=True)
    if truth["effects"] or found.set:
        assert set(truth["effects"]) <= set(found.set[0]) <= set(truth["effects"]) | BENCH
    else:
        assert found.verdict == "nothing missing"
