"""Less or more of what a structure file states: all of one of its terms, such as a support or a joint."""

from __future__ import annotations

from functools import partial

import numpy as np
import scipy.sparse as sp

from updating.changes.candidate import Candidates, Kind, plain
from updating.changes.structure import Part, Structure, Vector


def why_not(structure: Structure) -> str | None:
    """Return why a structure without stated terms cannot have a change of one."""
    return None if structure.stated else "its model has no stated terms"


def of_terms(structure: Structure, at: Vector, *, sign: float, upper: float) -> Candidates:  # noqa: ARG001
    """Return each stated term with more (sign 1) or less (-1) of it; what is not there cannot be less."""
    number = [i for i, term in enumerate(structure.stated) if term.there or sign > 0.0]
    n, parts = len(number), list[Part]()
    for j, i in enumerate(number):
        for part in structure.stated[i].parts:
            one = sp.coo_array(part.weight)
            weight = sp.csr_array((sign * one.data, (one.coords[0] + j, one.coords[1])), (n, one.shape[1]))
            parts.append(Part(rows=part.rows, target=part.target, weight=weight))
    return plain(np.zeros((n, 3)), tuple(parts), part=np.array(number, dtype=np.intp), upper=upper)


KINDS = (
    Kind(
        name="lesser_term",
        label="less of a stated term",
        quantity="share of it that is gone",
        why_not=why_not,
        candidates=partial(of_terms, sign=-1.0, upper=1.0),
        on_plan=False,
        whole=1.0,
        local=False,
    ),
    Kind(
        name="greater_term",
        label="more of a stated term",
        quantity="share of it, or of what the file states, that was added",
        why_not=why_not,
        candidates=partial(of_terms, sign=1.0, upper=10.0),
        on_plan=False,
        local=False,
    ),
)
