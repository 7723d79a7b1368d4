"""Evidence assembled: measured configurations put beside the reduced model with all effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from ema.modal.mac import mac
from ema.types.modal_model import ModalModel
from model import Observation, ReducedEquations, ReducedSystem, contact_strain, observe, solve_modes
from updating.correlation.registration import register
from updating.correlation.subspace import CLOSE, span_mac
from updating.diagnosis.candidates import EXTRAPOLATED, G_F_RANGE, N_MODEL, CandidateModel
from updating.diagnosis.evidence import (
    D_F_START,
    DiagnosisScatter,
    Evidence,
    Shift,
    Tested,
    pair,
    solved,
    unit_shape,
)
from updating.diagnosis.hypotheses import measurement_hypotheses
from updating.diagnosis.mode_space import ModeSpace
from updating.diagnosis.residual import covariance_of, unit_shapes
from updating.diagnosis.sensor_place import USUAL, Seen, error_of_places, motion, place_slopes
from updating.diagnosis.slipping import AtLevel, silent_effects, strain_shares
from updating.errors import FitError

Vector = NDArray[np.float64]
Campaigned = tuple[str, float, ModalModel]  # name, pressure in Pa, identified modes

_MAC_USED = 0.6  # from which a measured mode counts as one that the model has
_MAC_MIXED = (
    0.9  # the same of what close modes of the model span: it has the mode, mixed too much to be compared
)
_MAC_SAME = 0.9  # from which the mesh does to its shape what it does to the model's
_TURNED = 0.05  # difference of two meshes' shapes that is no error but two close modes turned into each other
_FREE = 0.2  # of the directions of shapes that no mode may reach, from which sensors' scatter shows
_RESOLVED = 1e-3  # of a shape, that reduction and mesh leave
_USUAL_SCATTER = 1e-2  # of a shape, where too few sensors show it
_RANK = 1e-6  # singular values below this share of the largest are rounding
_PLACES = 4  # of an accelerometer, from which its gain is told
_TRIALS = 17


@dataclass(frozen=True, eq=False, kw_only=True)
class Assembled(Evidence):
    """Evidence with what it was assembled from, so that its basis can grow and further tests can be simulated.

    Attributes
    ----------
    system : ReducedSystem
        The model with all `effects`; `equations` are its.
    observation : tuple of Observation
        The measured points of each configuration.
    impossible : mapping of str to str
        Why effects of the catalogue that are not among `effects` cannot be.
    resized : mapping of str to ReducedEquations
        The model without effects with one dimension changed, in the basis that `system` began with.
    finer : ReducedSystem, optional
        The model without effects on a finer mesh.
    """

    system: ReducedSystem
    observation: tuple[Observation, ...]
    impossible: Mapping[str, str]
    resized: Mapping[str, ReducedEquations]
    finer: ReducedSystem | None

    @property
    def alone(self) -> Evidence:
        """The evidence alone: all that a fit needs, and small enough for another process."""
        return Evidence(**{field.name: getattr(self, field.name) for field in fields(Evidence)})


def assemble_evidence(
    candidates: CandidateModel,
    tested: Sequence[Campaigned],
    *,
    scatter: DiagnosisScatter | None = None,
    levels: Mapping[str, AtLevel] | None = None,
) -> Assembled:
    """Put measured configurations beside a model and find the measured modes that it has.

    Parameters
    ----------
    candidates : CandidateModel
        The model.
    tested : sequence of (str, float, ModalModel)
        Name, pressure in Pa and identified modes of each configuration.
    scatter : DiagnosisScatter, optional
        What separates a right model from a right measurement.
    levels : mapping of str to AtLevel, optional
        Which force level each configuration is, by its name, where some are levels of one state.

    Raises
    ------
    FitError
        No configuration is given, or no measured mode of one resembles one of the model.
    PairingError
        Measured points do not lie on the stack.
    """
    if not tested:
        message = "nothing to compare: no configuration was identified"
        raise FitError(message)
    base, silent = candidates.stack, silent_effects(candidates.effects, several_levels=bool(levels))
    observation = tuple(
        register(base, modes.geometry, modes.node, modes.direction).observation for _, _, modes in tested
    )
    assembled = Assembled(
        stack=base,
        tested=_as_tested(tested, levels or {}),
        used=tuple(np.arange(modes.frequency.size) for _, _, modes in tested),
        equations=candidates.system.equations,
        system=candidates.system,
        observation=observation,
        observed=tuple(observe(candidates.system, o) for o in observation),
        place_slope=tuple(place_slopes(candidates.system, o) for o in observation),
        effects={name: effect for name, effect in candidates.effects.items() if name not in silent},
        impossible={**candidates.impossible, **silent},
        scatter=scatter or DiagnosisScatter(),
        start=np.zeros(0),
        dimensions=tuple(candidates.resized),
        places=candidates.places,
        sensor=tuple(modes.sensor for _, _, modes in tested),
        n_gain=_n_gain([modes.sensor for _, _, modes in tested]),
        resized=candidates.resized,
        shift=(),
        finer=candidates.finer,
    )
    started = _started(assembled)
    G_f = started.theta(started.start, 0)["G_f"]
    return _completed(replace(started, tested=_strained(started, G_f, levels or {})), G_f)


def _completed(started: Assembled, G_f: float) -> Assembled:
    """Return evidence whose fits have a start with all else that is taken from the base model there."""
    started = replace(
        scattered(started),
        sizes=started.scatter.sizes,
        identity=identities(started.tested),
        shift=tuple(base_shift(started, c, G_f) for c in range(len(started.tested))),
        hypotheses=measurement_hypotheses(started),
    )
    return replace(started, covariance=covariance_of(started, started.start))


def _as_tested(given: Sequence[Campaigned], levels: Mapping[str, AtLevel]) -> tuple[Tested, ...]:
    states = {name: level.state for name, level in levels.items()}
    return tuple(
        Tested(name=name, pressure=p, modes=modes, state=states.get(name, "")) for name, p, modes in given
    )


def _strained(evidence: Assembled, G_f: float, levels: Mapping[str, AtLevel]) -> tuple[Tested, ...]:
    """Return the configurations with the strains that the contact has, by the base model's shapes, at their levels."""
    if not levels or not evidence.touching:
        return evidence.tested
    contact, found = contact_strain(evidence.system), []
    for c, own in enumerate(evidence.tested):
        if own.name not in levels:
            found.append(own)
            continue
        base = solved(evidence, c, {"G_f": G_f, "d_f": D_F_START}, (), N_MODEL)
        column = np.argmax(mac(own.modes.shape, base.shape), axis=1)
        amplitude = levels[own.name].rms_motion / np.sqrt(np.mean(base.shape[:, column] ** 2, axis=0))
        shares = [strain_shares(contact, x) for x in base.coordinate[:, column].T]
        strain = amplitude[:, None] * np.array(shares)
        found.append(replace(own, strain=strain, motion=levels[own.name].motion))
    return tuple(found)


