"""The command line as its user meets it: what it prints, what it writes, how it fails."""

import json
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from tests.command import lamella
from updating.commands.command_line import app

ROOT = Path(__file__).parents[2]


def modules_after(code):
    """Names of the modules that a new process has after some code."""
    code = f"import sys; {code}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    return set(done.stdout.split())


def test_a_package_is_imported_without_what_is_not_used():
    assert "numpy" not in modules_after("import ema, model, updating")
    assert "ema.modal.mac" in modules_after("from ema import mac")
    assert "ema.identification.identify" not in modules_after("from ema import mac")


@pytest.mark.parametrize("package", ["ema", "model", "updating", "updating.commands"])
def test_every_public_name_is_there(package):
    module = import_module(package)
    assert module.__all__
    assert all(getattr(module, name) is not None for name in module.__all__)
    assert set(module.__all__) <= set(dir(module))
    with pytest.raises(AttributeError, match="no attribute 'nothing_of_this_name'"):
        module.nothing_of_this_name  # noqa: B018


def test_ema_prints_a_table_and_writes_results(write_small_campaign, tmp_path):
    done = lamella("ema", write_small_campaign(tmp_path, 1), "-o", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "C1" in done.stdout
    assert "damping [%]" in done.stdout
    written = json.loads((tmp_path / "C1/modal_model.json").read_text(encoding="utf-8"))
    assert written["kind"] == "ModalModel"
    assert set(written["provenance"]) == {"versions", "inputs", "options"}
    assert f"{written['result']['frequency'][0]:.3f}" in done.stdout
    assert (tmp_path / "C1/frf.png").read_bytes().startswith(b"\x89PNG")


def test_edited_poles_are_given_back(write_small_campaign, tmp_path, undrawn):
    """A pole taken out of poles.txt is gone from the result of the second run, and only that one."""
    campaign = write_small_campaign(tmp_path, 1)
    assert lamella("ema", campaign, "-o", tmp_path / "first").returncode == 0
    poles = tmp_path / "first/C1/poles.txt"
    lines = poles.read_text(encoding="utf-8").splitlines()
    poles.write_text("\n".join(lines[:-1]), encoding="utf-8")
    done = lamella("ema", campaign, "-o", tmp_path / "second", "--poles", tmp_path / "first")
    assert done.returncode == 0, done.stderr
    first, second = (
        json.loads((tmp_path / run / "C1/modal_model.json").read_text(encoding="utf-8"))["result"]["frequency"]
        for run in ("first", "second")
    )
    # The residual terms take over the missing mode's skirt only roughly, so its neighbour moves by some 0.04 %.
    assert second == pytest.approx(first[:-1], rel=1e-3)


def test_model_prints_modes_and_draws_them(write_small_campaign, tmp_path):
    stack, out = write_small_campaign(tmp_path, 1).with_name("stack.toml"), tmp_path / "out"
    done = lamella("model", stack, "-o", out, "-n", 3)
    assert done.returncode == 0, done.stderr
    assert "torsion 1" in done.stdout
    assert sorted(p.name for p in out.iterdir()) == [
        "mode_01.png", "mode_02.png", "mode_03.png", "modes.json", "verification.json",
    ]  # fmt: skip
    assert "They are within the" in done.stdout


@pytest.mark.parametrize("command", [c.name or c.callback.__name__ for c in app.registered_commands])
def test_help_gives_an_example(command):
    done = lamella(command, "--help")
    assert done.returncode == 0
    assert f"Example: lamella {command}" in " ".join(done.stdout.split())


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("ema", "nowhere.toml", "-o", "out"), "nowhere.toml"),
        (("fit", "data/demo_stack/stack.toml", "-o", "out"), "stack.toml"),
        (("model", "data/demo_stack/campaign.toml", "-o", "out"), "campaign.toml"),
        (("report", "tests"), "campaign.json"),
        (("simulate", "data/demo_stack/campaign.toml", "-o", "out"), "campaign.toml"),
    ],
)
def test_a_wrong_file_is_one_message_and_exit_code_1(tmp_path, arguments, expected):
    here = [tmp_path / a if a == "out" else a for a in arguments]
    done = lamella(*here)
    assert done.returncode == 1
    assert done.stderr.startswith("Error:")
    assert expected in done.stderr.replace("\n", "")
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists() or not any((tmp_path / "out").iterdir())


def test_a_misspelt_command_is_answered_with_the_nearest(tmp_path):
    done = lamella("fitt", "x.toml", "-o", tmp_path)
    assert done.returncode == 2
    assert "Did you mean 'fit'" in done.stderr


def test_picking_without_a_display_says_what_to_do_instead(tmp_path):
    done = lamella("pick", "data/demo_stack/campaign.toml", "M1", "-o", tmp_path)
    assert done.returncode == 1
    assert "no display" in done.stderr
    assert not any(tmp_path.iterdir())


def test_an_unwritable_folder_is_said(tmp_path):
    (tmp_path / "file").write_text("in the way")
    done = lamella("ema", "data/demo_stack/campaign.toml", "-o", tmp_path / "file")
    assert done.returncode == 1
    assert "cannot write" in done.stderr
