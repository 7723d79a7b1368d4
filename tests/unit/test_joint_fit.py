"""Several configurations fitted at once: planted values come out, intervals hold them, settings do what they say."""

import dataclasses
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ema.types.frf import Dof, Dofs, Geometry
from model import Mesh, Observation, find_effects, observe, read_stack, reduce, solve_modes
from updating.diagnosis.candidates import candidate_model
from updating.diagnosis.diagnosis import diagnose
from updating.diagnosis.evidence import DiagnosisScatter
from updating.diagnosis.fit_settings import FitSettings
from updating.errors import FitError
from updating.pooled.joint_fit import entry_of, joint_fit
from updating.pooled.specimen import Specimen, assembled
from updating.results.store import digest

STACK = dataclasses.replace(
    read_stack(Path(__file__).parents[2] / "data/demo_stack/stack.toml"), n_lamina=24, mesh=Mesh(n_x=8, n_y=2)
)
EFFECTS = {effect.name: effect for effect in find_effects(["clamp_mass", "pressure_exponent"])}
MASS, EXPONENT = 0.3, 0.6
D_F = 2e-11
PRESSURES = {"M1": 160e3, "M2": 320e3}
N_MODE = 6
KNOWN = DiagnosisScatter(frequency=1e-3, damping=0.03)


@cache
def true_system(height):
    """The stack on a mesh so fine that what a finer one would bring is small."""
    fine = dataclasses.replace(STACK, height=height, mesh=Mesh(n_x=12, n_y=3))
    return reduce(fine.with_effects(*EFFECTS.values()), G_f_range=(300.0, 4000.0), n_snapshot=4, n_mode=22)


def points():
    x = np.linspace(-0.48, 0.48, 9) * STACK.length
    y = np.array([-0.48, 0.48]) * STACK.width
    return np.array([[a, b, 0.5 * STACK.height] for a in x for b in y])


def modes_of(name, G_f, seed=0, height=STACK.height, mass=MASS, exponent=EXPONENT, d_f=D_F):
    """Modes at one torque as an identification gives them, with some noise."""
    location, system, rng = points(), true_system(height), np.random.default_rng([seed, ord(name[-1])])
    n = len(location)
    up = np.tile([0.0, 0.0, 1.0], (n, 1))
    seen = observe(system, Observation(node=np.arange(n), location=location, direction=up))
    values = {"clamp_added_mass": mass, "exponent": exponent, "pressure": PRESSURES[name]}
    found = solve_modes(system, G_f=G_f, d_f=d_f, n_mode=22, observation=seen, parameters=values, by=()).elastic()
    frequency = found.frequency[:N_MODE] * (1.0 + 1e-4 * rng.standard_normal(N_MODE))
    damping = found.damping[:N_MODE] * (1.0 + 0.01 * rng.standard_normal(N_MODE))
    shape = found.shape[:, :N_MODE] / np.abs(found.shape[:, :N_MODE]).max(axis=0)
    shape = shape + 3e-3 * rng.standard_normal(shape.shape)
    return assembled(
        name,
        np.stack([frequency, 1e-4 * frequency, damping, 0.01 * damping]),
        (shape, np.full(shape.shape, 3e-3)),
        geometry=Geometry(node=np.arange(n), coordinate=location, line=np.empty((0, 2), dtype=int)),
        dofs=Dofs(node=np.arange(n), direction=up),
        sensor=np.zeros(n, dtype=np.int64),
        force=Dof(0, (0.0, 0.0, 1.0)),
    )


def specimen(name="S", G_f=1200.0, height=STACK.height, **planted):
    tested = tuple(
        (torque, p, modes_of(torque, G_f, seed=ord(name[-1]), height=height, **planted))
        for torque, p in PRESSURES.items()
    )
    return Specimen(name=name, stack=dataclasses.replace(STACK, height=height), tested=tested)


@pytest.fixture(scope="module")
def one():
    return specimen()


