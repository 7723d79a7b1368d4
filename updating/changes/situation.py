"""A state beside its reference in the equations of one model, and what scatters from one assembly to the next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy
import scipy.linalg as la
from numpy.typing import NDArray

from updating.changes.joint import Joint, joint_errors
from updating.changes.reference import FittedReference
from updating.changes.scan import Actions, Measured
from updating.diagnosis.evidence import Campaigned
from updating.diagnosis.stack_model import n_gain
from updating.errors import FitError
from updating.inference.discrepancy import STIFFNESS
from updating.inference.equation_error import Errors
from updating.inference.protocol import Modal, State

Vector = NDArray[np.float64]

SCATTER_SPREAD = math.log(2.0) / 1.645
"""Standard deviation of the logarithm of the scatter between two assemblies: nine of ten laboratories know it within a
factor of 2 where they state it, or measure a few repeats."""

EXPLAINED = 0.5
"""Share of the misfit beyond the scatter below which the likeliest change explains too little to be named."""

IN_FULL = 0.9
"""The same below which more changed than that, or otherwise."""

REACHED = 0.9
"""Share of a shape's square that the model's modes reach, below which a measured mode is none of the structure's."""

IDEAL = 0.1
"""Share by which a kind of change is off, as an idealisation of what happened: its effect on each eigenvalue counts as
a scatter of that share of all shifts. Cracks of 140 mm in a plate of 300 mm, which other finite elements slit open,
differ by 9 % from the law of `updating.changes.kinds.crack` once the amplitude is fitted."""

TWIN = 0.7
"""Cosine between the modal coordinates of two modes of one state from which they are one that was identified twice."""

SAME = 0.6
"""The same of two states from which a mode of one is a mode of the other."""


class Situation:
    """A state and its reference in the equations of one model.

    Parameters
    ----------
    reference : FittedReference
        The reference.
    changed : sequence of (str, float, ModalModel)
        The state and its repeats.
    stated : float
        Size of the scatter between two assemblies that the campaign states.
    """

    def __init__(self, reference: FittedReference, changed: Sequence[Campaigned], stated: float) -> None:
        self.reference, self.changed = reference, changed
        beside, self.n_reference = reference.beside(changed), len(reference.tested)
        pairs = [_distinct(state, modal) for state, modal in zip(beside.states, beside.modals, strict=True)]
        _require_modes([state for state, _ in pairs])
        sensor = [modes.sensor for _, _, modes in (*reference.tested, *changed)]
        roving = (sensor, reference.gain) if n_gain(sensor) else ((), 0.0)
        self.states, _, self.joint = _known(pairs, self.n_reference, reference.still, roving)
        _require_modes(self.states)
        every = np.concatenate([state.frequency for state in self.states])
        self.structure = beside.structure((float(every.min()), float(every.max())))
        self.sensors = beside.sensors[self.n_reference :]
        self.measured = [
            Measured(weight=error.weight, eigenvalue=error.eigenvalue, scale=scale)
            for error, scale in zip(self.joint.errors, self.joint.scale, strict=True)
        ]
        ours = self.measured[self.n_reference :]
        self.ours = Measured(
            weight=np.vstack([one.weight for one in ours]),
            eigenvalue=np.concatenate([one.eigenvalue for one in ours]),
            scale=np.vstack([one.scale for one in ours]),
        )
        self.is_changed = self.joint.state >= self.n_reference
        self.nuisance = self._nuisance(stated)
        self.idealised = 0.0  # size of the scatter that a change brings which is none of the kinds exactly

    def _nuisance(self, stated: float) -> Vector:
        """Return the covariance of errors by what is a little different in each assembly, (N, N), at a scatter of 1.

        What may differ is known as a most that workshops do: together it moves frequencies by no more than the campaign
        states that assembly does.
        """
        varied = self.reference.scattered(self.structure)
        total, squares = np.zeros((self.joint.value.size,) * 2), 0.0
        for c, measured in enumerate(self.measured):
            here = self.joint.state == c
            actions = Actions(measured)
            for part, std in varied:
                at = actions.at_points(part)
                change = std * (part.weight @ at.reshape(len(at), -1)).reshape(measured.scale.shape)
                total[np.ix_(here, here)] += np.outer(change, change)
                squares += float(np.mean(np.sum(change * measured.weight, axis=1) ** 2)) / len(self.measured)
        return np.asarray(total * min(1.0 / stated**2, 2.0 / squares))  # a scatter of 1 is of the root of 2

    def covariance(self, size: float, known: float) -> Vector:
        """Return the covariance of all errors, (N, N), where assembly scatters.

        Parameters
        ----------
        size : float
            Of the random perturbation of everything.
        known : float
            Of what is known to be a little different each time: it acts on all modes alike, as one of these alone may.
        """
        common = max(self.reference.fit.evidence.sizes.stiffness, size, STIFFNESS.median)
        joint = self.joint
        total = common**2 * joint.common + size**2 * joint.each + known**2 * self.nuisance + joint.noise
        here = np.ix_(self.is_changed, self.is_changed)
        total[here] += self.idealised**2 * joint.each[here]
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
        for error, value in zip(self.joint.errors[n:], values[n:], strict=True):
            each = np.full((n, value.size), np.nan)
            pairs = _pairs_of_repeats(error, self.joint.errors[:n])
            for c, ((row, column), reference) in enumerate(zip(pairs, values[:n], strict=True)):
                each[c, row] = np.log(reference[column])
            seen = np.isfinite(each).any(axis=0)
            mean = np.full(value.size, np.nan)
            mean[seen] = np.nanmean(each[:, seen], axis=0)
            ratios.append(np.log(value) - mean)
            before.append(np.exp(mean))
        return np.concatenate(ratios), np.concatenate(before)


