"""What kinds share that change the contact between laminas: slip and opening of interfaces in patches."""

from __future__ import annotations

import numpy as np

from updating.changes.kinds.patches import RADII

WIDE = np.append(RADII, 0.28)
"""Radii of patches of contact: pressure spreads farther than a fault of a lamina."""
