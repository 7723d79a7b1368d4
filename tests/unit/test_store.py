"""Results to files and back: whole or not at all, with what made them."""

import json
import tracemalloc
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import model
from ema import FRF, Dofs, Geometry
from ema.campaign.campaign import Campaign, read_campaign
from ema.io.table import TableLayout
from updating.errors import StoreError
from updating.results import store
from updating.results.store import (
    folder_name,
    read_current,
    read_document,
    read_frf,
    read_result,
    write_bytes,
    write_frf,
    write_result,
)

DATA = Path(__file__).parents[2] / "data"


@dataclass(frozen=True, eq=False, kw_only=True)
class Inner:
    name: str
    where: tuple[float, float]


@dataclass(frozen=True, eq=False, kw_only=True)
class Holding:
    stack: model.Stack
    table: TableLayout | None


@dataclass(frozen=True, eq=False, kw_only=True)
class Other:
    force: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Outer:
    pole: NDArray[np.complex128]
    std: NDArray[np.float64]
    count: NDArray[np.int64]
    value: float
    parts: tuple[Inner, ...]
    either: Inner | Other | None


@pytest.fixture
def outer():
    return Outer(
        pole=np.array([-1 + 2j, 1e-300 - 1j / 3]),
        std=np.array([[0.1, np.nan]]),
        count=np.array([3, 4]),
        value=float("nan"),
        parts=(Inner(name="Čepon", where=(0.1, 1e22)),),
        either=Other(force=2.5),
    )


def test_a_result_comes_back_to_the_last_bit(tmp_path, outer):
    path = tmp_path / "deep/er/outer.json"
    write_result(path, outer, inputs=(), options={})
    again = read_result(path, Outer)
    np.testing.assert_array_equal(again.pole, outer.pole)
    np.testing.assert_array_equal(again.std, outer.std)
    assert again.count.dtype.kind == "i"
    assert np.isnan(again.value)
    assert isinstance(again.either, Other)
    assert again.either.force == 2.5
    assert (again.parts[0].name, again.parts[0].where) == ("Čepon", (0.1, 1e22))


def test_documents_say_what_made_them_and_are_strict_json(tmp_path, outer):
    source = tmp_path / "input.txt"
    source.write_bytes(b"abc")
    write_result(tmp_path / "r.json", outer, inputs=(source,), options={"band_Hz": [1, 2]})
    text = (tmp_path / "r.json").read_text(encoding="utf-8")
    assert "NaN" not in text
    made = json.loads(text)["provenance"]
    assert made["inputs"]["input.txt"].startswith("ba7816bf8f01cfea")  # SHA-256 of "abc", FIPS 180-2
    assert made["options"] == {"band_Hz": [1, 2]}
    assert set(made["versions"]) == {"lamella", "numpy", "scipy"}


def test_the_same_result_gives_the_same_bytes(tmp_path, outer):
    for name in ("a.json", "b.json"):
        write_result(tmp_path / name, outer, inputs=(), options={})
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_a_failed_write_leaves_the_old_file_and_nothing_beside_it(tmp_path, monkeypatch):
    path = tmp_path / "r.json"
    write_bytes(path, b"old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.replace", full)
    with pytest.raises(StoreError, match="No space left on device"):
        write_bytes(path, b"new")
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["r.json"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "not a JSON file"),
        ("[1, 2]", "not a result of Lamella"),
        ('{"kind": "Outer", "result": {}}', "not a result of Lamella"),
        ("[" * 3000, "not a JSON file"),
        ('{"kind": "Fit", "provenance": {}, "result": {}}', "expected a Outer, found 'Fit'"),
        ('{"kind": "Outer", "provenance": {}, "result": {"value": 1}}', "not a complete Outer"),
    ],
)
def test_a_damaged_document_is_refused_by_name(tmp_path, content, message):
    path = tmp_path / "r.json"
    path.write_text(content)
    with pytest.raises(StoreError, match=message) as caught:
        read_result(path, Outer)
    assert str(path) in str(caught.value)


def test_a_missing_document_is_refused_by_name(tmp_path):
    with pytest.raises(StoreError, match=r"nothing\.json"):
        read_document(tmp_path / "nothing.json")


def test_frfs_come_back_to_the_last_bit(tmp_path):
    rng = np.random.default_rng(0)
    frf = FRF(
        frequency=np.arange(5.0),
        value=rng.standard_normal((2, 1, 5)) + 1j * rng.standard_normal((2, 1, 5)),
        quantity="mobility",
        output=Dofs(node=[1, 2], direction=[[0, 0, 1], [0, 0, -1]]),
        input=Dofs(node=[9], direction=[[1, 0, 0]]),
        run=[0, 1],
        source=("a.uff", "b.uff"),
    )
    write_frf(tmp_path / "m.npz", frf)
    again = read_frf(tmp_path / "m.npz")
    np.testing.assert_array_equal(again.value, frf.value)
    np.testing.assert_array_equal(again.output.direction, frf.output.direction)
    assert (again.quantity, again.source, again.coherence) == ("mobility", ("a.uff", "b.uff"), None)


def test_large_functions_are_read_without_a_copy(tmp_path):
    rng = np.random.default_rng(0)
    value = rng.normal(size=(15, 1, 100_000)) + 1j  # 24 MB
    up = np.tile([0.0, 0.0, 1.0], (15, 1))
    frf = FRF(
        frequency=np.arange(1.0, 100_001.0), value=value, quantity="accelerance",
        output=Dofs(node=np.arange(15), direction=up), input=Dofs(node=[0], direction=up[:1]),
        run=np.zeros(15, dtype=int), source=("a",) * 15,
    )  # fmt: skip
    write_frf(tmp_path / "m.npz", frf)
    tracemalloc.start()
    read_frf(tmp_path / "m.npz")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1.5 * value.nbytes


