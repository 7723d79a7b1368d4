"""Force levels are compared resonance by resonance; what differs is said with channel and band."""

from dataclasses import replace

import numpy as np
import pytest

from ema.campaign.campaign import Configuration, read_campaign
from ema.campaign.measurement import Measurement
from ema.identification.identify import identify
from ema.quality.channels import check
from ema.quality.linearity import check_force_levels, check_linearity
from ema.types.errors import CampaignError, MeasurementError
from ema.types.frf import FRF, Dofs, Geometry

FREQUENCY = np.arange(20.0, 500.0, 0.5)
MODES = np.array([120.0, 210.0, 380.0])
N = 12
X = np.linspace(0, 1, N)
UP = [0.0, 0.0, 1.0]
STATE = Configuration(name="a", stack=None, torque=None, pressure=None, height=None, files=())


def measured(name="a", *, modes=MODES, damping=0.01, frequency=FREQUENCY, noise=0.02, seed=0, points=N):
    """Return the first points of a bar with three smooth shapes, force at point 1."""
    omega, one = 2 * np.pi * frequency, 2 * np.pi * modes
    shape = np.cos(np.pi * np.outer(X, [2, 3, 4])) + 0.1
    mode = -(omega**2) / (one[:, None] ** 2 - omega**2 + 2j * damping * one[:, None] * omega)
    value = (shape * shape[0]) @ mode
    rng = np.random.default_rng(seed)
    rms = np.sqrt(np.mean(np.abs(value) ** 2, axis=1, keepdims=True) / 2)
    value = value + noise * rms * (rng.normal(size=value.shape) + 1j * rng.normal(size=value.shape))
    frf = FRF(
        frequency=frequency,
        value=value[:points, None],
        quantity="accelerance",
        output=Dofs(node=np.arange(1, points + 1), direction=np.tile(UP, (points, 1))),
        input=Dofs(node=[1], direction=[UP]),
        run=np.zeros(points, dtype=int),
        source=tuple(f"point{k + 1}.uff" for k in range(points)),
    )
    geometry = Geometry(node=np.arange(1, N + 1), coordinate=np.outer(X, [0.8, 0, 0]), line=np.empty((0, 2)))
    return Measurement(name=name, configuration=STATE, frf=frf, geometry=geometry, overload=np.zeros(points), notes=())


def scaled(measurement, channel, factor):
    value = np.array(measurement.frf.value)
    value[channel] *= factor
    return replace(measurement, frf=replace(measurement.frf, value=value))


@pytest.mark.parametrize("damping", [0.002, 0.01, 0.03])
def test_noise_alone_is_not_called_nonlinear(damping):
    for seed in range(10):
        first, second = (measured(damping=damping, noise=0.05, seed=s, points=4) for s in (seed, 100 + seed))
        assert {v.level for v in check_linearity(first, second)} == {"pass"}


@pytest.mark.parametrize("factor", [0.997, 1.003])
def test_a_resonance_that_moves_is_named_with_its_band(factor):
    # 0.3 % of the frequency are 15 % of the bandwidth
    verdicts = check_linearity(measured(), measured("b", modes=MODES * [1, factor, 1], seed=1))
    assert [v.level for v in verdicts] == ["pass", "warn", "pass"]
    assert verdicts[1].band[0] < 210 < verdicts[1].band[1]
    assert verdicts[1].channel == ()
    assert f"from a to b it moves by {'+' if factor > 1 else '-'}1" in verdicts[1].message


def test_damping_that_grows_with_the_force_lowers_the_peaks():
    verdicts = check_linearity(measured(), measured("b", damping=0.0125, seed=1))
    assert [v.level for v in verdicts] == ["warn"] * 3
    assert all("not linear" in v.message for v in verdicts)


def test_a_resonance_that_is_gone():
    verdicts = check_linearity(measured(), measured("b", modes=MODES * [1, 1.1, 1], seed=1))
    assert [v.level for v in verdicts] == ["pass", "warn", "pass"]
    assert "is gone" in verdicts[1].message


def test_a_resonance_that_is_lower_and_no_longer_clear_is_not_called_gone():
    # damped more, the second and third resonance stand out by less than the 10 dB that are asked of a clear one
    first, second = measured(damping=0.055, noise=0.002), measured("b", damping=0.065, noise=0.002, seed=1)
    verdicts = check_linearity(first, second)
    assert [v.level for v in verdicts] == ["warn"] * 3
    assert all("its height changes by -1" in v.message for v in verdicts)


def test_a_single_channel_is_named_and_not_the_structure():
    # point 5 is near a node of the second mode, where its height is not judged
    verdicts = check_linearity(measured(), scaled(measured("b", seed=1), 4, 0.8))
    assert {v.channel for v in verdicts if v.level == "warn"} == {(4,)}
    assert "5+z by -2" in next(v.message for v in verdicts if v.level == "warn")


