"""Modes that another program identified, as a modal model: all that follows an identification works from them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ema.campaign.campaign import Campaign, Configuration
from ema.campaign.campaign_file import format_of
from ema.io.found_modes import FoundModes, ModesStd, joined, read_modes_table
from ema.io.modes_uff import read_modes_uff
from ema.io.sdynpy import read_modes_numpy
from ema.modal.mac import check_complexity
from ema.quality.verdict import Verdict
from ema.types.errors import CampaignError, MeasurementError
from ema.types.frf import Dof, Dofs, Geometry, driving_points
from ema.types.modal_model import ModalModel
from lamella_shared import Booleans, Complexes, Reals

USUAL = ModesStd(frequency=1e-3, damping=0.1, shape=0.01)
"""Relative standard deviations where neither files nor campaign state any, as of tables of specimens. By Au's
uncertainty law of ambient tests (Mech. Syst. Signal Process. 48, 2014, pp. 15-33) the variance of a frequency is
damping / (2 pi N) of its square and that of a damping ratio 1 / (2 pi N damping): over N = 1000 to 3000 periods, at a
damping ratio of 0.5 %, 0.05 to 0.1 % and 10 to 20 %. 1 % of a shape is what the calibration of sensors leaves."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ReadModes:
    """Modes that were read, not identified.

    Attributes
    ----------
    modal_model : ModalModel
        The modes.
    verdicts : tuple of Verdict
        What the checks found that need no functions.
    notes : tuple of str
        What was odd in the files, what was assumed, and where standard deviations come from.
    """

    modal_model: ModalModel
    verdicts: tuple[Verdict, ...]
    notes: tuple[str, ...]


def read_modes(campaign: Campaign, name: str) -> ReadModes:
    """Read the modes of a configuration whose files hold modes.

    Parameters
    ----------
    campaign : Campaign
    name : str
        The configuration.

    Raises
    ------
    CampaignError
        There is no such configuration, or its files hold functions.
    MeasurementError
        A file cannot be read or holds no mode, or a point is not in the list of points.
    """
    large = 0.1  # median of damping ratios above which they may be in per cent: metal and concrete have 0.1 to 5 %
    configuration = campaign.configuration(name)
    if not configuration.has_modes:
        raise CampaignError(
            f'{campaign.path}: configuration {name!r}: its files hold functions; write modes = "file" where they hold '
            "modes"
        )
    files = tuple(file for group in configuration.files for file in group.files)
    _require_no_correction(campaign, files)
    modes = _in_band(_read(files, campaign.geometry), campaign.identification.band)
    _require_listed(campaign, modes)
    force = _force(configuration)
    model = modal_model_of(modes, name=name, geometry=campaign.geometry, force=force, std=campaign.modes_std)
    notes = [*campaign.notes, _read_note(files), *modes.notes, *_std_notes(modes, campaign.modes_std)]
    if force is None:
        notes.append(
            'where the force acted is not stated, which a diagnosis needs: write input = "12+z" with its point into '
            "the [[configuration]]"
        )
    usual = float(np.median(known)) if (known := modes.damping[~np.isnan(modes.damping)]).size else 0.0
    if usual > large:
        notes.append(
            f"half of the damping ratios are above {100 * usual:.3g} %, as of few structures: if the files state them "
            "in per cent, write the hundredth part"
        )
    if np.isnan(modes.damping).any():
        listed = ", ".join(f"{f:.5g} Hz" for f in model.frequency[model.damping_std > model.damping])
        notes.append(f"the damping of the modes at {listed} is not stated; it is not compared")
    return ReadModes(modal_model=model, verdicts=check_complexity(model), notes=tuple(notes))


