"""Thresholds of statements beside the verdict: odds, shares and standard deviations, not sizes."""

from __future__ import annotations

VISIBLE = 3.0
"""Change of the data, in standard deviations, that an effect must be able to cause to be visible."""
POINT_SHOWS = 5.0
"""Logarithm of the odds, the number of points counted, from which a change at one point is named."""
MOST = 0.5
"""Share of what an explanation leaves beyond its degrees of freedom that a change at one point must explain to be
reported: what only looks a little like one sends people to look in the wrong place."""
EXCLUDED = 5.0
"""Distance, in standard deviations, from which an effect of usual strength is excluded: more than 3, for it is to
first order."""
MIXED_UP = 10.0
"""Logarithm of the odds, all that is tried counted, from which points of a measurement are taken to be mixed up."""
FAR = 3.0
"""Standard deviations of its prior from which a nuisance is reported as pulled from it."""
