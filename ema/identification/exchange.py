"""Modal models and poles to and from other programs: universal files, tables, files of poles, sdypy-EMA.

Poles are chosen by hand in such a file. Of sdypy-EMA the `Model` is taken as it is: the package itself is not needed
here. Both programs write a receptance as the sum of residues over ``s - pole`` with their conjugates, and two residual
terms for the modes below and above the band, so that numbers go from one to the other unchanged.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ema.identification.shapes import shapes_from_residues
from ema.io.files import whole
from ema.io.found_modes import FoundModes, ModesStd
from ema.io.uff import write_uff
from ema.modal.mac import complexity
from ema.modal.read_modes import USUAL, completed, modal_model_of
from ema.types.errors import IdentificationError, MeasurementError
from ema.types.frf import FRF, Dof, Dofs, Geometry, Quantity
from ema.types.modal_model import ModalModel, synthesize
from lamella_shared import Complexes, Reals, csv_text, frozen, plain_bytes


def synthesized_frf(modal_model: ModalModel, step: float, quantity: Quantity) -> FRF:
    """Synthesise the FRFs of a modal model over its band.

    Parameters
    ----------
    modal_model : ModalModel
    step : float
        Line spacing, Hz.
    quantity : {"receptance", "mobility", "accelerance"}
    """
    lower, upper = modal_model.band
    n_line = int(np.floor((upper - lower) / step + 1e-9)) + 1
    frequency = np.linspace(lower, lower + step * (n_line - 1), n_line)
    n_output = modal_model.node.size
    return FRF(
        frequency=frequency,
        value=frozen(synthesize(modal_model, frequency, quantity)),  # large
        quantity=quantity,
        output=Dofs(node=modal_model.node, direction=modal_model.direction),
        input=modal_model.input,
        run=np.zeros(n_output, dtype=np.int64),
        source=("synthesised",) * n_output,
    )


def write_modes_uff(path: Path, modal_model: ModalModel, step: float) -> None:
    """Write points, modes (55) and FRFs synthesised in steps of `step` Hz (58b) to a universal file.

    Raises
    ------
    MeasurementError
        A direction is not along an axis of its point, so that the format cannot hold it.
    """
    write_uff(path, modal_model.geometry, synthesized_frf(modal_model, step, modal_model.quantity), modal_model)


def write_modes_csv(path: Path, modal_model: ModalModel) -> None:
    """Write a row for each mode: frequency, damping, their standard deviations, scale, and how complex its shape is."""
    rows = zip(
        modal_model.frequency, modal_model.frequency_std, modal_model.damping, modal_model.damping_std, strict=True
    )
    header = (
        "mode", "frequency_Hz", "frequency_std_Hz", "damping", "damping_std", "mass_normalised", "MPC", "MPD_deg",
        "MCF", "phase_scatter_deg", "too_complex",
    )  # fmt: skip
    scaled = ["yes" if s else "no" for s in modal_model.scaled]
    complexities = complexity(modal_model)
    measures = zip(complexities.mpc, complexities.mpd, complexities.mcf, complexities.phase_scatter, strict=True)
    words = ["yes" if c else "no" for c in complexities.is_complex]
    table = [
        (r + 1, *map(repr, map(float, row)), scaled[r], *(f"{value:.6g}" for value in measure), words[r])
        for r, (row, measure) in enumerate(zip(rows, measures, strict=True))
    ]
    with whole(path, MeasurementError) as part:
        part.write_text(csv_text(header, table), encoding="utf-8")


def write_shapes_csv(path: Path, modal_model: ModalModel) -> None:
    """Write a row for each DOF: point, direction, then real and imaginary part of each mode's shape there."""
    header = ["node", "x", "y", "z"]
    for r in range(1, modal_model.frequency.size + 1):
        header += [f"mode_{r}_real", f"mode_{r}_imag"]
    rows = [
        (
            int(node),
            *map(float, direction),
            *(part for value in shape for part in (float(value.real), float(value.imag))),
        )
        for node, direction, shape in zip(modal_model.node, modal_model.direction, modal_model.shape, strict=True)
    ]
    with whole(path, MeasurementError) as part:
        part.write_text(csv_text(header, rows), encoding="utf-8")


HEADER = (
    "# Poles, one a line: natural frequency in Hz and damping ratio (0.01 is 1 %).\n"
    "# Add and take away lines and give the file back to the identification.\n"
)


