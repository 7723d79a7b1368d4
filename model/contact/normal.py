"""Normal contact between neighbouring laminas: stiffness modulus / spacing per area against opening."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from model.contact.tangential import jump
from model.elements.equations import Kron
from model.elements.mesh import Plan


def normal_krons(
    plan: Plan,
    spacing: NDArray[np.float64] | float,
    modulus: NDArray[np.float64],
    weight: NDArray[np.float64] | float = 1.0,
) -> tuple[Kron, ...]:
    """Return the normal contact stiffness for a tangent modulus modulus[k] weight(x, y).

    Parameters
    ----------
    plan : Plan
        The lamina's mesh.
    spacing : float or (n_interface,)
        Distance of neighbouring mid-planes, m.
    modulus : (n_interface,)
        Tangent modulus of each interface, Pa.
    weight : float or (n_element, n_point)
        Its variation over the plan, at the plan's quadrature points.
    """
    d = jump(modulus.size + 1)
    e: Any = sp.diags_array(modulus / spacing)
    return (Kron(row="w", column="w", z=(d.T @ e @ d).tocsr(), planar=plan.form("w", "w", weight=weight)),)
