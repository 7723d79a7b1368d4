"""What was found about a measurement before it was identified, as it is stored beside its modes."""

from __future__ import annotations

from dataclasses import dataclass

from ema import Verdict


@dataclass(frozen=True, kw_only=True)
class Quality:
    """Verdicts of the checks and notes of the reading.

    Attributes
    ----------
    verdicts : tuple of Verdict
        Every check, passed ones too.
    notes : tuple of str
        What was odd in the files and how it was resolved.
    """

    verdicts: tuple[Verdict, ...]
    notes: tuple[str, ...]

    @property
    def findings(self) -> tuple[str, ...]:
        """What a user should read: warnings and failures of the checks, then the notes."""
        found = (f"{v.level}: {v.check}: {v.message}" for v in self.verdicts if v.level != "pass")
        return (*found, *self.notes)
