"""Specimens put beside their models: modes known by the same numbers, and models that several of them share."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from model import Effect, Stack
from updating.correlation.pairing import require_points
from updating.diagnosis.assembly import assemble_evidence, identities
from updating.diagnosis.candidates import CandidateModel, candidate_model, instruments_of
from updating.diagnosis.evidence import DiagnosisScatter, Evidence
from updating.diagnosis.experiment import aids
from updating.diagnosis.explanation import Explanation, explain
from updating.diagnosis.residual import Spread, covariance_of, spread_of
from updating.diagnosis.scan import Place, nearest, with_modes_of
from updating.errors import FitError
from updating.pooled.common import Latent, latents_of, separated
from updating.pooled.specimen import Specimen
from updating.results.store import digest
from updating.workers.workers import distribute

_LOG = logging.getLogger(__name__)
Vector = NDArray[np.float64]

ALIKE = 0.06
"""Relative difference of heights up to which specimens share the model of one amid them; the rest is taken to first
order, which is wrong by less than 0.1 % of a frequency."""
FAR_OFF = 0.04
"""Frequency error of base models, in the mean, beyond which steps from them mislead."""
MESSAGES = 8
"""In which work is sent to other processes."""
_PLACE = 4  # digits, in m, to which shakers sit at the same place


@dataclass(frozen=True, eq=False, kw_only=True)
class Beside:
    """One specimen beside its model.

    Attributes
    ----------
    specimen : Specimen
        What was measured.
    evidence : Evidence
        Beside the model; its covariance is what is the specimen's own.
    shared : (n, n_latent) float
        Rows of data by the discrepancies that all specimens share, rotated.
    known : (n_nuisance,) float
        Where the priors of its nuisances are centred.
    alone : Explanation
        Its base model, fitted to it alone.
    """

    specimen: Specimen
    evidence: Evidence
    shared: Vector
    known: Vector
    alone: Explanation


@dataclass(frozen=True, eq=False, kw_only=True)
class Bench:
    """All specimens beside their models.

    Attributes
    ----------
    own : tuple of Beside
        The specimens.
    latents : tuple of Latent
        Discrepancies that all share.
    effects : mapping of str to Effect
        Those that every one of the stacks can have.
    impossible : mapping of str to str
        Why others cannot be.
    places : tuple of Place
        Where single effects come near in a global search, where the base models are far off.
    apart : tuple of frozenset of int, optional
        Shapes of each specimen that take no part, beside those whose modes are close where the data are weighed.
    """

    own: tuple[Beside, ...]
    latents: tuple[Latent, ...]
    effects: Mapping[str, Effect]
    impossible: Mapping[str, str]
    places: tuple[Place, ...]
    apart: tuple[frozenset[int], ...] = ()

    @cached_property
    def nuisance_std(self) -> Mapping[str, float]:
        """What is known of each nuisance of any specimen, as a standard deviation; infinite where nothing is."""
        return {
            name: float(std)
            for own in self.own
            for name, std in zip(own.evidence.nuisances, own.evidence.prior_std, strict=True)
        }


def bench(
    specimens: Sequence[Specimen],
    effects: Mapping[str, Effect],
    *,
    scatter: DiagnosisScatter | None = None,
    executor: Executor | None = None,
    reduced: Callable[..., CandidateModel] = candidate_model,
) -> Bench:
    """Put specimens beside their models.

    Parameters
    ----------
    specimens : sequence of Specimen
        At least two.
    effects : mapping of str to Effect
        The catalogue.
    scatter : DiagnosisScatter, optional
        What a laboratory knows of what separates a right model from a right measurement.
    executor : Executor, optional
        Where a part of the work may run.
    reduced : callable
        `candidate_model`, or one that caches.

    Raises
    ------
    FitError
        There are fewer than two specimens, or no mode of one resembles its model.
    PairingError
        Measured points do not lie on a stack.
    """
    if len(specimens) < 2:
        message = f"a pooled diagnosis needs two specimens or more, found {len(specimens)}"
        raise FitError(message)
    evidences, impossible = _evidences(specimens, effects, scatter, reduced, executor)
    numbered = _numbered(evidences)
    alone = _alone(numbered, executor)
    places: tuple[Place, ...] = ()
    if any(own.lacking for own in numbered) or np.mean([x.residual.frequency_error for x in alone]) > FAR_OFF:
        most = max(numbered, key=lambda own: max(u.size for u in own.used))
        places = nearest(most, executor)
        used = distribute(
            partial(_used_at, tuple(numbered), places), range(len(numbered)), executor, MESSAGES
        )
        numbered = [_with(own, u, x.nuisance) for own, u, x in zip(numbered, used, alone, strict=True)]
        alone = _explained(numbered, [x.nuisance for x in alone], executor)
    own = [_beside(*each) for each in zip(specimens, numbered, alone, strict=True)]
    possible = {n: e for n, e in effects.items() if all(n in each.effects for each in numbered)}
    spreads = [spread_of(each, x.nuisance) for each, x in zip(numbered, alone, strict=True)]
    found = Bench(own=tuple(own), latents=(), effects=possible, impossible=impossible, places=places)
    return with_spreads(found, spreads)


def _alone(evidences: Sequence[Evidence], executor: Executor | None) -> list[Explanation]:
    """Fit the base model of each specimen; one that ended far off begins again where the others are."""
    found = _explained(evidences, [own.start for own in evidences], executor)
    contact = np.median([x.nuisance[:2] for x in found], axis=0)
    far = [s for s, x in enumerate(found) if x.residual.frequency_error > FAR_OFF]
    starts = [np.append(contact, evidences[s].start[2:]) for s in far]
    for s, again in zip(far, _explained([evidences[s] for s in far], starts, executor), strict=True):
        found[s] = max(found[s], again, key=lambda x: x.log_evidence)
    return found


def _explained(
    evidences: Sequence[Evidence], nuisances: Sequence[Vector], executor: Executor | None
) -> list[Explanation]:
    """Fit the base model of each specimen from its nuisances."""
    fits = partial(_fitted_from, tuple(evidences))
    return list(distribute(fits, tuple(enumerate(nuisances)), executor, MESSAGES))


def _fitted_from(evidences: Sequence[Evidence], start: tuple[int, Vector]) -> Explanation:
    s, nuisance = start
    return explain(evidences[s], nuisance=nuisance)


def _used_at(evidences: Sequence[Evidence], places: Sequence[Place], s: int) -> tuple[NDArray[np.int64], ...]:
    """Return the measured modes of each configuration that a specimen's model has at one of some places."""
    return with_modes_of(evidences[s], places)


