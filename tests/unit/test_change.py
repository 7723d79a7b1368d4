"""A state against its reference: what is called changed, which modes are the same, and what is said of it."""

import asyncio
import csv
import io
from types import SimpleNamespace

import numpy as np
import pytest

from ema import IdentificationError, Reassembly, change, change_csv, change_sentence
from ema.types.frf import Dof, Dofs, Geometry
from updating.pooled.specimen import assembled
from updating.workbench import comparison_panel

N = 12
PLACE = np.linspace(0.05, 0.95, N)
FREQUENCY = np.array([100.0, 220.0, 400.0, 640.0])
SHAPE = np.sin(np.pi * np.outer(PLACE, np.arange(1, 5)))


def state(name, frequency=FREQUENCY, shape=SHAPE, damping=0.005, node=None):
    """A state as it is identified: frequencies to 0.001 %, damping ratios and shapes to 0.5 %."""
    frequency = np.asarray(frequency, dtype=float)
    damping = np.broadcast_to(damping, frequency.shape)
    node = np.arange(1, len(shape) + 1) if node is None else node
    return assembled(
        name,
        np.array([frequency, 1e-5 * frequency, damping, 5e-3 * damping]),
        (shape, np.full(shape.shape, 5e-3)),
        geometry=Geometry(node=node, coordinate=np.outer(PLACE, [1, 0, 0])[: len(shape)], line=np.empty((0, 2))),
        dofs=Dofs(node=node, direction=np.tile([0.0, 0.0, 1.0], (len(shape), 1))),
        sensor=np.zeros(len(shape), dtype=np.int64),
        force=Dof(1, (0.0, 0.0, 1.0)),
    )  # fmt: skip


def test_one_mode_that_fell_is_named_and_the_others_are_not():
    found = change([state("cut", FREQUENCY * [0.93, 1.001, 0.999, 1.0])], [state("intact")])
    assert found.changed
    np.testing.assert_array_equal(found.which, [[True, False, False], *3 * [[False] * 3]])
    np.testing.assert_allclose(np.expm1(found.frequency_shift[0]), -0.07, rtol=1e-6)
    # two assemblies of 0.3 % each
    np.testing.assert_allclose(found.frequency_scatter, 3e-3 * np.sqrt(2), rtol=1e-3)
    text = change_sentence(found)
    assert text.startswith("cut against intact: changed: mode 1 fell by 7 %, 17 times the scatter")
    assert "modes 2, 3 and 4 did not" in text


def test_what_reassembly_may_do_is_no_change():
    found = change([state("again", FREQUENCY * [1.004, 0.996, 1.004, 0.997], damping=0.006)], [state("first")])
    assert not found.changed
    assert "no mode by itself shows a change" in change_sentence(found)
    better = change(
        [state("again", FREQUENCY * [1.004, 0.996, 1.004, 0.997])], [state("first")], Reassembly(frequency=2e-4)
    )
    assert better.which[:, 0].all()  # of a laboratory that assembles better


def test_repeats_that_scatter_more_than_is_stated_are_believed():
    moved = state("moved", FREQUENCY * [0.97, 1.0, 1.0, 1.0])
    sloppy = [state(f"R{k}", FREQUENCY * (1 + 0.015 * s)) for k, s in enumerate((-1.0, 0.0, 1.0))]
    assert change([moved], [state("R")]).changed
    found = change([moved], sloppy)
    assert not found.changed
    assert np.all(found.frequency_scatter > 0.012)


def test_equal_repeats_do_not_make_the_scatter_of_reassembly_vanish():
    """They may be of one mounting, which says nothing of the next."""
    moved = state("moved", FREQUENCY * [1.004, 0.996, 1.004, 0.997])
    assert not change([moved], [state("R1"), state("R2")]).changed


def test_more_repeats_find_smaller_changes():
    random = np.random.default_rng(1)
    repeats = [state(f"R{k}", FREQUENCY * (1 + 2e-3 * random.standard_normal(4))) for k in range(12)]
    few, many = (change([state("S")], repeats[:n]).critical_shift for n in (2, 12))
    assert np.all(many < 0.75 * few)


def test_modes_that_cross_are_followed_by_their_shapes():
    swapped = state("S", [100.0, 390.0, 370.0, 640.0], SHAPE)  # the second rose above the third
    found = change([swapped], [state("R")])
    order = np.argsort(found.reference_mode)
    np.testing.assert_array_equal(found.mode[order], [0, 2, 1, 3])
    np.testing.assert_allclose(np.exp(found.frequency_shift[order]), [1.0, 390 / 220, 370 / 400, 1.0])
    np.testing.assert_allclose(found.mac, 1.0)


def test_shapes_alike_are_told_apart_by_frequency():
    """An absorber makes two modes of one shape: each goes on as the one that is near."""
    shape = np.column_stack([SHAPE[:, 0], SHAPE[:, 0] + 0.05 * SHAPE[:, 3], SHAPE[:, 2]])
    before = state("R", [95.0, 105.0, 400.0], shape)
    found = change([state("S", [95.2, 105.1, 400.0], shape[:, [1, 0, 2]])], [before])
    np.testing.assert_allclose(np.abs(found.frequency_shift), 0.0, atol=3e-3)


@pytest.mark.parametrize("turn", [0.3, np.pi / 4, 1.2])
def test_close_modes_that_mix_are_one_plane_that_has_not_changed(turn):
    c, s = np.cos(turn), np.sin(turn)
    mixed = SHAPE.copy()
    mixed[:, 1:3] = SHAPE[:, 1:3] @ [[c, -s], [s, c]]
    close = [100.0, 220.0, 221.0, 640.0]
    found = change([state("S", close, mixed)], [state("R", close)])
    assert found.mode.size == 4
    assert not found.changed
    assert found.angle[1] < 0.01


