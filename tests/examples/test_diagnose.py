"""A diagnosis as its user runs it: made once, read back while nothing that it came from has changed."""

import io

import pytest
from rich.console import Console

import model
from updating.commands import diagnose as command
from updating.diagnosis import cached_model
from updating.diagnosis.diagnosis import diagnose
from updating.errors import FitError

CONSIDERED = ("clamp_mass", "pressure_exponent")


def test_what_was_diagnosed_is_read_back_until_an_input_changes(write_small_campaign, tmp_path, monkeypatch):
    whole, made = model.catalogue(), []
    campaign, shown = write_small_campaign(tmp_path, 2), io.StringIO()
    console = Console(file=shown, force_terminal=True, width=100)

    def counted(*given, **options):
        made.append(diagnose(*given, **options))
        return made[-1]

    monkeypatch.setattr(command, "catalogue", lambda _: {name: whole[name] for name in CONSIDERED})
    monkeypatch.setattr(command, "diagnose_stack", counted)
    monkeypatch.setattr(cached_model, "folder", lambda: tmp_path / "cache")
    first, second = (command.diagnose_campaign(campaign, tmp_path / "out", [], console) for _ in range(2))
    assert len(made) == 1
    for stage in ("reduce the model with 2 effects", "fit 2 effects, each alone"):
        assert f"diagnose: {stage}" in shown.getvalue()
    assert second.sentences == first.sentences == made[0].sentences
    assert second.ranking == first.ranking

    def here(*given, scatter, reduced, **_):
        made.append(diagnose(*given, scatter=scatter, reduced=reduced))
        return made[-1]

    monkeypatch.setattr(command, "diagnose_stack", here)
    campaign.write_text(campaign.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    command.diagnose_campaign(campaign, tmp_path / "out", [], console)
    assert len(made) == 2
    assert made[1].ranking == made[0].ranking  # wherever it was made, and with a model that was read back
    scatter = tmp_path / "scatter.toml"
    scatter.write_text("frequency = 0.02\ndamping = 0.5\nshape = 0.2\n", encoding="utf-8")
    doubtful = command.diagnose_campaign(campaign, tmp_path / "out", [], console, scatter)
    assert doubtful.p_value > made[1].p_value
    scatter.write_text("frequenzy = 0.02\nyoung = 2.0\n", encoding="utf-8")
    with pytest.raises(FitError, match=r"(?s)scatter.toml: young.*scatter.toml: .*frequenzy.*frequency"):
        command.diagnose_campaign(campaign, tmp_path / "out", [], console, scatter)
