"""Contact that slips, in a diagnosis: each mode of each force level has the softening and loss of its own strain.

To first order in the softening the contact keeps its shape. A mode whose contact holds the share e of its stiffness
then has omega**2 (1 - e s) and the further damping ratio e l / (2 (1 - e s)), with softening s and loss factor l
averaged over the contact's energy. At a drop of 5 % of frequency this is off by 0.1 % of it and by 3 % of damping
(`model.modes.backbone` has all of it).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model import ContactStrain, Effect

Vector = NDArray[np.float64]

N_SHARE = 16
"""Equal parts of the contact's energy, each at its own strain, that a mode is averaged over."""


@dataclass(frozen=True, eq=False, kw_only=True)
class AtLevel:
    """Which force level a configuration is.

    Attributes
    ----------
    state : str
        What all levels of one state have in common.
    rms_motion : (n_mode,) float
        Root mean square of the displacement amplitudes of all responses in resonance of each mode, m.
    motion : (n_mode,) float
        Displacement amplitude at the driving point there, m; where none is measured, at the point that moves most.
    """

    state: str
    rms_motion: Vector
    motion: Vector


@dataclass(frozen=True, eq=False, kw_only=True)
class Slipped:
    """What slip does to modes: factors on frequencies, added damping ratios, and their derivatives.

    Attributes
    ----------
    root : (n,) float
        What frequencies are multiplied by and damping ratios divided by.
    added : (n,) float
        What is then added to damping ratios.
    root_slope, added_slope : (n, n_parameter) float
        Their derivatives by the effect's parameters.
    """

    root: Vector
    added: Vector
    root_slope: Vector
    added_slope: Vector

    def damping(self, linear: Vector) -> tuple[Vector, Vector]:
        """Return damping ratios (n,) from those without slip, and their derivatives (n, n_parameter)."""
        return linear / self.root + self.added, self.added_slope - (linear / self.root**2)[:, None] * self.root_slope


def slip_effect(effects: Mapping[str, Effect]) -> Effect | None:
    """Return the effect that follows amplitude, if there is one."""
    return next((effect for effect in effects.values() if effect.over_strain is not None), None)


def silent_effects(effects: Mapping[str, Effect], *, several_levels: bool) -> dict[str, str]:
    """Return why effects are not asked about that follow amplitude, or that stand for one amplitude alone."""
    if several_levels:
        return {
            name: f"{name}: it is of one force level, and there are several here"
            for name, effect in effects.items()
            if effect.family == "amplitude" and effect.over_strain is None
        }
    return {
        name: (
            f"{name}: one force level does not show it; test again at a third or three times the force, and list that "
            "as [[configuration.force_level]]"
        )
        for name, effect in effects.items()
        if effect.over_strain is not None
    }


def strain_shares(strain: ContactStrain, coordinate: Vector) -> Vector:
    """Return the strains of `N_SHARE` equal parts of the contact's energy, ascending, of a deflection.

    Parameters
    ----------
    strain : ContactStrain
        The contact.
    coordinate : (n_basis,)
        The deflection in reduced coordinates.
    """
    size = strain.amplitude(coordinate)
    order = np.argsort(size)
    size, energy = size[order], (strain.weight * size**2)[order]
    below, moment = (np.append(0.0, np.cumsum(part)) for part in (energy, energy * size))
    ends = np.linspace(0.0, below[-1], N_SHARE + 1)
    return np.asarray(np.diff(np.interp(ends, below, moment)) / (below[-1] / N_SHARE))


def slipped(effect: Effect, values: Mapping[str, float], strain: Vector, held: Vector) -> Slipped:
    """Return what slip does to some modes.

    Parameters
    ----------
    effect : Effect
        With a law `over_strain`.
    values : mapping of str to float
        Its parameters.
    strain : (n, N_SHARE)
        Strains of each mode.
    held : (n,)
        Share of each mode's stiffness that the contact holds.
    """
    relative = 1e-4  # of a parameter's range, of differences: the law is smooth and costs nothing
    least = 0.05  # of a mode's stiffness, that stays however much slips

    def at(**moved: float) -> tuple[Vector, Vector]:
        softening, loss = effect.over_strain({**values, **moved}, strain)  # type: ignore[misc]
        left = np.maximum(1.0 - held * softening.mean(axis=1), least)
        return np.sqrt(left), held * loss.mean(axis=1) / (2.0 * left)

    root, added = at()
    root_slope, added_slope = np.zeros((2, root.size, len(effect.parameters)))
    for i, p in enumerate(effect.parameters):
        step = relative * (p.upper - p.lower)
        low, high = max(values[p.name] - step, p.lower), min(values[p.name] + step, p.upper)
        before, after = at(**{p.name: low}), at(**{p.name: high})
        root_slope[:, i], added_slope[:, i] = ((b - a) / (high - low) for a, b in zip(before, after, strict=True))
    return Slipped(root=root, added=added, root_slope=root_slope, added_slope=added_slope)
