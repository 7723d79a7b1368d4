"""Diagnoses of virtual tests whose hidden effect is known to the test alone."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import model
from tests.studies.blind import blind_test, candidates_of, simulated
from tests.studies.modal_data import ModalNoise, simulate_modes
from updating.diagnosis.assembly import assemble_evidence
from updating.diagnosis.diagnosis import conclude, searched
from updating.diagnosis.discrepancy import Block, Discrepancy
from updating.diagnosis.evidence import DiagnosisScatter
from updating.diagnosis.residual import covariance_of, residual, rough_about

SPECIFICATION = Path(__file__).parents[2] / "data" / "demo_stack" / "virtual_test.toml"
CONSIDERED = (
    "clamp_mass",
    "contact_direction",
    "pressure_exponent",
    "contact_loss",
    "clamp_rods",
    "temperature",
)


@pytest.fixture(scope="module")
def catalogue():
    return {name: effect for name, effect in model.catalogue().items() if name in CONSIDERED}


@pytest.fixture(scope="module")
def candidates(catalogue):
    return candidates_of(SPECIFICATION, catalogue)


@pytest.fixture(scope="module")
def coarse(tmp_path_factory):
    """The same test on a coarser mesh of fewer laminas, in a third of the time."""
    folder = tmp_path_factory.mktemp("coarse")
    shutil.copytree(SPECIFICATION.parent, folder, ignore=shutil.ignore_patterns("M*"), dirs_exist_ok=True)
    stack = (folder / "stack.toml").read_text(encoding="utf-8")
    for fine, rough in (
        ("n_x = 18", "n_x = 10"),
        ("n_y = 4", "n_y = 2"),
        ("n_lamina = 240", "n_lamina = 60"),
    ):
        assert fine in stack
        stack = stack.replace(fine, rough)
    (folder / "stack.toml").write_text(stack, encoding="utf-8")
    test = SPECIFICATION.read_text(encoding="utf-8")
    assert "mesh = [24, 6]" in test
    (folder / SPECIFICATION.name).write_text(
        test.replace("mesh = [24, 6]", "mesh = [14, 3]"), encoding="utf-8"
    )
    return folder / SPECIFICATION.name


@pytest.fixture(scope="module")
def quick(coarse, catalogue):
    """The candidates of the coarse test."""
    return candidates_of(coarse, catalogue)


@pytest.fixture(scope="module")
def bare(coarse):
    """What a coarse test of a stack without hidden effects measured."""
    return simulated(blind_test(coarse, 12, (), {}))


@pytest.fixture(scope="module")
def lean(quick, bare):
    """The evidence of a test of a stack without hidden effects."""
    return assemble_evidence(quick, bare[:2])


def diagnosed(candidates, effects, values, seed, specification=SPECIFICATION):
    test = blind_test(specification, seed, effects, values)
    return conclude(candidates, assemble_evidence(candidates, simulated(test)[:2]))


def test_nothing_is_missing_where_nothing_is_hidden(quick, coarse):
    found = diagnosed(quick, (), {}, 11, coarse)
    assert found.verdict == "nothing missing"
    assert found.set == ()
    assert found.too_large == ()
    assert {"clamp_rods", "temperature"} <= set(found.not_visible)
    assert {"contact_direction", "pressure_exponent"} <= set(found.ruled_out)
    assert not set(found.ruled_out) & set(found.not_visible)
    assert found.sentences[0].startswith("Nothing is missing that these data can show")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "values"),
    [("contact_direction", {"G_yz_ratio": 0.8}), ("pressure_exponent", {"exponent": 0.5})],
)
def test_a_hidden_effect_is_named_and_its_parameter_found(candidates, catalogue, name, values):
    found = diagnosed(candidates, (catalogue[name],), values, 12)
    assert found.verdict in ("identified", "one of")
    assert found.set[0] == (name,)
    told_apart_by_none = {effect for effects in found.set[1:] for effect in effects}
    assert told_apart_by_none <= set(found.measurement)  # two torques stated wrongly do as an exponent does
    assert found.verdict == "identified" or name == "pressure_exponent"
    assert name not in found.ruled_out
    assert {"contact_direction", "pressure_exponent"} - {name} <= set(found.ruled_out)
    best = next(x for x in found.ranking if x.effects == (name,))
    (parameter,) = best.parameter
    assert parameter.lower < values[parameter.name] < parameter.upper
    assert best.frequency_error < 0.3 * found.ranked(()).frequency_error


@pytest.mark.slow
def test_clamps_that_a_file_has_too_heavy_are_no_physical_effect(candidates, catalogue):
    found = diagnosed(candidates, (catalogue["clamp_mass"],), {"clamp_added_mass": -0.3}, 16)
    assert found.set[0] == ("clamp_mass",)
    assert "clamp_mass" in found.measurement
    assert found.labels["clamp_mass"] == catalogue["clamp_mass"].overstated
    assert found.sentences[0].startswith(
        "Not the model but the measurement: clamps that are lighter than stated"
    )


def test_an_effect_that_is_not_in_the_catalogue_is_not_given_a_name_with_confidence(quick, coarse, catalogue):
    offered = replace(quick, effects={k: v for k, v in quick.effects.items() if k != "contact_direction"})
    found = diagnosed(offered, (catalogue["contact_direction"],), {"G_yz_ratio": 0.6}, 13, coarse)
    assert found.verdict == "unlike anything"
    assert found.set == ()


@pytest.mark.slow
def test_a_mass_that_no_effect_of_the_catalogue_is_gets_no_name_and_shows_where_it_sits(candidates):
    """It moves with the stack at the shaker."""
    moving, mass = model.catalogue()["stinger_mass"], 0.05
    test = blind_test(SPECIFICATION, 15, (moving,), {moving.parameters[0].name: mass})
    tested = simulated(test)[:2]
    found = conclude(candidates, assemble_evidence(candidates, tested))
    assert found.set == ()
    point = found.point_change
    assert point.kind == "mass"
    assert 0.2 * mass < point.size < 2.0 * mass
    points = dict(zip(tested[0][2].geometry.node, tested[0][2].geometry.coordinate, strict=True))
    shaker = points[tested[0][2].input.node[0]]
    assert np.linalg.norm(points[point.node] - shaker) < 0.03


def test_a_rough_model_about_a_fit_tells_of_changes_as_the_full_one_does(lean):
    """About the fit it is the full one; what an effect changes of frequencies it has to a thousandth."""
    evidence = lean.alone
    (parameter,) = evidence.parameters(["contact_direction"])
    about, there = evidence.start, np.array([-0.5])
    rough = rough_about(evidence, about)
    here = [residual(own, about) for own in (evidence, rough)]
    assert np.abs(residual(evidence.rough, about).rotated - here[0].rotated).max() > 1e-6
    assert here[1].rotated == pytest.approx(here[0].rotated, abs=1e-9)
    assert here[1].frequency_error == pytest.approx(here[0].frequency_error, rel=1e-9)
    changed = [
        residual(own, about, [parameter], there).log_frequency - at.log_frequency
        for own, at in zip((evidence, rough), here, strict=True)
    ]
    assert np.abs(changed[1] - changed[0]).max() < 1e-3 * np.abs(changed[0]).max()


@pytest.mark.slow
def test_what_the_mesh_is_off_by_is_taken_out(candidates):
    """Data without noise, of a mesh 5/3 times finer, hold three quarters of the fit's error, which is extrapolated."""
    test = replace(blind_test(SPECIFICATION, 14, (), {}), spread={})
    still = ModalNoise(frequency=1e-7, damping=1e-7, shape=1e-7)
    exact = [drawn for drawn, _ in simulate_modes(test, still).values()]
    evidence = assemble_evidence(
        candidates, [(c.name, c.pressure, m) for c, m in zip(test.configurations, exact, strict=True)][:2]
    )
    truth = np.zeros(len(evidence.nuisances))
    contact = evidence.stack.contact
    truth[:2] = (
        np.log(test.configurations[0].G_f / contact.G_f),
        np.log(test.configurations[0].d_f / contact.d_f),
    )
    nothing = tuple(replace(s, mesh=0.0 * s.mesh, mesh_shape=0.0 * s.mesh_shape) for s in evidence.shift)
    corrected, plain = (compared(own, truth) for own in (evidence, replace(evidence, shift=nothing)))
    lengths = (lambda found: found[0]), (lambda found: np.linalg.norm(found[1], axis=1))
    for own, bound, left in zip(
        lengths, (6e-5, 1e-3), (0.5, 0.7), strict=True
    ):  # the basis leaves of shapes as much
        assert np.linalg.norm(own(corrected)) < left * np.linalg.norm(own(plain))
        assert np.abs(own(corrected)).max() < bound < np.abs(own(plain)).max()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["length", "width", "height"])
