"""What a round hole in a bent thin plate releases, against the solution with a free edge."""

from types import SimpleNamespace

import numpy as np
import pytest

from updating.changes.kinds.hole import _more

NU = 0.3


def edge_forces(power, n):
    """Return moment and shear force at radius 1 of a deflection r**power cos(n phi) of a plate of stiffness 1."""
    laplacian = power * power - n * n
    moment = -(power * (power - 1) + NU * (power - n * n))
    return np.array([moment, -(laplacian * (power - 2) - (1.0 - NU) * n * n * (power - 1))])


@pytest.mark.parametrize("n", [2, 3, 4])
def test_curvatures_that_vary_within_a_hole_release_what_the_exact_solution_does(n):
    """r**(n + 2) cos(n phi) is bent by forces that shear it; r**-n and r**(2 - n) free the edge (Timoshenko 1959)."""
    power, outside = n + 2, (-n, 2 - n)
    free = np.array([edge_forces(p, n) for p in outside]).T
    share = np.linalg.solve(free, -edge_forces(power, n))
    moment, force = edge_forces(power, n)
    released = force * (1.0 + share.sum()) - moment * (power + share @ outside)  # work at the edge, over pi
    mean, apart, twist = (power**2 - n**2) / 2, (power * (power - 1) - (power - n**2)) / 2, n * (power - 1)  # over r**n
    area = 1.0 / (2 * n + 2)  # integral of r**(2 n) over the radius
    even = 2.0 * (1.0 + NU) * mean**2 * area
    rest = 2.0 * (1.0 - NU) * (apart**2 + twist**2) * area
    plate = SimpleNamespace(stack=SimpleNamespace(material=SimpleNamespace(poisson=NU)))
    law = even * (2.0 / (1.0 - NU) + _more(plate)) + rest * 4.0 / (3.0 + NU)
    assert law == pytest.approx(released, rel=1e-9)