def _n_gain(sensors: Sequence[NDArray[np.int64]]) -> int:
    """Return how many accelerometers that rove have a gain beside the first's; with few places each it is scatter."""
    number = max(int(own.max()) + 1 for own in sensors)
    return number - 1 if min(own.size for own in sensors) >= _PLACES * number else 0


def identities(tested: Sequence[Tested]) -> tuple[NDArray[np.int64], ...]:
    """Return for each configuration which mode of the stack each measured mode is, by MAC and distance in frequency.

    A mode that resembles none of the configurations before is one of its own.
    """
    known: list[tuple[int, int]] = []
    found: list[NDArray[np.int64]] = []
    for c, own in enumerate(tested):
        number = np.full(own.modes.frequency.size, -1, dtype=np.int64)
        for before in range(c - 1, -1, -1):
            other = tested[before].modes
            if other.shape.shape[0] != own.modes.shape.shape[0]:
                continue
            similar = mac(own.modes.shape, other.shape)
            row, column = linear_sum_assignment(similar, maximize=True)
            for i, j in zip(row, column, strict=True):
                if similar[i, j] >= _MAC_USED and number[i] < 0 and found[before][j] not in number:
                    number[i] = found[before][j]
        for i in np.flatnonzero(number < 0):
            number[i] = len(known)
            known.append((c, int(i)))
        found.append(number)
    return tuple(found)


