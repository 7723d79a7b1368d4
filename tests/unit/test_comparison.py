"""Modes followed through configurations."""

from dataclasses import fields, replace

import numpy as np
import pytest

from ema import FRF, Dofs, Geometry, compare, identify_frf


@pytest.fixture(scope="module")
def model():
    """A modal model of a beam with three modes, identified from exact FRFs at eight points."""
    x = np.linspace(0, 1, 8)
    shape = np.stack([np.cos((r + 2) * np.pi * x) for r in range(3)], axis=1)
    frequency = np.arange(20.0, 400.0, 0.25)
    omega, natural, xi = (
        2 * np.pi * frequency,
        2 * np.pi * np.array([80.0, 170.0, 300.0]),
        np.array([0.01, 0.02, 0.015]),
    )
    modal = 1 / (natural[:, None] ** 2 - omega**2 + 2j * xi[:, None] * natural[:, None] * omega)
    value = np.einsum("or,r,rf->of", shape, shape[0], modal)[:, None]
    noise = np.random.default_rng(3).standard_normal((2, *value.shape))
    up = np.tile([0.0, 0.0, 1.0], (8, 1))
    frf = FRF(
        frequency=frequency,
        value=value + 1e-3 * np.std(value) * (noise[0] + 1j * noise[1]),
        quantity="receptance",
        output=Dofs(node=np.arange(1, 9), direction=up),
        input=Dofs(node=[1], direction=up[:1]),
        run=np.zeros(8),
        source=("test",) * 8,
    )
    geometry = Geometry(node=np.arange(1, 9), coordinate=np.c_[x, 0 * x, 0 * x], line=np.empty((0, 2)))
    return identify_frf(frf, geometry, name="A")


def take(model, modes, dofs=slice(None), **changed):
    """The model with some of its modes and DOFs; only what `compare` reads is cut."""
    cut = object.__new__(type(model))
    for field in fields(model):
        object.__setattr__(cut, field.name, getattr(model, field.name))
    for name in ("frequency", "frequency_std", "damping", "damping_std"):
        object.__setattr__(cut, name, getattr(model, name)[modes])
    for name in ("node", "direction"):
        object.__setattr__(cut, name, getattr(model, name)[dofs])
    object.__setattr__(cut, "shape", model.shape[dofs][:, modes])
    for name, value in changed.items():
        object.__setattr__(cut, name, value)
    return cut


def test_modes_are_followed_when_their_order_changes(model):
    swapped = take(model, [1, 0, 2], name="B")
    found = compare([model, swapped])
    assert found.name == ("A", "B")
    np.testing.assert_allclose(found.frequency[0], found.frequency[1])
    np.testing.assert_allclose(found.mac, 1.0)


def test_a_mode_that_a_configuration_lacks_is_taken_up_again(model):
    found = compare([model, take(model, [0, 2], name="B"), replace(model, name="C")])
    assert found.frequency.shape == (3, 3)
    assert np.isnan(found.frequency[1, 1])
    assert found.frequency[2, 1] == model.frequency[1]


def test_channels_that_only_one_configuration_has_do_not_matter(model):
    found = compare([model, take(model, [0, 1, 2], dofs=[0, 2, 3, 5, 6, 7], name="B")])
    assert found.frequency.shape == (2, 3)
    np.testing.assert_allclose(found.mac, 1.0)


def test_strangers_are_not_joined(model):
    stranger = take(model, [0], name="B", shape=np.eye(8)[:, [3]].astype(complex))
    assert compare([model, stranger]).frequency.shape == (2, 4)


def test_modes_at_a_single_point_are_paired_by_their_frequencies(model):
    # with one DOF every MAC is 1: 152 Hz and 199 Hz were called one mode
    first = take(model, [0, 1], dofs=[2], name="A", frequency=np.array([152.0, 300.0]))
    second = take(model, [0, 1], dofs=[2], name="B", frequency=np.array([199.0, 303.0]))
    found = compare([first, second])
    np.testing.assert_array_equal(found.frequency, [[152.0, np.nan, 300.0], [np.nan, 199.0, 303.0]])
    assert np.isnan(found.mac[1, 2])


def test_the_nearest_of_the_modes_alike_at_two_points_goes_on(model):
    shape = np.array([[1.0, 1.0], [1.0, 1.05]], dtype=complex)
    cut = {"dofs": [2, 3], "shape": shape}
    found = compare(
        [
            take(model, [0, 1], name="A", frequency=np.array([100.0, 106.0]), **cut),
            take(model, [0, 1], name="B", frequency=np.array([101.0, 107.0]), **cut),
        ]
    )
    np.testing.assert_array_equal(found.frequency, [[100.0, 106.0], [101.0, 107.0]])
