"""Frequency response functions: modal superposition with the static residual of the modes above."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, get_args

import numpy as np
import scipy.sparse.linalg as splinalg
from numpy.typing import NDArray

from model.errors import SolveError
from model.modes import full_parameters, solve_modes
from model.observation import Observation, observation_rows
from model.reduction import ReducedSystem, shifted_factor

Quantity = Literal["receptance", "mobility", "accelerance"]


def frf(
    system: ReducedSystem,
    *,
    G_f: float,
    d_f: float,
    frequency: NDArray[np.float64],
    output: Observation,
    input: Observation,  # noqa: A002  # the field's word for where the force acts
    quantity: Quantity = "accelerance",
    n_mode: int = 22,
    parameters: Mapping[str, float] | None = None,
) -> NDArray[np.complex128]:
    """Synthesise frequency response functions by modal superposition.

    The modes above `n_mode` enter through their static flexibility,
    (K + s M)^-1 - sum_r phi phi' / (omega_r**2 + s) with the shift s that makes K positive definite; it is
    taken from the equations reduced over z only (Craig and Kurdila, Fundamentals of Structural Dynamics,
    2nd ed., 11.4).

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
    n_mode : int
        Modes in the sum, rigid-body modes included.
    parameters : mapping of str to float, optional
        Values of further parameters that differ from `system.theta`.

    Returns
    -------
    (n_output, n_input, n_frequency) complex
        A line at 0 Hz is infinite in receptance where rigid-body modes respond.

    Raises
    ------
    SolveError
        The quantity or a parameter is unknown, or a frequency is negative.
    """
    if quantity not in get_args(Quantity):
        message = f"quantity must be one of {', '.join(get_args(Quantity))}, got {quantity!r}"
        raise SolveError(message)
    frequency = np.asarray(frequency, dtype=float)
    if frequency.size and frequency.min() < 0.0:
        message = f"frequencies must not be negative, got {frequency.min():g} Hz"
        raise SolveError(message)
    theta = full_parameters(system, G_f, d_f, parameters)
    at_input = solve_modes(system, G_f=G_f, d_f=d_f, n_mode=n_mode, observation=input, parameters=parameters)
    rows_out, rows_in = observation_rows(system, output), observation_rows(system, input)
    shape_out = rows_out @ system.basis @ at_input.coordinate
    natural = 2.0 * np.pi * at_input.frequency

    factor, shift = shifted_factor(system, theta)
    flexibility = rows_out @ factor.solve(rows_in.T.toarray())
    flexibility -= (shape_out / (natural**2 + shift)) @ at_input.shape.T

    omega = 2.0 * np.pi * frequency
    modal = natural[:, None] ** 2 - omega**2 + 2j * (at_input.damping * natural)[:, None] * omega
    power = ("receptance", "mobility", "accelerance").index(quantity)
    scale = (1j * omega) ** power
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = scale / modal
    if power == 2:  # a free body's acceleration has a limit at 0 Hz: the rigid-body modes' own
        weight[:, omega == 0.0] = (natural == 0.0)[:, None]
    value = np.einsum("or,ir,rf->oif", shape_out, at_input.shape, weight, optimize=True)
    return np.asarray(value + flexibility[:, :, None] * scale)


def frf_direct(
    system: ReducedSystem,
    *,
    G_f: float,
    d_f: float,
    frequency: NDArray[np.float64],
    output: Observation,
    input: Observation,  # noqa: A002
    parameters: Mapping[str, float] | None = None,
) -> NDArray[np.complex128]:
    """Solve (K + i omega C - omega**2 M) x = f of the z-reduced equations at a few lines: the receptance.

    It assumes nothing about damping and truncates no mode, so it checks `frf`; each line costs a sparse
    complex factorisation.

    Parameters and returns as in `frf`.
    """
    theta = full_parameters(system, G_f, d_f, parameters)
    stiffness, damping, mass = (system.assembly.matrix(target, theta) for target in ("K", "C", "M"))
    rows_out, rows_in = observation_rows(system, output), observation_rows(system, input)
    lines = []
    for omega in 2.0 * np.pi * np.asarray(frequency, dtype=float):
        dynamic = (stiffness + 1j * omega * damping - omega**2 * mass).tocsc()
        lines.append(rows_out @ splinalg.spsolve(dynamic, rows_in.T.toarray().astype(complex)))
    return np.stack([np.reshape(line, (rows_out.shape[0], rows_in.shape[0])) for line in lines], axis=2)
