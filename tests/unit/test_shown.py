"""Results show themselves in a notebook: their table, their figure, and a shape that turns."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import ema
import model
import updating
from lamella_shared import figure_of, html_of, html_table
from updating.diagnosis.answer import Diagnosis, Ranked
from updating.report.files import diagnosis_figure, diagnosis_html, fit_figure, fit_html

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def bar():
    """A modal model of three points on a line, two modes."""
    f = np.arange(1.0, 401.0)
    pole = 2 * np.pi * np.array([60.0, 200.0]) * (-0.02 + 1j)
    phi = np.array([[1.0, 1.0], [0.3, -0.8], [-0.9, 0.7]])
    s = 2j * np.pi * f
    residue = phi * phi[0] / (2j * pole.imag)
    value = s**2 * (residue @ (1 / (s - pole[:, None])) + residue.conj() @ (1 / (s - pole.conj()[:, None])))
    z = np.tile([0.0, 0.0, 1.0], (3, 1))
    frf = ema.FRF(
        frequency=f, value=value[:, None], quantity="accelerance", output=ema.Dofs(node=[1, 2, 3], direction=z),
        input=ema.Dofs(node=[1], direction=z[:1]), run=[0, 0, 0], source=("generated",) * 3,
    )  # fmt: skip
    places = ema.Geometry(node=[1, 2, 3], coordinate=np.outer(range(3), [0.2, 0, 0]), line=[[1, 2], [2, 3]])
    return ema.identify_frf(frf, places, name="a <bar>", order=20)


def test_a_modal_model_shows_its_modes_and_draws_its_shapes(bar):
    text = bar._repr_html_()
    assert "a &lt;bar&gt;: 2 modes" in text
    for f in bar.frequency:
        assert f"<td>{f:.2f}</td>" in text
    titles = [axes.get_title() for axes in bar.plot().axes]
    assert titles == [f"{f:.4g} Hz, 2 %" for f in bar.frequency]


def test_a_shape_turns(bar):
    plotter = ema.turnable(bar, 1, off_screen=True)
    first = plotter.screenshot(return_img=True)
    assert np.ptp(first) > 100
    plotter.camera.azimuth += 60.0
    plotter.render()
    assert np.abs(first.astype(float) - plotter.screenshot(return_img=True)).max() > 50
    plotter.close()
    with pytest.raises(ema.IdentificationError, match="numbered from 0 to 1"):
        ema.turnable(bar, 2)


@pytest.mark.parametrize(("name", "holes"), [("demo_stack", 0), ("stator", 5)])
def test_a_stack_shows_its_numbers_and_draws_its_plan(name, holes):
    stack = model.read_stack(ROOT / "data" / name / "stack.toml")
    assert f"{stack.n_lamina} of {1e3 * stack.pitch:.3g} mm" in stack._repr_html_()
    plan, side = stack.plot().axes
    assert len(plan.patches) == 1 + holes + len(stack.clamps)
    (x0, x1), (y0, y1) = plan.get_xlim(), plan.get_ylim()
    assert x0 <= -500 * stack.length < 500 * stack.length <= x1
    assert y0 <= -500 * stack.width < 500 * stack.width <= y1
    assert len(side.lines) == len(stack.clamps)


def estimate(name, value):
    return updating.Estimate(
        name=name, unit="1", value=value, std=0.1 * value, lower=0.1, upper=9.0, at_bound=False, objective=1.0,
        history=[[0.5 * value, 2.0], [value, 1.0]],
    )  # fmt: skip


def test_a_fit_shows_its_parameters_and_pairs():
    mac = np.array([[0.1, 0.97, 0.0], [0.9, 0.1, 0.0]])
    pairing = updating.Pairing(
        mac=mac, measured=[0, 1], model=[1, 0], unpaired_measured=[], unpaired_model=[2], threshold=0.8,
        subspace=[0, 1], subspace_mac=[0.97, 0.9],
    )  # fmt: skip
    fit = SimpleNamespace(
        name="M1", error=0.031, G_f=estimate("G_f", 2.0), d_f=estimate("d_f", 3.0), pairing=pairing, findings=(),
        modes=SimpleNamespace(frequency=np.array([100.0, 150.0, 300.0]), damping=np.full(3, 0.01)),
    )  # fmt: skip
    text = fit_html(fit)
    assert "M1: mean frequency error 3.1 %" in text
    assert "<td>1</td><td>150.00</td><td>1</td><td>0.970</td>" in text
    left, right = fit_figure(fit).subfigs
    np.testing.assert_allclose(right.axes[0].collections[0].get_array(), mac, rtol=1e-6)
    assert [panel.get_xscale() for panel in left.axes] == ["log", "linear"]
    assert html_of.dispatch(updating.Fit) is fit_html
    assert figure_of.dispatch(updating.Fit) is fit_figure


def ranked(effects, error, left_out):
    given = dict.fromkeys(Ranked.__dataclass_fields__, 0.0)
    return Ranked(**given | {"effects": effects, "frequency_error": error, "left_out_error": left_out, "parameter": ()})


def test_a_diagnosis_shows_its_answer_and_draws_how_the_error_falls():
    base, found = ranked((), 0.04, 0.05), ranked(("mass",), 0.001, 0.002)
    mode = SimpleNamespace(configuration="M1", mode=1, frequency=300.0, base=0.04, explained=0.001)
    one = SimpleNamespace(
        verdict="identified", set=(("mass",),), labels={"mass": "a mass"}, measurement=(), explained=0.9,
        steps=(base, found), ranking=(found, base), errors=(mode,), ranked=lambda e: found if e else base,
        shown=lambda most: (found, base)[:most],
    )  # fmt: skip
    text = diagnosis_html(one)
    assert "What the model lacks is a mass: with it the mean frequency error falls from 4.0 % to 0.10 %" in text
    assert text.index("<td>a mass</td>") < text.index("<td>base model</td>")
    steps, modes = (part.axes[0] for part in diagnosis_figure(one).subfigs)
    assert [bar.get_height() for bar in steps.patches[:3]] == pytest.approx([4.0, 3.9, 0.1])
    assert [bar.get_height() for bar in modes.patches] == pytest.approx([4.0, 0.1])
    assert html_of.dispatch(Diagnosis) is diagnosis_html
    assert figure_of.dispatch(Diagnosis) is diagnosis_figure


def test_what_nobody_draws_is_said():
    assert html_of(3) == "<pre>3</pre>"
    with pytest.raises(TypeError, match="nothing draws a int"):
        figure_of(3)
    assert html_table("t", ("a",), [["1 < 2"]], "n").endswith("<td>1 &lt; 2</td></tr></tbody></table><p>n</p>")
