"""Modes that share a pole, or nearly so, put in the place of what a fit without their rank gave there.

A fit in which every function has residues of its own sees one pole where modes coincide and, where they hardly differ,
two with residues of large and opposite errors, or a third. Where forces act at several points, the rank of the residues
says how many modes there are (`ema.identification.rank_one`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.identification.rank_one import FALSE_ALARM, Around, RankOneModes, rank_one_modes
from ema.identification.shapes import shapes_from_residues
from ema.types.frf import DERIVATIVE, FRF
from ema.types.geometry import Dofs, driving_points
from ema.types.modal_model import ModalModel, synthesize

NEAR = 1.0
"""Half bandwidths within which residues of two poles are taken together: beyond, each pole has certain ones."""
ALIKE = 0.9
"""MAC from which on neighbouring poles are one mode."""
WINDOW = 10.0
"""Half bandwidths on each side of a pole over which its modes are sought."""
_FEWEST_LINES = 16


def with_repeated_roots(model: ModalModel, frf: FRF) -> ModalModel:
    """Put the modes that share a pole in the place of that pole.

    Parameters
    ----------
    model : ModalModel
        What was identified.
    frf : FRF
        The functions that it was identified from, on the lines of its band.

    Returns
    -------
    ModalModel
        The same one where there is one input, or where the residues of every pole are those of one mode.
    """
    if model.input.node.size == 1:
        return model
    pairs = driving_points(Dofs(node=model.node, direction=model.direction), model.input)
    rest = synthesize(model, frf.frequency, frf.quantity)
    np.subtract(frf.value, rest, out=rest)
    noise = np.log(np.sqrt(np.mean(np.abs(rest) ** 2, axis=-1)) + np.finfo(float).tiny)
    noises = np.exp(noise.mean(axis=1)), np.exp(noise.mean(axis=0) - noise.mean())
    for own in reversed(list(_clusters(model.pole))):
        around, left = _around(model, own, frf, rest, noises)
        size = np.linalg.norm(model.residue[..., own], axis=(0, 1)) / -model.pole[own].real
        pole = complex(np.average(model.pole[own], weights=size))
        modes = rank_one_modes(around, pole, pairs, model.input.node.size)
        if modes.pole.size > 1 and (own.size == 1 or _as_good(modes, left, around, own.size)):
            model = _with_modes(model, own, modes)
        elif own.size > 1 and _alike(model.residue[..., own]):
            model = _with_modes(model, own, rank_one_modes(around, pole, pairs, 1))
    return model


def _alike(residue: NDArray[np.complex128]) -> bool:
    """Whether neighbouring modes have one shape: a mode whose frequency is another one with each force."""
    shape = np.stack([np.linalg.svd(one)[0][:, 0] for one in np.moveaxis(residue, -1, 0)])
    return bool(np.all(np.abs(np.sum(shape[1:].conj() * shape[:-1], axis=1)) ** 2 > ALIKE))


def _clusters(pole: NDArray[np.complex128]) -> Iterator[NDArray[np.int64]]:
    """Yield the positions of poles that are near each other, of one alone, too."""
    first = 0
    for r in range(1, pole.size + 1):
        if r == pole.size or np.abs(pole[r] - pole[r - 1]) > -NEAR * max(
            pole.real[r], pole.real[r - 1], key=abs
        ):
            yield np.arange(first, r)
            first = r


def _around(
    model: ModalModel,
    own: NDArray[np.int64],
    frf: FRF,
    rest: NDArray[np.complex128],
    noises: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> tuple[Around, float]:
    """Return the functions around modes, less all other ones, and the power of what the model leaves of them."""
    spacing = 2.0 * np.pi * (frf.frequency[1] - frf.frequency[0])
    reach = int(max(np.ceil(WINDOW * -model.pole[own].real.min() / spacing), _FEWEST_LINES))
    middle = int(np.argmin(np.abs(2.0 * np.pi * frf.frequency - model.pole[own].imag.mean())))
    lines = slice(max(0, middle - reach), middle + reach + 1)
    s = 2j * np.pi * frf.frequency[lines]
    pole, residue = model.pole[own], model.residue[..., own]
    response = residue @ (s ** DERIVATIVE[frf.quantity] / (s - pole[:, None]))
    noise = np.outer(*noises)[..., None]
    around = Around(
        frequency=frf.frequency[lines],
        quantity=frf.quantity,
        value=(rest[..., lines] + response) / noise,
        output_noise=noises[0],
        input_noise=noises[1],
    )
    return around, float(np.sum(np.abs(around.rough(rest[..., lines] / noise)) ** 2))


def _as_good(modes: RankOneModes, left: float, around: Around, n_before: int) -> bool:
    """Whether modes of rank one explain the functions as well as poles with free residues, which have more unknowns."""
    n_function = around.value[..., 0].size
    n_output, n_input = around.value.shape[:2]
    saved = 2 * n_before * (n_function + 1) - 2 * modes.pole.size * (n_output + n_input)
    freedom = 2 * around.value.size - 2 * n_before * (n_function + 1)
    grown = max(left / (0.5 * freedom), np.finfo(float).tiny)
    return 2.0 * (modes.left - left) / grown < scipy.special.chdtri(max(saved, 1), FALSE_ALARM)


def _with_modes(model: ModalModel, own: NDArray[np.int64], modes: RankOneModes) -> ModalModel:
    """Replace modes of a model by others."""
    n, first = modes.pole.size, int(own[0])
    new = np.arange(first, first + n)
    # Of each mode after: which one before it comes from.
    nearest = own[np.minimum(np.arange(n) * own.size // n, own.size - 1)]
    index = np.concatenate([np.arange(first), nearest, np.arange(own[-1] + 1, model.pole.size)])
    pole = model.pole[index]
    pole[new] = modes.pole
    free = model.free_pole[index] + (pole - model.pole[index])
    residue = model.residue[..., index]
    residue[..., new] = modes.residue
    residue_std = model.residue_std[..., index]
    residue_std[..., new] = modes.residue_std[..., None]
    output = Dofs(node=model.node, direction=model.direction)
    shapes = shapes_from_residues(modes.pole, modes.residue, residue_std[..., new] ** 2, output, model.input)
    # A rotation adds to each shape a share of the others.
    turned = modes.angle_std * (np.abs(shapes.shape).sum(axis=1, keepdims=True) - np.abs(shapes.shape))
    parts = np.stack([2 * index, 2 * index + 1], axis=1).reshape(-1)
    covariance = model.covariance[np.ix_(parts, parts)]
    changed = np.arange(2 * first, 2 * (first + n))
    covariance[changed], covariance[:, changed] = 0.0, 0.0
    covariance[changed, changed] = np.repeat(modes.pole_std, 2) ** 2
    std = {name: getattr(model, name)[index] for name in ("frequency_std", "damping_std")}
    std["frequency_std"][new] = modes.pole_std / (2.0 * np.pi)
    std["damping_std"][new] = modes.pole_std / np.abs(modes.pole)
    shape = {name: getattr(model, name)[:, index] for name in ("shape", "shape_std")}
    shape["shape"][:, new], shape["shape_std"][:, new] = shapes.shape, np.hypot(shapes.std, turned)
    scaled = model.scaled[index]
    scaled[new] = shapes.scaled
    run = ("run_frequency_std", "run_damping_std", "run_probability")
    return replace(
        model,
        frequency=np.abs(free) / (2.0 * np.pi),
        damping=-free.real / np.abs(free),
        pole=pole,
        residue=residue,
        residue_std=residue_std,
        covariance=covariance,
        scaled=scaled,
        run_pole=model.run_pole[:, index] + (pole - model.pole[index]),
        **std,
        **shape,
        **{name: getattr(model, name)[:, index] for name in run},
    )
