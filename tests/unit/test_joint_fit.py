"""Several configurations fitted at once: what was put in comes out, with the derivatives that are claimed."""

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from model import find_effects, read_stack
from model.stack.parts import Mesh
from updating.errors import FitError
from updating.fitting.descent import covariance, descend
from updating.fitting.intervals import bootstrap_intervals, normal_intervals
from updating.fitting.joint_fit import joint_fit
from updating.fitting.joint_problem import FitSettings, Problem
from updating.fitting.prepared import prepare, solve_target
from updating.fitting.sensitivity import Scatter
from updating.fitting.starts import starts
from updating.fitting.target import Target, target_of_table
from updating.workers.workers import workers

ROOT = Path(__file__).parents[2]
CLASSES = ("torsion 1", "bending 1", "bending 2", "torsion 2")
TRUE = {"clamp_roll_inertia": 0.004, "clamp_station": 0.79}
G_F = {"A": 1300.0, "B": 900.0}
D_F = {"A": 1.5e-10, "B": 0.8e-10}


@pytest.fixture(scope="module")
def stack():
    found = read_stack(ROOT / "data/pirnat2013/stack_C1.toml")
    return dataclasses.replace(found, n_lamina=40, mesh=Mesh(n_x=8, n_y=2)).with_effects(
        *find_effects(["clamp_inertia"])
    )


def blank(stack, name, pressure):
    return target_of_table(
        stack.with_contact(pressure=pressure), CLASSES, np.full(4, 500.0), name=name, damping=np.full(4, 0.01)
    )


@pytest.fixture(scope="module")
def prepared(stack):
    """Two torques of one stack, their modes those of the model with the true parameters."""
    found = []
    for one in prepare([blank(stack, "A", 160e3), blank(stack, "B", 320e3)], n_snapshot=3):
        name = one.target.name
        modes, column = solve_target(one, {**TRUE, "G_f": G_F[name], "d_f": D_F[name]}, ())
        target = dataclasses.replace(
            one.target, frequency=modes.frequency[column], damping=modes.damping[column]
        )
        found.append(dataclasses.replace(one, target=target))
    return tuple(found)


@pytest.fixture(scope="module")
def fitted(prepared):
    return joint_fit(prepared)


def with_shapes(one):
    """Return the target with the shapes of its modes in place of their classes."""
    name = one.target.name
    modes, column = solve_target(one, {**TRUE, "G_f": G_F[name], "d_f": D_F[name]}, ())
    shape = modes.shape[:, column] / np.linalg.norm(modes.shape[:, column], axis=0)
    values = {f.name: getattr(one.target, f.name) for f in dataclasses.fields(Target)}
    values |= {"shape_class": (), "shape": shape, "shape_std": np.full(shape.shape, 1e-3)}
    return dataclasses.replace(one, target=Target(**values))


def problem_of(prepared, **fixed):
    return Problem(prepared, FitSettings(fixed=fixed, priors={"G_f": (1000.0, 300.0)}))


def test_targets_that_differ_by_pressure_share_one_reduction(prepared):
    assert prepared[0].system is prepared[1].system


def test_true_parameters_are_found_from_exact_data(fitted):
    for name, value in TRUE.items():
        assert fitted.value(name) == pytest.approx(value, rel=1e-4)
    for name in "AB":
        assert fitted.value("G_f", name) == pytest.approx(G_F[name], rel=1e-4)
        assert fitted.value("d_f", name) == pytest.approx(D_F[name], rel=1e-4)
    assert fitted.error() < 1e-5
    assert fitted.error(before=True) > 0.01
    assert all(p.determined and not p.at_bound for p in fitted.parameter)


def test_the_record_of_each_start_falls(fitted):
    best = fitted.start[0]
    assert best.converged
    assert best.objective[-1] == pytest.approx(fitted.chi_square / 2, abs=1e-9)
    assert best.objective[-1] < 1e-3 * best.objective[0]
    assert len(fitted.start) == 8


@pytest.mark.parametrize("shapes", [False, True])
def test_derivatives_agree_with_differences(prepared, shapes):
    problem = problem_of([with_shapes(one) for one in prepared] if shapes else prepared)
    x = starts(problem, 1, {})[0]
    station = next(j for j, f in enumerate(problem.free) if f.name == "clamp_station")
    x[station] = 0.65  # between the effect's fixed places, where its derivative jumps
    _, jacobian = problem.evaluate(x)
    for j in range(x.size):
        step = 1e-5 * (problem.high - problem.low)[j]
        ahead, behind = (problem.evaluate(x + s * step * np.eye(x.size)[j])[0] for s in (1.0, -1.0))
        difference = (ahead - behind) / (2.0 * step)
        assert np.abs(jacobian[:, j] - difference).max() < 1e-4 * np.abs(difference).max()


def test_shapes_are_fitted_as_vectors(prepared):
    found = joint_fit([with_shapes(one) for one in prepared], n_start=2)
    assert found.value("clamp_station") == pytest.approx(TRUE["clamp_station"], rel=1e-3)
    assert all(np.all(c.mac > 0.9999) for c in found.configuration)