def write_poles(path: Path, pole: Complexes) -> None:
    """Write poles (rad/s) to a text file of natural frequencies and damping ratios."""
    lines = [f"{abs(p) / (2.0 * np.pi):.10g}  {-p.real / abs(p):.6g}\n" for p in pole]
    with whole(path, IdentificationError) as part:
        part.write_text(HEADER + "".join(lines), encoding="utf-8")


def read_poles(path: Path) -> Complexes:
    """Read poles (rad/s) from a text file of natural frequencies (Hz) and damping ratios, a pole a line.

    Raises
    ------
    IdentificationError
        The file cannot be read or holds no pole, or a line does not hold two numbers in range; the message names file
        and line.
    """
    try:
        lines = plain_bytes(path).decode("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise IdentificationError(f"{path}: cannot be read: {error}") from error
    poles: list[complex] = []
    for number, line in enumerate(lines, start=1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        try:
            frequency, damping = (float(w) for w in words)
        except ValueError:
            raise IdentificationError(
                f"{path}, line {number}: expected a frequency in Hz and a damping ratio, got {line.strip()!r}"
            ) from None
        if not (frequency > 0.0 and 0.0 < damping < 1.0):
            raise IdentificationError(
                f"{path}, line {number}: frequency must be above 0 Hz and the damping ratio between 0 and 1 "
                f"(0.01 is 1 %), got {frequency:g} and {damping:g}"
            )
        poles.append(2.0 * np.pi * frequency * complex(-damping, np.sqrt(1.0 - damping**2)))
    if not poles:
        raise IdentificationError(f"{path}: holds no pole; give one a line, as frequency in Hz and damping ratio")
    return np.array(sorted(poles, key=abs))


Model = TypeVar("Model")
_NAME = "sdypy-EMA"


def from_sdypy(
    model: Any, *, output: Dofs, force: Dof, geometry: Geometry, name: str = _NAME, std: ModesStd = USUAL
) -> ModalModel:
    """Return the modes of a sdypy-EMA `Model` as a modal model, which `updating.fit` and the others take.

    Parameters
    ----------
    model : sdypy.EMA.Model
        After `select_poles` or `select_closest_poles`, and `get_constants`.
    output : Dofs
        The DOFs of its functions, in their order.
    force : Dof
        Where the force acted. With the same DOF among the outputs, shapes are mass-normalised.
    geometry : Geometry
        The measured points.
    name : str
        The configuration.
    std : ModesStd
        Relative standard deviations, which sdypy-EMA does not give; those that it lacks are the usual ones.

    Raises
    ------
    IdentificationError
        The model has no modal constants yet, or another number of functions than outputs.
    """
    frequency, damping, constant = _identified(model, name, output.node.size)
    order = np.argsort(frequency)
    residue = constant[:, order][:, None, :]
    modes = _with_shapes(frequency[order], damping[order], residue, (output, force), std)
    made = modal_model_of(modes, name=name, geometry=geometry, force=force, std=std)
    band = (float(getattr(model, "lower", made.band[0])), float(getattr(model, "upper", made.band[1])))
    return replace(
        made,
        residue=residue,
        lower=_residual(model, "LR", output.node.size),
        upper=_residual(model, "UR", output.node.size),
        band=band,
        quantity=getattr(model, "frf_form", made.quantity),
    )


def to_sdypy(modal_model: ModalModel, model: Model) -> Model:
    """Give a sdypy-EMA `Model` the modes of a modal model, at its first force, and return it.

    The model is then as after `get_constants`: it has `nat_freq`, `nat_xi`, `A`, `LR`, `UR`, the poles, and `H`, its
    functions at the lines of `freq` above 0 Hz in its `frf_form`.

    Parameters
    ----------
    modal_model : ModalModel
        The modes.
    model : sdypy.EMA.Model
        Such as ``sdypy.EMA.Model(frf, freq, lower=..., upper=..., frf_form="accelerance")``; it is changed.

    Raises
    ------
    IdentificationError
        The modal model has no residues: its modes were read from a file, and are not mass-normalised at the force.
    """
    if not np.any(modal_model.residue):
        raise IdentificationError(
            f"{modal_model.name}: has no residues, which modal constants are; its modes were read from a file and are "
            "not mass-normalised at a stated force"
        )
    given: Any = model
    pole = modal_model.pole
    given.nat_freq, given.nat_xi = np.abs(pole) / (2.0 * np.pi), -pole.real / np.abs(pole)
    given.all_poles = pole[None, :].copy()
    given.pole_ind = np.column_stack([np.zeros(pole.size, int), np.arange(pole.size)])
    given.A = modal_model.residue[:, 0].copy()
    given.LR, given.UR = modal_model.lower[:, 0].copy(), modal_model.upper[:, 0].copy()
    if getattr(given, "driving_point", None) is not None:
        given.phi = given.A / np.sqrt(given.A[given.driving_point])  # as sdypy-EMA scales its shapes
    if getattr(given, "freq", None) is not None:
        lines = np.asarray(given.freq, float)
        given.H = synthesize(modal_model, lines[lines > 0.0], given.frf_form)[:, 0]
    return model


def _with_shapes(
    frequency: Reals, damping: Reals, residue: Complexes, dofs: tuple[Dofs, Dof], std: ModesStd
) -> FoundModes:
    """Return modes with the shapes of their residues, (n_output, 1, n_mode)."""
    output, force = dofs
    nothing = np.full(frequency.size, np.nan)
    plain = FoundModes(
        source=_NAME,
        frequency=frequency,
        damping=damping,
        frequency_std=nothing,
        damping_std=nothing,
        shape=residue[:, 0],
        shape_std=nothing,
        scaled=np.zeros(frequency.size, bool),
        node=output.node,
        direction=output.direction,
    )
    rms = np.sqrt(np.mean(np.abs(residue) ** 2, axis=(0, 1)))
    variance = np.broadcast_to((completed(plain, std).shape_std * rms) ** 2, residue.shape)
    inputs = Dofs(node=np.array([force.node]), direction=np.array([force.direction]))
    pole = 2.0 * np.pi * frequency * (-damping + 1j * np.sqrt(1.0 - damping**2))
    shapes = shapes_from_residues(pole, residue, variance, output, inputs)
    return replace(plain, shape=shapes.shape, scaled=shapes.scaled)


def _identified(model: Any, name: str, n_output: int) -> tuple[Reals, Reals, Complexes]:
    """Return frequencies, damping ratios and modal constants (n_output, n_mode); refuse what is not complete."""
    missing = [attribute for attribute in ("nat_freq", "nat_xi", "A") if getattr(model, attribute, None) is None]
    if missing:
        raise IdentificationError(
            f"{name}: the sdypy-EMA model has no {', '.join(missing)}; call get_poles(), select_closest_poles(...) and "
            "get_constants() first"
        )
    frequency, damping = _poles(model)
    constant = np.asarray(model.A, complex)
    if constant.shape != (n_output, frequency.size):
        raise IdentificationError(
            f"{name}: the modal constants A are {' x '.join(map(str, constant.shape))}, expected {n_output} outputs x "
            f"{frequency.size} modes; give one DOF for each function, in the order of the FRFs"
        )
    if not (np.all((damping > 0.0) & (damping < 1.0) & (frequency > 0.0)) and np.isfinite(constant).all()):
        raise IdentificationError(
            f"{name}: a pole does not decay, or a modal constant is not finite; choose other poles"
        )
    return frequency, damping, constant


def _poles(model: Any) -> tuple[Reals, Reals]:
    """Return frequencies, Hz, and damping ratios of the poles that the constants belong to.

    `nat_freq` and `nat_xi` are those of the row of the stabilisation table beside it, off by some millionths.
    """
    rows = getattr(model, "pole_ind", None)
    if rows is None or getattr(model, "all_poles", None) is None:
        return np.atleast_1d(np.asarray(model.nat_freq, float)), np.atleast_1d(np.asarray(model.nat_xi, float))
    pole = np.array([model.all_poles[int(i)][int(j)] for i, j in np.atleast_2d(rows)], complex)
    return np.abs(pole) / (2.0 * np.pi), -pole.real / np.abs(pole)


def _residual(model: Any, name: str, n_output: int) -> Complexes:
    """Return a residual term of every function, (n_output, 1); zero where the model has none."""
    term = getattr(model, name, None)
    return np.zeros((n_output, 1), complex) if term is None else np.asarray(term, complex).reshape(n_output, 1)
