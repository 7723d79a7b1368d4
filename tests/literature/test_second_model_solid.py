"""The solid of the independent benchmark: against Lamella's own model without effects, and against closed forms."""

import dataclasses
from functools import cache

import numpy as np
import pytest

import model
from tests.independent.bench import read_bench
from tests.independent.campaign import STACK, nominal_points
from tests.independent.effects import TABLE, draw_strength
from tests.independent.solid import Solid

STATED = read_bench(STACK)
SHAKER = tuple(nominal_points(STATED)[-1])
COARSE = Solid(order=(12, 3))
N_RIGID = 6


def bench(pressure=160e3, planted=None, **other):
    return dataclasses.replace(STATED, pressure=pressure, shaker=SHAKER, planted=planted or {}, **other)


@cache
def usual(pressure):
    return Solid().modes(bench(pressure), 16)


@cache
def rough():
    return Solid(order=(6, 2)).modes(bench(), 12)


@cache
def plain():
    return COARSE.modes(bench(), 16)


def with_(key, **values):
    return COARSE.modes(bench(planted={key: values}), 16)


@pytest.mark.parametrize("pressure", [160e3, pytest.param(320e3, marks=pytest.mark.slow)])
def test_first_ten_modes_are_those_of_lamella(pressure):
    stack = model.read_stack(STACK).with_contact(pressure=pressure)
    place = nominal_points(STATED)[:-1]
    seen = model.Observation(
        node=np.repeat(np.arange(1, 45), 3), location=np.repeat(place, 3, axis=0), direction=np.tile(np.eye(3), (44, 1))
    )
    contact = stack.contact
    ours = model.solve_modes(
        model.reduce(stack, n_mode=16, n_snapshot=1), G_f=contact.G_f, d_f=contact.d_f, n_mode=16, observation=seen
    ).elastic()
    solid = usual(pressure)
    np.testing.assert_array_equal(solid.frequency[:N_RIGID], 0.0)
    np.testing.assert_allclose(solid.frequency[N_RIGID:], ours.frequency, rtol=2e-3)
    np.testing.assert_allclose(solid.damping[N_RIGID:], ours.damping, rtol=5e-3, atol=1e-5)
    shape = solid.shape_at(place).reshape(132, -1)[:, N_RIGID:]
    length = np.einsum("ir,ir->r", shape, shape) * np.einsum("ir,ir->r", ours.shape, ours.shape)
    mac = np.einsum("ir,ir->r", shape, ours.shape) ** 2 / length
    np.testing.assert_allclose(mac, 1.0, atol=3e-4)


def test_without_bending_of_the_sheets_it_is_a_little_softer():
    stiff = usual(160e3).frequency[N_RIGID:]
    soft = Solid(bending=False).modes(bench(), 16).frequency[N_RIGID:]
    assert np.all(soft <= stiff)
    np.testing.assert_allclose(soft, stiff, rtol=6e-3)


@pytest.mark.slow
def test_higher_order_changes_little():
    coarse = usual(160e3).frequency[N_RIGID:]
    finer = Solid(order=(29, 5)).modes(bench(), 16).frequency[N_RIGID:]
    assert np.all(finer <= coarse * (1 + 1e-9))
    np.testing.assert_allclose(finer, coarse, rtol=1e-3)


def test_rigid_body_motion_weighs_what_the_stack_and_clamps_weigh():
    shape = plain().shape_at(np.zeros((1, 3)))[0, :, :N_RIGID]  # centre of mass; its motion sums to 1 / m
    weight = STATED.density * STATED.length * STATED.width * STATED.height
    weight += sum(clamp.mass for clamp in STATED.clamps)
    np.testing.assert_allclose(np.sum(shape**2, axis=1), 1.0 / weight, rtol=1e-6)


def test_a_small_mass_lowers_frequencies_as_rayleigh_says():
    mass = 0.002
    corner = np.array([[STATED.length, STATED.width, STATED.height]]) / 2 - [[0.012, 0.012, 0.008]]
    motion = np.sum(plain().shape_at(corner)[0, :, N_RIGID:] ** 2, axis=0)
    shift = with_("point_mass", mass=mass).frequency[N_RIGID:] / plain().frequency[N_RIGID:] - 1
    np.testing.assert_allclose(shift, -0.5 * mass * motion, rtol=0.1, atol=1e-6)


