"""Tangential contact between neighbouring laminas, integrated over the area.

The shear strain of an interface is (u[k+1] - u[k]) / spacing + dw/dx, and the same in y with v, where dw/dx
is the mean slope of the two laminas: a lamina that tilts carries its faces along. The shear modulus is G =
G_f p.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from model.elements.equations import Kron
from model.elements.mesh import Derivative, Field, Plan


def jump(n_lamina: int) -> sp.csr_array:
    """Return the matrix of differences between neighbouring laminas, (n_lamina - 1, n_lamina)."""
    ones = np.ones(n_lamina - 1)
    return sp.diags_array([-ones, ones], offsets=[0, 1], shape=(n_lamina - 1, n_lamina)).tocsr()


def mean(n_lamina: int) -> sp.csr_array:
    """Return the matrix of means of neighbouring laminas, (n_lamina - 1, n_lamina)."""
    halves = np.full(n_lamina - 1, 0.5)
    return sp.diags_array([halves, halves], offsets=[0, 1], shape=(n_lamina - 1, n_lamina)).tocsr()


def tangential_krons(
    plan: Plan,
    spacing: NDArray[np.float64] | float,
    modulus: NDArray[np.float64],
    weight: NDArray[np.float64] | float = 1.0,
    axes: str = "xy",
) -> tuple[Kron, ...]:
    """Return the tangential contact stiffness for a shear modulus modulus[k] weight(x, y).

    Parameters
    ----------
    plan : Plan
        The lamina's mesh.
    spacing : float or (n_interface,)
        Distance of neighbouring mid-planes, m.
    modulus : (n_interface,)
        Shear modulus of each interface, Pa.
    weight : float or (n_element, n_point)
        Its variation over the plan, at the plan's quadrature points.
    axes : "xy", "x" or "y"
        Directions of slip that it resists.
    """
    n_lamina = modulus.size + 1
    d, a = jump(n_lamina), mean(n_lamina)
    over: Any = sp.diags_array(modulus / spacing)
    g: Any = sp.diags_array(modulus)
    times: Any = sp.diags_array(modulus * spacing)
    krons: list[Kron] = []
    directions: dict[str, tuple[Field, Derivative]] = {"x": ("u", "x"), "y": ("v", "y")}
    for axis in axes:
        field, slope = directions[axis]
        krons += [
            Kron(
                row=field,
                column=field,
                z=(d.T @ over @ d).tocsr(),
                planar=plan.form(field, field, weight=weight),
            ),
            Kron(
                row=field,
                column="w",
                z=(d.T @ g @ a).tocsr(),
                planar=plan.form(field, "w", ("", slope), weight),
            ),
            Kron(
                row="w",
                column="w",
                z=(a.T @ times @ a).tocsr(),
                planar=plan.form("w", "w", (slope, slope), weight),
            ),
        ]
    return tuple(krons)
