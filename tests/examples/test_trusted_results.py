"""What is stored can be trusted: what was changed, exchanged or belongs to other modes is noticed, and heals."""

import ast
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from updating.commands.ema import identify_campaign
from updating.commands.fit import fit_campaign
from updating.commands.terminal import Run
from updating.errors import StoreError
from updating.report.answer import opening_section
from updating.report.results import read_results
from updating.results.store import read_document
from updating.workers import workers as workers_module

ROOT = Path(__file__).parents[2]
QUIET = Console(quiet=True)


@pytest.fixture(scope="module")
def fitted(small, tmp_path_factory):
    """The campaign file and results of the first configuration of the small campaign."""
    text = small[0].read_text(encoding="utf-8")
    campaign = small[0].with_name("first.toml")
    campaign.write_text(text[: text.index('[[configuration]]\nname = "C2"')], encoding="utf-8")
    out = tmp_path_factory.mktemp("fitted")
    list(fit_campaign(Run(campaign=campaign, output=out, console=QUIET)))
    return campaign, out


@pytest.fixture
def results(fitted, tmp_path):
    """A copy of these results."""
    return fitted[0], Path(shutil.copytree(fitted[1], tmp_path / "out"))


def shifted(path, *keys):
    """Change one number of a result, as an editor would."""
    document = json.loads(path.read_text(encoding="utf-8"))
    place = document["result"]
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] *= 1.01
    path.write_text(json.dumps(document), encoding="utf-8")


def test_other_line_breaks_are_no_change(results):
    _, out = results
    path = out / "C1/fit.json"
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8"))), encoding="utf-8")
    assert read_results(out).tested[0].fit is not None


def test_an_edited_fit_is_left_out_or_marked(results):
    campaign, out = results
    true = read_results(out).tested[0].fit.G_f.value
    shifted(out / "C1/fit.json", "G_f", "value")
    found = read_results(out)
    assert found.tested[0].fit is None
    assert found.remarks[0].startswith("C1/fit.json was changed after it was written, and is left out")
    kept = read_results(out, keep=True)
    assert kept.tested[0].fit.G_f.value == pytest.approx(1.01 * true)
    assert kept.remarks == ("C1/fit.json was changed after it was written, and is used all the same (--keep).",)
    assert opening_section(kept).text == kept.remarks
    ((_, used),) = fit_campaign(Run(campaign=campaign, output=out, keep=True, console=QUIET))
    assert used.G_f.value == pytest.approx(1.01 * true)


def test_edited_modes_are_an_error_of_a_report(results):
    _, out = results
    shifted(out / "C1/modal_model.json", "frequency", 0)
    with pytest.raises(StoreError, match=r"modal_model\.json: was changed after it was written; make it anew"):
        read_results(out)
    remarks = read_results(out, keep=True).remarks
    assert "C1/modal_model.json was changed after it was written, and is used all the same (--keep)." in remarks
    assert any(r.startswith("C1/fit.json comes from another modal_model.json than is here") for r in remarks)


FILES = ["quality.json", "modes.json", "fit.json", "modal_model.json", "measurement.npz"]
QUICK = ("modes.json", "changed")


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        pytest.param(name, damage, marks=() if (name, damage) == QUICK else pytest.mark.slow)
        for name in FILES
        for damage in ("cut", "gone", "changed")
    ],
)
def test_every_damaged_file_heals(results, written, name, damage):
    campaign, out = results
    before, path = written(out), out / "C1" / name
    content = path.read_bytes()
    if damage == "gone":
        path.unlink()
    else:
        middle = len(content) // 2
        path.write_bytes(content[:middle] + (b"" if damage == "cut" else b"7" + content[middle + 1 :]))
    list(fit_campaign(Run(campaign=campaign, output=out, console=QUIET)))
    # of the copy, campaign.json names the campaign by another relative path
    assert {**written(out), "campaign.json": b""} == {**before, "campaign.json": b""}


def test_a_fit_of_another_configuration_is_noticed(small, results):
    _, out = results
    shutil.copy(small[1] / "C2/fit.json", out / "C1/fit.json")
    found = read_results(out)
    assert found.tested[0].fit is None
    assert "C1/fit.json comes from another modal_model.json than is here, and is left out" in found.remarks[0]


def test_another_measurement_is_noticed(small, results):
    _, out = results
    shutil.copy(small[1] / "C2/measurement.npz", out / "C1/measurement.npz")
    with pytest.raises(StoreError, match=r"modal_model\.json: comes from another measurement\.npz than is here"):
        read_results(out)


def test_a_fit_of_the_modes_before_poles_were_chosen_is_noticed(results, monkeypatch):
    """`lamella ema --poles` makes other modes beside the fit of an earlier run."""
    monkeypatch.setattr("updating.commands.ema.as_png", lambda _: b"")
    campaign, out = results
    identify_campaign(Run(campaign=campaign, output=out, console=QUIET))
    poles = out / "C1/poles.txt"
    lines = poles.read_text(encoding="utf-8").splitlines(keepends=True)
    poles.write_text("".join(lines[:-1]), encoding="utf-8")
    identify_campaign(Run(campaign=campaign, output=out, console=QUIET), out)
    found = read_results(out)
    assert found.tested[0].measured.frequency.size == sum(not line.startswith("#") for line in lines) - 1
    assert found.tested[0].fit is None
    assert "C1/fit.json comes from another modal_model.json than is here" in found.remarks[0]


def test_every_document_says_what_it_is_and_where_it_comes_from(results):
    _, out = results
    for path in out.rglob("*.json"):
        document = read_document(path)
        assert len(document["digest"]) == 64
        assert document["provenance"]["inputs"]


def dotted(node):
    """Return a name and what is asked of it as they stand; of what is asked of anything else, that alone."""
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def test_no_code_comes_from_a_file():
    """Pickles are read from the pipe of a process that asks, nowhere else; arrays are read without objects."""
    found = set()
    for package in ("ema", "model", "updating"):
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute | ast.Name):
                    continue
                name = dotted(node.func)
                if name == "np.load":
                    assert any(k.arg == "allow_pickle" and ast.unparse(k.value) == "False" for k in node.keywords)
                elif name.split(".")[0] in ("pickle", "cloudpickle", "joblib", "shelve", "marshal", "dill") or name in (
                    "eval", "exec", "read_pickle",
                ):  # fmt: skip
                    found.add((path.relative_to(ROOT).as_posix(), name))
    assert {place for place, name in found if "dump" not in name} == {"updating/workers/workers.py"}
    assert {name for _, name in found} == {"cloudpickle.dumps", "cloudpickle.loads", "pickle.loads"}


def test_the_file_of_a_task_holds_numbers_alone(tmp_path):
    """What a worker finds in the folder of temporary files is never run."""
    numbers = np.arange(1000.0)

    def task(x):
        return x * numbers.sum()

    (tmp_path / "x").mkdir()
    pool = workers_module._Processes.__new__(workers_module._Processes)
    pool.folder = type("Folder", (), {"name": str(tmp_path / "x")})()
    sent = pool.leave(task)
    assert sent.arrays.path.read_bytes() == numbers.tobytes()
    sent.arrays.path.write_bytes(np.ones(1000).tobytes())
    assert sent._read()(2.0) == 2000.0
