"""Effects that the data exclude: what they would change did not happen."""

from __future__ import annotations

from collections.abc import Sequence

from updating.coordinates import coordinate_of
from updating.evidence import Evidence
from updating.explanation import Explanation
from updating.screening import Screened, screen

SURE = 5.0
"""Distance beyond which an effect of usual strength is excluded: more than 3, for it is to first order."""


def ruled_out(evidence: Evidence, beside: Sequence[Explanation]) -> tuple[str, ...]:
    """Return the effects whose nominal strength is excluded beside every one of some explanations.

    Effects of several parameters are not judged: there is no usual place or shape at which to exclude them.
    """
    excluded = [{s.effect for s in screen(evidence, x) if _is_excluded(s)} for x in beside]
    return tuple(sorted(set.intersection(*excluded))) if excluded else ()


def _is_excluded(own: Screened) -> bool:
    """Tell whether the nominal strength, to either side of neutral where there are two, is too far off."""
    if len(own.parameter) != 1 or own.strength.size != 1:
        return False
    (p,), (estimate,) = own.parameter, own.start
    nominal = coordinate_of(p, p.nominal)
    sides = (nominal, -nominal) if p.lower < p.neutral < p.upper else (nominal,)
    return all(abs(side - estimate) * float((own.column**2).sum()) ** 0.5 > SURE for side in sides)
