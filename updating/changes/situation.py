"""A state beside its reference in the equations of one model: errors of both, what they share, and what scatters.

Three things make the equation errors of two states of one structure alike. The model's discrepancy is the same but for
what is assembled anew. Sensors read too much or too little at the same points, as long as they stay; each state adds a
scatter of its own where they are put back. And shapes are rough in the same way where points are not where the list has
them. Sizes of these are estimated from what no mode of the model reaches of the shapes.

A sensor that reads g too much turns every shape by g u_r(i) at its point, which looks like a mass there but for the
frequencies. So errors of one gain in all modes of a state are no independent noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
import scipy.linalg as la
from numpy.typing import NDArray

from updating.changes.candidate import Part
from updating.changes.fields import Fields
from updating.changes.kinds.clamp_force import under_clamps
from updating.changes.kinds.everywhere import edges, whole_contact, whole_laminas
from updating.changes.scan import Actions, Measured
from updating.correlation.registration import register
from updating.diagnosis.assembly import Campaigned, assemble_evidence
from updating.diagnosis.candidates import CandidateModel
from updating.diagnosis.diagnosis import SHARES, priors_of, start_of
from updating.diagnosis.evidence import DiagnosisScatter, Tested
from updating.diagnosis.stack_model import StackModel
from updating.errors import FitError
from updating.inference.discrepancy import STIFFNESS, joined
from updating.inference.equation_error import Errors, equation_errors, shape_noise
from updating.inference.explain import Explanation, explain
from updating.inference.protocol import Modal, State
from updating.inference.search import begin, extended

Vector = NDArray[np.float64]

_LEAST = 0.1  # of a shape's noise that is independent, whatever is estimated to be common


@dataclass(frozen=True, eq=False, kw_only=True)
class SensorErrors:
    """Sizes of the errors of shapes, standard deviations.

    Attributes
    ----------
    gain_common, gain_state : float
        Relative errors of each sensor that all states share, and that each state has.
    rough_common : float
        Of components of shapes of unit length, the same in all states.
    """

    gain_common: float
    gain_state: float
    rough_common: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Joint:
    """Equation errors of several states of one structure.

    Attributes
    ----------
    errors : tuple of Errors
        By state.
    value : (N,) float
        All of them, mode by mode.
    common, own : (N, N) float
        Covariance by a discrepancy of size 1 that all states share, and that each has.
    noise : (N, N) float
        Covariance by what is wrong with shapes and frequencies.
    state : (N,) int
        Which state each belongs to.
    scale : tuple of (n, m) float
        omega_s omega_r of each state.
    sensors : SensorErrors
        What was estimated of the sensors.
    """

    errors: tuple[Errors, ...]
    value: Vector
    common: Vector
    own: Vector
    noise: Vector
    state: NDArray[np.intp]
    scale: tuple[Vector, ...]
    sensors: SensorErrors


def joint_errors(states: Sequence[State], modals: Sequence[Modal]) -> Joint:
    """Put measured modes of several states into the equations of a model.

    Parameters
    ----------
    states : sequence of State
        What was measured, at the same points where roughness is to cancel.
    modals : sequence of Modal
        The model of each.
    """
    modals = [_at_rest(modal) for modal in modals]
    noise = [shape_noise(state, modal) for state, modal in zip(states, modals, strict=True)]
    errors = tuple(
        equation_errors(state, modal, n, 1) for state, modal, n in zip(states, modals, noise, strict=True)
    )
    n_state = len(states)
    problem = joined(errors, np.ones((n_state, n_state)))
    own = joined(errors, np.eye(n_state)).discrepancy
    sensors = sensor_errors(states, modals, errors)
    return Joint(
        errors=errors,
        value=problem.value,
        common=problem.discrepancy,
        own=own,
        noise=_noise(states, modals, errors, noise, sensors),
        state=np.concatenate([np.full(e.value.size, c) for c, e in enumerate(errors)]),
        scale=tuple(_scale(state, modal) for state, modal in zip(states, modals, strict=True)),
        sensors=sensors,
    )


def _at_rest(modal: Modal) -> Modal:
    """Return a model of which nothing moves."""
    none = np.zeros(0, dtype=np.intp)
    return replace(
        modal,
        moves=none,
        stiffness=modal.stiffness[:0],
        mass=modal.mass[:0],
        beyond_stiffness=modal.beyond_stiffness[:0],
        beyond_mass=modal.beyond_mass[:0],
        looks=none,
        row_change=modal.row_change[:0],
        damps=none,
        damping_change=modal.damping_change[:0],
        of_mode_moves=none,
    )


def _scale(state: State, modal: Modal) -> Vector:
    """Return what errors are relative to, (n, m), as `equation_errors` has it."""
    omega = 2.0 * np.pi * state.frequency
    own = np.sqrt(np.maximum(modal.eigenvalue, 0.0))
    elastic = np.arange(own.size) >= modal.n_rigid
    return np.asarray(omega[:, None] * np.where(elastic, own, omega[:, None]))


def sensor_errors(states: Sequence[State], modals: Sequence[Modal], errors: Sequence[Errors]) -> SensorErrors:
    """Estimate what the errors of shapes have in common, from what no mode of the model reaches of them.

    Pairs of modes show it: residuals of two modes at one sensor have the sign of the product of the shapes there where
    it reads too much. States that were measured at other points share nothing.
    """
    rests, free = [], []
    for state, modal in zip(states, modals, strict=True):
        basis = la.orth(modal.rows, rcond=1e-3)
        rests.append(state.shape - basis @ (basis.T @ state.shape))
        free.append(1.0 - basis.shape[1] / len(basis))
    if min(free) < 0.2 or len({len(rest) for rest in rests}) > 1:  # too little is left to see anything
        return SensorErrors(gain_common=0.0, gain_state=0.0, rough_common=0.0)
    within, between, same = np.zeros((3, 2))
    for c, (one, rest) in enumerate(zip(states, rests, strict=True)):
        for d in range(c + 1):
            other, rest_other = states[d], rests[d]
            share = float(np.sqrt(free[c] * free[d]))
            product = rest.T @ rest_other, one.shape.T @ other.shape
            shapes = np.einsum("ir,iq->irq", one.shape, other.shape)
            left = np.einsum("ir,iq->irq", rest, rest_other)
            overlap = errors[c].weight @ errors[d].weight.T
            apart = np.abs(overlap) < 0.3
            if c == d:
                apart &= ~np.eye(len(overlap), dtype=bool)
            sums = np.array([np.sum((left * shapes)[:, apart]), share * np.sum((shapes**2)[:, apart])])
            if c == d:
                within += sums
            else:
                between += sums
                alike = np.abs(overlap) > 0.7
                same += np.array(
                    [np.sum((product[0] * overlap)[alike]), share * len(rest) * np.sum(overlap[alike] ** 2)]
                )
    gain_all = within[0] / max(within[1], 1e-300)
    gain_common = min(max(between[0] / max(between[1], 1e-300), 0.0), max(gain_all, 0.0))
    n_dof = len(rests[0])
    rough = max(same[0] / max(same[1], 1e-300) - gain_common / n_dof, 0.0)
    return SensorErrors(
        gain_common=float(np.sqrt(gain_common)),
        gain_state=float(np.sqrt(max(gain_all - gain_common, 0.0))),
        rough_common=float(np.sqrt(rough)),
    )


def _noise(
    states: Sequence[State],
    modals: Sequence[Modal],
    errors: Sequence[Errors],
    noise: Sequence[Vector],
    sensors: SensorErrors,
) -> Vector:
    """Return the covariance of all errors by what is wrong with shapes and frequencies, (N, N)."""
    maps, blocks, gains = [], [], []
    for state, modal, own, n in zip(states, modals, errors, noise, strict=True):
        gap = _gap(state, modal)
        on_frequency = (2.0 * state.frequency_std / state.frequency) ** 2 + 1e-9
        whole = own.noise.copy()
        m = gap.shape[1]
        whole[:, np.arange(m), np.arange(m)] -= on_frequency[:, None] * own.weight**2
        covariance = whole / gap[:, :, None] / gap[:, None, :]
        towards = (
            covariance @ modal.rows.T / n[:, None, None] ** 2
        )  # (n, m, n_dof), but for the shape's length
        raw = np.einsum("rmi,ir->rm", towards, state.shape)
        length = np.linalg.norm(own.value / gap, axis=1) / np.maximum(np.linalg.norm(raw, axis=1), 1e-300)
        towards = towards * (length[:, None, None] * gap[:, :, None])  # from a shape to equation errors
        at_random = np.einsum("rmi,rki->rmk", towards, towards) * n[:, None, None] ** 2
        shared = (sensors.gain_common**2 + sensors.gain_state**2) / len(state.shape) + sensors.rough_common**2
        share = np.maximum(1.0 - shared / n**2, _LEAST)
        blocks += list(own.noise - at_random + share[:, None, None] * at_random)
        maps.append(towards)
        gains.append(towards * state.shape.T[:, None, :])
    total = la.block_diag(*blocks)
    sizes = [own.value.size for own in errors]
    first = np.cumsum([0, *sizes])
    for c, one in enumerate(maps):
        for d, other in enumerate(maps):
            here, there = slice(first[c], first[c + 1]), slice(first[d], first[d + 1])
            if one.shape[2] != other.shape[2]:
                continue
            by_gain = sensors.gain_common**2 + (sensors.gain_state**2 if c == d else 0.0)
            flat = gains[c].reshape(-1, one.shape[2]), gains[d].reshape(-1, one.shape[2])
            total[here, there] += by_gain * (flat[0] @ flat[1].T)
            if sensors.rough_common:
                alike = errors[c].weight @ errors[d].weight.T
                rough = (one.reshape(-1, one.shape[2]) @ other.reshape(-1, one.shape[2]).T).reshape(
                    len(one), one.shape[1], len(other), one.shape[1]
                )
                total[here, there] += (sensors.rough_common**2 * rough * alike[:, None, :, None]).reshape(
                    total[here, there].shape
                )
    return np.asarray((total + total.T) / 2.0 + 1e-10 * np.eye(len(total)))


def _gap(state: State, modal: Modal) -> Vector:
    gap = ((2.0 * np.pi * state.frequency[:, None]) ** 2 - modal.eigenvalue) / _scale(state, modal)
    return np.where(np.abs(gap) < 1e-9, 1e-9, gap)


SCATTER_SPREAD = math.log(2.0) / 1.645
"""Standard deviation of the logarithm of the scatter between two assemblies: nine of ten laboratories know it within a
factor of 2 where they state it, or measure a few repeats."""

MOUNTING = 0.1
"""Relative standard deviation, from one mounting to the next, of what holds an edge against moving and against turning:
10 % of it moves the modes of a held plate by some 0.4 %, as a plate did that was clamped anew."""

TIGHTENING = 0.03
"""The same of the contact under one clamp whose bolt is tightened to the same torque again; between bolts friction
makes it 17 to 23 % (VDI 2230), which the reference has as well."""

TEMPERATURE = 2e-3
"""The same of the stiffness of everything: 5 K."""

EXPLAINED = 0.5
"""Share of the misfit beyond the scatter below which the likeliest change explains too little to be named."""

IN_FULL = 0.9
"""The same below which more changed than that, or otherwise."""

REACHED = 0.9
"""Share of a shape's square that the model's modes reach, below which a measured mode is none of the structure's."""

