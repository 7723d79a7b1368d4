"""A fit from modes that were read is that from the modes that were identified, whichever file they come in."""

import warnings

import numpy as np
import pytest
from rich.console import Console

import ema
import model
import updating
from updating.commands.fit import fit_campaign
from updating.commands.terminal import Run
from updating.fitting.fit import Fit
from updating.results.store import folder_name, read_result


def tables(folder, modes, geometry):
    ema.write_modes_csv(folder / "modes.csv", modes)
    ema.write_shapes_csv(folder / "shapes.csv", modes)
    return "modes.csv", "shapes.csv"


def data_sets_55(folder, modes, geometry):
    ema.write_uff(folder / "modes.uff", geometry, modal_model=modes)
    return ("modes.uff",)


def data_sets_2414(folder, modes, geometry):
    """Complex modes as analysis data at nodes, with eigenvalues, and values at three translations."""
    sets = []
    for r, pole in enumerate(modes.pole):
        at = {node: np.zeros(3, complex) for node in modes.node}
        for node, direction, value in zip(modes.node, modes.direction, modes.shape[:, r], strict=True):
            at[node] += direction * value
        head = f"{r + 1:10}\nmode\n{1:10}\n" + 5 * "NONE\n" + f"{1:10}{3:10}{2:10}{8:10}{5:10}{3:10}\n"
        head += 2 * f"{1:10}{0:10}{1:10}{0:10}{1:10}{r + 1:10}{0:10}{0:10}\n"
        numbers = [0.0] * 6, [pole.real, pole.imag, 0.0, 0.0, 0.0, 0.0]
        head += "".join("".join(f"{x:13.5E}" for x in row) + "\n" for row in numbers)
        values = "".join(
            f"{node:10}\n" + "".join(f"{x:13.5E}" for v in value for x in (v.real, v.imag)) + "\n"
            for node, value in at.items()
        )
        sets.append(f"    -1\n  2414\n{head}{values}    -1\n")
    (folder / "modes.unv").write_text("".join(sets))
    return ("modes.unv",)


def shapes_of_sdynpy(folder, modes, geometry):
    """Real shapes of unit modal mass with damping, at nodes and codes of directions, as SDynPy saves them."""
    n = modes.node.size
    coordinate = [("node", "uint64"), ("direction", "int8")]
    kind = [("frequency", "f8"), ("damping", "f8"), ("coordinate", coordinate, (n,)), ("shape_matrix", "f8", (n,)),
            ("modal_mass", "f8"), ("comment1", "<U80")]  # fmt: skip
    array = np.zeros(modes.frequency.size, kind)
    array["frequency"], array["damping"], array["modal_mass"] = modes.frequency, modes.damping, 1.0
    code = np.argmax(np.abs(modes.direction), axis=1)
    array["coordinate"]["node"], array["shape_matrix"] = modes.node, modes.shape.real.T
    array["coordinate"]["direction"] = np.sign(modes.direction[np.arange(n), code]) * (code + 1)
    np.savez(folder / "modes.npz", shapes=array)
    return ("modes.npz",)


@pytest.fixture(scope="module")
def identified(small):
    path, out = small
    campaign = ema.read_campaign(path)
    one = campaign.configurations[0]
    folder = out / folder_name(one.name)
    modes = read_result(folder / "modal_model.json", ema.ModalModel)
    return campaign, one, modes, read_result(folder / "fit.json", Fit)


@pytest.mark.parametrize("written", [tables, data_sets_55, data_sets_2414, shapes_of_sdynpy])
def test_fit_from_exported_modes_is_that_from_functions(identified, tmp_path, written):
    campaign, one, modes, expected = identified
    files = written(tmp_path, modes, ema.read_measurement(campaign, one.name).geometry)
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
files = {list(files)}
input = "{modes.input.name(0)}"
pressure_kPa = {one.pressure / 1e3}
"""
    )
    ((found, fitted),) = fit_campaign(
        Run(campaign=tmp_path / "campaign.toml", output=tmp_path / "out", console=Console(quiet=True))
    )
    whole = written is tables  # the others state no scatter, so that usual ones weigh the modes
    assert files[0] in found.modal_model.read_from
    assert fitted.G_f.value == pytest.approx(expected.G_f.value, rel=1e-4 if whole else 0.02)
    assert fitted.d_f.value == pytest.approx(expected.d_f.value, rel=1e-3 if whole else 0.2)
    assert fitted.pairing.measured.size == expected.pairing.measured.size > 0


def test_fit_from_a_model_of_sdypy_is_that_from_functions(identified):
    campaign, one, modes, expected = identified
    measurement = ema.read_measurement(campaign, one.name)
    frf = measurement.frf.convert("accelerance")
    step = float(frf.frequency[1] - frf.frequency[0])
    axis = np.arange(0.0, frf.frequency[-1] + step / 2, step)
    value = np.zeros((frf.output.node.size, axis.size), complex)
    value[:, -frf.frequency.size :] = frf.value[:, 0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from sdypy import EMA

        peer = EMA.Model(value, axis, lower=100.0, upper=420.0, pol_order_high=20, frf_form="accelerance")
        peer.get_poles(show_progress=False)
        peer.select_closest_poles(list(modes.frequency))
        peer.get_constants()
    force = ema.Dof(int(frf.input.node[0]), tuple(frf.input.direction[0]))
    read = ema.from_sdypy(peer, output=frf.output, force=force, geometry=measurement.geometry)
    fitted = updating.fit(model.read_stack(campaign.stack).with_contact(pressure=one.pressure), read)
    assert fitted.G_f.value == pytest.approx(expected.G_f.value, rel=0.05)
    assert fitted.pairing.measured.size == expected.pairing.measured.size > 0
