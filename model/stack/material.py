"""Lamina material: a linear elastic sheet, isotropic or orthotropic along its rolling direction."""

from __future__ import annotations

import math
from dataclasses import dataclass

from model.stack.errors import StackError


@dataclass(frozen=True, eq=False, kw_only=True)
class Material:
    """Elastic constants and density of a sheet.

    Attributes
    ----------
    young : float
        Young's modulus along x (the rolling direction), Pa.
    poisson : float
        Poisson's ratio nu_xy: contraction along y under tension along x.
    density : float
        Mass per volume of the stack as it stands (gaps between the sheets included), kg/m3.
    transverse_ratio : float
        Young's modulus along y over that along x; 1 for isotropic steel.
    shear_ratio : float
        In-plane shear modulus over ``young / 2 (1 + poisson)``; 1 for isotropic steel.

    Raises
    ------
    StackError
        A constant is not positive, or the sheet's stiffness is not positive definite.
    """

    young: float
    poisson: float
    density: float
    transverse_ratio: float = 1.0
    shear_ratio: float = 1.0

    def __post_init__(self) -> None:
        for name in ("young", "density", "transverse_ratio", "shear_ratio"):
            if not 0.0 < getattr(self, name) < math.inf:
                message = f"material: {name} must be positive, got {getattr(self, name):g}"
                raise StackError(message)
        if not (-1.0 < self.poisson < 1.0 and self.poisson**2 * self.transverse_ratio < 1.0):
            message = (
                f"material: poisson = {self.poisson:g} with transverse_ratio = {self.transverse_ratio:g} is "
                "not stable; poisson must lie between -1 and 1 and poisson**2 * transverse_ratio below 1"
            )
            raise StackError(message)

    def plane_stress(self) -> tuple[float, float, float, float]:
        """Return the plane-stress stiffnesses (Q11, Q12, Q22, Q66), Pa (Reddy 2004, eq. 2.4.8)."""
        q11 = self.young / (1.0 - self.poisson**2 * self.transverse_ratio)
        q22 = q11 * self.transverse_ratio
        shear = self.shear_ratio * self.young / (2.0 * (1.0 + self.poisson))
        return q11, self.poisson * q22, q22, shear
