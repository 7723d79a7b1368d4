"""What came of an updating, as it is stored."""

from __future__ import annotations

from dataclasses import dataclass

from updating.fitting.joint_fit import JointFit
from updating.fitting.ledger import Entry


@dataclass(frozen=True, eq=False, kw_only=True)
class Updated:
    """What came of an updating.

    Attributes
    ----------
    name : str
        Its title.
    fit : JointFit
        All configurations at once.
    ledger : tuple of Entry
        The error without effects, with each, and with all.
    """

    name: str
    fit: JointFit
    ledger: tuple[Entry, ...]