def test_a_parameter_of_the_specimen_is_one_for_both_torques(prepared):
    same = [dataclasses.replace(p, target=dataclasses.replace(p.target, specimen="S")) for p in prepared]
    found = joint_fit(same, FitSettings(effects=(), scope={"G_f": "specimen"}, damping=False))
    assert [(p.name, p.group) for p in found.parameter] == [("G_f", "S")]


def test_the_covariance_predicts_the_scatter_of_estimates(prepared):
    """Estimates from noisy frequencies lie as far from the truth as their standard deviations say."""
    random, distances = np.random.default_rng(3), []
    for _ in range(12):
        noisy = [
            dataclasses.replace(
                p,
                target=dataclasses.replace(
                    p.target,
                    frequency=p.target.frequency * np.exp(0.003 * random.standard_normal(4)),
                ),
            )
            for p in prepared
        ]
        found = joint_fit(
            noisy,
            FitSettings(damping=False, fixed={"clamp_station": 0.79}, scatter=Scatter(frequency=0.003)),
            n_start=1,
        )
        std = np.sqrt(np.diag(found.covariance))
        truth = np.array([G_F["A"], G_F["B"], TRUE["clamp_roll_inertia"]])
        estimate = np.array([p.value for p in found.parameter])
        assert std == pytest.approx([p.std for p in found.parameter])
        distances.append((estimate - truth) / std)
    # 36 distances, correlated within each draw, and each std estimated from five degrees of freedom or the stated one
    assert 0.5 < np.sqrt(np.mean(np.square(distances))) < 1.5


def test_modes_held_out_are_predicted_not_fitted(prepared):
    wrong = prepared[0].target.frequency * [1.0, 1.0, 1.0, 1.5]
    spoilt = (
        dataclasses.replace(prepared[0], target=dataclasses.replace(prepared[0].target, frequency=wrong)),
        prepared[1],
    )
    found = joint_fit(spoilt, FitSettings(hold_out={"A": [3]}), n_start=2)
    assert found.value("clamp_station") == pytest.approx(TRUE["clamp_station"], rel=1e-3)
    assert found.error() < 1e-4
    assert found.error(held_out=True) == pytest.approx(1.0 - 1.0 / 1.5, rel=1e-3)


def test_a_fit_begins_where_another_ended(prepared, fitted):
    again = joint_fit(prepared, first=fitted, n_start=1)
    np.testing.assert_allclose(again.start[0].first, [p.value for p in fitted.parameter], rtol=2e-2)
    assert again.start[0].objective.size < fitted.start[0].objective.size
    assert again.value("clamp_station") == pytest.approx(TRUE["clamp_station"], rel=1e-4)


def test_a_prior_draws_the_estimate(prepared):
    found = joint_fit(
        prepared, FitSettings(fixed={"clamp_station": 0.79}, priors={"clamp_roll_inertia": (0.006, 1e-5)})
    )
    assert found.value("clamp_roll_inertia") == pytest.approx(0.006, rel=1e-2)


def test_an_estimate_at_its_bound_says_so(prepared):
    found = joint_fit(prepared, FitSettings(bounds={"clamp_roll_inertia": (0.0, 0.002)}), n_start=2)
    inertia = next(p for p in found.parameter if p.name == "clamp_roll_inertia")
    assert inertia.at_bound
    assert not inertia.determined
    assert inertia.std == 0.0


def noisy(prepared, std, seed):
    random = np.random.default_rng(seed)
    return [
        dataclasses.replace(
            p,
            target=dataclasses.replace(
                p.target, frequency=p.target.frequency * np.exp(std * random.standard_normal(4))
            ),
        )
        for p in prepared
    ]


def test_a_profile_ends_where_chi_square_has_risen(prepared):
    """An inertia that is hardly known is bounded more sharply from below: its interval is not symmetric."""
    options = {"damping": False, "scatter": Scatter(frequency=0.1), "fixed": {"clamp_station": 0.79}}
    data = noisy(prepared, 0.01, 1)
    found = joint_fit(data, FitSettings(**options), n_start=1, intervals="profile")
    inertia = next(p for p in found.parameter if p.name == "clamp_roll_inertia")
    assert inertia.method == "profile"
    above, below = inertia.interval[1] - inertia.value, inertia.value - inertia.interval[0]
    assert above > 1.2 * below > 0.0
    for end in inertia.interval:
        fixed = {**options["fixed"], "clamp_roll_inertia": end}
        there = joint_fit(data, FitSettings(**{**options, "fixed": fixed}))
        assert there.chi_square - found.chi_square == pytest.approx(3.84, abs=0.05)