def modal_model_of(
    modes: FoundModes, *, name: str, geometry: Geometry, force: Dof | None, std: ModesStd = USUAL
) -> ModalModel:
    """Return modes as an identification gives them that has no functions, ascending in frequency.

    Parameters
    ----------
    modes : FoundModes
        The modes.
    name : str
        The configuration.
    geometry : Geometry
        The measured points.
    force : Dof, optional
        Where it acted. Mass-normalised shapes that hold its DOF give residues.
    std : ModesStd
        Relative standard deviations where `modes` has none; those that it lacks are the usual ones.
    """
    known = completed(modes, std)
    frequency, damping = known.frequency, known.damping
    largest = known.shape[np.argmax(np.abs(known.shape), axis=0), np.arange(frequency.size)]
    shape = known.shape / np.where(known.scaled, 1.0, largest)
    rms = np.sqrt(np.mean(np.abs(shape) ** 2, axis=0))
    pole = 2.0 * np.pi * frequency * (-damping + 1j * np.sqrt(1.0 - damping**2))
    inputs = _at(force)
    n_dof, n_mode = shape.shape
    return ModalModel(
        name=name,
        frequency=frequency,
        damping=damping,
        frequency_std=known.frequency_std,
        damping_std=known.damping_std,
        pole=pole,
        residue=_residues(Dofs(node=modes.node, direction=modes.direction), inputs, pole, shape, known.scaled),
        shape=shape,
        shape_std=np.broadcast_to(known.shape_std * rms, shape.shape),
        scaled=known.scaled,
        node=modes.node,
        direction=modes.direction,
        sensor=modes.sensor,
        input=inputs,
        band=(float(frequency[0]), float(frequency[-1])),
        geometry=geometry,
        quantity="accelerance",
        covariance=_covariance(known),
        run=np.array([0]),
        run_pole=pole[None, :],
        run_frequency_std=known.frequency_std[None, :],
        run_damping_std=known.damping_std[None, :],
        run_probability=np.ones((1, n_mode)),
        read_from=modes.source,
        **_without_functions(n_dof, n_mode),
    )


def _without_functions(n_dof: int, n_mode: int) -> dict[str, Any]:
    """Return the parts of a modal model that only functions give: none, or not a number."""
    zero, unknown = np.zeros((n_dof, 1), complex), np.full((n_dof, 1), np.nan)
    return {
        "lower": zero,
        "upper": zero,
        "outside_pole": np.empty(0, complex),
        "outside_residue": np.empty((n_dof, 1, 0), complex),
        "residue_std": np.zeros((n_dof, 1, n_mode)),
        "noise": unknown,
        "correlation": unknown,
        "error": unknown,
    }


def _read(files: tuple[Path, ...], geometry: Geometry) -> FoundModes:
    """Read the modes of files of one kind."""
    kinds = {format_of(file) for file in files}
    if kinds == {"csv"}:
        return read_modes_table(files)
    if kinds == {"uff"}:
        return joined([read_modes_uff(file, geometry) for file in files])
    if kinds == {"numpy"}:
        return joined([read_modes_numpy(file, geometry) for file in files])
    raise MeasurementError(
        f"{files[0]}: modes are read from universal files (.uff, .unv), tables (.csv) or shapes of SDynPy (.npy, "
        f".npz), of one kind for a configuration; found {', '.join(file.name for file in files)}"
    )


def _in_band(modes: FoundModes, band: tuple[float, float] | None) -> FoundModes:
    """Return the modes within a band, Hz."""
    if band is None:
        return modes
    inside = (modes.frequency >= band[0]) & (modes.frequency <= band[1])
    if not inside.any():
        raise MeasurementError(
            f"{modes.source}: none of its modes, from {modes.frequency.min():.5g} to {modes.frequency.max():.5g} Hz, "
            f"lies in band_Hz = [{band[0]:g}, {band[1]:g}] of the campaign file"
        )
    names = ("frequency", "damping", "frequency_std", "damping_std", "shape_std", "scaled")
    kept = {name: getattr(modes, name)[inside] for name in names}
    return replace(modes, shape=modes.shape[:, inside], **kept)


def completed(modes: FoundModes, std: ModesStd, *, unknown: float = 1e3) -> FoundModes:
    """Return modes ascending in frequency, with standard deviations and damping ratios where none are stated.

    Parameters
    ----------
    modes : FoundModes
        The modes.
    std : ModesStd
        Relative standard deviations for those that have none; those that it lacks are the usual ones.
    unknown : float
        Relative standard deviation of what was not measured.
    """
    # Damping ratio that stands where none is stated.
    unstated = 1e-2
    order = np.argsort(modes.frequency)
    relative = {
        key: getattr(std, key) if getattr(std, key) is not None else getattr(USUAL, key)
        for key in ("frequency", "damping", "shape")
    }
    frequency, damping = modes.frequency[order], modes.damping[order]
    known = ~np.isnan(damping)
    damping = np.where(known, damping, unstated)
    stated = [std_of[order] for std_of in (modes.frequency_std, modes.damping_std, modes.shape_std)]
    usual = np.where(known, relative["damping"], unknown) * damping
    return replace(
        modes,
        frequency=frequency,
        damping=damping,
        frequency_std=np.where(np.isnan(stated[0]), relative["frequency"] * frequency, stated[0]),
        damping_std=np.where(np.isnan(stated[1]) | ~known, usual, stated[1]),
        shape=modes.shape[:, order],
        shape_std=np.where(np.isnan(stated[2]), relative["shape"], stated[2]),
        scaled=modes.scaled[order],
    )


