"""A test that two torques cannot settle: a set is named, what was planted in it, and the next test that would tell."""

from pathlib import Path

import pytest

from updating.commands.command_line import diagnose
from updating.diagnosis.answer import Diagnosis
from updating.results.store import read_result

pytestmark = pytest.mark.slow

CAMPAIGN = Path(__file__).parents[2] / "data" / "hidden_effect" / "open" / "campaign.toml"


def test_what_cannot_be_told_apart_is_named_with_the_test_that_would_tell(tmp_path):
    diagnose(CAMPAIGN, tmp_path)
    found = read_result(tmp_path / "diagnosis.json", Diagnosis)
    assert found.verdict == "one of"
    assert ("contact_loss",) in found.set
    best, *_ = found.next_tests
    assert best.distance > 3.0 > best.now