@pytest.fixture(scope="module")
def linear():
    """A stack whose contact is as stiff as stated, and as it is pressed, so that one effect explains all of it."""
    return specimen(G_f=STACK.contact.G_f, exponent=1.0)


@pytest.fixture(scope="module")
def at_one_torque(linear):
    """The same measured at its first torque alone, in half of the time."""
    return dataclasses.replace(linear, tested=linear.tested[:1])


def fitted(specimens, names=tuple(EFFECTS), **settings):
    given = FitSettings(**{"scatter": KNOWN, **settings})
    return joint_fit("test", specimens, {n: EFFECTS[n] for n in names}, given, known={}, reduced=reduced)


MODELS = {}


def reduced(stack, instruments, effects, *further):
    """The model of a stack with some of the effects: one for all tests is reduced with all of them."""
    key = digest(dataclasses.replace(stack, instruments=instruments))
    if key not in MODELS:
        MODELS[key] = candidate_model(stack, instruments, EFFECTS, *further)
    return dataclasses.replace(MODELS[key], effects={n: e for n, e in MODELS[key].effects.items() if n in effects})


def parameter(found, name, group=""):
    (one,) = (p for p in found.fit.parameter if (p.name, p.group) == (name, group))
    return one


def holds(found, name, value, group=""):
    one = parameter(found, name, group)
    return one.interval[0] < value < one.interval[1]


@pytest.fixture(scope="module")
def of_one(one):
    return fitted([one])


def test_planted_values_of_one_stack_are_found_and_lie_in_their_intervals(of_one):
    found = of_one
    assert holds(found, "clamp_added_mass", MASS)
    assert holds(found, "exponent", EXPONENT)
    assert holds(found, "G_f", 1200.0, STACK.name)
    assert holds(found, "d_f", D_F, STACK.name)
    assert parameter(found, "clamp_added_mass").value == pytest.approx(MASS, rel=0.1)
    assert found.fit.error() < 2e-3 < found.fit.error(before=True)
    assert [e.effects for e in found.ledger] == [(), ("clamp_mass",), ("pressure_exponent",), tuple(EFFECTS)]
    base, *_, both = found.ledger
    assert both.chi_square < 0.5 * base.chi_square
    assert base.pulled  # without effects, only what is known of the stack could meet the data
    assert not both.pulled
    assert all(np.all(c.mac > 0.99) for c in found.fit.configuration)
    std = np.sqrt(np.diag(found.fit.covariance))
    assert std == pytest.approx([p.std for p in found.fit.parameter], rel=1e-6)


def test_numbers_of_one_stack_are_those_of_a_diagnosis(one, of_one):
    every = [(), *((name,) for name in EFFECTS), tuple(EFFECTS)]
    answer = diagnose(one.stack, one.tested, EFFECTS, scatter=KNOWN, reduced=reduced, asked=every[1:])
    assert repr(of_one.ledger) == repr(tuple(entry_of(answer.ranked(names)) for names in every))
    both = answer.ranked(tuple(EFFECTS))
    for p in both.parameter:
        each = parameter(of_one, p.name)
        assert (each.value, *each.interval) == pytest.approx((p.value, p.lower, p.upper), rel=1e-9)


@pytest.mark.slow
def test_two_stacks_share_an_effect_and_have_contact_of_their_own():
    two = [specimen(name, G_f, mass=0.0) for name, G_f in (("S", 1200.0), ("T", 900.0))]
    found = fitted(two, ["pressure_exponent"])
    assert holds(found, "exponent", EXPONENT)
    for name, G_f in (("S", 1200.0), ("T", 900.0)):
        assert parameter(found, "G_f", name).value == pytest.approx(G_f, rel=0.1)
    assert [c.name for c in found.fit.configuration] == ["S/M1", "S/M2", "T/M1", "T/M2"]
    assert found.ledger[-1].configuration_error < 0.5 * found.ledger[0].configuration_error


