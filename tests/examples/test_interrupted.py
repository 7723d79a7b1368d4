"""A run that is stopped goes on where it stopped, and its results are those of a run that was not."""

from pathlib import Path

import pytest
from rich.console import Console

from updating import identified as module
from updating import jobs

CAMPAIGN = Path(__file__).parents[2] / "data/demo_stack/campaign.toml"


def test_a_run_stopped_after_its_first_configuration_ends_with_the_same_bytes(demo, tmp_path, monkeypatch):
    identify, computed = module.identify, []

    def counted(campaign, poles):
        computed.append(campaign.configurations[0].name)
        return identify(campaign, poles)

    def stopped(campaign, poles):
        if campaign.configurations[0].name == "M2":
            raise KeyboardInterrupt
        return counted(campaign, poles)

    def run():
        return jobs.fit(CAMPAIGN, tmp_path, 0.8, Console(quiet=True))

    monkeypatch.setattr(module, "identify", stopped)
    with pytest.raises(KeyboardInterrupt):
        run()
    kept = (tmp_path / "M1/fit.json").stat().st_mtime_ns
    assert not (tmp_path / "M2").exists()
    monkeypatch.setattr(module, "identify", counted)
    again = run()
    assert computed == ["M1", "M2"]
    assert (tmp_path / "M1/fit.json").stat().st_mtime_ns == kept
    files = [f.relative_to(tmp_path) for f in tmp_path.rglob("*") if f.is_file()]
    assert len(files) == 11
    for file in files:
        assert (tmp_path / file).read_bytes() == (demo[0] / file).read_bytes(), file
    assert [fitted.G_f.value for _, fitted in again] == [fitted.G_f.value for _, fitted in demo[1]]
