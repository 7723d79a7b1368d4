"""Law of a contact that slips: Jenkins elements with Segalman's distribution of slip limits.

An Iwan model is many springs in parallel, each in series with a slider. With a power law of slip limits that ends in a
spike it has four parameters (D. J. Segalman, A four-parameter Iwan model for lap-type joints, J. Appl. Mech. 72,
2005, eqs. 19 to 26): the stiffness K_T, the force F_S at which all of it slides, the exponent chi and the share beta of
the spike. Here it is a law of shear stress over shear strain of an interface. K_T is the shear modulus G_f p and F_S
the traction mu p, so the strain from which everything slides is the same at every pressure.

Stress and strain are in units of G gamma_slide and gamma_slide here: all that a law has of its own is its shape.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class SlipLaw:
    """Shear stress of an interface over its shear strain.

    Attributes
    ----------
    friction : float
        mu, traction over pressure at which an interface slides as a whole.
    exponent : float
        chi, of the power law of slip limits, above -1; the loss of a cycle grows with strain to the 3 + chi.
    spike : float
        beta, what slips at once when everything slides, over what slips before, 0 or above.

    Raises
    ------
    ValueError
        A parameter lies outside its range.
    """

    friction: float
    exponent: float = -0.5
    spike: float = 0.0

    def __post_init__(self) -> None:
        if not (self.friction > 0.0 and self.exponent > -1.0 and self.spike >= 0.0):
            raise ValueError(f"{self}: friction must be above 0, the exponent above -1, the spike 0 or above")

    @property
    def _power(self) -> tuple[float, float]:
        """Density of the power law of slip limits, R, and stiffness of the spike, S (Segalman 2005, eq. 19)."""
        return (self.exponent + 1.0) / (1.0 + self.spike), self.spike / (1.0 + self.spike)

    @property
    def strength(self) -> float:
        """Stress at which everything slides, over that of a contact that never slips."""
        density, spike = self._power
        return density / (self.exponent + 2.0) + spike

    def sliding_strain(self, G_f: float) -> float:
        """Return the shear strain gamma_slide from which an interface slides as a whole (Segalman 2005, eq. 23)."""
        return self.friction / (G_f * self.strength)

    def stress(self, x: Vector) -> Vector:
        """Return the stress at strains x, 0 or above, at first loading (Segalman 2005, eq. 20), (n,)."""
        density, _ = self._power
        below = x - density * x ** (self.exponent + 2.0) / ((self.exponent + 1.0) * (self.exponent + 2.0))
        return np.where(x < 1.0, below, self.strength)

    def softening(self, x: Vector) -> Vector:
        """Return by which share a cycle of strain amplitude x, 0 or above, lowers the stiffness, (n,).

        It is that of the stress's first harmonic. The loop is the curve of first loading, twice as large (Masing's
        rules). Below sliding the integral over it is a ratio of gamma functions; beyond, a sum over sliders, each with
        the describing function of a Jenkins element.
        """
        spike = self._power[1]
        share = self._at_sliding * np.minimum(x, 1.0) ** (self.exponent + 1.0)
        beyond = x > 1.0
        if np.any(beyond):
            limit, weight = self._limits
            stuck = _jenkins(limit / x[beyond, None])
            share[beyond] = (1.0 - stuck) @ weight + spike * (1.0 - _jenkins(1.0 / x[beyond]))
        return share

    def reach(self, softening: float) -> float:
        """Return the strain x at which a cycle would lower the stiffness by a share, were none above 1."""
        return float((softening / self._at_sliding) ** (1.0 / (self.exponent + 1.0)))

    @property
    def _at_sliding(self) -> float:
        """Softening where everything is about to slide."""
        n = self.exponent + 2.0
        gamma = np.exp(scipy.special.gammaln(n + 0.5) - scipy.special.gammaln(n + 1.0))
        return float(4.0 / np.sqrt(np.pi) * gamma / (n + 1.0) * self._power[0] / (n - 1.0))

    def growth(self, x: Vector) -> Vector:
        """Return the derivative of `softening` by the logarithm of the strain amplitude x, (n,)."""
        _, spike = self._power
        grown = (self.exponent + 1.0) * self.softening(np.minimum(x, 1.0))
        beyond = x > 1.0
        if np.any(beyond):
            limit, weight = self._limits
            grown[beyond] = _growing(limit / x[beyond, None]) @ weight + spike * _growing(1.0 / x[beyond])
        return grown

    def loss(self, x: Vector) -> Vector:
        """Return the energy lost in a cycle of strain amplitude x over pi x**2, a loss factor, (n,).

        Below sliding it is Segalman 2005, eq. 28; beyond, each slider of limit t loses 4 t (x - t).
        """
        n = self.exponent + 2.0
        density, spike = self._power
        reach = np.minimum(x, 1.0)
        slid = density * (x * reach**n / n - reach ** (n + 1.0) / (n + 1.0)) + spike * np.maximum(x - 1.0, 0.0)
        return 4.0 * slid / (np.pi * np.where(x > 0.0, x, 1.0) ** 2)

    @cached_property
    def _limits(self) -> tuple[Vector, Vector]:
        """Slip limits and weights that integrate over the power law (Gauss and Jacobi)."""
        nodes = 60  # of the integral over slip limits where everything slides at the peak
        density, _ = self._power
        node, weight = scipy.special.roots_jacobi(nodes, 0.0, self.exponent)
        return 0.5 * (node + 1.0), density * weight / 2.0 ** (self.exponent + 1.0)

    def sliders(self, count: int) -> tuple[Vector, Vector]:
        """Return slip limits and stiffnesses, ``(count + 1,)`` each, of that many Jenkins elements and of the spike.

        The power law is cut into equal parts of its stiffness, each of which slips where it does on average.
        """
        density, spike = self._power
        m = self.exponent + 1.0
        edge = np.linspace(0.0, 1.0, count + 1) ** (1.0 / m)
        stiffness = np.full(count, density / m / count)
        limit = density * np.diff(edge ** (m + 1.0)) / (m + 1.0) / stiffness
        return np.append(limit, 1.0), np.append(stiffness, spike)


def _jenkins(limit: Vector) -> Vector:
    """Return the first harmonic of a Jenkins element's stress over that of its spring, for a slip limit 0 to 1."""
    angle = np.arccos(np.clip(1.0 - 2.0 * limit, -1.0, 1.0))
    return np.asarray((angle - np.sin(angle) * np.cos(angle)) / np.pi)


def _growing(limit: Vector) -> Vector:
    """Return the derivative of `_jenkins` by the logarithm of the slip limit."""
    return np.asarray(8.0 / np.pi * limit**1.5 * np.sqrt(1.0 - limit))
