"""Synthesis from a modal model, scaling by the driving point, and the runs' table."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ema.identification.identify import identify_frf
from ema.types.errors import IdentificationError
from ema.types.frf import FRF, Dofs, Geometry
from ema.types.modal_model import ModalModel, synthesize

F = np.arange(1.0, 401.0, 0.5)
POLE = 2 * np.pi * np.array([60.0, 200.0]) * (-0.02 + 1j)
PHI = np.array([[1.0, 1.0], [0.3, -0.8], [-0.9, 0.7], [0.2, 0.4]])
Z = np.tile([0.0, 0.0, 1.0], (4, 1))


def value(drives: list[int], pole: NDArray = POLE) -> NDArray:
    s = 2j * np.pi * F
    residue = np.einsum("or,ir->oir", PHI, PHI[drives]) / (2j * POLE.imag)
    return s**2 * (residue @ (1 / (s - pole[:, None])) + residue.conj() @ (1 / (s - pole.conj()[:, None])))


def identified(
    functions: NDArray, drives: list[int], input_direction: NDArray | None = None, run: tuple[int, ...] = (0,) * 4
) -> ModalModel:
    node = np.arange(1, 5)
    frf = FRF(
        frequency=F,
        value=functions,
        quantity="accelerance",
        output=Dofs(node=node, direction=Z),
        input=Dofs(node=node[drives], direction=Z[drives] if input_direction is None else input_direction),
        run=run,
        source=("generated",) * 4,
    )
    geometry = Geometry(node=node, coordinate=np.outer(node, [0.1, 0.0, 0.0]), line=np.zeros((0, 2)))
    return identify_frf(frf, geometry, name="small", order=20)


def test_synthesis_returns_the_functions_in_every_quantity() -> None:
    model = identified(value([0]), [0])
    s = 2j * np.pi * F
    accelerance = value([0])
    for quantity, power in (("receptance", -2), ("mobility", -1), ("accelerance", 0)):
        expected = accelerance * s**power
        got = synthesize(model, F, quantity)  # type: ignore[arg-type]
        np.testing.assert_allclose(got, expected, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(model.correlation, 1.0)
    assert np.all(model.error < 1e-6)


def test_accelerance_exists_at_zero_and_receptance_does_not() -> None:
    model = identified(value([0]), [0])
    assert np.all(np.isfinite(synthesize(model, np.array([0.0]), "accelerance")))
    with pytest.raises(IdentificationError, match="receptance has no value at 0 Hz"):
        synthesize(model, np.array([0.0, 1.0]), "receptance")


@pytest.mark.parametrize("drives", [[0], [2], [0, 2]])
def test_driving_point_gives_mass_normalised_shapes(drives: list[int]) -> None:
    model = identified(value(drives), drives)
    assert model.scaled.all()
    sign = np.sign(np.sum(model.shape.real * PHI, axis=0))
    np.testing.assert_allclose(model.shape * sign, PHI, atol=1e-5)


def test_a_force_against_the_response_direction_still_scales() -> None:
    model = identified(-value([0]), [0], -Z[:1])
    assert model.scaled.all()
    sign = np.sign(np.sum(model.shape.real * PHI, axis=0))
    np.testing.assert_allclose(model.shape * sign, PHI, atol=1e-5)


def test_a_sign_reversed_driving_point_is_refused_for_scaling() -> None:
    model = identified(-value([0]), [0])
    assert not model.scaled.any()
    assert np.all(np.isfinite(model.shape))
    np.testing.assert_allclose(np.abs(model.shape).max(axis=0), 1.0)


def test_a_driving_point_that_holds_no_signal_of_one_mode_leaves_the_other_its_scale() -> None:
    constant = PHI * PHI[0]
    constant[0, 1] = 0.0  # a nodal line of mode 2 goes through the driving point
    residue, s = constant[:, None] / (2j * POLE.imag), 2j * np.pi * F
    functions = s**2 * (residue @ (1 / (s - POLE[:, None])) + residue.conj() @ (1 / (s - POLE.conj()[:, None])))
    rng = np.random.default_rng(3)
    functions = functions + 1e-3 * np.abs(functions).max() * rng.standard_normal(functions.shape)
    model = identified(functions, [0])
    np.testing.assert_array_equal(model.scaled, [True, False])
    np.testing.assert_allclose(np.abs(model.shape[:, 0]), np.abs(PHI[:, 0]), rtol=0.02)
    assert np.abs(model.shape[:, 1]).max() == pytest.approx(1.0)


def test_an_input_at_no_measured_point_leaves_unit_shapes() -> None:
    node = np.arange(1, 5)
    frf = FRF(
        frequency=F,
        value=value([0]),
        quantity="accelerance",
        output=Dofs(node=node, direction=Z),
        input=Dofs(node=[45], direction=Z[:1]),
        run=[0] * 4,
        source=("generated",) * 4,
    )
    geometry = Geometry(node=node, coordinate=np.outer(node, [0.1, 0.0, 0.0]), line=np.zeros((0, 2)))
    model = identify_frf(frf, geometry, name="small", order=20)
    assert not model.scaled.any()
    np.testing.assert_allclose(np.abs(model.shape).max(axis=0), 1.0)


def test_a_shifted_run_is_named_and_its_poles_are_kept() -> None:
    functions = value([0])
    functions[2:] = value([0], POLE * 0.997)[2:]
    functions = np.concatenate([functions] * 3)
    rng = np.random.default_rng(0)
    functions[6:] = np.concatenate([value([0])] * 2)[:6]
    scale = 1e-3 * np.sqrt(np.mean(np.abs(functions) ** 2, axis=-1, keepdims=True))
    functions = functions + scale * (rng.standard_normal(functions.shape) + 1j * rng.standard_normal(functions.shape))
    node = np.arange(1, 13)
    frf = FRF(
        frequency=F,
        value=functions,
        quantity="accelerance",
        output=Dofs(node=node, direction=np.tile(Z, (3, 1))),
        input=Dofs(node=[1], direction=Z[:1]),
        run=np.array([0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5]),
        source=("generated",) * 12,
    )
    geometry = Geometry(node=node, coordinate=np.outer(node, [0.1, 0.0, 0.0]), line=np.zeros((0, 2)))
    model = identify_frf(frf, geometry, name="roving", order=20)
    np.testing.assert_array_equal(np.flatnonzero(model.disagreeing_runs().any(axis=1)), [1])
    np.testing.assert_allclose(model.run_frequency[1] / model.frequency, 0.997, atol=2e-4)
    # The shape joins the shifted run at its own poles: in phase with the others.
    expected = PHI[[0, 1, 2, 3, 0, 1] * 2]
    scale = np.sum(model.shape * expected, axis=0) / np.sum(expected**2, axis=0)
    np.testing.assert_allclose(model.shape / scale, expected, atol=5e-3)
    np.testing.assert_allclose(model.frequency, np.abs(POLE) / (2 * np.pi), rtol=1e-4)


def test_wrong_array_lengths_are_named() -> None:
    model = identified(value([0]), [0])
    fields = {name: getattr(model, name) for name in model.__dataclass_fields__}
    with pytest.raises(ValueError, match=r"ModalModel.damping: expected shape \(2,?\), got \(3,?\)"):
        ModalModel(**fields | {"damping": np.zeros(3)})
