"""The functions of a fitted model where functions were measured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.types.frf import Quantity
from ema.types.geometry import Dofs, Geometry
from model import frf, reduce, solve_modes
from updating.correlation.registration import register
from updating.fitting.fit import Fit


def fitted_frf(
    fit: Fit,
    geometry: Geometry,
    *,
    output: Dofs,
    input: Dofs,  # noqa: A002  # the field's word for where the force acts
    frequency: NDArray[np.float64],
    quantity: Quantity,
) -> NDArray[np.complex128]:
    """Synthesise the functions of a fitted model from its modes, with the static residual of those left out.

    Where the modes are those of an ever finer mesh, lines are taken where this mesh has them, so that resonances lie at
    the frequencies of the modes.

    Parameters
    ----------
    fit : Fit
        The fitted model.
    geometry : Geometry
        Measured points, those of the forces among them.
    output, input : Dofs
        Measured DOFs of the responses and the forces.
    frequency : (n_frequency,) float
        Lines, Hz.
    quantity : {"receptance", "mobility", "accelerance"}
        What the response is.

    Returns
    -------
    (n_output, n_input, n_frequency) complex

    Raises
    ------
    PairingError
        A point has no coordinates, or lies too far from the stack.
    """
    responses, forces = (
        register(fit.stack, geometry, dofs.node, dofs.direction).observation for dofs in (output, input)
    )
    n_mode = 6 + fit.modes.frequency.size
    system = reduce(fit.stack, n_snapshot=1, n_mode=n_mode)  # in the middle of the range, at the fitted G_f
    G_f, d_f = fit.G_f.value, fit.d_f.value
    plain = solve_modes(system, G_f=G_f, d_f=d_f, n_mode=n_mode, observation=responses, by=()).elastic()
    n = min(plain.frequency.size, fit.modes.frequency.size)
    natural = np.sort(fit.modes.frequency[:n])
    ratio = np.interp(frequency, natural, np.sort(plain.frequency[:n]) / natural)
    return frf(
        system,
        G_f=G_f,
        d_f=d_f,
        frequency=ratio * frequency,
        output=responses,
        input=forces,
        quantity=quantity,
    )
