"""Effects that the data exclude: what they would change did not happen."""

from __future__ import annotations

from updating.diagnosis.calibration import EXCLUDED
from updating.diagnosis.coordinates import coordinate_of
from updating.diagnosis.screening import Screened, screen
from updating.diagnosis.search import Search
from updating.diagnosis.verdict import Decision


def ruled_out(found: Search, decision: Decision) -> tuple[str, ...]:
    """Return the effects whose nominal strength is excluded beside every explanation that a decision leaves.

    Effects of several parameters are not judged: there is no usual place or shape at which to exclude them.
    """
    left = (found.base,) if decision.verdict == "nothing missing" else decision.left
    excluded = [{s.effect for s in screen(found.evidence, x) if _is_excluded(s)} for x in left]
    return tuple(sorted(set.intersection(*excluded))) if excluded else ()


def _is_excluded(own: Screened) -> bool:
    """Tell whether the nominal strength, to either side of neutral where there are two, is too far off."""
    if len(own.parameter) != 1 or own.strength.size != 1:
        return False
    (p,), (estimate,) = own.parameter, own.start
    nominal = coordinate_of(p, p.nominal)
    sides = (nominal, -nominal) if p.lower < p.neutral < p.upper else (nominal,)
    return all(abs(side - estimate) * float((own.column**2).sum()) ** 0.5 > EXCLUDED for side in sides)
