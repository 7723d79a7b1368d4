"""Contact parameters of a specimen at one torque alone."""

from types import SimpleNamespace

import numpy as np
import pytest

from updating.diagnosis.explanation import Z95
from updating.pooled import states
from updating.pooled.algebra import Block
from updating.pooled.linear import Scales
from updating.pooled.states import contact_states, modes_told

G_F, D_F = 1000.0, 1e-10
SLOPE = np.array([[5.0, -400.0, 0.0], [5.0, -300.0, 0.0], [0.0, 40.0, -50.0], [0.0, 30.0, -40.0]])
"""Two frequencies and two damping ratios of a torque by Young's modulus, G_f and d_f, over their noise."""
STEPS = np.array([[0.0, 0.05, -0.2], [0.0, -0.03, 0.1]])
"""What ln G_f and ln d_f are at each torque over what they are of the specimen."""


class Weighed:
    """Stands for `Weighing`: a common discrepancy of 2 in the first row of each torque."""

    def __init__(self, *_):
        pass

    def reduced(self, _):
        return None

    def bounds(self):
        return ()

    def joined(self, *_):
        return SimpleNamespace(step=lambda *_: np.array([0.0, 2.0, 0.4]))


@pytest.fixture
def bench():
    rows = SimpleNamespace(
        configuration=np.repeat([0, 1], 5), kind=np.tile(["frequency"] * 2 + ["damping"] * 2 + ["shape"], 2)
    )
    evidence = SimpleNamespace(
        nuisances=("young", "G_f", "d_f"),
        rows=rows,
        tested=(None, None),
        stack=SimpleNamespace(contact=SimpleNamespace(G_f=G_F)),
        theta=lambda *_: {"d_f": D_F},
    )
    specimen = SimpleNamespace(tested=(("M1", 1.6e5, None), ("M2", 3.2e5, None)))
    return SimpleNamespace(own=(SimpleNamespace(evidence=evidence, specimen=specimen),))


@pytest.fixture
def fitted(bench):
    shape = np.full((1, 3), 9.0)  # no shape counts
    own = np.vstack([SLOPE, shape, SLOPE, shape])
    shared = np.tile([[1.0], [0.0], [0.0], [0.0], [0.0]], (2, 1))
    data = [np.append(-SLOPE @ step, 99.0) for step in STEPS]
    value = np.concatenate(data) + 2.0 * shared[:, 0]
    block = Block(
        value=value,
        own=own,
        shared=shared,
        effect=np.zeros((10, 1)),
        kind=bench.own[0].evidence.rows.kind,
        growth=np.zeros(10),
        away=np.zeros(3),
        mean=np.arange(3),
    )
    group = SimpleNamespace(name="G_f", parameter=None, members=(0,))
    at = SimpleNamespace(nuisance=(np.array([0.3, 0.2, -0.1]),), coordinate=np.array([0.4]))
    return SimpleNamespace(
        linear=SimpleNamespace(block=(block,)), at=at, coordinates=(group,), scales=Scales()
    )


def test_a_torque_alone_tells_its_contact(bench, fitted, monkeypatch):
    monkeypatch.setattr(states, "Weighing", Weighed)
    monkeypatch.setattr(states, "strengths", lambda *_: SimpleNamespace(mean=(1.0,)))
    (found,) = contact_states(bench, fitted)
    assert [(own.name, own.pressure) for own in found] == [("M1", 1.6e5), ("M2", 3.2e5)]
    for own, step in zip(found, STEPS, strict=True):
        assert own.G_f.value == pytest.approx(G_F * np.exp(0.2 + 0.4 + step[1]), rel=1e-3)
        assert own.d_f.value == pytest.approx(D_F * np.exp(-0.1 + step[2]), rel=1e-3)
        std = np.sqrt(np.linalg.inv(SLOPE[:, 1:].T @ SLOPE[:, 1:]).diagonal())
        half = np.log(own.d_f.upper / own.d_f.lower) / 2.0 / Z95
        assert half == pytest.approx(std[1], rel=1e-2)


def test_a_torque_without_damping_ratios_tells_nothing_of_contact_damping(bench, fitted, monkeypatch):
    monkeypatch.setattr(states, "Weighing", Weighed)
    monkeypatch.setattr(states, "strengths", lambda *_: SimpleNamespace(mean=(1.0,)))
    bench.own[0].evidence.rows.kind[7:9] = "shape"
    ((first, second),) = contact_states(bench, fitted)
    assert first.d_f is not None
    assert second.d_f is None
    assert second.G_f is not None


def test_modes_are_told_beside_both_models():
    modes = SimpleNamespace(
        frequency=np.array([100.0, 200.0, 300.0]),
        damping=np.array([0.01, 0.02, 0.03]),
        damping_std=np.array([0.001, 20.0, 0.003]),
    )
    evidence = SimpleNamespace(tested=[SimpleNamespace(name="M1", modes=modes)], used=[np.array([0, 1])])
    base, found = (
        SimpleNamespace(log_frequency=-np.log(np.array(ratio)), log_damping=-np.log(np.full(2, 0.5)))
        for ratio in ([1.1, 0.9], [1.01, 1.0])
    )
    first, second = modes_told(evidence, base, found)
    assert (first.configuration, first.frequency, second.frequency) == ("M1", 100.0, 200.0)
    assert (first.base_frequency, first.model_frequency) == pytest.approx((110.0, 101.0))
    assert (second.base_frequency, second.model_frequency) == pytest.approx((180.0, 200.0))
    assert (first.damping, first.model_damping) == pytest.approx((0.01, 0.005))
    assert np.isnan(second.damping)  # nobody knows it to a thousand times itself
