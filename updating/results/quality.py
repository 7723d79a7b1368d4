"""What was found about a measurement and how well its modes explain it, as it is stored beside them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ema import ExplainedPower, Identification, ReadModes, Verdict
from ema.modal.runs import run_changes


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


def quality(found: Identification, remarks: tuple[str, ...] = ()) -> Quality:
    """Collect what reading, checks and the comparison of roving runs found, after further remarks."""
    frf = found.measurement.frf
    changes = run_changes(found.modal_model, frf.run, sensors_rove=not frf.reciprocal)
    return Quality(
        verdicts=found.verdicts,
        notes=(*remarks, *found.measurement.notes, *((changes.finding,) if changes.finding else ())),
        explained=found.explained,
    )


def quality_of_read(found: ReadModes) -> Quality:
    """Collect what reading modes and the checks of them found; of functions, which there are none, nothing."""
    n_mode = found.modal_model.frequency.size
    explained = ExplainedPower(
        channel=(),
        edge=np.full(n_mode + 1, np.nan),
        share=np.empty((0, n_mode)),
        whole=np.empty(0),
        quantity=found.modal_model.quantity,
    )
    return Quality(verdicts=found.verdicts, notes=found.notes, explained=explained)
