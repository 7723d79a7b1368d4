"""Thresholds of an answer on many specimens, and of what is said beside the verdict on one stack.

They are odds and shares, not sizes: what a frequency or a shape may be off by is estimated from the data. They were set
on tests simulated with the first second model (`tests/independent/solid.py`), and what they are worth is measured on
the other one, which took no part (`make blind`, `data/blind`).
"""

from __future__ import annotations

SHOWS = 5.0
"""Logarithm of the posterior odds against the base model from which an effect is believed: 150 to 1."""
HELPS = 0.8
"""Ratio of the errors, of frequencies, damping ratios or shapes, of modes that are predicted from all others, below
which an explanation helps to predict."""
HALVES = 0.5
"""Ratio of what is left of frequencies or damping ratios, with an effect and without it, below which it helps, however
little others tell of the modes that it is seen in."""
NEGLIGIBLE = 0.25
"""Share of what right models leave, in the median, of frequencies, damping ratios or shapes: an effect that takes less
off what a model leaves is of no matter, however sure it seems. Where a model misses hundredths of a per cent, it does
so alike in kindred modes, as some effect would."""
NEGLIGIBLE_HALF = 0.1
"""The same for what halves the error of frequencies of many specimens, or of those of them that have it."""
SEPARATE = 3.0
"""Difference of such logarithms below which two explanations are an ambiguity."""
STEP = 3.0
"""Rise of the logarithm of the posterior odds that a further effect must bring."""
P_ADEQUATE = 0.05
"""Probability of a discrepancy as large, below which a model is not adequate."""
VISIBLE = 3.0
"""Change of the data, in standard deviations, that an effect must be able to bring to be seen."""
POINT_SHOWS = 5.0
"""Logarithm of the odds, the number of points counted, from which a change at one point is named."""
MOST = 0.5
"""Share of what an explanation leaves beyond its degrees of freedom that a change at one point must explain to be told:
what only looks a little like one sends people to look in the wrong place."""
EXCLUDED = 5.0
"""Distance, in standard deviations, from which an effect of usual strength is excluded: more than 3, for it is to
first order."""
MIXED_UP = 10.0
"""Logarithm of the odds, all that is tried counted, from which points of a measurement are taken to be mixed up."""
STRAINED = 3.0
"""Standard deviations of what is known of it, from which a nuisance is said to be far off."""
MODEL_FORM = 0.3
"""Share of what an effect changes by which its form may be wrong: what a further effect brings beside it must be more,
or it may be no more than that."""
WIDER = 1.8
"""Ratio of the standard deviations of effect parameters under real discrepancies, over those under ones that differ
freely from mode to mode: a wrong form is wrong alike in neighbouring modes. What is due to noise is not widened."""
