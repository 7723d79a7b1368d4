"""All levels of decisions: of probability, and of sizes that matter."""

from __future__ import annotations

import math

NAMED = 3.0
"""Logarithm of posterior odds, 20 to 1, from which a term is named; below it, two explanations cannot be told apart
(Kass and Raftery 1995: strong evidence)."""
SEPARATE = math.log(100.0)
"""Logarithm of the ratio of probabilities from which two explanations can be told apart: the plausible ranges of
parameters are known to a factor of some ten each."""
MISSING = 0.5
"""Prior probability that a model lacks something; the terms of the catalogue share it, and something that none of them
describes has as much."""
FALLS = 0.9
"""Ratio of left-out errors, after over before, below which an explanation predicts better."""
RISES = 1.02
"""Ratio of left-out errors above which an explanation predicts worse."""
PREDICTS = 0.1
"""Relative error of left-out frequencies from which an explanation predicts nothing: predictions are to first order."""
FREQUENCY_MATTERS = 5e-4
"""Smallest change of a relative frequency that matters: reassembly alone moves frequencies by as much."""
DAMPING_MATTERS = 1e-2
"""Smallest relative change of a damping ratio that matters."""
PULLED = 3.0
"""Standard deviations of its prior from which a nuisance counts as pulled from its prior."""
RELEASED = 0.6
"""Ratio of the farthest pull, after over before, below which an explanation releases it."""
INADEQUATE = 0.05
"""Probability, by its prior, of a discrepancy as large, below which it is larger than that of a right model."""
STRANGE = 0.01
"""Prior probability that a measured mode is none of the model's: of the rig, or of what is missing."""
