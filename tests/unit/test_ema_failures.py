"""One configuration that cannot be used does not end the others."""

import numpy as np
import pytest

from ema import CampaignError, Failure, IdentificationError, identify, read_campaign, try_identify

N = 6
FREQUENCY = np.arange(60.0, 160.0, 0.5)
CONFIGURATION = """
[[configuration]]
name = "{name}"
files = ["{file}"]
output = [{output}]
input = ["1+z"]
"""


@pytest.fixture
def campaign(tmp_path, campaign_text):
    """A campaign of four configurations: two sound ones, one of noise alone and one with too few points stated."""
    x = np.linspace(0, 1, N)
    omega, one = 2 * np.pi * FREQUENCY, 2 * np.pi * 110.0
    shape = np.cos(2 * np.pi * x) + 0.1
    rng = np.random.default_rng(0)
    noise = 0.01 * (rng.normal(size=(N, FREQUENCY.size)) + 1j * rng.normal(size=(N, FREQUENCY.size)))
    signal = np.outer(shape * shape[0], -(omega**2) / (one**2 - omega**2 + 0.02j * one * omega))
    for name, value in {"sound": signal + noise, "noise": noise}.items():
        columns = [FREQUENCY, *(part for v in value for part in (v.real, v.imag))]
        np.savetxt(tmp_path / f"{name}.csv", np.column_stack(columns), delimiter=",")
    rows = [f"{n},{800 * at},0,0" for n, at in zip(range(1, N + 1), x, strict=True)]
    (tmp_path / "points.csv").write_text("\n".join(["node,x,y,z", *rows]))
    dofs = [f'"{n}+z"' for n in range(1, N + 1)]
    text = campaign_text[: campaign_text.index("[[configuration]]")]
    for name, file, count in (("A", "sound", N), ("B", "noise", N), ("C", "sound", N - 1), ("D", "sound", N)):
        text += CONFIGURATION.format(name=name, file=f"{file}.csv", output=", ".join(dofs[:count]))
    (tmp_path / "campaign.toml").write_text(text)
    return read_campaign(tmp_path / "campaign.toml")


def test_the_others_are_identified_and_the_errors_come_last(campaign):
    found = identify(campaign)
    assert [next(found).modal_model.name for _ in range(2)] == ["A", "D"]
    with pytest.raises(IdentificationError, match=r"(?s)^B: .*stands out of the noise.*\nC: .*output"):
        next(found)


def test_each_failure_says_which_and_why(campaign):
    results = {name: try_identify(campaign, name) for name in "ABCD"}
    failed = {name: result for name, result in results.items() if isinstance(result, Failure)}
    assert set(failed) == {"B", "C"}
    assert isinstance(failed["B"].error, IdentificationError)
    assert isinstance(failed["C"].error, CampaignError)
    assert failed["C"].name == "C"


def test_a_verdict_names_its_point_though_channels_before_it_are_left_out(tmp_path, campaign):
    file = tmp_path / "sound.csv"
    columns = np.loadtxt(file, delimiter=",")
    columns[:, 3:5] = 0.0  # point 2 is dead
    columns[:, 9:11] *= -1.0  # point 5 is upside down
    np.savetxt(file, columns, delimiter=",")
    found = try_identify(campaign, "A")
    about = {v.check: v.point for v in found.verdicts if v.level != "pass" and v.point}
    assert about["dead"] == (2,)
    assert 2 not in found.modal_model.node
    about.pop("dead")
    assert all(5 in point for point in about.values())