def test_simulated_data_give_the_interval_of_the_covariance_where_all_is_nearly_linear(prepared):
    problem = problem_of(noisy(prepared, 0.003, 2), clamp_station=0.79)
    x = descend(problem, starts(problem, 1, {})[0]).last
    spread, inflation = covariance(problem, x)
    normal = normal_intervals(problem, x, spread)
    drawn = bootstrap_intervals(problem, x, inflation, seed=0, n_draw=40)
    stiffness = [j for j, f in enumerate(problem.free) if f.name in ("G_f", "clamp_roll_inertia")]
    assert np.ptp(drawn, axis=1)[stiffness] == pytest.approx(np.ptp(normal, axis=1)[stiffness], rel=0.4)
    assert np.all((drawn[:, 0] < x) & (x < drawn[:, 1]))


def test_what_only_a_product_of_two_parameters_changes_is_not_determined(prepared):
    """Young's modulus, density and G_f scale together: frequencies tell two of the three."""
    found = joint_fit(
        prepared,
        FitSettings(effects=(), fixed=TRUE, free=("young", "density"), scope={"G_f": "all"}, damping=False),
    )
    assert len(found.subset) < len(found.parameter)
    assert not all(p.determined for p in found.parameter)
    known = joint_fit(
        prepared,
        FitSettings(
            effects=(),
            fixed=TRUE,
            free=("young", "density"),
            damping=False,
            priors={"young": (1.0, 0.02), "density": (1.0, 0.01)},
        ),
    )
    assert known.value("young") == pytest.approx(1.0, abs=0.002)
    assert known.value("G_f", "A") == pytest.approx(G_F["A"], rel=1e-2)
    assert all(p.determined for p in known.parameter)


def test_frequencies_that_fit_badly_are_not_excused_by_shapes_that_fit_well(prepared):
    """88 shape components that fit must not shrink the uncertainty that 8 frequencies off by 3 % leave."""
    off = np.array([1.03, 0.97, 1.03, 0.97])
    spoilt = [
        dataclasses.replace(p, target=dataclasses.replace(p.target, frequency=p.target.frequency * off))
        for p in prepared
    ]
    plain, shaped = (
        joint_fit(data, FitSettings(effects=(), fixed=TRUE, damping=False))
        for data in (spoilt, [with_shapes_of(p, q) for p, q in zip(prepared, spoilt, strict=True)])
    )
    assert shaped.parameter[0].std > 0.7 * plain.parameter[0].std


def with_shapes_of(right, one):
    """Return a target with the true shapes and its own frequencies."""
    shaped = with_shapes(right)
    return dataclasses.replace(
        shaped, target=dataclasses.replace(shaped.target, frequency=one.target.frequency)
    )


def test_a_pressure_with_a_prior_takes_up_a_torque_error(prepared):
    same = [dataclasses.replace(p, target=dataclasses.replace(p.target, specimen="S")) for p in prepared]
    found = joint_fit(same, FitSettings(damping=False, fixed=TRUE, effects=(), scatter=Scatter(pressure=0.3)))
    a, b = (found.value("pressure", name) for name in "AB")
    assert found.error() < 2e-3
    assert a / b == pytest.approx(G_F["A"] * 160e3 / (G_F["B"] * 320e3), rel=0.02)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"effects": ["clamp_inertias"]}, "did you mean clamp_inertia"),
        ({"priors": {"G_ff": (1.0, 1.0)}}, "did you mean G_f"),
        ({"free": ["joung"]}, "did you mean young"),
        ({"bounds": {"clamp_station": (0.9, 0.1)}}, "is not below"),
        ({"hold_out": {"C": [0]}}, "configuration 'C' is unknown"),
        ({"hold_out": {"A": range(4)}}, "all its modes are held out"),
        (
            {"hold_out": {"A": range(4), "B": range(4)}, "scope": {"G_f": "all", "d_f": "all"}},
            "no mode is left",
        ),
    ],
)
def test_what_cannot_be_fitted_is_said(prepared, options, message):
    with pytest.raises(FitError, match=message):
        joint_fit(prepared, FitSettings(**options))


def test_a_misspelt_kind_of_interval_is_said(prepared):
    with pytest.raises(FitError, match="did you mean profile"):
        joint_fit(prepared, intervals="profil")


def test_names_of_configurations_are_unique(stack):
    with pytest.raises(FitError, match="a name each"):
        prepare([blank(stack, "A", 160e3), blank(stack, "A", 320e3)])


def test_workers_find_the_same_to_the_last_bit(prepared, two_processes):
    """The models go to other processes with their effects, whose factors are functions within functions."""
    problem = problem_of(prepared)
    with threadpool_limits(1, user_api="blas"), workers(2) as executor:
        here, there = joint_fit(prepared, n_start=2), joint_fit(prepared, n_start=2, executor=executor)
        x = starts(problem, 1, {})[0]
        inflation = np.ones(problem.evaluate(x)[0].size)
        assert executor.submit(os.getpid).result() != os.getpid()
        drawn = [
            bootstrap_intervals(problem, x, inflation, seed=0, n_draw=6, executor=where)
            for where in (None, executor)
        ]
    assert here.parameter == there.parameter
    np.testing.assert_array_equal(*drawn)
