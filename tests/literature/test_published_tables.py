"""The transcription of the paper's tables against what the paper itself computes from them."""

import csv
from pathlib import Path

import numpy as np
import pytest

from updating.fitting.fit import frequency_error, opt_d, opt_G

TABLES = Path(__file__).parents[2] / "data/pirnat2013"


def rows(name):
    with (TABLES / name).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("row", rows("table7_frequencies_320kPa.csv"), ids=lambda row: f"stack {row['stack']}")
def test_equation_2_gives_the_printed_error(row):
    f_exp, f_num = ([float(row[f"f{i}_{kind}_Hz"]) for i in range(1, 5)] for kind in ("exp", "num"))
    assert 100 * frequency_error(f_exp, f_num) == pytest.approx(float(row["error_percent"]), abs=0.051)


def test_table_6_averages_are_those_of_its_columns():
    for row in rows("table6_contact_parameters.csv"):
        assert np.mean([float(row["Gf_M1"]), float(row["Gf_M2"])]) == pytest.approx(float(row["Gf_avg"]), abs=0.51)
        assert np.mean([float(row["df_M1"]), float(row["df_M2"])]) == pytest.approx(float(row["df_avg"]), rel=0.02)


def test_every_stack_of_table_7_has_a_height():
    assert {r["stack"] for r in rows("table7_frequencies_320kPa.csv")} == {
        r["stack"] for r in rows("table1_stacks.csv")
    }


def test_the_table_of_modes_is_tables_4_and_7():
    """All of Table 4 at M1 and of Table 7 at M2, less the two frequencies that the README calls faults."""
    both = {(row["stack"], row["torque"]): row for row in rows("table4_modal_parameters.csv")}
    expected = {}
    for row in rows("table7_frequencies_320kPa.csv"):
        stack = row["stack"]
        for torque in ("M1", "M2"):
            four = both.get((stack, torque), {})
            for i, mode in enumerate(("torsion 1", "bending 1", "bending 2", "torsion 2"), 1):
                frequency = row[f"f{i}_exp_Hz"] if torque == "M2" else four.get(f"f{i}_Hz", "")
                if frequency:
                    damping = four.get(f"xi{i}_percent", "")
                    expected[stack, torque, mode] = frequency, float(damping) / 100.0 if damping else None
    del expected["3", "M1", "bending 1"], expected["13", "M2", "torsion 2"]
    found = {
        (row["specimen"], row["configuration"], row["shape_class"]): (
            row["frequency_Hz"],
            pytest.approx(float(row["damping"]), rel=1e-5) if row["damping"] else None,
        )
        for row in rows("modes.csv")
    }
    assert found == expected


def test_objectives_of_equation_1():
    assert opt_G([3.0, 10.0], [0.0, 14.0]) == pytest.approx(5.0)
    assert opt_d([0.03, 0.10], [0.0, 0.14]) == pytest.approx(0.05)