IDEAL = 0.15
"""Share by which a kind of change is off, as an idealisation of what happened and taken to first order: its effect on
each eigenvalue counts as a scatter of that share of all shifts."""

TWIN = 0.7
"""Cosine between the modal coordinates of two modes of one state from which they are one that was identified twice."""

SAME = 0.6
"""The same of two states from which a mode of one is a mode of the other."""

STILL = 1e-3
"""Motion of a mode at the sensors, over the median of all modes, below which a single plate moves in its plane, which
no change couples to its bending."""

NEARBY = 0.3
"""Relative difference of eigenvalues within which a mode that the reference does not have may be what shows."""

FEWEST = 3
"""Modes of a state and of its reference, below which nothing is compared with a model."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedReference:
    """A model that was fitted to a reference: about this point changes are looked for.

    Attributes
    ----------
    candidates : CandidateModel
        The reduced model.
    tested : tuple of (str, float, ModalModel)
        Name, pressure in Pa and modes of the reference and of its repeats.
    model : StackModel
        The model beside the first of them.
    fit : Explanation
        Its fit.
    """

    candidates: CandidateModel
    tested: tuple[Campaigned, ...]
    model: StackModel
    fit: Explanation


def fit_reference(
    candidates: CandidateModel, tested: Sequence[Campaigned], *, scatter: DiagnosisScatter | None = None
) -> FittedReference:
    """Fit the base model to a reference; held edges may give way, for no edge is rigid.

    Parameters
    ----------
    candidates : CandidateModel
        The reduced model, with the effects that are fitted where they raise the evidence.
    tested : sequence of (str, float, ModalModel)
        The reference and its repeats; the first is fitted, for what it shares with the others cancels.
    scatter : DiagnosisScatter, optional
        Priors of what is known of the structure.

    Raises
    ------
    FitError
        No measured mode resembles one of the model.
    PairingError
        Measured points do not lie on the stack.
    """
    evidence = assemble_evidence(candidates, tested[:1], scatter=scatter)
    model = StackModel(
        candidates,
        evidence.tested,
        evidence.observation,
        evidence.scatter,
        evidence.effects,
        start=evidence.start["G_f"],
    )
    common, fit = begin(
        model, shares=SHARES, starts=[start_of(model, evidence)], priors=priors_of(evidence.scatter)
    )
    for one in extended(model, common, fit)[:1] if model.effects else ():
        own = explain(model, [model.terms[name] for name in one.terms], common, one.x)
        fit = own if own.log_evidence > fit.log_evidence else fit
    return FittedReference(candidates=candidates, tested=tuple(tested), model=model, fit=fit)


class Situation:
    """A state and its reference in the equations of one model."""

    def __init__(self, reference: FittedReference, changed: Sequence[Campaigned]) -> None:
        self.reference, self.changed = reference, changed
        before, stack = reference.model, reference.candidates.stack
        tested = [Tested(name=n, pressure=p, modes=m) for n, p, m in (*reference.tested, *changed)]
        observation = [
            register(stack, own.modes.geometry, own.modes.node, own.modes.direction).observation  # type: ignore[attr-defined]
            for own in tested
        ]
        model = StackModel(
            reference.candidates,
            tested,
            observation,
            before.scatter,
            before.effects,
            start=before.start,
            n_equation=before.n_equation,
            like=before,
        )
        local = model.about(reference.fit.coordinates, [reference.fit.x])
        modals = [local.modal(reference.fit.x, c) for c in range(len(tested))]
        pairs = [_distinct(state, modal) for state, modal in zip(model.states, modals, strict=True)]
        self.n_reference = len(reference.tested)
        _require_modes([state for state, _ in pairs])
        states, modals, self.joint = _known(pairs, self.n_reference, STILL if stack.n_lamina == 1 else 0.0)
        _require_modes(states)
        self.states = states
        at = dict(zip((c.name for c in reference.fit.coordinates), reference.fit.x.tolist(), strict=True))
        theta = model.theta(at, self.n_reference)[0]
        every = np.concatenate([state.frequency for state in states])
        band = float(every.min()), float(every.max())
        system = reference.candidates.system
        self.modes = local.basis @ modals[self.n_reference].shape  # in the basis of the system
        self.fields = Fields(system, system.basis @ self.modes, theta, band)
        self.measured = [
            Measured(weight=own.weight, eigenvalue=own.eigenvalue, scale=scale)
            for own, scale in zip(self.joint.errors, self.joint.scale, strict=True)
        ]
        ours = self.measured[self.n_reference :]
        self.ours = Measured(
            weight=np.vstack([own.weight for own in ours]),
            eigenvalue=np.concatenate([own.eigenvalue for own in ours]),
            scale=np.vstack([own.scale for own in ours]),
        )
        self.is_changed = self.joint.state >= self.n_reference
        self.nuisance = self._nuisance()
        self.idealised = 0.0  # size of the scatter that a change brings which is none of the kinds exactly

    def _nuisance(self) -> Vector:
        """Return the covariance of errors by what is a little different in each assembly, (N, N)."""
        fields, scatter = self.fields, self.reference.model.scatter
        varied: list[tuple[Part, float]] = [(whole_laminas(fields), TEMPERATURE)]
        varied += [(part, MOUNTING) for part in edges(fields)]
        if fields.stack.n_lamina > 1:
            varied.append((whole_contact(fields), scatter.stiffness))
            varied += [(part, TIGHTENING) for part in under_clamps(fields)]
        total = np.zeros((self.joint.value.size,) * 2)
        for c, measured in enumerate(self.measured):
            here = self.joint.state == c
            actions = Actions(measured)
            for part, std in varied:
                at = actions.at_points(part)
                change = std * (part.weight @ at.reshape(len(at), -1)).ravel()
                total[np.ix_(here, here)] += np.outer(change, change)
        return total

    def covariance(self, size: float) -> Vector:
        """Return the covariance of all errors at a size of the scatter between assemblies, (N, N)."""
        common = max(self.reference.fit.evidence.sizes.stiffness, size, STIFFNESS.median)
        joint = self.joint
        total = common**2 * joint.common + size**2 * joint.own + self.nuisance + joint.noise
        here = np.ix_(self.is_changed, self.is_changed)
        total[here] += self.idealised**2 * joint.own[here]
        return np.asarray(total)

    @cached_property
    def shift(self) -> Vector:
        """Logarithm of each frequency of the changed state over the reference's, (n_mode,); NaN where that has none.

        A mode of the reference is the same one where most of it is, in the model's modal coordinates.
        """
        return self._beside([state.frequency for state in self.states])[0]

    @cached_property
    def damping_shift(self) -> Vector:
        """The same of its damping ratios."""
        return self._beside([ratio for ratio, _ in self._damping])[0]

    @cached_property
    def damping(self) -> Vector:
        """Damping ratio of each such mode in the reference, (n_mode,)."""
        return self._beside([ratio for ratio, _ in self._damping])[1]

    @cached_property
    def damping_noise(self) -> Vector:
        """Relative standard deviation of each damping ratio of the changed state, (n_mode,)."""
        return np.concatenate([std / ratio for ratio, std in self._damping[self.n_reference :]])

    @cached_property
    def _damping(self) -> list[tuple[Vector, Vector]]:
        """Damping ratios of the modes of all states and their standard deviations, NaN where there is none."""
        found = []
        for (_, _, modes), state in zip((*self.reference.tested, *self.changed), self.states, strict=True):
            which = np.argmin(np.abs(modes.frequency[:, None] - state.frequency), axis=0)
            ratio = np.where(modes.damping[which] > 0.0, modes.damping[which], np.nan)
            found.append((ratio, np.nan_to_num(modes.damping_std[which])))
        return found

    def _beside(self, values: Sequence[Vector]) -> tuple[Vector, Vector]:
        """Return logarithms of values of the changed state over the reference's, and the reference's, (n_mode,)."""
        n, ratios, before = self.n_reference, [], []
        for own, value in zip(self.joint.errors[n:], values[n:], strict=True):
            each = np.full((n, value.size), np.nan)
            for c, (other, reference) in enumerate(zip(self.joint.errors[:n], values[:n], strict=True)):
                row, column = _pairs(np.abs(own.weight @ other.weight.T))
                each[c, row] = np.log(reference[column])
            seen = np.isfinite(each).any(axis=0)
            mean = np.full(value.size, np.nan)
            mean[seen] = np.nanmean(each[:, seen], axis=0)
            ratios.append(np.log(value) - mean)
            before.append(np.exp(mean))
        return np.concatenate(ratios), np.concatenate(before)


def _require_modes(states: Sequence[State]) -> None:
    """Refuse states that have too few modes in common with the model or with the reference."""
    for state in states:
        if state.frequency.size < FEWEST:
            message = (
                f"{state.name}: {state.frequency.size} of its modes are ones of the model and of the reference, and "
                f"what changed takes {FEWEST}; check points, directions and signs, and that all are of one structure"
            )
            raise FitError(message)


def _known(
    pairs: Sequence[tuple[State, Modal]], n_reference: int, still: float
) -> tuple[list[State], list[Modal], Joint]:
    """Return states without those modes of the changed one that the reference does not have.

    What the model is wrong by in a mode cancels only there. A resonator splits a mode in two, both of which are that
    one, or some of several: such a further mode counts as well, unless the model has one nearby that was not measured
    in the reference. A change may couple that to those which are seen, and it is then what shows; `still` is the motion
    at the sensors below which nothing does, such as of a single plate in its plane.
    """
    states, modals = [state for state, _ in pairs], [modal for _, modal in pairs]
    joint = joint_errors(states, modals)
    shorter = False
    for c in range(n_reference, len(states)):
        own = joint.errors[c]
        alike = [np.abs(own.weight @ other.weight.T) for other in joint.errors[:n_reference]]
        near = np.abs(own.eigenvalue[:, None] / np.maximum(modals[c].eigenvalue, 1e-300) - 1.0) < NEARBY
        taken = (
            np.max([np.abs(other.weight).max(axis=0) for other in joint.errors[:n_reference]], axis=0) > SAME
        )
        unseen = np.any(near & (_motion(modals[c]) >= still) & ~taken, axis=1)
        keep = np.max([one.max(axis=1) for one in alike], axis=0) > SAME
        keep |= (
            np.max([_within(own.weight, other.weight) for other in joint.errors[:n_reference]], axis=0)
            > REACHED
        )
        for r in np.flatnonzero(keep & unseen):
            keep[r] = any(r in _pairs(one)[0] for one in alike)
        if not keep.all():
            states[c], modals[c] = _only(states[c], modals[c], np.flatnonzero(keep))
            shorter = True
    return states, modals, joint_errors(states, modals) if shorter else joint


def _within(weight: Vector, other: Vector) -> Vector:
    """Return which share of the square of each mode, (n, m), lies in the space that others span, (n,)."""
    return np.asarray(np.sum((weight @ la.orth(other.T)) ** 2, axis=1) / np.sum(weight**2, axis=1))


def _motion(modal: Modal) -> Vector:
    """Return how much the modes of a model move the sensors, over the median of all, (m,)."""
    size = np.linalg.norm(modal.rows, axis=0)
    return np.asarray(size / np.median(size))


def _pairs(alike: Vector) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return which modes of two states are the same, one for one, by the cosines between their modal coordinates."""
    row, column = scipy.optimize.linear_sum_assignment(alike, maximize=True)
    good = alike[row, column] > SAME
    return row[good], column[good]