def _residues(outputs: Dofs, inputs: Dofs, pole: Complexes, shape: Complexes, scaled: Booleans) -> Complexes:
    """Return residues (n_output, 1, n_mode) of mass-normalised shapes, ``phi_o phi_i / (2 i omega_d)``, else zero."""
    residue = np.zeros((*shape.shape[:1], 1, shape.shape[1]), dtype=complex)
    for output, _, sign in driving_points(outputs, inputs)[:1]:
        residue[:, 0] = np.where(scaled, sign * shape * shape[output] / (2j * pole.imag), 0.0)
    return residue


def _at(force: Dof | None, *, nowhere: int = 0) -> Dofs:
    """Return the DOF of a force as those of a model; nowhere, along z, where it is not known.

    `nowhere`: point of a force that nobody stated; a list of points seldom has it.
    """
    dof = Dof(nowhere, (0.0, 0.0, 1.0)) if force is None else force
    return Dofs(node=np.array([dof.node]), direction=np.array([dof.direction]))


def _covariance(known: FoundModes) -> Reals:
    """Return the covariance of Re and Im of each pole, (rad/s)**2, to first order; modes are independent."""
    frequency, damping = known.frequency, known.damping
    n = frequency.size
    covariance = np.zeros((2 * n, 2 * n))
    omega, root = 2.0 * np.pi * frequency, np.sqrt(1.0 - damping**2)
    for r in range(n):
        slope = np.array([[-2.0 * np.pi * damping[r], -omega[r]],
                          [2.0 * np.pi * root[r], -omega[r] * damping[r] / root[r]]])  # fmt: skip
        variance = np.diag([known.frequency_std[r] ** 2, known.damping_std[r] ** 2])
        covariance[2 * r : 2 * r + 2, 2 * r : 2 * r + 2] = slope @ variance @ slope.T
    return covariance


def _force(configuration: Configuration) -> Dof | None:
    return next((dof for group in configuration.files for dof in group.input), None)


def _require_listed(campaign: Campaign, modes: FoundModes) -> None:
    if campaign.points is None:
        return
    absent = {int(n) for n in modes.node} - {int(n) for n in campaign.geometry.node}
    absent -= set(campaign.without_coordinates)
    if absent:
        raise MeasurementError(
            f"{modes.source}: shapes at points {sorted(absent)[:20]}, which are not in {campaign.points}; add them "
            "there, or list them in points.without_coordinates"
        )


def _require_no_correction(campaign: Campaign, files: tuple[Path, ...]) -> None:
    for correction in campaign.corrections:
        if set(correction.files) <= set(files):
            raise CampaignError(
                f"{campaign.path}: correction ({correction.reason}): corrects single functions, and {files[0].name} "
                "holds modes; correct it in the program that wrote it"
            )


def _read_note(files: tuple[Path, ...]) -> str:
    return (
        f"these modes were read from {', '.join(file.name for file in files)}, not identified here: what needs "
        "functions (quality checks, power explained, stabilisation chart) is left out"
    )


def _std_notes(modes: FoundModes, std: ModesStd) -> list[str]:
    """Say which standard deviations neither the files nor the campaign state."""
    std_of = {"frequency": modes.frequency_std, "damping": modes.damping_std, "shape": modes.shape_std}
    usual = [
        f"{100.0 * getattr(USUAL, key):g} % of the {key}"
        for key, stated in std_of.items()
        if np.isnan(stated).any() and getattr(std, key) is None
    ]
    if not usual:
        return []
    return [
        f"standard deviations are not stated, so the usual ones stand: {', '.join(usual)}; state those of your test in "
        "[modes] as frequency_std, damping_std, shape_std"
    ]