@pytest.mark.slow
def test_an_effect_can_be_each_stacks_own():
    heavy, plain = specimen("S", mass=MASS), specimen("T", mass=0.0)
    found = fitted([heavy, plain], ["clamp_mass"], scope={"clamp_added_mass": "specimen"}, fixed={})
    assert parameter(found, "clamp_added_mass", "S").value > 2.0 * abs(parameter(found, "clamp_added_mass", "T").value)


def test_a_prior_draws_an_estimate_and_what_is_fixed_is_no_parameter(at_one_torque, of_one):
    """What is planted is the same in both stacks."""
    priors, fixed = {"clamp_added_mass": (0.33, 1e-4)}, {"G_f": STACK.contact.G_f}
    found = fitted([at_one_torque], ["clamp_mass"], priors=priors, fixed=fixed)
    assert parameter(of_one, "clamp_added_mass").value < 0.32
    assert parameter(found, "clamp_added_mass").value == pytest.approx(0.33, abs=1e-3)
    assert {p.name for p in found.fit.parameter} == {"clamp_added_mass", "d_f"}
    assert found.fit.error() < 2e-3


def test_an_estimate_at_its_bound_says_so(at_one_torque):
    found = fitted([at_one_torque], ["clamp_mass"], bounds={"clamp_added_mass": (0.0, 0.1)}, damping=False)
    mass = parameter(found, "clamp_added_mass")
    assert mass.at_bound
    assert not mass.determined
    assert mass.value == pytest.approx(0.1)
    assert (mass.lower, mass.upper) == (0.0, 0.1)


def test_modes_held_out_are_predicted_not_fitted(linear):
    (_, p, modes), other = linear.tested
    wrong = modes.frequency * np.where(np.arange(N_MODE) == 3, 1.3, 1.0)
    spoilt = dataclasses.replace(linear, tested=(("M1", p, dataclasses.replace(modes, frequency=wrong)), other))
    found = fitted([spoilt], ["clamp_mass"], hold_out={"M1": [3]}, damping=False)
    assert holds(found, "clamp_added_mass", MASS)
    assert found.fit.error() < 2e-3
    assert found.fit.error(held_out=True) == pytest.approx(1.0 - 1.0 / 1.3, abs=0.01)


def test_each_configuration_can_have_its_own_contact(one):
    found = fitted([one], ["clamp_mass"], scope={"G_f": "configuration", "d_f": "configuration"})
    law = parameter(found, "G_f", "M2").value / parameter(found, "G_f", "M1").value
    assert law == pytest.approx(2.0 ** (EXPONENT - 1.0), rel=0.02)
    assert not found.ledger[-1].pulled


@pytest.mark.slow
def test_young_and_density_that_are_free_are_told_apart_by_nothing(linear):
    """Young's modulus, density and G_f scale together: frequencies tell two of the three."""
    free = fitted([linear], ["clamp_mass"], free=("young", "density"), damping=False)
    known = fitted([linear], ["clamp_mass"], priors={"young": (1.0, 0.02), "density": (1.0, 0.01)}, damping=False)
    assert parameter(free, "young").std > 3.0 * parameter(known, "young").std
    assert holds(known, "young", 1.0)
    assert holds(known, "clamp_added_mass", MASS)
    assert "d_f" not in [p.name for p in known.fit.parameter]  # there is none without damping
    assert np.isnan(known.fit.error(damping=True))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"priors": {"G_ff": (1.0, 1.0)}}, "did you mean G_f"),
        ({"free": ["joung"]}, "did you mean young"),
        ({"bounds": {"exponent": (0.9, 0.1)}}, "is not below"),
        ({"bounds": {"G_f": (1.0, 2.0)}}, "what the model is made for"),
        ({"hold_out": {"M3": [0]}}, "configuration 'M3' is unknown"),
        ({"hold_out": {"M1": range(N_MODE)}}, "all its modes are held out"),
        ({"hold_out": {"M1": [N_MODE]}}, "there is no mode 7"),
        ({"scope": {"young": "configuration"}}, "'all' or 'specimen'"),
    ],
)
def test_what_cannot_be_fitted_is_said(one, settings, message):
    with pytest.raises(FitError, match=message):
        fitted([one], **settings)
