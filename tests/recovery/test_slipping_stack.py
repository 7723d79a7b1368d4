"""A stack that slips, tested at three forces: modes over their amplitude from its backbone, diagnosed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import model
from model.effects.contact_slip import STRAIN
from tests.studies.blind import blind_test, candidates_of, simulated
from updating.commands.command_line import diagnose
from updating.diagnosis.answer import Diagnosis
from updating.diagnosis.diagnosis import conclude, searched
from updating.diagnosis.evidence import assemble_evidence
from updating.diagnosis.experiment import second_level
from updating.diagnosis.slipping import AtLevel
from updating.results.store import read_result

pytestmark = pytest.mark.slow

SPECIFICATION = Path(__file__).parents[2] / "data" / "demo_stack" / "virtual_test.toml"
SLIPPING = Path(__file__).parents[2] / "data" / "hidden_effect" / "slip"
CONSIDERED = ("clamp_mass", "contact_direction", "contact_loss", "contact_slip", "micro_slip", "pressure_exponent")
AMPLITUDE = (2e-7, 8e-7, 3e-6)
LAW = model.SlipLaw(friction=0.3, exponent=-0.4)


@pytest.fixture(scope="module")
def candidates():
    effects = {name: effect for name, effect in model.catalogue().items() if name in CONSIDERED}
    return candidates_of(SPECIFICATION, effects)


@pytest.fixture(scope="module")
def system():
    return model.reduce(model.read_stack(SPECIFICATION.parent / "stack.toml"))


def levels_of(candidates, system, seed, law):
    """One configuration of a played test as three force levels; a law of None is a stack that does not slip."""
    test = blind_test(SPECIFICATION, seed, (), {})
    name, pressure, modes = simulated(test)[0]
    each, strain = test.configurations[0], model.contact_strain(system)
    given = {"G_f": each.G_f, "d_f": each.d_f, "parameters": {"pressure": pressure}}
    ratio, added, rms = np.ones((3, modes.frequency.size)), *np.zeros((2, 3, modes.frequency.size))
    points = assemble_evidence(candidates, [(name, pressure, modes)]).observation[0]
    rows = model.observe(system, points).reduced_rows
    linear = [
        model.backbone(system, strain, model.SlipLaw(friction=1.0), mode=k, amplitude=np.zeros(1), **given)
        for k in range(10)
    ]
    nominal = np.array([one.frequency[0] for one in linear])
    stiffer = np.median(modes.frequency[:5] / nominal[:5])  # than the nominal stack: two modes lie 0.8 % apart
    for r, f in enumerate(modes.frequency):
        k = int(np.argmin(np.abs(np.log(stiffer * nominal / f))))
        along = linear[k]
        if law is not None:
            along = model.backbone(system, strain, law, mode=k, amplitude=np.array(AMPLITUDE), **given)
            ratio[:, r] = along.frequency / linear[k].frequency[0]
            added[:, r] = along.damping - linear[k].damping[0]
        rms[:, r] = AMPLITUDE * np.sqrt(np.mean((rows @ along.coordinate) ** 2, axis=0))
    rng, levels, found = np.random.default_rng([seed, 1]), {}, []
    for i in range(len(AMPLITUDE)):
        scatter = rng.standard_normal((2, modes.frequency.size))
        frequency = modes.frequency * ratio[i] * (1 + 1e-4 * scatter[0])
        damping = (modes.damping + added[i]) * (1 + 0.01 * scatter[1])
        level = f"{name} at {i}"
        found.append((level, pressure, replace(modes, name=level, frequency=frequency, damping=damping)))
        levels[level] = AtLevel(state=name, rms_motion=rms[i], motion=rms[i])
    return found, levels


def test_slip_is_named_with_its_parameters(candidates, system):
    found, levels = levels_of(candidates, system, 31, LAW)
    evidence = assemble_evidence(candidates, found, levels=levels)
    assert {one.assembled for one in evidence.tested} == {levels[found[0][0]].state}
    assert evidence.impossible["micro_slip"].endswith("there are several here")
    answer = conclude(candidates, evidence)
    assert answer.verdict in ("identified", "partly explained")
    assert answer.set[0] == ("contact_slip",)
    best = answer.ranked(("contact_slip",))
    truth = {
        "slip_softening": float(LAW.softening(np.array([STRAIN / LAW.sliding_strain(1480.0)]))[0]),
        "slip_exponent": LAW.exponent,
    }
    for parameter in best.parameter:
        assert parameter.lower < truth[parameter.name] < parameter.upper


def test_the_shipped_campaign_that_another_model_made_is_called_slipping(tmp_path, capsys):
    """From FRFs that time integration made to the sentences: name, fall of the error, truth in the intervals."""
    truth = json.loads((SLIPPING / "truth.json").read_text(encoding="utf-8"))
    diagnose(SLIPPING / "campaign.toml", tmp_path)
    said = " ".join(capsys.readouterr().out.split())
    answer = read_result(tmp_path / "diagnosis.json", Diagnosis)
    assert answer.set[0] == ("contact_slip",)
    assert answer.verdict in ("identified", "one of", "partly explained")
    before, after = answer.ranked(()), answer.ranked(("contact_slip",))
    assert before.frequency_error == pytest.approx(0.0114, abs=5e-4)
    assert after.frequency_error < 0.004
    assert after.left_out_error < 0.6 * before.left_out_error
    law = model.SlipLaw(friction=truth["friction"], exponent=truth["exponent"])
    slide = law.sliding_strain(truth["bench"]["G_f"])
    true = {"slip_softening": float(law.softening(np.array([STRAIN / slide]))[0]), "slip_exponent": truth["exponent"]}
    softening, exponent = after.parameter
    assert softening.lower < true["slip_softening"] < softening.upper
    # The simulation took the contact at eight points along the stack, so that it slips less than the law asks for.
    assert exponent.value == pytest.approx(true["slip_exponent"], abs=0.3)
    assert [one.configuration for one in answer.contact[::4]] == ["M1", "M1 at 1.2 N", "M1 at 4 N"]
    for one in answer.contact[8:]:  # at its own strain, beside the law that was integrated
        expected = float(law.softening(np.array([one.strain / slide]))[0])
        assert one.softening == pytest.approx(expected, rel=0.4)
    assert "these 3 force levels shear the contact by" in said
    assert answer.second_level is None
    assert "second_force" not in {test.name for test in answer.next_tests}
    assert "not linear" not in said  # the levels are part of the answer


def test_a_linear_stack_at_three_forces_is_not_called_slipping(candidates, system):
    found, levels = levels_of(candidates, system, 32, None)
    answer = conclude(candidates, assemble_evidence(candidates, found, levels=levels))
    assert not any("contact_slip" in effects for effects in answer.set)


def test_one_force_level_asks_for_another(candidates, system):
    found, levels = levels_of(candidates, system, 31, LAW)
    evidence = assemble_evidence(candidates, found[:1])
    assert "contact_slip" not in evidence.effects
    assert "test again at a third or three times the force" in evidence.impossible["contact_slip"]
    one, search, _ = searched(candidates, evidence)
    shows = second_level(one, search.base)
    assert shows is not None
    assert shows > 30.0
    several = searched(candidates, assemble_evidence(candidates, found, levels=levels))[0]
    assert second_level(several, search.base) is None