def _require_modes(states: Sequence[State]) -> None:
    """Refuse states that have too few modes in common with the model or with the reference."""
    fewest = 3  # modes of a state and of its reference, below which nothing is compared with a model
    for state in states:
        if state.frequency.size < fewest:
            message = (
                f"{state.name}: {state.frequency.size} of its modes are ones of the model and of the reference, and "
                f"what changed takes {fewest}; check points, directions and signs, and that all are of one structure"
            )
            raise FitError(message)


def _known(
    pairs: Sequence[tuple[State, Modal]],
    n_reference: int,
    still: float,
    roving: tuple[Sequence[NDArray[np.int64]], float],
) -> tuple[list[State], list[Modal], Joint]:
    """Return states without those modes of the changed one that the reference does not have.

    What the model is wrong by in a mode cancels only there. A resonator splits a mode in two, both of which are that
    one, or some of several: such a further mode counts as well, unless the model has one nearby that was not measured
    in the reference. A change may couple that to those which are seen, and it is then what shows; `still` is the motion
    at the sensors below which nothing does, such as of a single plate in its plane; `roving` is as `joint_errors` takes
    it.
    """
    # Relative difference of eigenvalues within which a mode that the reference does not have may be what shows
    nearby = 0.3
    states, modals = [state for state, _ in pairs], [modal for _, modal in pairs]
    joint = joint_errors(states, modals, *roving)
    shorter = False
    for c in range(n_reference, len(states)):
        error = joint.errors[c]
        alike = [np.abs(error.weight @ other.weight.T) for other in joint.errors[:n_reference]]
        near = np.abs(error.eigenvalue[:, None] / np.maximum(modals[c].eigenvalue, 1e-300) - 1.0) < nearby
        taken = np.max([np.abs(other.weight).max(axis=0) for other in joint.errors[:n_reference]], axis=0) > SAME
        unseen = np.any(near & (_motion(modals[c]) >= still) & ~taken, axis=1)
        keep = np.max([one.max(axis=1) for one in alike], axis=0) > SAME
        keep |= np.max([_within(error.weight, other.weight) for other in joint.errors[:n_reference]], axis=0) > REACHED
        same = _pairs_of_repeats(error, joint.errors[:n_reference])
        for r in np.flatnonzero(keep & unseen):
            keep[r] = any(r in row for row, _ in same)
        if not keep.all():
            states[c], modals[c] = _only(states[c], modals[c], np.flatnonzero(keep))
            shorter = True
    return states, modals, joint_errors(states, modals, *roving) if shorter else joint


def _within(weight: Vector, other: Vector) -> Vector:
    """Return which share of the square of each mode, (n, m), lies in the space that others span, (n,)."""
    return np.asarray(np.sum((weight @ la.orth(other.T)) ** 2, axis=1) / np.sum(weight**2, axis=1))


def _motion(modal: Modal) -> Vector:
    """Return how much the modes of a model move the sensors, over the median of all, (m,)."""
    size = np.linalg.norm(modal.rows, axis=0)
    return np.asarray(size / np.median(size))


def _pairs(one: Errors, other: Errors) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return which modes of two states are the same, one for one.

    The cosines between their modal coordinates say so; of two that have the same shape, such as a mode beside one that
    sensors hardly see, the nearer one is it.
    """
    alike = np.abs(one.weight @ other.weight.T)
    apart = np.abs(np.log(one.eigenvalue[:, None] / other.eigenvalue)) / 2.0
    row, column = scipy.optimize.linear_sum_assignment(alike - apart, maximize=True)
    good = alike[row, column] > SAME
    return row[good], column[good]


def _pairs_of_repeats(one: Errors, references: Sequence[Errors]) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Return which modes of a state are the same as ones of each of some repeats, as `_pairs` does.

    All repeats of one mode are one of the state: half way between two that a resonator makes, either may be nearer.
    """
    taken, found = dict[tuple[int, int], int](), []
    for c, other in enumerate(references):
        of_first = dict(zip(*(index.tolist() for index in _pairs(other, references[0])), strict=True))
        row, column = _pairs(one, other)
        same = [(0, of_first[q]) if q in of_first else (c, q) for q in column.tolist()]
        keep = np.array([taken.setdefault(q, r) == r for q, r in zip(same, row.tolist(), strict=True)], dtype=bool)
        found.append((row[keep], column[keep]))
    return found


def _distinct(state: State, modal: Modal) -> tuple[State, Modal]:
    """Return a state without modes that the model's do not reach, and without those that were identified twice."""
    basis = la.orth(modal.rows, rcond=1e-3)
    rest = np.sum((state.shape - basis @ (basis.T @ state.shape)) ** 2, axis=0)
    # coordinates in which shapes of modes that the sensors see are orthogonal
    a = la.lstsq(modal.rows, state.shape, cond=1e-2)[0]
    a = a / np.maximum(np.linalg.norm(a, axis=0), 1e-300)
    kept: list[int] = []
    for r in np.argsort(rest).tolist():
        near = np.array([abs(np.log(state.frequency[r] / state.frequency[k])) < 0.02 for k in kept], dtype=bool)
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
