"""Every level of a decision, in one place: of probability, and of sizes that matter."""

from __future__ import annotations

import math

NAMED = 3.0
"""Logarithm of posterior odds, 20 to 1, from which a term is named; below it, one explanation is not told from another
(Kass and Raftery 1995: strong evidence)."""
SEPARATE = math.log(100.0)
"""Logarithm of the ratio of probabilities from which one explanation is told from another: the ranges over
which parameters are plausible are known to a factor of some ten each."""
MISSING = 0.5
"""Prior probability that a model lacks something; the terms of the catalogue share it."""
FALLS = 0.9
"""Ratio of left-out errors, after over before, below which an explanation predicts better."""
RISES = 1.02
"""The same above which it predicts worse."""
PREDICTS = 0.1
"""Relative error of left-out frequencies from which an explanation predicts nothing: it is taken to first order."""
FREQUENCY_MATTERS = 5e-4
"""Change of a relative frequency that matters to nobody: reassembly alone moves frequencies by as much."""
DAMPING_MATTERS = 1e-2
"""The same of a damping ratio."""
PULLED = 3.0
"""Standard deviations of its prior from which a nuisance is pulled far."""
RELEASED = 0.6
"""Ratio of the farthest pull, after over before, below which an explanation lets go of it."""
INADEQUATE = 0.05
"""Probability, by its prior, of a discrepancy as large, below which what is left is more than a right model leaves."""
STRANGE = 0.01
"""Prior probability that a measured mode is none of the model's: of the rig, or of what is missing."""
