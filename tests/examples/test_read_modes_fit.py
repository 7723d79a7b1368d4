"""A fit from modes that were read is that from the modes that were identified."""

import pytest
from rich.console import Console

import ema
from updating.commands.fit import fit_campaign
from updating.fitting.fit import Fit
from updating.results.store import folder_name, read_result


def test_fit_from_exported_modes_is_that_from_functions(small, tmp_path):
    path, out = small
    campaign = ema.read_campaign(path)
    own = campaign.configurations[0]
    folder = out / folder_name(own.name)
    identified = read_result(folder / "modal_model.json", ema.ModalModel)
    ema.write_modes_csv(tmp_path / "modes.csv", identified)
    ema.write_shapes_csv(tmp_path / "shapes.csv", identified)
    (tmp_path / "campaign.toml").write_text(
        f"""
[campaign]
name = "read"
[structure]
stack = '{campaign.stack}'
[points]
file = '{campaign.points}'
unit = "mm"
[[configuration]]
name = "M1"
modes = "file"
files = ["modes.csv", "shapes.csv"]
input = "{identified.input.name(0)}"
pressure_kPa = {own.pressure / 1e3}
"""
    )
    ((found, fitted),) = fit_campaign(tmp_path / "campaign.toml", tmp_path / "out", 0.8, Console(quiet=True))
    expected = read_result(folder / "fit.json", Fit)
    assert found.modal_model.read_from.endswith("modes.csv")
    assert fitted.G_f.value == pytest.approx(expected.G_f.value, rel=1e-4)
    assert fitted.d_f.value == pytest.approx(expected.d_f.value, rel=1e-3)
    assert fitted.pairing.measured.size == expected.pairing.measured.size > 0
