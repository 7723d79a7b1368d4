"""Measurement less model as one whitened residual: what fits, diagnosis and further tests share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model import Parameter
from updating.diagnosis.coordinates import scaled
from updating.diagnosis.evidence import SHARED, Evidence, pair, solved
from updating.diagnosis.mixing import Mixing
from updating.diagnosis.mode_space import ModeSpace

Vector = NDArray[np.float64]

BLOCKS = ("frequency", "damping", "shape", "prior")
"""Kinds of data."""
_WEAK = 0.05  # standard deviation of a shape, over its length


@dataclass(frozen=True, eq=False, kw_only=True)
class Residual:
    """Whitened differences of measurement and model.

    Attributes
    ----------
    value : (n,) float
        Measured less modelled, over the standard deviation; last the priors.
    jacobian : (n, n_coordinate) float
        Its derivatives by the coordinates: nuisances, then effect parameters over their range.
    kind : (n,) str
        One of `BLOCKS`.
    label : tuple of str
        Configuration and number of the mode, of each value.
    log_frequency, log_frequency_std : (n_frequency,) float
        Logarithms of measured over modelled frequencies, and what these are divided by in `value`.
    partner : (n_frequency,) int
        The model's elastic modes that they are of.
    mixing : tuple of Mixing
        The shapes of each configuration.
    weak : tuple of str
        Labels of modes whose shapes are stated so uncertainly that they do not judge a model: what is left of a mode
        beside stronger ones holds these' errors, of which its standard deviation knows nothing.
    """

    value: Vector
    jacobian: Vector
    kind: NDArray[np.str_]
    label: tuple[str, ...]
    log_frequency: Vector
    log_frequency_std: Vector
    partner: NDArray[np.int64]
    mixing: tuple[Mixing, ...]
    weak: tuple[str, ...]

    @cached_property
    def span(self) -> Vector:
        """Orthonormal columns, (n, n_coordinate) at most, that span what the coordinates can change."""
        length = np.linalg.norm(self.jacobian, axis=0)
        return np.asarray(la.orth(self.jacobian[:, length > 0.0] / length[length > 0.0]))


def residual(
    evidence: Evidence,
    nuisance: Vector,
    parameters: Sequence[Parameter] = (),
    coordinate: Vector | None = None,
) -> Residual:
    """Compare the measurement with the model at nuisance coordinates and coordinates of effect parameters.

    Parameters
    ----------
    evidence : Evidence
        Both.
    nuisance : (n_nuisance,)
        Logarithms of ratios to the stack's own values, as `Evidence.nuisances` names them.
    parameters : sequence of Parameter
        Effect parameters that take part.
    coordinate : (n_parameter,)
        Their coordinates in units of their ranges; neutral without.
    """
    z = np.zeros(len(parameters)) if coordinate is None else coordinate
    effect = {p.name: scaled(p, float(x)) for p, x in zip(parameters, z, strict=True)}
    n_own, n_tested, n_shared = len(evidence.nuisances), len(evidence.tested), len(SHARED)
    n_sized, n_common, s = evidence.n_sized, evidence.n_common, evidence.scatter
    value, rows, kinds, labels, logarithm, spreads, partner, mixed = [], [], [], [], [], [], [], []
    weak: list[str] = []
    for c, tested in enumerate(evidence.tested):
        theta = evidence.theta(nuisance, c)
        by = (*theta, *effect)
        modes = solved(evidence, c, {**theta, **{name: v for name, (v, _) in effect.items()}}, by)
        place = [modes.parameter.index(name) for name in by]
        per = np.array([*theta.values(), *(slope for _, slope in effect.values())])
        by_gain = evidence.by_gain(c)
        gain = np.exp(by_gain @ nuisance[n_sized:n_common])
        modes = replace(
            modes,
            shape=gain[:, None] * modes.shape,
            shape_gradient=gain[:, None, None] * modes.shape_gradient,
        )
        used, measured, shift = evidence.used[c], tested.modes, evidence.shift[c]
        _, column = pair(measured.shape[:, used], measured.frequency[used], modes)
        partner.append(column)

        def spread(gradient: Vector, c: int = c, per: Vector = per, place: list[int] = place) -> Vector:
            """Return derivatives by the coordinates from those by the model's parameters."""
            own = gradient[..., place] * per
            full = np.zeros((*own.shape[:-1], n_own + len(effect)))
            full[..., :n_shared], full[..., n_own:] = own[..., :n_shared], own[..., n_shared:]
            if n_tested > 1:
                full[..., n_common + c], full[..., n_common + n_tested + c] = own[..., 0], own[..., 1]
            return full

        mesh = shift.mesh[used]
        for kind, modelled, measured_std, own in (
            ("frequency", modes.pole_frequency, measured.frequency_std, np.hypot(s.frequency, s.mesh * mesh)),
            ("damping", modes.damping, measured.damping_std, s.damping),
        ):
            of_measured, of_model = getattr(measured, kind)[used], modelled[column]
            sigma = np.hypot(measured_std[used] / of_measured, own)
            safe = np.maximum(of_model, 1e-12)
            difference = np.log(of_measured / safe)
            gradient = spread(getattr(modes, f"{kind}_gradient")[column]) / safe[:, None]
            if kind == "frequency":
                gradient[:, n_shared:n_sized] = shift.slope[used]
                difference -= mesh + shift.slope[used] @ nuisance[n_shared:n_sized]
                logarithm.append(difference)
                spreads.append(sigma)
            value.append(difference / sigma)
            rows.append(-gradient / sigma[:, None])
            kinds += [kind] * used.size
            labels += [f"{tested.name}, mode {r + 1}" for r in used]
        u, v, length = unit_shapes(measured.shape[:, used], modes.shape[:, column])
        space = ModeSpace.of(modes, evidence.observed[c], s)
        mesh_shape = shift.mesh_shape[:, used]
        v = v + mesh_shape
        own_shape = np.hypot(s.shape, s.mesh * np.linalg.norm(mesh_shape, axis=0))
        form = np.zeros(used.size)
        for i, (r, m) in enumerate(zip(used, column, strict=True)):
            uncertain = measured.shape_std[:, r] / np.linalg.norm(measured.shape[:, r])
            sigma = np.hypot(uncertain, own_shape[i] / np.sqrt(len(u)))
            kept = space.apart(int(m), float(np.sqrt(np.mean(sigma**2))))
            slope = spread(modes.shape_gradient[:, m]) / length[i]
            slope[:, n_sized:n_common] = by_gain * v[:, i, None]
            if evidence.weight is not None:
                counted = evidence.weight[len(kinds) : len(kinds) + len(u)]
                form[i] = np.linalg.norm(sigma * np.sqrt(np.maximum(counted**-2 - 1.0, 0.0)))
            value.append(kept(u[:, i] - v[:, i]) / sigma)
            rows.append(-kept(slope) / sigma[:, None])
            kinds += ["shape"] * len(u)
            labels += [f"{tested.name}, mode {r + 1}"] * len(u)
            if np.linalg.norm(uncertain) > _WEAK:
                weak.append(labels[-1])
        mixed.append(space.mixing(u, v, column, form))
    std = np.concatenate(spreads)
    if evidence.weight is not None:
        std = std / evidence.weight[np.array(kinds) == "frequency"]
        weight = np.split(evidence.weight, np.cumsum([v.size for v in value])[:-1])
        value = [v * w for v, w in zip(value, weight, strict=True)]
        rows = [r * w[:, None] for r, w in zip(rows, weight, strict=True)]
    held = np.isfinite(evidence.prior_std)
    priors = np.flatnonzero(held)
    prior_rows = np.zeros((priors.size, n_own + len(effect)))
    prior_rows[np.arange(priors.size), priors] = -1.0 / evidence.prior_std[held]
    value.append(-nuisance[held] / evidence.prior_std[held])
    rows.append(prior_rows)
    kinds += ["prior"] * priors.size
    labels += [evidence.nuisances[i] for i in priors]
    return Residual(
        value=np.concatenate(value),
        jacobian=np.vstack(rows),
        kind=np.array(kinds),
        label=tuple(labels),
        log_frequency=np.concatenate(logarithm),
        log_frequency_std=std,
        partner=np.concatenate(partner),
        mixing=tuple(mixed),
        weak=tuple(weak),
    )


def unit_shapes(measured: NDArray[np.complex128] | Vector, modelled: Vector) -> tuple[Vector, Vector, Vector]:
    """Return measured and modelled shapes at unit length, (n_dof, n_mode) each.

    The modelled ones are turned as the measured ones are: a solver's own sign is by chance, and residuals are compared.
    Last is what they were divided by: their lengths, negative where they were turned.
    """
    u = unit_shape(measured)
    length = np.linalg.norm(modelled, axis=0) * np.where(np.sum(u * modelled, axis=0) < 0.0, -1.0, 1.0)
    return u, modelled / length, length


def unit_shape(measured: NDArray[np.complex128] | Vector) -> Vector:
    """Return measured shapes, (n_dof, n_mode), turned real and at unit length."""
    turned = np.real(measured * np.exp(-0.5j * np.angle(np.sum(measured**2, axis=0))))
    return np.asarray(turned / np.linalg.norm(measured, axis=0))