def test_hysteretic_loss_damps_by_the_share_of_energy_in_shear():
    eta, step = 0.01, 1e-3
    low, high = (COARSE.modes(bench(G_f=STATED.G_f * (1 + s)), 16).frequency[N_RIGID:] for s in (-step, step))
    share = (np.log(high) - np.log(low)) / (2 * step)  # d ln f / d ln G is half the share of the energy
    found = with_("contact_loss", eta=eta)
    np.testing.assert_allclose((found.damping - plain().damping)[N_RIGID:], eta * share, atol=1e-6)


def test_viscous_loss_of_a_uniform_contact_grows_with_frequency():
    thick = bench(d_f=0.0, planted={"contact_loss": {"eta": 1.0}})
    hysteretic = COARSE.modes(thick, 16)
    beta, omega = STATED.d_f * 160e3, 2 * np.pi * plain().frequency[N_RIGID:]
    first = slice(0, 5)  # modes that hardly stretch the height, whose loss is viscous alone
    viscous = beta * omega * hysteretic.damping[N_RIGID:]
    np.testing.assert_allclose(plain().damping[N_RIGID:][first], viscous[first], rtol=1e-2)


def test_an_absorber_splits_the_mode_that_it_is_tuned_to():
    mode, place = N_RIGID, np.array([[0.9 * STATED.length / 2 - 1e-9, 0.5 * STATED.width / 2, 0.0238]])
    motion = plain().shape_at(place)[0, 2, mode] ** 2
    target, mass = plain().frequency[mode], 1e-3
    found = with_("absorber", mass=mass, frequency=target, damping=0.0, x=0.9, y=0.5).frequency
    split = (found[mode + 1] - found[mode]) / target
    np.testing.assert_allclose(split, np.sqrt(mass * motion), rtol=0.05)


def test_stinger_springs_hold_the_rigid_body():
    stiffness = 3e4
    found = with_("stinger_spring", stiffness=stiffness).frequency[:N_RIGID]
    pad = np.add([SHAKER], [0.0, 0.0, 0.008])
    held = np.sum(plain().shape_at(pad)[0, :2, :N_RIGID] ** 2)
    assert np.sum(found == 0.0) == N_RIGID - 2
    np.testing.assert_allclose(np.sum((2 * np.pi * found) ** 2), stiffness * held, rtol=0.03)


def test_offset_of_a_uniform_contact_is_more_of_it():
    more = 2e7
    offset = with_("contact_offset", modulus=more).frequency
    stiffer = COARSE.modes(bench(G_f=STATED.G_f + more / 160e3), 16).frequency
    np.testing.assert_allclose(offset, stiffer, rtol=1e-9)


def test_pressure_exponent_changes_nothing_at_its_reference():
    at_reference = COARSE.modes(bench(320e3, {"pressure_exponent": {"exponent": 0.4}}), 12)
    np.testing.assert_allclose(at_reference.frequency, COARSE.modes(bench(320e3), 12).frequency, rtol=1e-9)


def test_a_stiff_loose_bolt_that_presses_is_a_tight_one():
    tight = with_("loose_bolt", loss=0.0, stiffness=1e13, clamp=0.5)
    np.testing.assert_allclose(tight.frequency, plain().frequency, rtol=1e-4)


@pytest.mark.parametrize("key", TABLE)
def test_everything_can_be_planted_and_does_something(key):
    strength = draw_strength(np.random.default_rng(1), key)
    found, without = Solid(order=(6, 2)).modes(bench(planted={key: strength}), 12), rough()
    assert np.all(np.isfinite(found.frequency))
    assert np.all(found.damping >= 0.0)
    change = np.r_[found.frequency - without.frequency, 1e3 * (found.damping - without.damping)]
    assert np.max(np.abs(change)) > 1e-3
