import dataclasses
from pathlib import Path

import numpy as np
import pytest
import scipy.integrate as integrate

import model
from model.contact.pressing import press
from model.stack.parts import CompressionCurve, Interlayer, Pressing, read_curve

CURVE = read_curve(Path(__file__).parents[2] / "data/contact/compression_standin.csv")
STEEL_PLATE = 2e11 * 0.02**3 / 12 / 0.91  # N m, 20 mm thick
STACK = model.Stack(
    name="pressed",
    length=0.4,
    width=0.06,
    height=0.064,
    n_lamina=40,
    material=model.Material(young=2e11, poisson=0.28, density=7650.0),
    contact=model.Contact(G_f=1000.0, d_f=5e-11, pressure=320e3, normal_modulus=1e9),
    clamps=(
        model.Clamp(mass=2.0, x=-0.1, y=0.0, footprint=(0.04, 0.05)),
        model.Clamp(mass=2.0, x=0.1, y=0.0, footprint=(0.04, 0.05)),
    ),
    mesh=model.Mesh(n_x=12, n_y=3),
    pressing=Pressing(curve=CURVE, plate_rigidity=STEEL_PLATE),
)


def test_rigid_plates_press_evenly_as_the_closed_form_says():
    field = press(dataclasses.replace(STACK, pressing=Pressing(curve=CURVE)))
    np.testing.assert_allclose(field.pressure, 320e3, rtol=1e-8)
    height = field.plan.point_rows("w", np.array([[0.11, 0.02]])) @ field.deflection.T
    shortening = float(height[0, 0] - height[0, -1])
    assert shortening == pytest.approx(39 * STACK.pitch * CURVE.strain_at(320e3), rel=1e-8)


def test_a_footprint_over_the_whole_plan_presses_evenly_through_any_plate():
    clamp = model.Clamp(mass=1.0, x=0.0, y=0.0, footprint=(0.4, 0.06))
    field = press(dataclasses.replace(STACK, clamps=(clamp,)))
    np.testing.assert_allclose(field.pressure, 320e3, rtol=1e-6)


def test_every_interface_carries_the_clamps_force_and_moment():
    clamps = tuple(dataclasses.replace(c, share=s) for c, s in zip(STACK.clamps, (1.0, 2.0), strict=True))
    field = press(dataclasses.replace(STACK, clamps=clamps))
    assert field.residual[-1] <= 1e-8
    force = 320e3 * 0.4 * 0.06
    assert field.force == pytest.approx(force, rel=1e-12)
    np.testing.assert_allclose(field.interface_force, force, rtol=1e-6)
    x = field.plan.quadrature_points[0]
    moment = np.sum(field.pressure * x * field.plan.membrane.dx, axis=(1, 2))
    np.testing.assert_allclose(moment, force * (0.1 * 2.0 - 0.1) / 3.0, rtol=1e-6)
    assert field.pressure.min() >= 0.0
    assert field.pressure.max() > 1.2 * 320e3


def test_contact_is_lost_where_thin_plates_lift_and_lags_no_force():
    field = press(dataclasses.replace(STACK, pressing=Pressing(curve=CURVE, plate_rigidity=2000.0)))
    assert field.lost_contact.max() > 0.2
    assert field.pressure.min() == 0.0
    np.testing.assert_allclose(field.interface_force, field.force, rtol=1e-6)


def test_two_laminas_are_a_beam_on_a_nonlinear_foundation():
    # One interface, no Poisson's effect, load over the whole width: D w'''' = q(x) - p(2 w / pitch), integrated
    # as a boundary value problem over half the length, in two pieces joined at the footprint's edge.
    width, half, foot, t = 0.02, 0.1, 0.02, 4e-3
    pair = model.Stack(
        name="pair",
        length=2 * half,
        width=width,
        height=2 * t,
        n_lamina=2,
        material=model.Material(young=2e11, poisson=0.0, density=7650.0),
        contact=STACK.contact,
        clamps=(model.Clamp(mass=0.0, x=0.0, y=0.0, footprint=(2 * foot, width)),),
        mesh=model.Mesh(n_x=40, n_y=1),
        pressing=Pressing(curve=CURVE, plate_rigidity=1e-6),
    )
    field = press(pair)
    rigidity, load = 2e11 * t**3 / 12, 320e3 * half / foot

    def rates(s, y):
        rows = []
        for part, length, q in ((y[:4], foot, load), (y[4:], half - foot, 0.0)):
            pressure = CURVE.evaluate(2.0 * part[0] / t)[0]
            rows += [length * part[1], length * part[2], length * part[3], length * (q - pressure) / rigidity]
        return np.array(rows)

    def ends(a, b):
        return np.array([a[1], a[3], *(b[:4] - a[4:]), b[6], b[7]])

    s = np.linspace(0.0, 1.0, 100)
    start = np.zeros((8, 100))
    start[[0, 4]] = CURVE.strain_at(320e3) * t / 2.0
    exact = integrate.solve_bvp(rates, ends, s, start, tol=1e-6, max_nodes=20000)
    assert exact.success
    for column, x0, length in ((0, 0.0, foot), (4, foot, half - foot)):
        x = x0 + length * s[::9]
        expected = CURVE.evaluate(2.0 * exact.sol(s[::9])[column] / t)[0]
        found = field.at(np.column_stack([x, np.zeros_like(x)]))[0][0]
        np.testing.assert_allclose(found, expected, atol=1e-3 * expected.max())
    assert expected.min() == 0.0  # the beam lifts off at its end, so the test reaches lost contact


def test_a_soft_layer_is_compressed_by_its_own_law():
    layer = Interlayer(below=10, thickness=2e-3, shear_modulus=1e6, normal_modulus=5e7, density=1200.0)
    stack = dataclasses.replace(STACK, interlayers=(layer,), height=0.066, pressing=Pressing(curve=CURVE))
    field = press(stack)
    closing = -np.diff(field.plan.point_rows("w", np.array([[0.0, 0.0]])) @ field.deflection.T)[0]
    assert closing[9] == pytest.approx(320e3 / 5e7 * 2e-3, rel=1e-7)
    assert closing[8] == pytest.approx(CURVE.strain_at(320e3) * 0.064 / 40, rel=1e-7)


def test_what_cannot_be_pressed_is_refused():
    with pytest.raises(model.StackError, match="says nothing about how it is pressed"):
        press(dataclasses.replace(STACK, pressing=None))
    with pytest.raises(model.StackError, match="one clamp"):
        press(dataclasses.replace(STACK, clamps=()))
    short = CompressionCurve(strain=[0.0, 4e-4, 8e-4], pressure=[0.0, 1.5e5, 3.3e5])
    with pytest.raises(model.StackError, match=r"pressure reaches .* ends at 330 kPa"):
        press(dataclasses.replace(STACK, pressing=Pressing(curve=short, plate_rigidity=STEEL_PLATE)))