def test_a_dimension_that_is_slightly_off_is_met_by_its_influence(candidates, name):
    """The influence is a Rayleigh quotient of the nominal stack's modes; the data are those of another stack."""
    test = blind_test(SPECIFICATION, 14, (), {})
    test = replace(test, spread={}, configurations=test.configurations[:1])
    still = ModalNoise(frequency=1e-7, damping=1e-7, shape=1e-7)

    def left(ratio, known):
        stack = replace(test.stack, **{name: ratio * getattr(test.stack, name)})
        drawn = simulate_modes(replace(test, stack=stack), still)
        tested = [
            (c.name, c.pressure, m) for c, (m, _) in zip(test.configurations, drawn.values(), strict=True)
        ]
        evidence = assemble_evidence(candidates, tested)
        at = np.zeros(len(evidence.nuisances))
        at[evidence.nuisances.index(name)] = np.log(known)
        return residual(evidence, at).log_frequency

    reference, change = left(1.0, 1.0), 1.004
    moved = left(change, 1.0) - reference
    assert np.abs(moved).max() > 5e-4
    assert np.linalg.norm(left(change, change) - reference) < 0.07 * np.linalg.norm(moved)


def as_they_are(evidence, nuisance):
    """Return what is left with all rows as they are, not rotated."""
    n = evidence.rows.kind.size
    block = Block(row=np.arange(n), rotation=np.eye(n), growth=np.zeros(n), log_noise=0.0)
    return residual(replace(evidence, covariance=Discrepancy(blocks=(block,))), nuisance)


