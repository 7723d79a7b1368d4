"""Equation errors of several states of one structure, what they share, and what is wrong with shapes in all of them.

Three things make the equation errors of two states of one structure alike. The model's discrepancy is the same but for
what is assembled anew. Sensors read too much or too little at the same points, as long as they stay; each state adds a
scatter of its own where they are put back. And shapes are rough in the same way where points are not where the list has
them. Sizes of these are estimated from what no mode of the model reaches of the shapes.

A sensor that reads g too much turns every shape by g u_r(i) at its point, which looks like a mass there but for the
frequencies. So errors of one gain in all modes of a state are no independent noise. One that roves does so at all of
its points alike, and two along the sides of a structure mix modes that bend with modes that twist: 2 % between them
looked like glue in a patch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from updating.inference.discrepancy import joined
from updating.inference.equation_error import Errors, equation_errors, shape_noise
from updating.inference.protocol import Modal, State

Vector = NDArray[np.float64]


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
    common, each : (N, N) float
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
    each: Vector
    noise: Vector
    state: NDArray[np.intp]
    scale: tuple[Vector, ...]
    sensors: SensorErrors


def joint_errors(
    states: Sequence[State], modals: Sequence[Modal], roving: Sequence[NDArray[np.int64]] = (), gain: float = 0.0
) -> Joint:
    """Put measured modes of several states into the equations of a model.

    Parameters
    ----------
    states : sequence of State
        What was measured, at the same points where roughness is to cancel.
    modals : sequence of Modal
        The model of each.
    roving : sequence of (n_dof,) int
        Which accelerometer measured each component, in each state; empty where none roves.
    gain : float
        Relative standard deviation of what one of these reads over the truth, anew in each state.
    """
    modals = [_at_rest(modal) for modal in modals]
    noise = [shape_noise(state, modal) for state, modal in zip(states, modals, strict=True)]
    errors = tuple(equation_errors(state, modal, n, 1) for state, modal, n in zip(states, modals, noise, strict=True))
    n_state = len(states)
    problem = joined(errors, np.ones((n_state, n_state)))
    each = joined(errors, np.eye(n_state)).discrepancy
    sensors = sensor_errors(states, modals, errors)
    return Joint(
        errors=errors,
        value=problem.value,
        common=problem.discrepancy,
        each=each,
        noise=_noise(states, modals, errors, noise, sensors, roving, gain),
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
    natural = np.sqrt(np.maximum(modal.eigenvalue, 0.0))
    elastic = np.arange(natural.size) >= modal.n_rigid
    return np.asarray(omega[:, None] * np.where(elastic, natural, omega[:, None]))


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
    roving: Sequence[NDArray[np.int64]],
    gain: float,
) -> Vector:
    """Return the covariance of all errors by what is wrong with shapes and frequencies, (N, N)."""
    least = 0.1  # of a shape's noise that is independent, whatever is estimated to be common
    maps, blocks, gains = [], [], []
    for state, modal, error, n in zip(states, modals, errors, noise, strict=True):
        gap = _gap(state, modal)
        on_frequency = (2.0 * state.frequency_std / state.frequency) ** 2 + 1e-9
        whole = error.noise.copy()
        m = gap.shape[1]
        whole[:, np.arange(m), np.arange(m)] -= on_frequency[:, None] * error.weight**2
        covariance = whole / gap[:, :, None] / gap[:, None, :]
        towards = covariance @ modal.rows.T / n[:, None, None] ** 2  # (n, m, n_dof), but for the shape's length
        raw = np.einsum("rmi,ir->rm", towards, state.shape)
        length = np.linalg.norm(error.value / gap, axis=1) / np.maximum(np.linalg.norm(raw, axis=1), 1e-300)
        towards = towards * (length[:, None, None] * gap[:, :, None])  # from a shape to equation errors
        at_random = np.einsum("rmi,rki->rmk", towards, towards) * n[:, None, None] ** 2
        shared = (sensors.gain_common**2 + sensors.gain_state**2) / len(state.shape) + sensors.rough_common**2
        share = np.maximum(1.0 - shared / n**2, least)
        blocks += list(error.noise - at_random + share[:, None, None] * at_random)
        maps.append(towards)
        gains.append(towards * state.shape.T[:, None, :])
    total = la.block_diag(*blocks)
    sizes = [one.value.size for one in errors]
    first = np.cumsum([0, *sizes])
    for c, number in enumerate(roving):
        here = slice(first[c], first[c + 1])
        for sensor in np.unique(number).tolist():
            turned = gains[c][:, :, number == sensor].sum(axis=2).ravel()
            total[here, here] += gain**2 * np.outer(turned, turned)
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
