"""Responses to a force by superposition of modes with a static residual."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Literal, get_args

import numpy as np
import scipy.sparse as sp

from lamella_shared import Complexes, Reals
from model.elements.equations import OMEGA, Riding, Target, Term
from model.modes.modes import Observation, full_parameters, observe
from model.reduction.reduction import ReducedSystem, shifted_factor
from model.solvers.eigen import completed, orthonormalize
from model.stack.errors import SolveError

Quantity = Literal["receptance", "mobility", "accelerance"]


def frf(
    system: ReducedSystem,
    *,
    G_f: float,
    d_f: float,
    frequency: Reals,
    output: Observation,
    input: Observation,  # noqa: A002  # the field's word for where the force acts
    quantity: Quantity = "accelerance",
    parameters: Mapping[str, float] | None = None,
) -> Complexes:
    """Synthesise frequency response functions from the modes of the reduced system.

    The static residual of the modes that the reduced system lacks enters through one attachment vector for
    each input and each output, (K + s M)^-1 f with the shift s that makes K positive definite (Craig and
    Kurdila, Fundamentals of Structural Dynamics, 2nd ed., chapter 17). Both have theirs, so that the functions
    do not depend on which end the force acts at. The modes stay coupled by the damping matrix:
    at a driving point the contact's share of the residual is damped too, and a modal damping alone missed
    that by a tenth.

    Parameters
    ----------
    system : ReducedSystem
        The reduced stack.
    G_f, d_f : float
        Contact parameters, Pa/Pa and s/Pa.
    frequency : (n_frequency,)
        Lines, Hz.
    output, input : Observation
        Where the motion is taken and where unit forces act.
    quantity : "receptance", "mobility" or "accelerance"
        m/N, m/(N s) or m/(N s2).
    parameters : mapping of str to float, optional
        Values of further parameters that differ from `system.theta`.

    Returns
    -------
    (n_output, n_input, n_frequency) complex

    Raises
    ------
    SolveError
        The quantity or a parameter is unknown, or a frequency is not positive.
    """
    frequency = np.asarray(frequency, dtype=float)
    _require_sound(quantity, frequency)
    theta = full_parameters(system, G_f, d_f, parameters)
    rows_out, rows_in = observe(system, output).rows, observe(system, input).rows
    if OMEGA in theta:
        theta = {**theta, OMEGA: 2.0 * np.pi * float(np.median(frequency))}
    reduced, basis = _with_attachments(system, theta, sp.vstack([rows_in, rows_out]).tocsr())
    following = _following_terms(system, theta, basis)
    omega = 2.0 * np.pi * frequency
    value = _superposed(reduced, following, theta, omega, (rows_in @ basis).T, rows_out @ basis)
    return value * (1j * omega) ** get_args(Quantity).index(quantity)


def _with_attachments(
    system: ReducedSystem, theta: Mapping[str, float], load: sp.csr_matrix
) -> tuple[dict[Target, Reals], Reals]:
    """Return the matrices in the reduced basis extended by the attachment vectors of loads, and that basis.

    Without what rides on the structure, which acts line by line.
    """
    steady = [term for term in system.assembly.terms if not isinstance(term.factor, Riding)]
    assembly = dataclasses.replace(system.assembly, terms=tuple(steady))
    krons = {target: assembly.krons(target, theta) for target in get_args(Target)}
    n, displaced = system.n_displaced, system.basis[:, : system.n_displaced]

    factor = shifted_factor(assembly, theta)
    attachment, _ = orthonormalize(
        factor.solve(load.T.toarray()),
        lambda x: assembly.apply(krons["M"], x),
        [(displaced, assembly.apply(krons["M"], displaced))],
    )
    basis = np.hstack([displaced, attachment])
    reduced = {
        target: completed(system.matrix(target, theta)[:n, :n], basis.T @ assembly.apply(parts, attachment))
        for target, parts in krons.items()
    }
    return reduced, basis


def _require_sound(quantity: str, frequency: Reals) -> None:
    if quantity not in get_args(Quantity):
        raise SolveError(f"quantity must be one of {', '.join(get_args(Quantity))}, got {quantity!r}")
    if frequency.size and not frequency.min() > 0.0:
        raise SolveError(
            f"frequencies must be positive: a free stack has no static response; got {frequency.min():g} Hz"
        )


def _superposed(
    reduced: Mapping[Target, Reals],
    following: list[tuple[Term, Reals]],
    theta: Mapping[str, float],
    omega: Reals,
    load: Reals,
    response: Reals,
) -> Complexes:
    """Return the receptances (n_output, n_input, n_frequency) of matrices in a basis.

    `following` are the terms whose factor depends on frequency; the matrices have them at that of `theta`, but nothing
    of what rides on the structure.
    """
    lines_at_once = 256
    value = np.empty((response.shape[0], load.shape[1], omega.size), dtype=complex)
    for first in range(0, omega.size, lines_at_once):
        lines = omega[first : first + lines_at_once, None, None]
        dynamic = reduced["K"] + 1j * lines * reduced["C"] - lines**2 * reduced["M"]
        for term, matrix in following:
            at = [term.factor({**theta, OMEGA: float(line)}) for line in lines.ravel()]
            held = 0.0 if isinstance(term.factor, Riding) else term.factor(theta)
            change = np.array(at)[:, None, None] - held
            power = {"K": 0, "C": 1, "M": 2}[term.target]
            dynamic += change * (1j * lines) ** power * matrix
        solved = np.linalg.solve(dynamic, np.broadcast_to(load, (lines.size, *load.shape)))
        value[:, :, first : first + lines_at_once] = (response @ solved).transpose(1, 2, 0)
    return value


def _following_terms(system: ReducedSystem, theta: Mapping[str, float], basis: Reals) -> list[tuple[Term, Reals]]:
    """Return the terms whose factor depends on frequency, with their matrices in a basis."""
    if OMEGA not in theta:
        return []
    return [
        (term, basis.T @ system.assembly.apply(term.krons, basis))
        for term in system.assembly.terms
        if term.factor.derivative(theta, OMEGA) != 0.0
    ]
