"""The report's section on a changed state."""

import numpy as np

from ema import change
from tests.unit.test_change import FREQUENCY, SHAPE, state
from updating.report.page import render
from updating.report.state_part import state_section


def test_a_changed_state_stands_beside_its_reference():
    found = change([state("cut", FREQUENCY * [0.93, 1.001, 0.999, 1.0])], [state("intact")])
    section = state_section(found)
    assert "mode 1 fell by 7 %" in section.text[0]
    table = section.blocks[0]
    assert table.rows[0][1:3] == ("100.00", "93.00")
    assert [row[-1] for row in table.rows] == ["frequency", "", "", ""]
    assert [picture.name for picture in section.pictures] == ["change_cut", "change_mac_cut", "change_comac_cut"]
    assert "cut against intact" in render("x", (section,))


def test_states_without_a_common_mode_have_no_pictures():
    other = SHAPE[:, ::-1] + 3.0 * np.random.default_rng(2).standard_normal(SHAPE.shape)
    found = change([state("S", 3.0 * FREQUENCY, other)], [state("R")])
    assert not found.mode.size
    section = state_section(found)
    assert "share no mode" in section.text[0]
    assert not section.pictures
