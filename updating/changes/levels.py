"""Every level and prior of the question what changed, in one place, beside those of `updating.inference.levels`."""

from __future__ import annotations

import math

SCATTER_SPREAD = math.log(2.0) / 1.645
"""Standard deviation of the logarithm of the scatter between two assemblies: nine of ten laboratories know it within a
factor of 2 where they state it, or measure a few repeats."""
MOUNTING = 0.1
"""Relative standard deviation, from one mounting to the next, of what holds an edge against moving and against turning:
10 % of it moves the modes of a held plate by some 0.4 %, as a plate did that was clamped anew."""
TIGHTENING = 0.03
"""The same of the contact under one clamp whose bolt is tightened to the same torque again; between bolts friction
makes it 17 to 23 % (VDI 2230), which the reference has as well."""
TEMPERATURE = 2e-3
"""The same of the stiffness of everything: 5 K."""
EXPLAINED = 0.5
"""Share of the misfit beyond the scatter below which the likeliest change explains too little to be named."""
IN_FULL = 0.9
"""The same below which more changed than that, or otherwise."""
REACHED = 0.9
"""Share of a shape's square that the model's modes reach, below which a measured mode is none of the structure's."""
IDEAL = 0.15
"""Share by which a kind of change is off, as an idealisation of what happened and taken to first order: its effect on
each eigenvalue counts as a scatter of that share of all shifts."""
TWIN = 0.7
"""Cosine between the modal coordinates of two modes of one state from which they are one that was identified twice."""
SAME = 0.6
"""The same of two states from which a mode of one is a mode of the other."""
STILL = 1e-3
"""Motion of a mode at the sensors, over the median of all modes, below which a single plate moves in its plane, which
no change couples to its bending."""
NEARBY = 0.3
"""Relative difference of eigenvalues within which a mode that the reference does not have may be what shows."""
FEWEST = 3
"""Modes of a state and of its reference, below which nothing is compared with a model."""