def _distinct(state: State, modal: Modal) -> tuple[State, Modal]:
    """Return a state without modes that the model's do not reach, and without those that were identified twice."""
    basis = la.orth(modal.rows, rcond=1e-3)
    rest = np.sum((state.shape - basis @ (basis.T @ state.shape)) ** 2, axis=0)
    # coordinates in which shapes of modes that the sensors see are orthogonal
    a = la.lstsq(modal.rows, state.shape, cond=1e-2)[0]
    a = a / np.maximum(np.linalg.norm(a, axis=0), 1e-300)
    kept: list[int] = []
    for r in np.argsort(rest).tolist():
        near = np.array(
            [abs(np.log(state.frequency[r] / state.frequency[k])) < 0.02 for k in kept], dtype=bool
        )
        twin = np.abs(a[:, kept].T @ a[:, r]) > TWIN if kept else np.zeros(0, dtype=bool)
        if rest[r] < 1.0 - REACHED and not np.any(twin & near):
            kept.append(r)
    return _only(state, modal, np.sort(np.array(kept, dtype=np.intp)))


def _only(state: State, modal: Modal, use: NDArray[np.intp]) -> tuple[State, Modal]:
    """Return a state with some of its modes, without damping, and the model of them."""
    chosen = replace(
        state,
        frequency=state.frequency[use],
        frequency_std=state.frequency_std[use],
        damping=np.full(use.size, np.nan),
        damping_std=state.damping_std[use],
        shape=state.shape[:, use],
        shape_std=state.shape_std[use],
    )
    of_mode = None if modal.of_mode is None else modal.of_mode[use]
    return chosen, replace(modal, damping=modal.damping[:1], of_mode=of_mode)
