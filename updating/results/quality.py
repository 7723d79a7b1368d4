"""What was found about a measurement and how well its modes explain it, as it is stored beside them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema import ExplainedPower, Identification, ModalModel, Verdict

_EACH = 3  # runs that are told one by one
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
        """What a user should read: failures of the checks, then warnings, then the notes."""
        found = (
            f"{v.level}: {v.check}: {v.message}"
            for level in ("fail", "warn")
            for v in self.verdicts
            if v.level == level
        )
        return (*found, *self.notes)


def quality(found: Identification) -> Quality:
    """Collect what reading, checks and the comparison of roving runs found."""
    return Quality(
        verdicts=found.verdicts,
        notes=(*found.measurement.notes, *_disagreeing_runs(found.modal_model)),
        explained=found.explained,
    )


def _disagreeing_runs(modal_model: ModalModel) -> tuple[str, ...]:
    """Say of each roving run that differs from the others in which modes it does, by how much and what does that.

    Many runs that differ are the normal case where sensors have mass: then all of them are one line.
    """
    differs = modal_model.disagreeing_runs()
    odd = np.flatnonzero(differs.any(axis=1))
    if not odd.size:
        return ()
    shift = np.stack([_shift(modal_model, int(i)) for i in odd])
    if odd.size > _EACH:
        return (_most_runs(modal_model, odd, shift, differs[odd]),)
    return tuple(_one_run(modal_model, int(i), own, differs[i]) for i, own in zip(odd, shift, strict=True))


def _shift(modal_model: ModalModel, run: int) -> NDArray[np.float64]:
    """Return by which shares of their frequencies a run's modes are off those of the others, (n_mode,)."""
    others = np.delete(modal_model.run_frequency, run, axis=0)
    return np.asarray(modal_model.run_frequency[run] / np.median(others, axis=0) - 1.0)


def _one_run(
    modal_model: ModalModel, run: int, shift: NDArray[np.float64], differs: NDArray[np.bool_]
) -> str:
    modes = ", ".join(
        f"{modal_model.frequency[r]:.1f} Hz by {100 * shift[r]:+.3f} %" for r in np.flatnonzero(differs)
    )
    return f"run {modal_model.run[run] + 1} disagrees with the others: {modes}; {_cause(shift[differs])}"


def _most_runs(
    modal_model: ModalModel, odd: NDArray[np.intp], shift: NDArray[np.float64], differs: NDArray[np.bool_]
) -> str:
    size = np.where(differs, np.abs(shift), 0.0)
    i, r = np.unravel_index(int(np.argmax(size)), size.shape)
    count = Counter(_cause(own[which]) for own, which in zip(shift, differs, strict=True))
    causes = ", ".join(
        f"{cause} ({n} of them)" if len(count) > 1 else cause for cause, n in count.most_common()
    )
    middle, most = 100.0 * np.median(size[differs]), 100.0 * size[i, r]
    where = f"run {modal_model.run[odd[i]] + 1} at {modal_model.frequency[r]:.1f} Hz"
    return (
        f"{odd.size} of {modal_model.run.size} runs disagree with the others, in the median by {middle:.2g} % and at "
        f"most by {most:.2g} % ({where}); {causes}"
    )


def _cause(shift: NDArray[np.float64]) -> str:
    """Name what moves the modes of a run by these shares of their frequencies.

    Mass moves each mode by the square of its shape there; a change of the stiffness as a whole moves all alike.
    """
    if shift.size >= _FEWEST_ALIKE and np.std(shift) < _ALIKE * np.abs(np.mean(shift)):
        return "all modes alike, as temperature or settling moves them"
    return "a sensor's mass does this"
