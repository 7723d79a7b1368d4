import dataclasses
from pathlib import Path

import numpy as np
import pytest

import model
from model.contact.pressing import press
from model.elements.mesh import plan_of, triangles
from model.plot.plots import pressure_figure
from model.stack.outline import BoltHoles, Outline, Triangulation, ring, smallest_angle, stator
from model.stack.parts import Pressing, read_curve
from tests.full_matrices import lowest, lowest_modes

DATA = Path(__file__).parents[2] / "data"
CURVE = read_curve(DATA / "contact/compression_standin.csv")
STATOR = stator(
    outer=0.2,
    inner=0.11,
    slot=0.16,
    n_tooth=12,
    tooth_width=0.014,
    holes=BoltHoles(number=4, diameter=0.008, circle=0.182),
    n_side=32,
)
MATERIAL = model.Material(young=2e11, poisson=0.3, density=7850.0)
CONTACT = model.Contact(G_f=1000.0, d_f=5e-11, pressure=320e3, normal_modulus=1e9)


def stack(outline: Outline | None, n_lamina: int, n_x: int, **values) -> model.Stack:
    length, width = (0.3, 0.08) if outline is None else np.ptp(outline.bounds, axis=1)
    return model.Stack(
        name="outline",
        length=float(length),
        width=float(width),
        height=1e-3 * n_lamina,
        n_lamina=n_lamina,
        material=MATERIAL,
        contact=CONTACT,
        mesh=model.Mesh(n_x=n_x, n_y=4),
        outline=outline,
        **values,
    )


def frequencies(assembly: model.Assembly, n: int) -> np.ndarray:
    return lowest_modes(assembly, n, hertz=100.0)[0]


@pytest.mark.parametrize("size", [0.02, 0.01, 0.006])
def test_stator_is_meshed_along_its_whole_outline(size):
    mesh = STATOR.triangulated(size)
    assert mesh.area == pytest.approx(STATOR.area, rel=1e-9)
    assert smallest_angle(mesh.point, mesh.triangle).min() > 8.0
    assert STATOR.area == pytest.approx(np.pi / 4 * (0.2**2 - 0.16**2 - 4 * 0.008**2) + 12 * 0.014 * 0.025, rel=0.02)


def test_triangles_and_rectangles_give_the_same_stack():
    box = Outline(boundary=[(-0.15, -0.04), (0.15, -0.04), (0.15, 0.04), (-0.15, 0.04)])
    found, expected = (frequencies(model.assemble(stack(o, 4, n)), 14) for o, n in ((box, 12), (None, 12)))
    assert np.all(found[:6] < 0.05)
    np.testing.assert_allclose(found[6:], expected[6:], rtol=1e-3)


def test_ring_bends_in_its_plane_as_a_curved_beam():
    # Thin ring, in-plane mode of two waves: omega**2 = E I / (rho A R**4) n**2 (n**2-1)**2 / (n**2+1)
    # (Love, Theory of Elasticity, section 293); thickness over radius 0.04 leaves shear below 0.2 %
    outer, inner = 0.204, 0.196
    thin = ring(outer, inner, 96)
    sheet = stack(thin, 1, 50)
    assembly = model.assemble(sheet)
    n = 2 * assembly.plan.size("u")  # in-plane motion alone
    stiffness, mass = (assembly.matrix(m, assembly.theta)[:n, :n].tocsc() for m in ("K", "M"))
    found = lowest(stiffness, mass, 5, hertz=16.0)[0][3:]
    radius, depth = 0.1, (outer - inner) / 2
    exact = np.sqrt(2e11 * depth**2 / 12 / (7850 * radius**4) * 4 * 9 / 5) / (2 * np.pi)
    np.testing.assert_allclose(found, exact, rtol=5e-3)


def test_stator_repeats_itself_by_twelfths_and_floats_freely():
    whole = stator(outer=0.2, inner=0.11, slot=0.16, n_tooth=12, tooth_width=0.014, n_side=24)
    found = frequencies(model.assemble(stack(whole, 2, 8)), 12)
    assert np.all(found[:6] < 0.05)
    assert found[6] > 100.0
    assert found[7] == pytest.approx(found[6], rel=0.02)  # a pair of two waves, split by the mesh alone