@pytest.mark.parametrize("split", ["state", "repeat"])
def test_one_mode_that_was_identified_as_two_has_the_plane_of_both(split):
    """Their bands overlap: the larger of the two may have any shape in the plane of both."""
    rest = SHAPE[:, 1] - SHAPE[:, 2] * (SHAPE[:, 1] @ SHAPE[:, 2]) / (SHAPE[:, 2] @ SHAPE[:, 2])
    two = np.column_stack([SHAPE[:, 2] + 0.5 * rest, 0.5 * SHAPE[:, 2] - 1.0 * rest])
    twice = state(split, [100.0, 220.0, 400.0, 400.4, 640.0], np.column_stack([SHAPE[:, :2], two, SHAPE[:, 3]]))
    found = change([twice], [state("R")]) if split == "state" else change([state("S")], [state("R"), twice])
    assert not found.changed
    assert found.angle[2] < 0.03
    assert found.angle_scatter[0] < 0.04  # the repeat does not raise what others scatter by


def test_a_shape_that_turned_is_a_change():
    turned = SHAPE.copy()
    turned[:, 0] += 0.35 * SHAPE[:, 1]
    found = change([state("S", FREQUENCY, turned)], [state("R")])
    np.testing.assert_array_equal(found.which[:, 2], [True, False, False, False])
    assert "the shape of mode 1 is another one (MAC down to 0.8" in change_sentence(found)


def test_modes_that_one_side_lacks_are_said_and_decide_nothing():
    found = change([state("S", FREQUENCY[[0, 1, 3]], SHAPE[:, [0, 1, 3]])], [state("R")])
    assert not found.changed
    np.testing.assert_allclose(found.gone_frequency, [400.0])
    assert "a mode at 400 Hz was found in the reference only" in change_sentence(found)
    twice = change([state("S", [100.0, 220.0, 400.0, 402.0, 640.0], SHAPE[:, [0, 1, 2, 2, 3]])], [state("R")])
    np.testing.assert_array_equal(twice.new_like, [2])
    assert "a mode at 402 Hz (with the shape of mode 3) was found in S only" in change_sentence(twice)


def test_a_mode_that_a_repeat_of_the_reference_lacks_too_is_not_gone():
    short = state("R2", FREQUENCY[[0, 1, 3]], SHAPE[:, [0, 1, 3]])
    found = change([state("S", FREQUENCY[[0, 1, 3]], SHAPE[:, [0, 1, 3]])], [state("R1"), short])
    assert not found.gone_frequency.size


def test_comac_is_low_where_shapes_differ():
    dented = SHAPE.copy()
    dented[4] *= [0.2, 1.9, 0.3, 1.8]
    found = change([state("S", FREQUENCY, dented)], [state("R")])
    assert int(np.argmin(found.comac)) == 4
    np.testing.assert_allclose(found.location[4], [PLACE[4], 0, 0])


def test_points_that_are_not_shared_are_left_out():
    found = change([state("S", FREQUENCY, SHAPE[2:], node=np.arange(3, N + 1))], [state("R")])
    np.testing.assert_array_equal(found.node, np.arange(3, N + 1))
    assert not found.changed
    with pytest.raises(IdentificationError, match="S and R share no point and direction"):
        change([state("S", node=np.arange(101, 101 + N))], [state("R")])


def test_the_table_has_a_row_for_each_mode():
    found = change([state("S", FREQUENCY * [0.9, 1, 1, 1])], [state("R")])
    rows = list(csv.DictReader(io.StringIO(change_csv(found))))
    assert [row["changed"] for row in rows] == ["frequency", "", "", ""]
    assert float(rows[0]["frequency_Hz"]) == pytest.approx(90.0)


class Page(SimpleNamespace):
    """The state of a page of the workbench."""

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def update(self, given):
        vars(self).update(given)

    def change(self, *_):
        return lambda call: call


def test_the_workbench_shows_a_state_beside_its_reference_and_another_without():
    found = change([state("cut", FREQUENCY * [0.93, 1.001, 0.999, 1.0])], [state("intact")])
    nothing = {"identified": None, "shown": None, "fit": None, "reference": None}
    said = SimpleNamespace(sentences=("cut, what and where: a crack or cut.",))
    tested = {
        "cut": SimpleNamespace(change=found, what_changed=said, **nothing),
        "intact": SimpleNamespace(change=None, what_changed=None, **nothing),
    }
    page = Page()
    server = SimpleNamespace(state=page, controller=SimpleNamespace())
    opened = SimpleNamespace(modelled=lambda name: (tested[name], []))
    comparison_panel.panel(server, opened)
    page.configuration = "cut"
    asyncio.run(comparison_panel._Comparison(server, opened).begin())
    assert page.change_text == f"{change_sentence(found)}."
    assert page.what_changed == ["cut, what and where: a crack or cut."]
    assert len(page.change_table["rows"]) == 4
    table = page.change_table
    assert all(len(row) == len(table["header"]) for row in table["rows"])
    assert [row[-1] for row in page.change_table["rows"]] == ["frequency", "", "", ""]
    assert [len(trace["x"]) for trace in page.shifts["data"]] == [3, 1]  # within the scatter, changed
    page.configuration = "intact"
    asyncio.run(comparison_panel._Comparison(server, opened).begin())
    assert (page.change_text, page.what_changed) == ("", [])
