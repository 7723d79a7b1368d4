"""Slip in the diagnosis on levels that an independent model made: part of `make blind`, resumable."""

import numpy as np
import pytest

from model.contact.contact import SlipLaw
from tests.independent import slipping_modes
from tests.independent.slipping_campaign import sliders
from tests.studies.slipping import SlippingCase, figures, median_factor, planned, study_of

OUT = "out/blind/slipping.jsonl"
NUMBER = 100


def case(**given):
    made = {
        "seed": 1, "slips": True, "moved": 9.0, "truth": (0.05, -0.5), "verdict": "identified",
        "named": (("contact_slip",),), "found": ((0.06, 0.03, 0.09), (-0.2, -0.3, -0.1)), "limit": 1.2,
        "error": (0.01, 0.002),
    }  # fmt: skip
    return SlippingCase(**(made | given))


def linear(**given):
    return case(**({"slips": False, "moved": 0.0, "named": (), "verdict": "nothing missing"} | given))


def share(name, cases):
    return next((one.hits, one.total) for one in figures(cases) if one.name.startswith(name))


def test_a_linear_stack_that_is_called_slipping_is_counted():
    cases = [case(), linear(), linear(named=(("clamp_mass",), ("contact_slip",)), verdict="one of")]
    assert share("linear stacks called slipping", cases) == (1, 2)


def test_slip_that_hardly_moves_a_frequency_need_not_be_named():
    cases = [case(), case(named=(), verdict="nothing missing"), case(moved=2.0, named=())]
    assert share("slip moves a frequency", cases) == (1, 2)


def test_intervals_and_the_slip_limit_are_held_to_the_truth():
    assert case().covered == (True, False)
    assert share("slip limit within 15 %", [case(), case(limit=1.1)]) == (1, 2)
    assert median_factor([case(limit=0.5), case(limit=2.0), linear(limit=float("nan"))]) == pytest.approx(2.0)


def test_the_sliders_of_the_other_model_are_of_the_same_law():
    """What they leave of the stress at first loading, beside Segalman's curve in closed form."""
    law, G_f = SlipLaw(friction=0.6, exponent=-0.4), 1480.0
    limit, stiffness = sliders(G_f, 0.6, -0.4, 1e-5, 32)
    strain = law.sliding_strain(G_f) * np.geomspace(1e-3, 2.0, 12)
    carried = np.minimum(strain[:, None], limit) @ stiffness
    expected = law.sliding_strain(G_f) * law.stress(strain / law.sliding_strain(G_f))
    np.testing.assert_allclose(carried, expected, rtol=0.01)


@pytest.mark.slow
def test_more_points_of_the_contact_move_the_modes_no_further(monkeypatch):
    """Frequencies fall by 1 to 2 % from 0.3 to 4 N; with eight points along x one falls by a quarter of its 1 %."""

    def drop(points):
        monkeypatch.setattr(slipping_modes, "POINTS", points)
        first, _, last = slipping_modes.slipping_test(900_100, slips=True).level
        return last.frequency / first.frequency - 1.0

    np.testing.assert_allclose(drop(slipping_modes.POINTS), drop((40, 5, 12)), atol=3e-4)


@pytest.mark.blind
def test_slipping_and_linear_stacks(capsys, request):
    """Every figure is printed; of linear stacks called slipping no more are left than chance explains."""
    with capsys.disabled():
        cases = study_of(planned(NUMBER), request.config.rootpath / OUT)
        print("\n".join(one.row for one in figures(cases)))
        print(f"median factor by which the slip limit is off: {median_factor(cases):.2f}")
    hits, total = share("linear stacks called slipping", cases)
    assert hits <= 0.1 * total
