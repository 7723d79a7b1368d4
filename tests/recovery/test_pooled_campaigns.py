"""The shipped campaigns of six specimens, from their tables to the answer."""

import json
from pathlib import Path

import pytest

import model
from updating.diagnosis.cached_model import cached_model
from updating.pooled.campaign_file import read_specimens, specimens_of
from updating.pooled.diagnosis import diagnose_specimens

DATA = Path(__file__).parents[2] / "data" / "hidden_effect"
MEANT = {
    "pooled_a": {("clamp_mass", "rig", ""), ("adhesive_edges", "specimen", "S5")},
    "pooled_b": {("pressure_exponent", "group", "treatment = lacquered")},
}
"""What the catalogue calls what was planted, and whose it is."""


@pytest.mark.blind
@pytest.mark.parametrize("name", sorted(MEANT))
def test_what_was_planted_is_found_where_it_is(name, capsys):
    campaign = read_specimens(DATA / name / "campaign.toml")
    found = diagnose_specimens(
        campaign.name,
        specimens_of(campaign, lambda own: None),
        model.catalogue(),
        reduced=cached_model,
    )
    with capsys.disabled():
        plan = json.loads((DATA / name / "truth.json").read_text(encoding="utf-8"))["plan"]
        print(f"\n{name}: {plan}")
        print("\n".join(found.sentences), flush=True)
    assert {(own.effect, own.level, own.of) for own in found.best.parts} == MEANT[name]
    odd = {own.name for own in found.specimens if own.odd}
    assert odd == {of for _, level, of in MEANT[name] if level == "specimen"}