def test_stator_is_pressed_by_its_clamps():
    clamps = tuple(
        model.Clamp(mass=0.0, x=0.088 * np.cos(a), y=0.088 * np.sin(a), footprint=(0.012, 0.012))
        for a in np.pi / 4 + np.pi / 2 * np.arange(4)
    )
    pressed = stack(STATOR, 6, 10, clamps=clamps, pressing=Pressing(curve=CURVE, plate_rigidity=5e4))
    field = press(pressed)
    assert field.residual[-1] <= 1e-8
    np.testing.assert_allclose(field.interface_force, 320e3 * STATOR.area, rtol=1e-6)
    figure = pressure_figure(field)
    assert "top interface" in figure.axes[2].get_title(loc="left") + figure.axes[3].get_title(loc="left")


def test_places_beside_the_outline_count_as_the_nearest_inside():
    plan = plan_of(stack(STATOR, 1, 10))
    points = np.array([[0.12, 0.0], [0.0, 0.0], [0.085, 0.001]])
    found = plan.nearest(points)
    assert found[0] == pytest.approx([0.1, 0.0], abs=1.5e-3)
    assert np.linalg.norm(found[1]) == pytest.approx(0.055, rel=0.02)
    np.testing.assert_allclose(found[2], points[2], atol=1e-12)
    for field in ("u", "w"):
        linear = plan.interpolate(field, (1.0, 2.0, 3.0))
        np.testing.assert_allclose(plan.point_rows(field, points) @ linear, 1 + found @ [2.0, 3.0], atol=1e-6)


def test_mesh_file_gives_the_same_sheet(tmp_path):
    pv = pytest.importorskip("pyvista")
    mesh = STATOR.triangulated(0.02)
    solid = pv.PolyData.from_regular_faces(
        np.column_stack([mesh.point * 1e3 + 50.0, 0 * mesh.point[:, 0]]), mesh.triangle
    )
    solid.save(tmp_path / "sheet.vtk")
    text = (DATA / "stator/stack.toml").read_text().replace("../contact", f"{DATA}/contact").split("[outline]")
    rest = text[1][text[1].index("\n[") :]
    path = tmp_path / "stack.toml"
    path.write_text(text[0] + '[outline]\nkind = "mesh"\nfile = "sheet.vtk"\n' + rest)
    read = model.read_stack(path)
    assert isinstance(read.outline, Triangulation)
    assert read.area == pytest.approx(mesh.area, rel=1e-5)
    assert triangles(read.outline).area == pytest.approx(mesh.area, rel=1e-5)


def test_shipped_stator_is_valid():
    shipped = model.read_stack(DATA / "stator/stack.toml")
    assert shipped.n_lamina == 240
    assert shipped.mass == pytest.approx(shipped.outline.area * 0.065 * 7650.0, rel=1e-9)
    field = press(shipped)  # all 240 laminas under plates a million times as stiff: no rounding in the way
    assert field.residual[-1] <= 1e-8
    np.testing.assert_allclose(field.interface_force, 320e3 * shipped.outline.area, rtol=1e-6)


HOLED = {"outer": 0.2, "inner": 0.1, "slot": 0.16, "n_tooth": 6, "tooth_width": 0.01}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ring(0.1, 0.2, 32), "must lie between 0 and the outer one"),
        (lambda: ring(float("inf"), 0.2, 32), "and that below 1000 m"),
        (lambda: Outline(boundary=[(0, 0), (1e300, 0), (0, 1)]), "not within 1000 m"),
        (lambda: stator(outer=0.2, inner=0.11, slot=0.16, n_tooth=40, tooth_width=0.014), "40 teeth of 0.014 m"),
        (lambda: stator(**HOLED, holes=BoltHoles(number=2, diameter=0.02, circle=0.18)), "do not fit into the yoke"),
        (lambda: stator(outer=0.2, inner=0.0, slot=0.16, n_tooth=4, tooth_width=0.014), r"0 < inner \(0\)"),
        (lambda: stator(**HOLED, holes=BoltHoles(number=60, diameter=0.01, circle=0.18)), "do not fit into the yoke"),
        (lambda: model.Mesh(n_x=2_000_000), "n_x and n_y must be at most 1000, got 2000000"),
        (lambda: Outline(boundary=[(0, 0), (1, 0)]), "2 corners"),
        (lambda: Outline(boundary=[(0, 0), (1, 0), (0, 1)], holes=([(2, 2), (3, 2), (2, 3)],)), "reaches outside"),
        (lambda: Triangulation(point=[(0, 0), (1, 0), (0.5, 1e-3)], triangle=[(0, 1, 2)]), "degrees; at least 5"),
        (lambda: dataclasses.replace(stack(STATOR, 2, 8), length=0.3), "must fill a box of 0.3 by"),
    ],
)
def test_impossible_outlines_are_refused(make, message):
    with pytest.raises(model.StackError, match=message):
        make()