def _with(own: Evidence, used: tuple[NDArray[np.int64], ...], nuisance: Vector) -> Evidence:
    """Return the evidence with other modes that are used."""
    wider = replace(own, used=used)
    return replace(wider, covariance=covariance_of(wider, nuisance))


def _beside(specimen: Specimen, evidence: Evidence, alone: Explanation) -> Beside:
    """Return a specimen beside its model, before what is own and what is shared of its discrepancy are told apart."""
    known = np.zeros(len(evidence.nuisances))
    if "height" in evidence.dimensions:
        ratio = specimen.stack.height / evidence.stack.height
        known[evidence.nuisances.index("height")] = np.log(ratio)
    none = np.zeros((0, 0))
    return Beside(specimen=specimen, evidence=evidence, shared=none, known=known, alone=alone)


def with_spreads(bench: Bench, spreads: Sequence[Spread]) -> Bench:
    """Return specimens with what separates their models from the measurements, own and shared, by how data scatter."""
    evidences = [own.evidence for own in bench.own]
    latents = latents_of(evidences, spreads)
    found = []
    apart = bench.apart or (frozenset[int](),) * len(spreads)
    for own, spread, without in zip(bench.own, spreads, apart, strict=True):
        divided = separated(own.evidence, spread, latents, without)
        found.append(
            replace(own, evidence=replace(own.evidence, covariance=divided.own), shared=divided.shared)
        )
    return replace(bench, own=tuple(found), latents=latents)


def _evidences(
    specimens: Sequence[Specimen],
    effects: Mapping[str, Effect],
    scatter: DiagnosisScatter | None,
    reduced: Callable[..., CandidateModel],
    executor: Executor | None,
) -> tuple[list[Evidence], dict[str, str]]:
    """Return each specimen beside its model, and why effects cannot be; no process holds two models in full."""
    groups = _alike(specimens)
    for members in groups:
        _LOG.info("the model of %s", ", ".join(specimens[i].name for i in members))
    put = partial(_put_beside, specimens, effects, scatter, reduced)
    single = len(groups) == 1  # then its own parts are made beside each other
    every = [put(groups[0], executor)] if single else list(distribute(put, groups, executor, MESSAGES))
    of = {
        i: evidence
        for members, (evidences, _) in zip(groups, every, strict=True)
        for i, evidence in zip(members, evidences, strict=True)
    }
    impossible = {name: why for _, reasons in every for name, why in reasons.items()}
    return [of[i] for i in range(len(specimens))], impossible


def _put_beside(
    specimens: Sequence[Specimen],
    effects: Mapping[str, Effect],
    scatter: DiagnosisScatter | None,
    reduced: Callable[..., CandidateModel],
    members: Sequence[int],
    executor: Executor | None = None,
) -> tuple[list[Evidence], Mapping[str, str]]:
    """Return specimens beside the model of the middle one of them, and why effects cannot be."""
    for i in members:
        for _, _, modes in specimens[i].tested:
            require_points(modes)
    first = specimens[members[len(members) // 2]]
    candidates = reduced(first.stack, instruments_of(first.tested[0][2]), effects, aids(), executor)
    found, shared = [], candidates.system.equations  # with what of them acts
    for i in members:
        try:
            own = assemble_evidence(candidates, specimens[i].tested, scatter=scatter).alone
            found.append(replace(own, equations=shared))
        except FitError as error:
            message = f"specimen {specimens[i].name}: {error}"
            raise FitError(message) from error
    return found, candidates.impossible


def _alike(specimens: Sequence[Specimen]) -> list[list[int]]:
    """Return which specimens share a model, by height ascending: their stacks differ by `ALIKE` of height at most."""
    groups: list[list[int]] = []
    key = [_key(own) for own in specimens]
    for i in sorted(range(len(specimens)), key=lambda i: (key[i], specimens[i].stack.height)):
        height = specimens[i].stack.height
        last = groups[-1][0] if groups else -1
        if last >= 0 and key[last] == key[i] and height / specimens[last].stack.height <= 1.0 + ALIKE:
            groups[-1].append(i)
        else:
            groups.append([i])
    return groups


def _key(own: Specimen) -> str:
    """Return what tells the models of two stacks apart, but for their height."""
    stack: Stack = replace(own.stack, name="", height=own.stack.width)
    instruments = instruments_of(own.tested[0][2])
    x, y, z = instruments.shaker
    place = (round(x, _PLACE), round(y, _PLACE), z > 0.0)
    return digest({"stack": stack, "shaker": place, "sensors": len(instruments.sensor)})


def _numbered(evidences: Sequence[Evidence]) -> list[Evidence]:
    """Return the evidence with modes that have the same number in all specimens."""
    every = [tested for own in evidences for tested in own.tested]
    number = iter(identities(every))
    return [replace(own, identity=tuple(next(number) for _ in own.tested)) for own in evidences]
