"""How often slip is named, and its parameters hold, on levels that harmonic balance of an independent model made."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

import model
from ema.types.frf import Geometry
from model.effects.contact_slip import STRAIN
from tests.independent.campaign import SHAKER, STACK
from tests.independent.slipping_modes import BAND, STATE, SlippingTest, slipping_test
from tests.recovery.reference_models import modal_model
from tests.studies.runner import BLIND, Share, share, study
from updating.diagnosis.cached_model import cached_model
from updating.diagnosis.candidates import CandidateModel, instruments_of
from updating.diagnosis.diagnosis import searched
from updating.diagnosis.evidence import assemble_evidence
from updating.diagnosis.experiment import aids
from updating.diagnosis.ranking import estimates, log_ratios, mean_error
from updating.diagnosis.slipping import AtLevel
from updating.inference.decide import decide
from updating.results.text import Z95

RECORD = BLIND / "slipping.jsonl"
"""The cases of the published table."""
FIRST_SEED = 900_100
MIXTURE = (True, True, False)
"""Whether a case slips, in their turn."""
CONSIDERED = (
    "air_damping",
    "clamp_mass",
    "contact_direction",
    "contact_loss",
    "contact_slip",
    "lost_contact_ends",
    "steel_loss",
)
"""Effects of the catalogue that are tried: slip, and what changes stiffness or damping of many modes."""
MOVES = 3.0
"""Half-widths of its 95 % interval by which a frequency moves where slip is to be named."""
_Z90 = 1.645
_CLOSE = 0.15  # of the slip limit


@dataclass(frozen=True, kw_only=True)
class SlippingCase:
    """One case and what was said of it.

    Attributes
    ----------
    seed, slips
        As drawn.
    moved : float
        As `SlippingTest` has it.
    truth : (float, float)
        Softening at the effect's strain, and exponent; 0 and 0 of a stack that does not slip.
    verdict : str
        Of the diagnosis.
    named : tuple of tuple of str
        What it leaves, the first one first.
    found : tuple of (float, float, float)
        Value and 95 % interval of both parameters, slip alone.
    limit : float
        Strain at which everything slides, found over true; NaN of a stack that does not slip.
    error : (float, float)
        Mean frequency errors of the base model and with slip alone.
    """

    seed: int
    slips: bool
    moved: float
    truth: tuple[float, float]
    verdict: str
    named: tuple[tuple[str, ...], ...]
    found: tuple[tuple[float, float, float], ...]
    limit: float
    error: tuple[float, float]

    @property
    def slip_named(self) -> bool:
        """Whether slip is in everything that is left."""
        return bool(self.named) and all("contact_slip" in effects for effects in self.named)

    @property
    def slip_leads(self) -> bool:
        """Whether slip is in the first that is named."""
        return bool(self.named) and "contact_slip" in self.named[0]

    @property
    def covered(self) -> tuple[bool, ...]:
        """Whether the 90 % intervals hold the truth."""
        found = []
        for (_, low, high), true in zip(self.found, self.truth, strict=True):
            half = _Z90 / Z95 * 0.5 * (high - low)
            found.append(abs(true - 0.5 * (low + high)) <= half)
        return tuple(found)


def _levels(test: SlippingTest) -> list:
    geometry = Geometry(node=np.arange(1, SHAKER + 1), coordinate=test.nominal, line=np.empty((0, 2), dtype=int))
    return [
        (table.configuration.name, table.configuration.pressure, modal_model(table, geometry, BAND))
        for table in test.level
    ]


def run(seed: int, slips: bool, candidates: CandidateModel) -> SlippingCase:
    """Draw, simulate, diagnose and score one case."""
    test = slipping_test(seed, slips=slips)
    tested = _levels(test)
    levels = {
        name: AtLevel(state=STATE.name, rms_motion=motion, motion=motion)
        for (name, _, _), motion in zip(tested, test.motion, strict=True)
    }
    evidence = assemble_evidence(candidates, tested, levels=levels)
    whole, found, _ = searched(candidates, evidence, [("contact_slip",)])
    alone = found.fitted[frozenset(("contact_slip",))]
    fitted = estimates(whole, alone)
    values = {p.name: p.value for p in fitted}
    truth, limit = (0.0, 0.0), float("nan")
    if slips:
        law = model.SlipLaw(friction=test.friction, exponent=test.exponent)
        slide = law.sliding_strain(test.G_f)
        truth = (float(law.softening(np.array([STRAIN / slide]))[0]), test.exponent)
        one = model.SlipLaw(friction=1.0, exponent=values["slip_exponent"])
        limit = STRAIN / max(one.reach(values["slip_softening"]), 1e-12) / slide
    return SlippingCase(
        seed=seed,
        slips=slips,
        moved=test.moved,
        truth=truth,
        verdict=(decision := decide(found)).verdict,
        named=tuple(x.terms for x in decision.left),
        found=tuple((p.value, p.lower, p.upper) for p in fitted),
        limit=limit,
        error=(mean_error(log_ratios(found.base)[0]), mean_error(log_ratios(alone)[0])),
    )


def planned(number: int) -> list[tuple[int, bool]]:
    """Return seeds of so many cases, and whether they slip."""
    return [(FIRST_SEED + i, MIXTURE[i % len(MIXTURE)]) for i in range(number)]


def study_of(cases: Sequence[tuple[int, bool]], record: Path) -> list[SlippingCase]:
    """Run the cases that are not recorded yet, and return all of them."""

    def say(case: SlippingCase) -> None:
        kind = "slips" if case.slips else "linear"
        print(f"{case.seed} {kind} {case.moved:.0f} -> {case.verdict} {case.named}", flush=True)

    with threadpool_limits(1, user_api="blas"):
        return study(
            cases, lambda seed, slips: run(seed, slips, _model()), record, SlippingCase,
            lambda one: (one.seed, one.slips), say=say,
        )  # fmt: skip


@cache
def _model() -> CandidateModel:
    """Return the model of the stated stack, the same for all cases."""
    effects = {name: effect for name, effect in model.catalogue().items() if name in CONSIDERED}
    instruments = instruments_of(_levels(slipping_test(FIRST_SEED, slips=False))[0][2])
    return cached_model(model.read_stack(STACK), instruments, effects, aids())


def figures(cases: Sequence[SlippingCase]) -> Iterator[Share]:
    """Yield what the cases say."""
    slipping = [c for c in cases if c.slips]
    seen = [c for c in slipping if c.moved >= MOVES]
    linear = [c for c in cases if not c.slips]

    moves = f"slip moves a frequency by {MOVES:g} half-widths"
    yield share(f"{moves}: it is in all that is left", "90 %", [c.slip_named for c in seen])
    yield share("the same: it is in the first that is named", "reported", [c.slip_leads for c in seen])
    yield share("the same: *identified*", "reported", [c.verdict == "identified" for c in seen])
    yield share(
        "linear stacks called slipping", "at most 3 %", [any("contact_slip" in x for x in c.named) for c in linear]
    )
    yield share("linear stacks called *nothing missing*", "reported", [c.verdict == "nothing missing" for c in linear])
    for i, name in enumerate(("softening at a strain of 1e-5", "exponent")):
        yield share(f"90 % interval of the {name} holds the truth", "80 to 97 %", [c.covered[i] for c in seen])
    yield share("slip limit within 15 %", "reported", [abs(c.limit - 1.0) <= _CLOSE for c in seen])
    yield share("mean frequency error is lower with slip alone", "reported", [c.error[1] < c.error[0] for c in seen])


def median_factor(cases: Sequence[SlippingCase]) -> float:
    """Return the median factor by which the slip limit is off, either way, where slip shows."""
    off = [abs(np.log(c.limit)) for c in cases if c.slips and c.moved >= MOVES]
    return float(np.exp(np.median(off))) if off else float("nan")
