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
        campaign.name, specimens_of(campaign, lambda one: None), model.catalogue(), reduced=cached_model
    )
    with capsys.disabled():
        plan = json.loads((DATA / name / "truth.json").read_text(encoding="utf-8"))["plan"]
        print(f"\n{name}: {plan}")
        print("\n".join(found.sentences), flush=True)
    assert {(one.effect, one.level, one.of) for one in found.best.parts} == MEANT[name]
    odd = {one.name for one in found.specimens if one.odd}
    assert odd == {of for _, level, of in MEANT[name] if level == "specimen"}


@pytest.mark.slow
def test_an_effect_that_is_asked_for_is_fitted_to_all_specimens():
    """Half a kilogram was planted under each clamp of the rig; one specimen is glued besides."""
    campaign = read_specimens(DATA / "pooled_a" / "campaign.toml")
    specimens = specimens_of(campaign, lambda one: None)
    found = diagnose_specimens(campaign.name, specimens, {"clamp_mass": model.catalogue()["clamp_mass"]}, asked=True)
    assert found.verdict == "as asked"
    (one,) = found.best.parts
    (mass,) = one.parameter
    assert (one.effect, one.level) == ("clamp_mass", "rig")
    assert 0.4 < mass.value < 0.9
    assert found.best.frequency_error < found.ranking[1].frequency_error
    assert found.sentences[0].startswith("As asked for: clamp mass (clamp_mass), of the rig")