def scattered(evidence: Assembled) -> Assembled:
    """Return the evidence with the errors of the points' places and of the sensors that its shapes show."""
    place, scatter = _sensor_scatter(evidence, evidence.theta(evidence.start, 0)["G_f"])
    return replace(evidence, point_place=place, sensor_scatter=scatter)


def _sensor_scatter(evidence: Assembled, G_f: float) -> tuple[float, tuple[Vector, ...]]:
    """Return the error of the points' places, m, and what else is added to each measured shape, over its length.

    Shapes show both where no mode of the model, no rigid-body motion and no gain of a sensor reaches; what an effect
    changes in shapes are these modes for the most part. With few sensors too little is left: what is usual is taken.
    """
    stated, seen = evidence.scatter.point_place, []
    nodes = np.unique(np.concatenate([observed.node for observed in evidence.observed]))
    for c, (tested, used) in enumerate(zip(evidence.tested, evidence.used, strict=True)):
        base = solved(evidence, c, {"G_f": G_f, "d_f": D_F_START}, ())
        known = la.orth(ModeSpace.of(base, evidence.observed[c], evidence.stack).shape, _RANK)
        if len(known) - known.shape[1] - evidence.n_gain <= _FREE * len(known):
            usual = tuple(np.full(t.modes.frequency.size, _USUAL_SCATTER) for t in evidence.tested)
            return USUAL if stated is None else stated, usual
        measured, point = tested.modes.shape, np.searchsorted(nodes, evidence.observed[c].node)
        column = np.argmax(mac(measured, base.shape), axis=1)
        u = unit_shape(measured)
        along = evidence.place_slope[c] @ motion(base, u, base.shape, column)
        for r in used:
            slope = np.zeros((len(known), 2, nodes.size))
            slope[np.arange(len(known)), :, point] = along[:, :, r]
            seen.append(
                Seen(
                    shape=u[:, r],
                    slope=slope.reshape(len(known), -1),
                    std=tested.modes.shape_std[:, r] / np.linalg.norm(measured[:, r]),
                    reached=la.orth(np.hstack([known, evidence.by_gain(c) * u[:, r, None]]), _RANK),
                )
            )
    place, scatter = error_of_places(seen, stated)
    each, found = iter([own.scatter(place, scatter) for own in seen]), []
    for tested, used in zip(evidence.tested, evidence.used, strict=True):
        own = np.full(tested.modes.frequency.size, scatter)
        own[used] = [next(each) for _ in used]
        found.append(own)
    return place, tuple(found)


def base_shift(evidence: Assembled, configuration: int, G_f: float) -> Shift:
    """Return the shift of a configuration: of those modes of the base model at `G_f` that resemble its most."""
    own = evidence.tested[configuration]
    base = solved(evidence, configuration, {"G_f": G_f, "d_f": D_F_START}, (), N_MODEL)
    alike = mac(own.modes.shape, base.shape)
    column = np.argmax(alike, axis=1)
    frequency, shape = base.frequency[column], base.shape[:, column]
    at = {"G_f": G_f, "pressure": own.pressure}
    slopes = [
        _slope(evidence, name, resized, base.coordinate[:, column], at)
        for name, resized in evidence.resized.items()
    ]
    finer = (frequency, shape)
    if evidence.finer is not None:
        other = solve_modes(
            evidence.finer,
            G_f=G_f,
            d_f=D_F_START,
            n_mode=N_MODEL,
            observation=evidence.observation[configuration],
            parameters={"pressure": own.pressure},
            by=(),
        ).elastic()
        partner = pair(base.shape, base.frequency, other.shape, other.frequency)[1][column]
        finer = (other.frequency[partner], other.shape[:, partner])
    before, after = (unit_shapes(own.modes.shape, every)[1] for every in (shape, finer[1]))
    difference = EXTRAPOLATED * (after - before)
    same = (alike.max(axis=1) >= _MAC_SAME) & (np.linalg.norm(difference, axis=0) < _TURNED)
    return Shift(
        slope=np.column_stack(slopes),
        mesh=EXTRAPOLATED * np.log(finer[0] / frequency),
        mesh_shape=same * difference,
    )