def compared(evidence, nuisance):
    """Return logarithms of measured over modelled frequencies, and what all shapes differ by, (n_shape, n_dof)."""
    found = as_they_are(evidence, nuisance)
    return found.log_frequency, np.stack([found.rotated[row] for row in evidence.rows.shape.values()])


def test_the_sign_of_a_solver_does_not_change_what_is_left(lean):
    """Effects are chosen by what they change beside what others left, each solved on its own."""
    turned = replace(
        lean,
        observed=tuple(replace(o, reduced_rows=-o.reduced_rows) for o in lean.observed),
        place_slope=tuple(-slope for slope in lean.place_slope),
    )
    one, other = residual(lean, lean.start), residual(turned, lean.start)
    np.testing.assert_array_equal(other.value, one.value)
    np.testing.assert_array_equal(other.jacobian, one.jacobian)


@pytest.mark.parametrize("name", ["G_f", "density", "gain[sensor 2]"])
def test_what_is_left_has_right_derivatives(lean, name):
    """Shapes at unit length too: a denser stack moves less in each mode, which is no other shape."""
    i, step = lean.nuisances.index(name), 1e-3 * np.eye(len(lean.nuisances))
    ahead, behind = (as_they_are(lean, lean.start + s * step[i]).rotated for s in (1.0, -1.0))
    found = as_they_are(lean, lean.start)
    for kind in ("frequency", "damping", "shape"):
        of = lean.rows.kind == kind
        slope, column = ((ahead - behind) / 2e-3)[of], found.rotated_jacobian[of, i]
        np.testing.assert_allclose(slope, column, atol=5e-3 * np.abs(found.rotated_jacobian[:, i]).max())


