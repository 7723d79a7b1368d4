"""Faces between trace lines, so that a structure of measured points is drawn as a body."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray


def faces(line: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return triangles (n, 3) that fill what three or four trace lines enclose, in rows of points.

    A ring of four with a line across is filled as the two rings of three that it consists of.

    Parameters
    ----------
    line : (n_line, 2) int
        Rows of points that trace lines join.
    """
    beside: dict[int, set[int]] = {}
    for a, b in line:
        if a != b:
            beside.setdefault(int(a), set()).add(int(b))
            beside.setdefault(int(b), set()).add(int(a))
    found: list[tuple[int, int, int]] = []
    for a, around in sorted(beside.items()):
        for b, d in combinations(sorted(p for p in around if p > a), 2):
            if d in beside[b]:
                found.append((a, b, d))
                continue
            opposite = (c for c in beside[b] & beside[d] if c > a and c not in around)
            found += [triangle for c in sorted(opposite) for triangle in ((a, b, c), (a, c, d))]
    return np.array(found, dtype=np.int64).reshape(-1, 3)