@pytest.mark.parametrize("content", [b"PK\x03\x04 not really", "version", "deflated"])
def test_a_damaged_archive_is_refused(tmp_path, content):
    path = tmp_path / "m.npz"
    np.savez_compressed(path, frequency=np.arange(1000.0))
    whole = bytearray(path.read_bytes())
    if content == "version":  # needed to extract, in the central directory
        whole[whole.index(b"PK\x01\x02") + 6] = 99
    elif content == "deflated":
        whole[100:400] = bytes(300)
    path.write_bytes(content if isinstance(content, bytes) else whole)
    with pytest.raises(StoreError, match=r"m\.npz"):
        read_frf(path)


@pytest.mark.parametrize("name", ["demo_stack", "hidden_effect/b"])
def test_a_campaign_comes_back(tmp_path, name):
    campaign = read_campaign(DATA / name / "campaign.toml")
    write_result(tmp_path / "c.json", campaign, inputs=(), options={})
    again = read_result(tmp_path / "c.json", Campaign)
    assert again.configurations == campaign.configurations
    assert again.table == campaign.table
    np.testing.assert_array_equal(again.geometry.coordinate, campaign.geometry.coordinate)


@pytest.mark.parametrize(
    ("name", "folder"), [("M1", "M1"), ("stack 8, M1", "stack_8_M1"), ("../x", "x"), ("///", "configuration")]
)
def test_configuration_names_become_safe_folder_names(name, folder):
    assert folder_name(name) == folder


def test_a_stack_with_an_effect_and_the_columns_of_tables_come_back(tmp_path):
    stack = model.read_stack(DATA / "demo_stack" / "stack.toml").with_effects(
        *model.find_effects(["clamp_mass"]), clamp_added_mass=0.3
    )
    held = Holding(stack=stack, table=TableLayout(layout="real-imaginary", header_rows=1, columns=((2, 3), (5, 6))))
    write_result(tmp_path / "held.json", held, inputs=(), options={})
    back = read_result(tmp_path / "held.json", Holding)
    assert back.table == held.table
    assert [effect.name for effect in back.stack.effects] == ["clamp_mass"]
    assert back.stack.effect_values == {"clamp_added_mass": 0.3}


def test_points_without_trace_lines_are_read_back(tmp_path):
    points = Geometry(node=np.array([1, 2]), coordinate=np.eye(2, 3), line=np.empty((0, 2), int))
    write_result(tmp_path / "points.json", points, inputs=(), options={})
    assert read_result(tmp_path / "points.json", Geometry).line.shape == (0, 2)


def test_a_result_is_current_only_if_the_same_made_it_from_the_same(tmp_path, outer, monkeypatch):
    path, source = tmp_path / "r.json", tmp_path / "input.txt"
    source.write_bytes(b"abc")
    made_by = {"inputs": (source,), "options": {"band_Hz": (1.0, 2.0)}}
    assert read_current(path, Outer, **made_by) is None
    write_result(path, outer, **made_by)
    np.testing.assert_array_equal(read_current(path, Outer, **made_by).pole, outer.pole)
    assert read_current(path, Outer, inputs=(source,), options={}) is None
    assert read_current(path, Inner, **made_by) is None
    with monkeypatch.context() as other:
        other.setattr(store, "_code_digest", lambda: "0123456789ab")
        assert read_current(path, Outer, **made_by) is None
    source.write_bytes(b"abd")
    assert read_current(path, Outer, **made_by) is None
    source.write_bytes(b"abc")
    whole = path.read_text(encoding="utf-8")
    path.write_text(whole.replace("0.1", "0.2", 1), encoding="utf-8")
    assert read_current(path, Outer, **made_by) is None
    assert read_current(path, Outer, **made_by, keep=True) is not None
    with pytest.raises(StoreError, match="was changed after it was written"):
        read_result(path, Outer)
    path.write_text(whole, encoding="utf-8")
    assert read_current(path, Outer, **made_by) is not None
    path.write_bytes(path.read_bytes()[:-20])
    assert read_current(path, Outer, **made_by) is None


def test_inputs_of_the_same_name_are_told_apart_by_their_folders(tmp_path, outer):
    files = tuple(tmp_path / folder / "run_01.uff" for folder in ("M1", "M2"))
    for file in files:
        write_bytes(file, file.parent.name.encode())
    write_result(tmp_path / "r.json", outer, inputs=files, options={})
    inputs = read_document(tmp_path / "r.json")["provenance"]["inputs"]
    assert set(inputs) == {"M1/run_01.uff", "M2/run_01.uff"}
    assert len(set(inputs.values())) == 2


def test_infinity_comes_back_as_infinity(tmp_path):
    write_result(tmp_path / "r.json", Other(force=-np.inf), inputs=(), options={})
    assert read_result(tmp_path / "r.json", Other).force == -np.inf


def test_an_interrupted_write_leaves_the_old_file_and_nothing_beside_it(tmp_path, monkeypatch):
    path = tmp_path / "r.json"
    write_bytes(path, b"old")

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("pathlib.Path.replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_bytes(path, b"new")
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["r.json"]
