"""Every check has a name and a sentence, in the report and in the documents."""

import re
from pathlib import Path

from ema.quality.channels import _passed
from ema.quality.verdict import CHECKS, label, meaning

ROOT = Path(__file__).parents[2]


def test_every_check_that_the_source_names_has_a_name_and_a_sentence():
    named = {verdict.check for verdict in _passed([])}
    for file in (ROOT / "ema" / "quality").glob("*.py"):
        text = file.read_text(encoding="utf-8")
        named |= set(re.findall(r'check="([a-z ]+)"', text))
        named |= set(re.findall(r'_verdict\(frf, "([a-z ]+)"', text))
    assert len(named) > 15
    assert named <= CHECKS.keys()
    for check in named:
        assert label(check)
        assert meaning(check).endswith(".")
    assert label("a new one") == "a new one"


def test_the_documents_explain_every_check():
    text = (ROOT / "docs" / "own_test.md").read_text(encoding="utf-8")
    for check, (name, sentence) in CHECKS.items():
        assert f"| {name} | {check} | {sentence} |" in text
