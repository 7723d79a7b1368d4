"""What was found about a measurement and how well its modes explain it, as it is stored beside them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema import ExplainedPower, Identification, ModalModel, Verdict

_FEWEST_ALIKE, _ALIKE = 3, 0.5  # modes of a run, and their scatter over their mean shift


@dataclass(frozen=True, kw_only=True)
class Quality:
    """Verdicts of the checks and notes of the reading.

    Attributes
    ----------
    verdicts : tuple of Verdict
        Every check, passed ones too.
    notes : tuple of str
        What was odd in the files and how it was resolved, and which roving runs disagree with the others.
    explained : ExplainedPower
        Share of the measured power that the modes explain, per channel and band.
    """

    verdicts: tuple[Verdict, ...]
    notes: tuple[str, ...]
    explained: ExplainedPower

    @property
    def findings(self) -> tuple[str, ...]:
        """What a user should read: warnings and failures of the checks, then the notes."""
        found = (f"{v.level}: {v.check}: {v.message}" for v in self.verdicts if v.level != "pass")
        return (*found, *self.notes)


def quality(found: Identification) -> Quality:
    """Collect what reading, checks and the comparison of roving runs found."""
    return Quality(
        verdicts=found.verdicts,
        notes=(*found.measurement.notes, *_disagreeing_runs(found.modal_model)),
        explained=found.explained,
    )


def _disagreeing_runs(modal_model: ModalModel) -> tuple[str, ...]:
    """Say of each roving run that differs from the others in which modes it does, by how much and what does that."""
    lines = []
    differs = modal_model.disagreeing_runs()
    for i in np.flatnonzero(differs.any(axis=1)):
        other_runs = np.delete(modal_model.run_frequency, i, axis=0)
        shift = modal_model.run_frequency[i] / np.median(other_runs, axis=0) - 1.0
        modes = ", ".join(
            f"{modal_model.frequency[r]:.1f} Hz by {100 * shift[r]:+.3f} %"
            for r in np.flatnonzero(differs[i])
        )
        cause = _cause(shift[differs[i]])
        lines.append(f"run {modal_model.run[i] + 1} disagrees with the others: {modes}; {cause}")
    return tuple(lines)


def _cause(shift: NDArray[np.float64]) -> str:
    """Name what moves the modes of a run by these shares of their frequencies.

    Mass moves each mode by the square of its shape there; a change of the stiffness as a whole moves all alike.
    """
    if shift.size >= _FEWEST_ALIKE and np.std(shift) < _ALIKE * np.abs(np.mean(shift)):
        return "all modes alike, as temperature or settling moves them"
    return "a sensor's mass does this"
