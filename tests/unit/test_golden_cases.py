"""The golden cases: drawn alike from the same seed, judged by the truth, and on record for every kind."""

from dataclasses import astuple, replace

import numpy as np
import pytest

from tests.golden import cases
from tests.golden.campaigns import CAMPAIGNS, RECORD, ROOT, planted_in
from tests.golden.cases import CLOSE, FIRST, WORLDS, draw_case, kept, planned, saved
from tests.golden.comparison import compared, table
from tests.golden.published import published
from tests.golden.record import Errors, Record, Value, line, read
from tests.independent.bench import BenchModes
from tests.studies.other_models import FIRST_SEED

GONE = Errors(frequency=None, damping=None, left_out_frequency=None, left_out_damping=None)


class Toy:
    """Bending and torsion of a bar, whose frequencies follow the contact's stiffness by other powers and so cross."""

    def modes(self, bench, n_mode):
        contact = bench.G_f * bench.pressure / 5e8
        order = np.arange(2, 8)
        heavy = 1.0 + bench.planted.get("clamp_mass", {}).get("mass", 0.0)
        bending = 45.0 * order**2 * contact**0.05 / heavy
        torsion = 110.0 * order * contact**0.4
        frequency = np.concatenate([np.zeros(6), bending, torsion])
        which = np.argsort(frequency)

        def shape_at(place):
            x, y = place[:, 0] / bench.length + 0.5, place[:, 1] / bench.width
            along = np.cos(np.pi * np.outer(x, order))
            shape = np.zeros((len(place), 3, frequency.size))
            shape[:, 2, :6] = np.outer(x, np.arange(1.0, 7.0))
            shape[:, 2, 6:12], shape[:, 2, 12:] = along, 2.0 * y[:, None] * along
            return shape[:, :, which]

        damping = np.where(frequency[which] > 0.0, 1e-3, 0.0)
        return BenchModes(frequency=frequency[which], damping=damping, shape_at=shape_at)


@pytest.fixture
def quick(monkeypatch):
    """A second model that takes no time."""
    for name in ("second_model", "coarse"):
        monkeypatch.setattr(cases, name, lambda _: Toy())


def errors(left_out_frequency, left_out_damping=0.1):
    return replace(GONE, left_out_frequency=left_out_frequency, left_out_damping=left_out_damping)


def record(**given):
    made = {
        "seed": 1, "world": "layered", "kind": "single", "setup": "shipped", "distance": 0.05,
        "planted": {"clamp_mass": {"mass": 0.5}}, "truth": ("clamp_mass",), "verdict": "identified",
        "names": (("clamp_mass",),), "values": {"mass": Value(unit="kg", value=0.5, lower=0.4, upper=0.6)},
        "base": errors(0.02), "answer": errors(0.002), "true": errors(0.002), "seconds": 20.0,
    }  # fmt: skip
    return Record(**(made | given))


@pytest.mark.parametrize("kind", ["single", "crossing_null"])
def test_the_same_seed_draws_the_same_case(quick, kind):
    one, other, third = (draw_case("solid", kind, seed) for seed in (7, 7, 8))
    assert one.meta == other.meta
    for (_, p, modes), (_, q, again) in zip(one.tested, other.tested, strict=True):
        assert p == q
        np.testing.assert_array_equal(modes.frequency, again.frequency)
        np.testing.assert_array_equal(modes.shape, again.shape)
    assert third.tested[0][2].frequency[0] != one.tested[0][2].frequency[0]


def test_two_modes_of_a_near_crossing_are_close(quick):
    case = draw_case("solid", "crossing_null", 7)
    gaps = [np.min(np.diff(modes.frequency) / modes.frequency[1:]) for _, _, modes in case.tested]
    assert min(gaps) == pytest.approx(case.distance)
    assert case.distance < CLOSE < draw_case("solid", "null", 7).distance