def _slope(
    evidence: Assembled, name: str, resized: ReducedEquations, mode: Vector, at: Mapping[str, float]
) -> Vector:
    """Return how much the logarithm of each mode's frequency grows with that of a dimension (Rayleigh's quotient).

    What the basis got after the resized equations were made has little of a mode, and the quotient misses its square.
    """
    x = mode[: resized.size]

    def quotient(equations: ReducedEquations) -> Vector:
        theta = {**equations.theta, **at}
        stiffness, mass = (
            np.sum(x * (equations.matrix(target, theta)[: len(x), : len(x)] @ x), axis=0)
            for target in ("K", "M")
        )
        return np.asarray(stiffness / mass)

    ratio = getattr(resized.stack, name) / getattr(evidence.stack, name)
    return 0.5 * np.log(quotient(resized) / quotient(evidence.equations)) / np.log(ratio)


def _started(evidence: Assembled) -> Assembled:
    """Scan G_f for the value that explains most modes, and keep the measured modes that the model has there."""
    rough = evidence.rough
    G_f = min(np.geomspace(*G_F_RANGE, _TRIALS).tolist(), key=lambda trial: _matched(rough, trial)[0])
    _, used, mixed = _matched(evidence, G_f)
    unlike = [own.name for own, u in zip(evidence.tested, used, strict=True) if not u.size]
    if unlike:
        message = (
            f"no measured mode of {' or '.join(unlike)} resembles one of the model, so nothing of it would be used; "
            "check points, directions and signs there, and that its files are of this stack"
        )
        raise FitError(message)
    start = np.zeros(len(evidence.nuisances))
    if not evidence.touching:
        return replace(evidence, used=used, mixed=mixed, start=start)
    start[0] = np.log(G_f / evidence.stack.contact.G_f)
    start[1] = np.log(D_F_START / evidence.stack.contact.d_f) if evidence.stack.contact.d_f > 0 else 0.0
    return replace(evidence, used=used, mixed=mixed, start=start)


def _matched(
    evidence: Evidence, G_f: float
) -> tuple[float, tuple[NDArray[np.int64], ...], tuple[NDArray[np.int64], ...]]:
    """Return how far the measured modes are from the base model's in all, those that it has, and those that it mixes.

    Of two close modes the smallest error of a model makes mixtures: one that it has so is no mode that it lacks.
    """
    cost, used, mixed = 0.0, [], []
    for c, tested in enumerate(evidence.tested):
        modes = solved(evidence, c, {"G_f": G_f, "d_f": D_F_START}, (), N_MODEL)
        row, column = pair(tested.modes.shape, tested.modes.frequency, modes.shape, modes.frequency)
        alike = mac(tested.modes.shape, modes.shape)[row, column]
        far = np.log(tested.modes.frequency[row] / modes.frequency[column])
        cost += float(np.sum(np.minimum((far / 0.2) ** 2, 1.0) + 1.0 - alike))
        near = [np.abs(np.log(modes.frequency / modes.frequency[j])) < CLOSE for j in column]
        spanned = [
            span_mac(tested.modes.shape[:, [r]], modes.shape[:, own])[0]
            for r, own in zip(row, near, strict=True)
        ]
        used.append(row[alike >= _MAC_USED])
        mixed.append(row[(alike < _MAC_USED) & (np.array(spanned) >= _MAC_MIXED)])
    return cost, tuple(used), tuple(mixed)
