"""The layers of the independent benchmark, without effects, against Lamella's own model."""

import dataclasses

import numpy as np
import pytest

import model
from tests.independent.bench import read_bench
from tests.independent.campaign import STACK, nominal_points
from tests.independent.layered import Layered

STATED = read_bench(STACK)
SHAKER = tuple(nominal_points(STATED)[-1])
N_RIGID, N_MODE = 6, 18


@pytest.mark.parametrize("pressure", [160e3, pytest.param(320e3, marks=pytest.mark.slow)])
def test_modes_in_the_band_of_the_study_are_those_of_lamella(pressure):
    stack = model.read_stack(STACK).with_contact(pressure=pressure)
    place = nominal_points(STATED)[:-1]
    seen = model.Observation(
        node=np.repeat(np.arange(1, 45), 3), location=np.repeat(place, 3, axis=0), direction=np.tile(np.eye(3), (44, 1))
    )
    ours = model.solve_modes(
        model.reduce(stack, n_mode=N_MODE, n_snapshot=1),
        G_f=stack.contact.G_f,
        d_f=stack.contact.d_f,
        n_mode=N_MODE,
        observation=seen,
    ).elastic()
    layers = Layered().modes(dataclasses.replace(STATED, pressure=pressure, shaker=SHAKER), N_MODE)
    np.testing.assert_array_equal(layers.frequency[:N_RIGID], 0.0)
    np.testing.assert_allclose(layers.frequency[N_RIGID:], ours.frequency, rtol=5e-3)
    np.testing.assert_allclose(layers.damping[N_RIGID:], ours.damping, rtol=1e-2, atol=1e-5)
    shape = layers.shape_at(place).reshape(132, -1)[:, N_RIGID:]
    length = np.einsum("ir,ir->r", shape, shape) * np.einsum("ir,ir->r", ours.shape, ours.shape)
    mac = np.einsum("ir,ir->r", shape, ours.shape) ** 2 / length
    np.testing.assert_allclose(mac, 1.0, atol=1e-3)


@pytest.mark.slow
def test_more_elements_change_little():
    usual, finer = (
        Layered(n_element=n).modes(dataclasses.replace(STATED, shaker=SHAKER), N_MODE).frequency[N_RIGID:]
        for n in (Layered().n_element, (30, 5))
    )
    np.testing.assert_allclose(finer, usual, rtol=1e-3)
