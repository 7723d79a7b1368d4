"""What kinds share that add to the mass or to what holds the structure at a point."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from updating.changes.fields import Fields, Vector


def at_points(fields: Fields, at: Vector) -> tuple[Vector, Any]:
    """Return locations, (n, 2), and the weights of a point at each, (n, n_point)."""
    which, share = fields.grid.shares(at)
    row = np.broadcast_to(np.arange(len(at))[:, None], which.shape)
    weight = sp.coo_array(
        (share.ravel(), (row.ravel(), which.ravel())), shape=(len(at), len(fields.grid.point))
    )
    return at, weight.tocsr()
