"""A laboratory states what separates its right models from its right measurements."""

import re
from dataclasses import fields
from pathlib import Path

import pytest

from updating.diagnosis.evidence import DiagnosisScatter, read_scatter
from updating.errors import FitError


def test_what_is_stated_counts_and_the_rest_stays(tmp_path):
    (tmp_path / "scatter.toml").write_text("stiffness = 0.1\nheight = 0.005\n", encoding="utf-8")
    found = read_scatter(tmp_path / "scatter.toml")
    assert found == DiagnosisScatter(stiffness=0.1, height=0.005)


@pytest.mark.parametrize(("line", "fault"), [("yung = 0.1", "did you mean 'young'"), ("young = 0.0", "greater than 0")])
def test_a_faulty_line_is_named(tmp_path, line, fault):
    (tmp_path / "scatter.toml").write_text(line, encoding="utf-8")
    with pytest.raises(FitError, match=fault):
        read_scatter(tmp_path / "scatter.toml")


def test_the_documents_list_every_number():
    text = (Path(__file__).parents[2] / "docs/formats.md").read_text(encoding="utf-8")
    section = text.partition("(`lamella diagnose --scatter`)")[2].partition("\n## ")[0]
    listed = re.findall(r"^\| `(\w+)` \| (\S+) \|", section, flags=re.MULTILINE)
    found = {name: None if default == "estimated" else float(default) for name, default in listed}
    assert found == {field.name: field.default for field in fields(DiagnosisScatter)}
