"""Poles that a user chose are those of every later command, until the user says otherwise; results may be moved."""

import json
import shutil
from pathlib import Path

import pytest

from ema.campaign.campaign import read_campaign
from tests.command import lamella
from updating.commands import report as open_command
from updating.errors import StoreError
from updating.results.identified import campaign_file, chosen_poles, forget_choices
from updating.workbench.opened import find

pytestmark = pytest.mark.usefixtures("all_undrawn", "tables_alone")


def document(out):
    return json.loads((out / "C1/modal_model.json").read_text(encoding="utf-8"))


def n_mode(out):
    return len(document(out)["result"]["frequency"])


@pytest.fixture(scope="module")
def chosen(write_small_campaign, tmp_path_factory):
    """A campaign of one configuration, and its results with one of two poles chosen by hand."""
    folder = tmp_path_factory.mktemp("chosen")
    campaign, out = write_small_campaign(folder, 1), folder / "out"
    assert lamella("ema", campaign, "-o", out).returncode == 0
    assert n_mode(out) == 2
    poles = out / "C1/poles.txt"
    poles.write_text("\n".join(poles.read_text(encoding="utf-8").splitlines()[:-1]), encoding="utf-8")
    done = lamella("ema", campaign, "-o", out, "--poles", out)
    assert done.returncode == 0, done.stderr
    assert n_mode(out) == 1
    return campaign, out


@pytest.fixture
def results(chosen, tmp_path):
    """The campaign file beside a copy of its results."""
    folder = Path(shutil.copytree(chosen[0].parent, tmp_path / "moved"))
    return folder / "campaign.toml", folder / "out"


def test_a_fit_uses_the_poles_chosen_by_hand_and_says_so(results):
    campaign, out = results
    done = lamella("fit", campaign, "-o", out)
    assert done.returncode == 0, done.stderr
    assert n_mode(out) == 1
    assert "its 1 poles were chosen by hand" in " ".join(done.stdout.split())
    made = document(out)["provenance"]
    assert made["options"]["poles"] == "chosen by hand"
    assert "chosen_poles.txt" in made["inputs"]
    assert "chosen by hand" in (out / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("command", ["ema", "fit"])
def test_identify_anew_undoes_the_choice(results, command):
    campaign, out = results
    done = lamella(command, campaign, "-o", out, "--identify-anew")
    assert done.returncode == 0, done.stderr
    assert n_mode(out) == 2
    assert "chosen by hand" not in done.stdout
    assert "poles" not in document(out)["provenance"]["options"]
    again = lamella("ema", campaign, "-o", out)
    assert n_mode(out) == 2, again.stdout


def test_results_within_results_take_the_choice_from_them_and_those_of_others_do_not(results):
    campaign, out = results
    read = read_campaign(campaign)
    assert set(chosen_poles(read, out / "what_if")) == {"C1"}
    other = campaign.with_name("other.toml")
    shutil.copy(campaign, other)
    assert chosen_poles(read_campaign(other), out / "what_if") == {}


def test_results_moved_together_with_their_campaign_find_it(results, monkeypatch):
    campaign, out = results
    monkeypatch.chdir("/")
    assert find(out, None, lambda *_: None).campaign.samefile(campaign)


def test_results_moved_alone_find_the_same_file_above_them_and_no_other(results, tmp_path):
    campaign, out = results
    moved = tmp_path / "elsewhere" / "deep" / "out"
    moved.parent.mkdir(parents=True)
    shutil.move(out, moved)
    with pytest.raises(StoreError, match="which is not there; open the campaign file"):
        campaign_file(moved)
    same = tmp_path / "elsewhere" / "campaign.toml"
    shutil.copy(campaign, same)
    assert campaign_file(moved).samefile(same)
    same.write_text("another file", encoding="utf-8")
    with pytest.raises(StoreError, match="which is not there"):
        campaign_file(moved)


def test_a_slip_in_chosen_poles_is_said_of_the_file_that_was_given(results):
    campaign, out = results
    (out / "C1/poles.txt").write_text("100 1.5\n", encoding="utf-8")
    done = lamella("ema", campaign, "-o", out, "--poles", out)
    assert done.returncode == 1
    assert "C1/poles.txt, line 1" in done.stderr.replace("\n", "")
    assert n_mode(out) == 1


@pytest.mark.parametrize("name", ["ema", "fit", "diagnose", "next-test", "update", "open"])
def test_every_command_that_identifies_can_do_so_anew(name):
    done = lamella(name, "--help")
    assert "--identify-anew" in done.stdout


def test_a_workbench_opened_with_identify_anew_forgets_the_choice(results, monkeypatch):
    _, out = results
    served = []
    monkeypatch.setattr("updating.workbench.server.serve", lambda opened, **_: served.append(opened))
    open_command.open_command(out, None, 0, browser=False, identify_anew=True)
    assert n_mode(served[0].folder) == 2
    assert not list(out.glob("*/chosen_poles.txt"))


def test_choices_in_results_within_results_are_forgotten_too(tmp_path):
    inside = tmp_path / "campaign/M1/chosen_poles.txt"
    inside.parent.mkdir(parents=True)
    inside.write_text("100 0.01", encoding="utf-8")
    forget_choices(tmp_path)
    assert not inside.exists()