def test_a_saved_case_is_read_back(quick, tmp_path):
    case = kept(tmp_path, "solid", "single", 7)
    again = kept(tmp_path, "solid", "single", 7)
    assert case.meta == again.meta
    assert case.truth == again.truth
    np.testing.assert_array_equal(case.tested[1][2].frequency, again.tested[1][2].frequency)
    assert [one.meta for one in saved(tmp_path)] == [case.meta]


def test_seeds_of_the_two_models_are_apart():
    seeds = [seed for world in WORLDS for _, _, seed, _ in planned(world)]
    assert len(set(seeds)) == len(seeds)
    assert all(seed >= FIRST["layered"] for seed in seeds)


def test_an_answer_is_judged_by_what_was_planted():
    silent = {"names": (), "values": {}, "verdict": "nothing missing"}
    assert record().outcome == "right"
    assert record(names=(("clamp_mass", "weld_seam"),)).outcome == "with another"
    assert record(names=(("weld_seam",), ("clamp_mass",))).outcome == "wrong"
    assert record(**silent).outcome == "nothing"
    assert record(kind="null", truth=(), **silent).outcome == "right"
    assert record(kind="crossing_null", truth=(), **silent | {"verdict": "unlike anything"}).outcome == "wrong"
    assert record(kind="lacking", truth=(), **silent | {"verdict": "unlike anything"}).outcome == "right"
    assert record(kind="lacking", truth=()).outcome == "wrong"


def test_an_answer_that_raises_the_error_of_frequencies_is_seen():
    assert not record().raises
    worse = record(answer=errors(0.03, 0.095))
    assert worse.raises
    assert worse.raises_in_vain
    assert not record(answer=errors(0.03, 0.05)).raises_in_vain
    assert not record(names=(), answer=errors(0.03)).raises


def test_two_files_are_compared_on_the_cases_that_both_have(tmp_path):
    before, after = tmp_path / "before.jsonl", tmp_path / "after.jsonl"
    wrong = record(names=(("weld_seam",),))
    before.write_text(line(record()) + line(record(seed=2)) + line(record(seed=3))[:30], encoding="utf-8")
    after.write_text(line(wrong), encoding="utf-8")
    assert read(before) == [record(), record(seed=2)]
    text = "\n".join(compared(before, after))
    assert "before.jsonl: 1 cases that both have, of 2" in text
    assert "layered single 1 (clamp_mass): right [identified: clamp_mass" in text
    assert "wrong [identified: weld_seam" in text
    assert "| layered, single | 2 | 2 | 0 | 0 | 0 | 0 | 0 | 20.0 |" in list(table(read(before)))


def test_answers_of_the_published_figures_are_records(tmp_path):
    records = list(published())
    file = tmp_path / "published.jsonl"
    file.write_text("".join(map(line, records)), encoding="utf-8")
    assert [one.key for one in read(file)] == [one.key for one in records]
    of_shipped = [one for one in records if one.setup == "shipped" and one.seed >= FIRST_SEED]
    null = [one for one in of_shipped if one.kind == "null"]
    assert (len(null), sum(one.outcome == "right" for one in null)) == (8, 8)  # as `docs/validation.md` has it
    shows = [one for one in of_shipped if one.kind == "single" and one.shows]
    assert (len(shows), sum(one.outcome == "wrong" for one in shows)) == (12, 0)


def test_the_record_of_the_shipped_campaigns_is_complete():
    records = read(RECORD)
    assert records
    assert len({one.key for one in records}) == len(records)
    for one in records:
        assert one.setup in CAMPAIGNS
        assert (one.planted, one.truth) == planted_in(ROOT / "data" / one.setup), one.key
        assert bool(one.names) == (one.verdict not in ("nothing missing", "unlike anything")), one.key
        assert None not in (*astuple(one.base), *astuple(one.answer), one.seconds), one.key
        assert one.values or not one.names, one.key
        assert all(v.lower <= v.value <= v.upper for v in one.values.values()), one.key
