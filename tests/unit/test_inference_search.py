"""The search and its decision on a chain of masses: what is missing is named, twins are not told apart."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from tests.unit.test_inference import BASE, TERM, Chain, matrices, measured
from updating.inference.decide import decide
from updating.inference.descent import raced
from updating.inference.discrepancy import SizePrior
from updating.inference.explain import coordinates_of, errors_at, explain, setting, step_within
from updating.inference.left_out import LeftOut, left_out
from updating.inference.levels import NAMED
from updating.inference.protocol import Coordinate, Term
from updating.inference.robust_start import robust_start
from updating.inference.search import Prediction, begin, better, search
from updating.inference.spread import information

TWIN = Term(name="twin", coordinates=(replace(TERM.coordinates[0], name="as_spot"),))
STIFF = Term(name="stiff", coordinates=(replace(TERM.coordinates[0], name="twice", starts=(0.1,)),))
SHARES = (0.9, 0.1)
KNOWN = (SizePrior.exactly(2e-3), SizePrior.exactly(0.1))


class Choice(Chain):
    """The chain with several candidates: one that acts as `spot` does, or one that acts where `stiffness` does."""

    def __init__(self, states, terms=(TERM, STIFF), coordinates=BASE):
        super().__init__(states, coordinates)
        self.terms = {t.name: t for t in terms}

    def about(self, coordinates, points):
        return Choice(self.states, tuple(self.terms.values()), tuple(coordinates))

    of = about

    def modal(self, x, state):
        names = [c.name for c in self.coordinates]
        acting = {"as_spot": "loss", "twice": "stiffness"}
        at = dict.fromkeys(("stiffness", "density", "loss"), 0.0)
        for name, value in zip(names, x, strict=True):
            at[acting.get(name, name)] += value
        chain = Chain(self.states, [c for c in (*BASE, *TERM.coordinates) if c.name in at])
        modal = chain.modal(np.array([at[c.name] for c in chain.coordinates]), state)
        pick = [[c.name for c in chain.coordinates].index(acting.get(n, n)) for n in names]
        of = ("stiffness", "mass", "beyond_stiffness", "beyond_mass", "damping_change")
        return replace(
            modal,
            moves=np.arange(len(names)),
            damps=np.arange(len(names)),
            **{name: getattr(modal, name)[pick] for name in of},
        )


Choice.of = lambda self, coordinates, _=None: Choice(self.states, tuple(self.terms.values()), tuple(coordinates))


def states(loss):
    return tuple(
        measured(*matrices({"loss": loss, "stiffness": s})[:2], seed=i, name=name)
        for i, (name, s) in enumerate((("A", 0.0), ("B", 1e-4)))
    )


def searched(loss, terms=(TERM, STIFF)):
    model = Choice(states(loss), terms)
    return search(model, *begin(model, shares=SHARES, starts=[np.zeros(2)]), say=lambda _: None)


def test_what_is_missing_is_named_and_predicts_better():
    found = searched(0.4)
    decision = decide(found)
    assert decision.verdict == "identified"
    assert [x.terms for x in decision.left] == [("spot",)]
    assert [x.terms for x in decision.steps] == [(), ("spot",)]
    first = decision.left[0]
    assert first.value("loss") == pytest.approx(0.4, abs=3.0 * first.std[-1])
    assert found.prediction(first).mode.frequency < 0.5 * found.prediction(found.base).mode.frequency


def test_nothing_is_named_where_nothing_is_missing():
    decision = decide(searched(0.0))
    assert decision.verdict == "nothing missing"
    assert decision.left == ()


def test_what_acts_alike_is_not_told_apart():
    found = searched(0.4, (TERM, TWIN, STIFF))
    decision = decide(found)
    assert [found.odds(x) for x in decision.left] == sorted((found.odds(x) for x in decision.left), reverse=True)
    assert decision.verdict == "one of"
    assert {x.terms for x in decision.left} == {("spot",), ("twin",)}


def test_what_is_hardly_more_probable_than_nothing_stays_beside_what_is_hardly_named():
    found = searched(0.4, (TERM, TWIN))
    fits = {name: found.fitted[frozenset({name})] for name in ("spot", "twin")}
    gain = {name: fit.log_evidence - found.base.log_evidence for name, fit in fits.items()}
    priors = {"spot": NAMED + 1.0 - gain["spot"], "twin": NAMED - 1.0 - gain["twin"]}
    left = decide(replace(found, priors=priors, chosen=fits["spot"])).left
    assert [x.terms for x in left] == [("spot",), ("twin",)]
    priors["twin"] = -1.0 - gain["twin"]
    assert [x.terms for x in decide(replace(found, priors=priors, chosen=fits["spot"])).left] == [("spot",)]


def test_what_was_found_first_is_dropped_where_it_is_not_needed_any_more():
    """A term that can do a part leads to the one that does it all, which was not asked alone."""
    part = Term(name="part", coordinates=(replace(TERM.coordinates[0], name="as_spot", upper=0.15),))
    model = Choice(states(0.4), (TERM, part))
    common, base = begin(model, shares=SHARES, starts=[np.zeros(2)])

    def one_by_one(model, common, at, starts=()):
        terms = [model.terms[n] for n in (*at.terms, "spot" if at.terms else "part")]
        return [] if len(terms) > 2 else [explain(model, terms, common, np.append(at.x, 0.1))]

    found = search(model, common, base, extend_by=one_by_one, say=lambda _: None)
    assert frozenset(("part", "spot")) in found.fitted
    assert found.chosen.terms == ("spot",)


def test_a_mode_that_is_left_out_is_predicted_as_a_fit_without_it_does():
    """To first order nothing is fitted again; the fit without a mode, of which it is to first order, is made here."""
    model = Choice(states(0.01)[:1])
    common, base = begin(model, shares=SHARES, starts=[np.zeros(2)], priors=KNOWN)
    errors = []
    for r in range(base.errors[0].frequency.size):
        (state,) = model.states
        kept = np.delete(np.arange(state.frequency.size), r)
        names = ("frequency", "frequency_std", "damping", "damping_std", "shape_std")
        part = {name: getattr(state, name)[kept] for name in names}
        less = Choice((replace(state, shape=state.shape[:, kept], **part),))
        setting = replace(common, noise=(common.noise[0][kept],))
        refit = explain(less, [], setting, base.x)
        errors.append(errors_at(model, model.about(base.coordinates, []), common, refit.x)[0].frequency[r])
    assert left_out(base).frequency == pytest.approx(np.sqrt(np.mean(np.square(errors))), rel=0.05)


def test_a_state_that_is_left_out_is_nan_where_there_is_one_alone():
    model = Choice(states(0.1)[:1])
    _, base = begin(model, shares=SHARES, starts=[np.zeros(2)])
    assert np.isnan(left_out(base, "state").frequency)
    assert np.isfinite(left_out(base, "mode").frequency)


def test_what_data_say_beside_a_fit_is_what_a_fit_with_it_says():
    model = Choice(states(0.02))
    common, base = begin(model, shares=SHARES, starts=[np.zeros(2)], priors=KNOWN)
    coordinates = coordinates_of(model, [TERM])
    x = np.append(base.x, 0.0)
    local = model.about(coordinates, [])
    problem = explain(model, [TERM], common, x, local=local, steps=0, rounds=1).problem
    mean, std = information(problem, x, coordinates, base.evidence.sizes, [True, True, False])
    fitted = explain(model, [TERM], common, x)
    assert mean[2] == pytest.approx(fitted.value("loss"), rel=0.1)
    assert std[2] == pytest.approx(fitted.std[2], rel=0.1)
    assert np.isinf(std[:2]).all()


def prediction(frequency, damping=0.1, pull=1.0):
    nothing = LeftOut(errors={"frequency": np.full(1, np.nan), "damping": np.full(1, np.nan)}, state=np.zeros(1))
    mode = LeftOut(errors={"frequency": np.array([frequency]), "damping": np.array([damping])}, state=np.zeros(1))
    return Prediction(mode=mode, state=nothing, pull=pull)


@pytest.mark.parametrize(
    ("new", "old", "expected"),
    [
        (prediction(2e-3), prediction(5e-3), True),
        (prediction(4.9e-3), prediction(5e-3), False),  # by less than matters
        (prediction(1e-5), prediction(1e-4), False),  # of what matters to nobody
        (prediction(0.12), prediction(0.3), False),  # beyond first order nothing is predicted
        (prediction(0.02), prediction(0.3), True),
        (prediction(5e-3, damping=0.05), prediction(5e-3), True),
        (prediction(8e-3, damping=0.05), prediction(5e-3), False),  # what makes frequencies worse
        (prediction(5e-3, pull=1.0), prediction(5e-3, pull=5.0), True),  # what lets go of what is known
        (prediction(5e-3, pull=4.0), prediction(5e-3, pull=5.0), False),
        (prediction(2e-3, pull=3.6), prediction(5e-3, pull=3.1), True),  # a true deviation shows beside what is right
        (prediction(2e-3, pull=4.0), prediction(5e-3, pull=5.0), True),
        (prediction(2e-3, pull=2.5), prediction(5e-3, pull=1.0), True),
    ],
)
def test_what_predicts_better(new, old, expected):
    assert better(new, old) == expected


@pytest.mark.parametrize("far", [-0.5, 0.9])
def test_a_start_far_off_leads_near_the_truth_past_a_mode_that_the_model_lacks(far):
    """The third measured frequency is 20 % off: of the rig, say. Most others agree where the stiffness is right."""
    (state,) = states(0.0)[:1]
    frequency = state.frequency * np.where(np.arange(state.frequency.size) == 2, 1.2, 1.0)
    model = Choice((replace(state, frequency=frequency),))
    common = setting(model, model.about(BASE, []), np.zeros(2), shares=SHARES)
    x, apart = robust_start(model, common, np.array([far, 0.0]))
    assert x[0] == pytest.approx(0.0, abs=0.06)
    assert apart == {(0, 2)}


def test_a_step_does_not_crawl_along_a_valley_in_which_priors_alone_tell_where_to_go():
    """Data know the sum of a pulled nuisance and of a new term to 3e-4; the nuisance has a narrow prior."""
    pulled, new = Coordinate(name="pulled", std=0.03), Coordinate(name="new", std=1.0)
    priors = np.array([pulled.std, new.std]) ** -2.0
    x = np.array([0.2, 0.0])
    hessian = np.full((2, 2), 1e7) + np.diag(priors)
    to = step_within(priors * x, hessian, x, (pulled, new))
    assert to == pytest.approx([0.0, 0.2], abs=0.01)


@dataclass(frozen=True)
class Runner:
    """A descent whose steps lower its cost as they were listed."""

    falls: tuple[float, ...]
    cost: float = 0.0

    @property
    def ended(self):
        return not self.falls

    @property
    def fall(self):
        return self.falls[0]

    def further(self):
        return Runner(self.falls[1:], self.cost - self.falls[0])


def test_a_start_runs_on_while_its_steps_can_still_lead_near_the_best():
    """One far behind that falls steeply wins later; one that hardly falls is left where it is."""
    best, late, flat = Runner((50.0,)), Runner((30.0,) * 12, 300.0), Runner((1.0,) * 12, 100.0)
    ends = raced([best, late, flat], steps=5, later=10, behind=12.0)
    assert ends == [Runner((), -50.0), Runner((30.0,) * 7, 150.0)]
    assert raced([best, late, flat], steps=5, later=0, behind=12.0) == ends[:1]