def test_a_shape_that_is_stated_uncertain_counts_less(quick, bare):
    name, pressure, modes = bare[0]
    length = np.linalg.norm(modes.shape, axis=0)

    def misfit(share):
        own = np.where(np.arange(length.size) == 2, share, 0.01)
        spread = np.ones(modes.shape.shape) / np.sqrt(len(modes.shape)) * length * own
        off = modes.shape + 3.0 * spread * np.random.default_rng(1).choice([-1.0, 1.0], spread.shape)
        shape = np.where(np.arange(length.size) == 2, off, modes.shape)
        tested = [(name, pressure, replace(modes, shape=shape, shape_std=spread))]
        evidence = assemble_evidence(quick, tested, scatter=DiagnosisScatter(point_place=1e-5))
        evidence = replace(evidence, sensor_scatter=(np.full(length.size, 1e-3),))
        evidence = replace(evidence, covariance=covariance_of(evidence, evidence.start))
        found = residual(evidence, evidence.start)
        return np.sum(found.value[found.kind == "shape"] ** 2)

    far = 0.02
    assert misfit(far) == pytest.approx(misfit(2.0 * far), rel=0.25)  # each three standard deviations off


def test_sensors_scatter_as_much_as_their_shapes_show(quick, bare):
    """What every sensor reads too high or too low is neither a mode of the stack nor its rigid-body motion."""
    name, pressure, modes = bare[0]
    gain = np.random.default_rng(0).standard_normal((len(modes.shape), 1))

    def shown(share, **stated):
        tested = [(name, pressure, replace(modes, shape=(1.0 + share * gain) * modes.shape))]
        evidence = assemble_evidence(quick, tested, scatter=DiagnosisScatter(**stated))
        return evidence.point_place, np.median(evidence.sensor_scatter[0])

    assert shown(0.0)[1] < 0.003
    assert 0.01 <= shown(0.02)[1] <= 0.02
    assert shown(0.02, point_place=3e-4)[0] == 3e-4


@pytest.mark.slow
@pytest.mark.parametrize("seed", [31, 32])
@pytest.mark.parametrize("each", ["one of two sensors", "every point"])
def test_sensors_that_read_one_per_cent_too_high_are_no_missing_effect(candidates, catalogue, seed, each):
    test = blind_test(SPECIFICATION, seed, (catalogue["contact_direction"],), {"G_yz_ratio": 0.8})

    def read(modes):
        place = np.arange(len(modes.shape))
        every = np.random.default_rng(seed).standard_normal(place.size)
        gain = place % 2 if each == "one of two sensors" else every
        return replace(modes, shape=(1.0 + 0.01 * gain[:, None]) * modes.shape)

    tested = [(name, pressure, read(modes)) for name, pressure, modes in simulated(test)[:2]]
    found = conclude(candidates, assemble_evidence(candidates, tested))
    assert found.verdict == "identified"
    assert found.set == (("contact_direction",),)
    if each == "one of two sensors":
        (gain,) = found.sensor_gains
        assert gain.excess == pytest.approx(0.01, abs=3.0 * gain.std)
        assert gain.std < 0.0015


@pytest.mark.blind
def test_an_effect_that_brings_unseen_modes_below_the_measured_ones_is_still_named():
    """Strong enough, clamps that pitch add modes that the sensors miss; the last measured one is then the 22nd."""
    (effect,) = model.find_effects(["clamp_pitch_inertia"], model.catalogue())
    candidates = candidates_of(SPECIFICATION, {effect.name: effect})
    found = diagnosed(candidates, (effect,), {"clamp_pitch": 0.0051}, 51031)
    assert found.verdict == "identified"
    assert found.set == (("clamp_pitch_inertia",),)


@pytest.mark.slow
def test_an_effect_that_does_nothing_is_no_evidence(candidates, catalogue):
    test = blind_test(SPECIFICATION, 12, (catalogue["contact_direction"],), {"G_yz_ratio": 0.8})
    evidence = assemble_evidence(candidates, simulated(test)[:2])
    one = ("contact_direction",)
    _, found, _ = searched(candidates, evidence, [one, (*one, "clamp_rods")])
    single, both = found.fitted[frozenset(one)], found.fitted[frozenset((*one, "clamp_rods"))]
    assert both.log_evidence == pytest.approx(single.log_evidence, abs=0.3)
