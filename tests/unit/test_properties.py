"""What must hold whatever the numbers are: readers, units, signs, reciprocity, rigid bodies, numbering of points."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import model
from ema import FRF, Dofs, Geometry, mac
from ema.campaign.campaign_file import ConfigurationSection
from ema.io.measured_function import parse_unit
from ema.io.table import TableLayout, read_points, read_table
from ema.io.uff import read_uff_functions, read_uff_geometry, write_uff

QUICK = settings(max_examples=25, deadline=None, database=None, derandomize=True)
LONG = settings(max_examples=1000, deadline=None)
DEPTHS = [pytest.param(QUICK, id="quick"), pytest.param(LONG, id="long", marks=pytest.mark.slow)]
NUMBER = st.floats(-1e6, 1e6, allow_subnormal=False).map(lambda x: float(f"{x:.9g}"))
SEED = st.integers(0, 2**32 - 1)


def numbers(seed, *shape):
    rng = np.random.default_rng(seed)
    return rng.standard_normal(shape) + 1j * rng.standard_normal(shape)


@pytest.fixture
def file():
    """A path for one file; a folder of its own for each example would cost more than the reading."""
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder) / "file"


@pytest.mark.parametrize("depth", DEPTHS)
def test_a_table_holds_what_was_written(file, depth):
    @depth
    @given(
        st.lists(st.tuples(NUMBER, NUMBER), min_size=2, max_size=20),
        st.sampled_from([("comma", ",", "."), ("semicolon", ";", ","), ("tab", "\t", ","), ("space", " ", ".")]),
        st.integers(0, 3),
    )
    def holds(values, form, header):
        name, delimiter, decimal = form
        rows = [delimiter.join(f"{x!r}".replace(".", decimal) for x in (float(k), *v)) for k, v in enumerate(values)]
        file.write_text("\n".join(["head"] * header + rows))
        layout = TableLayout(layout="real-imaginary", delimiter=name, decimal=decimal, header_rows=header)
        (found,) = read_table(file, layout, parse_unit("m/N"))
        np.testing.assert_array_equal(found.value, [complex(*v) for v in values])

    holds()


@pytest.mark.parametrize("depth", DEPTHS)
def test_a_universal_file_holds_what_was_written(file, depth):
    @settings(depth, max_examples=depth.max_examples // 5)
    @given(SEED, st.integers(1, 5), st.integers(2, 30), st.floats(1e-3, 1e3), st.floats(-8, 8))
    def holds(seed, n_point, n_line, step, magnitude):
        value = 10.0**magnitude * numbers(seed, n_point, 1, n_line)
        node = np.random.default_rng(seed).permutation(1000)[:n_point] + 1
        points = Geometry(node=node, coordinate=numbers(seed, n_point, 3).real, line=np.empty((0, 2), int))
        frf = FRF(
            frequency=step * np.arange(1, n_line + 1), value=value, quantity="mobility", source=("a",) * n_point,
            output=Dofs(node=node, direction=np.tile([0.0, 0.0, -1.0], (n_point, 1))),
            input=Dofs(node=node[:1], direction=[[1.0, 0.0, 0.0]]), run=np.zeros(n_point, int),
        )  # fmt: skip
        write_uff(file, points, frf)
        found = [each for each in read_uff_functions(file)[0] if each.kind == "frf"]
        np.testing.assert_allclose([each.value for each in found], value[:, 0], rtol=1e-6)
        assert [each.output for each in found] == [(n, -3) for n in node]
        assert {each.quantity for each in found} == {"mobility"}
        geometry, _ = read_uff_geometry(file)
        order = [list(geometry.node).index(n) for n in node]
        np.testing.assert_allclose(geometry.coordinate[order], points.coordinate, atol=1e-5)

    holds()


@pytest.mark.parametrize("depth", DEPTHS)
def test_points_hold_what_was_written_whatever_their_order(file, depth):
    @depth
    @given(st.dictionaries(st.integers(1, 10**6), st.tuples(NUMBER, NUMBER, NUMBER), min_size=1, max_size=20))
    def holds(points):
        file.write_text("node,x,y,z\n" + "\n".join(f"{n},{x!r},{y!r},{z!r}" for n, (x, y, z) in points.items()))
        found = read_points(file, parse_unit("mm"))
        assert set(found.node) == set(points)
        for node, place in zip(found.node, found.coordinate, strict=True):
            np.testing.assert_allclose(place, 1e-3 * np.array(points[int(node)]), rtol=1e-12)

    holds()


LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
FORCES = {"N": 1.0, "kN": 1e3, "lbf": 4.4482216152605}


@pytest.mark.parametrize("force", FORCES)
@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize(("over", "quantity"), [("", "receptance"), ("/s", "mobility"), ("/s2", "accelerance")])
def test_a_unit_is_the_product_of_its_parts(length, force, over, quantity):
    found = parse_unit(f"({length}{over})/{force}")
    assert found.factor == pytest.approx(LENGTHS[length] / FORCES[force], rel=1e-9)
    assert found.frf == quantity


@pytest.mark.parametrize("depth", DEPTHS)
def test_a_degree_of_freedom_has_its_sign_axis_and_unit_length(depth):
    @depth
    @given(st.integers(0, 2**31 - 1), st.sampled_from("xyz"), st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3))
    def holds(node, axis, direction):
        written = [f"{node}+{axis}", f"{node}-{axis}"]
        plus, minus = ConfigurationSection(name="a", files=["b"], output=written).output
        assert plus.node == minus.node == node
        assert plus.direction == tuple(float(a == axis) for a in "xyz")
        np.testing.assert_array_equal(plus.direction, np.negative(minus.direction))
        if np.linalg.norm(direction) > 1e-3:
            table = {"node": node, "direction": direction}
            (one,) = ConfigurationSection(name="a", files=["b"], output=[table]).output
            np.testing.assert_allclose(one.direction, direction / np.linalg.norm(direction), atol=1e-12)

    holds()


@pytest.mark.parametrize("depth", DEPTHS)
def test_mac_knows_neither_scale_nor_phase_nor_numbering_nor_mirrored_axes(depth):
    @depth
    @given(SEED, st.integers(3, 20), st.integers(1, 3))
    def holds(seed, n_dof, n_mode):
        rng = np.random.default_rng(seed)
        a, b = numbers(seed, 2, n_dof, n_mode)
        factor, order = numbers(seed + 1, n_mode), rng.permutation(n_dof)
        mirrored = rng.choice([-1.0, 1.0], n_dof)[:, None]
        np.testing.assert_allclose(mac(a * factor, b), mac(a, b), atol=1e-12)
        np.testing.assert_allclose(mac((mirrored * a)[order], (mirrored * b)[order]), mac(a, b), atol=1e-12)
        np.testing.assert_allclose(mac(b, a), mac(a, b).T, atol=1e-12)
        np.testing.assert_allclose(np.diag(mac(a, a)), 1.0)

    holds()


STACK = model.Stack(
    name="small", length=0.3, width=0.08, height=0.065, n_lamina=8,
    material=model.Material(young=2e11, poisson=0.28, density=7650.0),
    contact=model.Contact(G_f=825.0, d_f=5e-11, pressure=320e3, normal_modulus=5e9),
    clamps=(model.Clamp(mass=2.0, x=0.05, y=0.01, distribution="faces", footprint=(0.04, 0.06)),),
    mesh=model.Mesh(n_x=4, n_y=2),
)  # fmt: skip


@pytest.fixture(scope="module")
def system():
    return model.reduce(STACK, n_snapshot=1)


def placed(x, y, top, sign=1.0):
    z = STACK.height / 2 * (1 if top else -1)
    return model.Observation(node=[1], location=[[x, y, z]], direction=[[0.0, 0.0, sign]])


ROUNDING = 1e-8  # of the highest peak; with one answer to the force alone 0.002 to 0.007 were seen
PLACE = st.tuples(st.floats(-0.149, 0.149), st.floats(-0.039, 0.039), st.booleans())


@pytest.mark.slow
def test_the_model_is_reciprocal_and_knows_signs(system):
    """Reciprocal to rounding, however coarse the basis, for it has the static answers to both ends."""
    line = np.linspace(20.0, 1500.0, 40)

    def response(output, force):
        return model.frf(system, G_f=825.0, d_f=5e-11, frequency=line, output=output, input=force)[0, 0]

    @settings(LONG, max_examples=12)
    @given(PLACE, PLACE)
    def holds(first, second):
        forth = response(placed(*first), placed(*second))
        scale = np.abs(forth).max()
        np.testing.assert_allclose(response(placed(*second), placed(*first)), forth, atol=ROUNDING * scale)
        np.testing.assert_allclose(response(placed(*first, -1.0), placed(*second)), -forth, atol=1e-12 * scale)
        power = response(placed(*first), placed(*first)) / (2j * np.pi * line)
        assert np.all(power.real >= -1e-12 * np.abs(power))  # a passive stack takes power at a driving point

    holds()


@pytest.mark.slow
def test_a_free_stack_has_six_rigid_body_motions_at_any_stiffness(system):
    @settings(LONG, max_examples=12)
    @given(st.floats(200.0, 6000.0))
    def holds(G_f):
        corner = placed(0.1, 0.0, top=True)
        modes = model.solve_modes(system, G_f=G_f, d_f=0.0, n_mode=8, observation=corner)
        assert modes.n_rigid == 6
        assert modes.frequency[5] < 1e-3 * modes.frequency[6]

    holds()
