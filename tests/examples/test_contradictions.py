"""What contradicts a measurement is printed with every answer that rests on it."""

import io
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from ema import read_campaign
from updating.commands import ema as ema_command
from updating.commands import update as update_command
from updating.commands.terminal import Run
from updating.commands.update import run_update
from updating.diagnosis import evidence
from updating.errors import FitError
from updating.fitting import fit
from updating.results.campaign import measurement_findings
from updating.results.identified import assignments, every_identified


@pytest.fixture(scope="module")
def results(small):
    """The configurations of the small campaign, of which C1 and C3, and C2 and C4, have the same files."""
    campaign, out = small
    return every_identified(assignments(read_campaign(campaign), out), "identify", Console(quiet=True))


def test_the_same_files_in_two_configurations_are_named(results):
    found = tuple(measurement_findings(results))
    for pair in ("C1 and C3", "C2 and C4"):
        assert (
            f"In the campaign: {pair} share 12 of 12 functions to the last digit: files of one stand in the other, "
            "too, which is no second measurement"
        ) in found
    assert not any("C1 and C2 share" in line for line in found)


def test_they_are_printed_with_the_modes(small, results, monkeypatch, tmp_path, undrawn):
    campaign, out, shown = small[0], tmp_path / "out", io.StringIO()
    shutil.copytree(small[1], out)  # other tests share what is there
    monkeypatch.setattr(ema_command, "OUT", Console(file=shown, width=200))
    ema_command.ema_command(Run(campaign=campaign, output=out), None)
    assert "C1 and C3 share 12 of 12 functions" in shown.getvalue()


def test_they_are_printed_where_several_configurations_are_fitted_together(small, tmp_path, monkeypatch):
    campaign, out = small
    file, shown = tmp_path / "update.toml", io.StringIO()
    file.write_text(f'name = "all"\n[[campaign]]\nfile = "{campaign}"\n', encoding="utf-8")

    def enough(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(update_command, "joint_fit", enough)
    with pytest.raises(KeyboardInterrupt):
        run_update(Run(campaign=file, output=out, console=Console(file=shown, width=200)))
    assert "In the campaign: C1 and C3 share 12 of 12 functions" in shown.getvalue()


def test_a_fit_that_leaves_no_pair_is_an_error(monkeypatch):
    """Its error would be that of nothing, which is no number."""
    monkeypatch.setattr(fit, "pair", lambda *_, **__: SimpleNamespace(measured=np.arange(0)))
    measured = SimpleNamespace(name="M1", frequency=np.ones(9))
    with pytest.raises(FitError, match="M1: at the best G_f none of 9 measured modes pairs with the model"):
        fit._paired(measured, None, 0.8)


def test_a_configuration_of_which_nothing_would_be_used_is_an_error(monkeypatch):
    tested = [SimpleNamespace(name=name) for name in ("M1", "M2")]
    monkeypatch.setattr(evidence, "_far", lambda *_: (1.0, [0, 3]))
    with pytest.raises(FitError, match="no measured mode of M1 resembles one of the model"):
        evidence._nearest(SimpleNamespace(rough=None), tested, ())