def test_only_common_points_and_the_band_are_compared():
    second = measured("b", modes=MODES * [1, 0.997, 1], seed=1, points=3)
    assert [v.level for v in check_linearity(measured(), second)] == ["pass", "warn", "pass"]
    assert [v.level for v in check_linearity(measured(), second, (250.0, 450.0))] == ["pass"]


def test_another_quantity_is_converted():
    second = measured("b", seed=1)
    second = replace(second, frf=second.frf.convert("receptance"))
    assert {v.level for v in check_linearity(measured(), second)} == {"pass"}


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda m: replace(m, frf=replace(m.frf, frequency=m.frf.frequency + 1)), "frequency lines"),
        (lambda m: replace(m, frf=replace(m.frf, input=Dofs(node=[2], direction=[UP]))), "force DOFs"),
        (
            lambda m: replace(
                m, frf=replace(m.frf, output=Dofs(node=m.frf.output.node + 50, direction=m.frf.output.direction))
            ),
            "outputs",
        ),
    ],
)
def test_what_cannot_be_compared(change, what):
    with pytest.raises(MeasurementError, match=f"'a' and 'b' cannot be compared .* do not share {what}"):
        check_linearity(measured(), change(measured("b")))


def test_failed_channels_are_not_compared_and_positions_stay():
    first, second = scaled(measured(), 2, 0.0), scaled(measured("b", seed=1), 9, 0.0)
    verdicts = check_force_levels(first, check(first), (scaled(second, 11, 0.8),))
    assert "b is compared without a channel: 10+z" in verdicts[0].message
    assert {v.channel for v in verdicts if v.level == "warn"} == {(), (11,)}


LEVELS = """\
force_N = 2
files = ["low.csv"]
output = ["1+z", "2+z", "3+z", "4+z", "5+z", "6+z", "7+z", "8+z", "9+z", "10+z", "11+z", "12+z"]
input = ["1+z"]
[[configuration.force_level]]
force_N = 10
files = ["high.csv"]
"""


@pytest.fixture
def text(campaign_text):
    """A campaign file with one configuration at two forces."""
    return campaign_text + LEVELS


def write(folder, text, **measurements):
    rows = [f"{n},{1e3 * 0.8 * x},0,0" for n, x in zip(range(1, N + 1), X, strict=True)]
    (folder / "points.csv").write_text("\n".join(["node,x,y,z", *rows]))
    for name, measurement in measurements.items():
        value = measurement.frf.value[:, 0]
        columns = [measurement.frf.frequency, *(p for v in value for p in (v.real, v.imag))]
        np.savetxt(folder / f"{name}.csv", np.column_stack(columns), delimiter=",")
    (folder / "campaign.toml").write_text(text)
    return folder / "campaign.toml"


def test_a_campaign_says_whether_its_structure_is_linear(tmp_path, text):
    path = write(tmp_path, text, low=measured(), high=measured(modes=MODES * [1, 1, 0.997], seed=1))
    (found,) = identify(read_campaign(path))
    linearity = [v for v in found.verdicts if v.check == "linearity"]
    assert [v.level for v in linearity] == ["pass", "pass", "warn"]
    assert "380" in linearity[2].message
    assert "from M1 to M1 at 10 N" in linearity[2].message
    np.testing.assert_allclose(found.modal_model.frequency, MODES, rtol=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("force_N = 10", "force_N = 2", "forces of one configuration must differ, found [2.0, 2.0] N"),
        ("force_N = 10", "force_N = -1", "configuration[1].force_level[1].force_N: "),
        ("force_N = 10", "", "configuration[1].force_level[1].force_N: this key is missing"),
        ("force_N = 10", "forceN = 10", "did you mean 'force_N'?"),
        ("high.csv", "hihg.csv", "force_level: files: no file 'hihg.csv'"),
        ("[[configuration.force_level]]", "[[configuration.force_levels]]", "did you mean 'force_level'"),
    ],
)
def test_a_campaign_file_with_faulty_force_levels(tmp_path, text, old, new, message):
    path = write(tmp_path, text.replace(old, new), low=measured(), high=measured())
    with pytest.raises(CampaignError) as error:
        read_campaign(path)
    assert message in str(error.value)


def test_a_level_with_other_lines_is_refused(tmp_path, text):
    path = write(tmp_path, text, low=measured(), high=measured(frequency=FREQUENCY[::2]))
    with pytest.raises(MeasurementError, match="'M1' and 'M1 at 10 N' cannot be compared"):
        list(identify(read_campaign(path)))
