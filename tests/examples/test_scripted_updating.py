"""The example of scripted updating runs, and says what the demo stack was simulated with."""

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_the_script_runs_and_finds_the_pressure_law(capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    names = runpy.run_path("tests/examples/scripted_updating.py")
    printed = capsys.readouterr().out
    base, law = re.findall(r"error ([\d.]+) %, left out ([\d.]+) %", printed)
    assert all(float(b) > 1.0 > 0.1 > float(x) for b, x in zip(base, law, strict=True))
    found = names["found"]
    assert law == tuple(
        f"{100 * error:.2f}"
        for error in (
            found.ranked(["pressure_exponent"]).frequency_error,
            found.ranked(["pressure_exponent"]).left_out_error,
        )
    )
    (exponent,) = found.ranked(["pressure_exponent"]).parameter
    assert exponent.value == pytest.approx(0.3, abs=0.01)
    assert names["points"].comac.min() > 0.999
