"""Measurement less model as one whitened residual: what fits, diagnosis and further tests share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model import Modes, Parameter
from updating.diagnosis.coordinates import scaled
from updating.diagnosis.discrepancy import (
    CLOSEST,
    Block,
    Discrepancy,
    MeasuredShape,
    alike,
    block_of,
    mixing_of,
    shape_block,
)
from updating.diagnosis.evidence import SHARED, Evidence, pair, solved, unit_shape
from updating.diagnosis.mode_space import ModeSpace
from updating.diagnosis.sensor_place import motion
from updating.diagnosis.slipping import Slipped, slip_effect, slipped

Vector = NDArray[np.float64]

_RESOLVED = 3e-5  # of a frequency, that a reduced model leaves
_LEAST = 1e-3  # of a measured value, below which a modelled one counts as that
_REPEATED = 1e-3  # of a damping ratio, below which no identification is told from another


@dataclass(frozen=True, eq=False, kw_only=True)
class Residual:
    """Differences of measurement and model, rotated so that noise is white and discrepancies are uncorrelated.

    Attributes
    ----------
    value : (n,) float
        Over the standard deviation that noise and discrepancy have at `Evidence.sizes`; last the priors.
    jacobian : (n, n_coordinate) float
        Its derivatives by the coordinates: nuisances, then effect parameters over their range.
    kind : (n,) str
        "frequency", "damping", "shape" or "prior".
    rotated, rotated_jacobian : (n_data,) and (n_data, n_coordinate) float
        Before they were divided, without the priors.
    log_frequency, log_damping : (n_frequency,) float
        Logarithms of measured over modelled values, configuration by configuration; damping of laminas that touch.
    partner : (n_frequency,) int
        The model's elastic modes that they are of.
    """

    value: Vector
    jacobian: Vector
    kind: NDArray[np.str_]
    rotated: Vector
    rotated_jacobian: Vector
    log_frequency: Vector
    log_damping: Vector
    partner: NDArray[np.int64]

    @property
    def frequency_error(self) -> float:
        """Mean relative error of the model's frequencies over all modes that are used."""
        return float(np.mean(np.abs(np.expm1(-self.log_frequency))))

    @property
    def damping_error(self) -> float:
        """Mean relative error of the model's damping ratios over all modes used; NaN where none is compared."""
        return float(np.mean(np.abs(np.expm1(-self.log_damping)))) if self.log_damping.size else float("nan")


@dataclass(frozen=True, eq=False, kw_only=True)
class _Compared:
    """One configuration beside the model at some coordinates: differences and derivatives, not whitened.

    `frequency` and `damping` are (n_mode,), `shape` (n_mode, n_dof), with Jacobians of one axis more; `u` are the
    measured shapes and `v` the modelled ones at unit length, (n_dof, n_mode), and `slope` is the change of the former
    as points move along x and y, (n_dof, 2, n_mode), 1/m.
    """

    frequency: tuple[Vector, Vector]
    damping: tuple[Vector, Vector]
    shape: tuple[Vector, Vector]
    u: Vector
    v: Vector
    slope: Vector
    modes: Modes
    column: NDArray[np.int64]


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
        Both, with the covariance of what separates them.
    nuisance : (n_nuisance,)
        Logarithms of ratios to the stack's own values, as `Evidence.nuisances` names them.
    parameters : sequence of Parameter
        Effect parameters that take part.
    coordinate : (n_parameter,)
        Their coordinates in units of their ranges; neutral without.
    """
    effect = _values(parameters, coordinate)
    compared = _every_compared(evidence, nuisance, effect)
    kind = evidence.rows.kind
    value = _value(compared)
    if evidence.offset is not None:
        value += evidence.offset
    width = len(evidence.nuisances) + len(effect)
    rows = np.concatenate(
        [
            np.concatenate([own.frequency[1], own.damping[1], own.shape[1].reshape(-1, width)])
            for own in compared
        ]
    )
    discrepancy = evidence.covariance
    rotated, rotated_rows = discrepancy.rotated(value), discrepancy.rotated(rows)
    weight = 1.0 / np.sqrt(1.0 + evidence.sizes.of(kind) ** 2 * discrepancy.growth)
    held = np.flatnonzero(np.isfinite(evidence.prior_std))
    prior_rows = np.zeros((held.size, width))
    prior_rows[np.arange(held.size), held] = -1.0 / evidence.prior_std[held]
    return Residual(
        value=np.concatenate([weight * rotated, -nuisance[held] / evidence.prior_std[held]]),
        jacobian=np.vstack([weight[:, None] * rotated_rows, prior_rows]),
        kind=np.append(kind, np.full(held.size, "prior")),
        rotated=rotated,
        rotated_jacobian=rotated_rows,
        log_frequency=value[kind == "frequency"],
        log_damping=value[kind == "damping"],
        partner=np.concatenate([own.column for own in compared]),
    )


def rough_about(
    evidence: Evidence,
    nuisance: Vector,
    parameters: Sequence[Parameter] = (),
    coordinate: Vector | None = None,
) -> Evidence:
    """Return the evidence beside a rough model that agrees with the full one about some coordinates.

    What differs there is taken for what differs nearby, so that the rough one tells of changes alone, at a fifth of the
    time.

    Parameters
    ----------
    evidence, nuisance, parameters, coordinate
        As in `residual`.
    """
    rough, effect = evidence.rough, _values(parameters, coordinate)
    exact, quick = (_value(_every_compared(own, nuisance, effect)) for own in (evidence, rough))
    return replace(rough, offset=exact - quick)


def _value(compared: Sequence[_Compared]) -> Vector:
    """Return measured less modelled data, configuration by configuration."""
    return np.concatenate(
        [np.concatenate([own.frequency[0], own.damping[0], own.shape[0].ravel()]) for own in compared]
    )


def reweighed(found: Residual, evidence: Evidence) -> Residual:
    """Return a residual over the standard deviations at other sizes of the discrepancy, those of `evidence`."""
    n = found.rotated.size
    size = evidence.sizes.of(found.kind[:n])
    weight = 1.0 / np.sqrt(1.0 + size**2 * evidence.covariance.growth)
    value, jacobian = found.value.copy(), found.jacobian.copy()
    value[:n], jacobian[:n] = weight * found.rotated, weight[:, None] * found.rotated_jacobian
    return replace(found, value=value, jacobian=jacobian)


@dataclass(frozen=True, eq=False, kw_only=True)
class Spread:
    """How far the data scatter by noise, mesh and errors of places, and the forms that discrepancies of shapes have.

    Attributes
    ----------
    frequency, damping : (n_frequency,) and (n_damping,) float
        Relative standard deviations, configuration by configuration.
    shape : tuple of MeasuredShape
        Each shape that is used, configuration by configuration.
    """

    frequency: Vector
    damping: Vector
    shape: tuple[MeasuredShape, ...]


def covariance_of(
    evidence: Evidence,
    nuisance: Vector,
    parameters: Sequence[Parameter] = (),
    coordinate: Vector | None = None,
) -> Discrepancy:
    """Return the covariance of noise and discrepancy, with the model's modes where it is compared.

    Parameters
    ----------
    evidence, nuisance, parameters, coordinate
        As in `residual`.
    """
    rows, spread = evidence.rows, spread_of(evidence, nuisance, parameters, coordinate)
    blocks: list[Block] = [shape_block(spread.shape)]
    for kind, std in (("frequency", spread.frequency), ("damping", spread.damping)):
        of_kind = np.flatnonzero(rows.kind == kind)
        for mode in np.unique(rows.mode[of_kind]):
            own_rows = rows.mode[of_kind] == mode
            noise = np.diag(std[own_rows] ** 2)
            blocks.append(block_of(of_kind[own_rows], noise, alike(int(own_rows.sum()))))
    return Discrepancy(blocks=tuple(blocks))


def spread_of(
    evidence: Evidence,
    nuisance: Vector,
    parameters: Sequence[Parameter] = (),
    coordinate: Vector | None = None,
) -> Spread:
    """Return how far the data scatter, with the model's modes where it is compared.

    Parameters
    ----------
    evidence, nuisance, parameters, coordinate
        As in `residual`.
    """
    effect, s, rows = _values(parameters, coordinate), evidence.scatter, evidence.rows
    std: dict[str, list[Vector]] = {"frequency": [], "damping": []}
    shapes, lengths = [], []
    nodes = np.unique(np.concatenate([observed.node for observed in evidence.observed]))
    compared = _every_compared(evidence, nuisance, effect)
    for c, (tested, own) in enumerate(zip(evidence.tested, compared, strict=True)):
        point = np.searchsorted(nodes, evidence.observed[c].node)
        used, measured, shift = evidence.used[c], tested.modes, evidence.shift[c]
        space = ModeSpace.of(own.modes, evidence.observed[c], evidence.stack)
        resolved = np.hypot(measured.frequency_std[used] / measured.frequency[used], _RESOLVED)
        std["frequency"].append(np.hypot(resolved, s.mesh * shift.mesh[used]))
        std["damping"].append(np.hypot(measured.damping_std[used] / measured.damping[used], _REPEATED))
        mesh = s.mesh * np.linalg.norm(shift.mesh_shape[:, used], axis=0)
        for i, (r, m) in enumerate(zip(used, own.column, strict=True)):
            uncertain = measured.shape_std[:, r] / np.linalg.norm(measured.shape[:, r])
            scattered = np.hypot(evidence.sensor_scatter[c][r], mesh[i]) / np.sqrt(len(own.u))
            mixing, length = mixing_of(int(m), space.frequency, space.shape)
            slope = np.zeros((len(own.u), 2, nodes.size))
            slope[np.arange(len(own.u)), :, point] = evidence.point_place * own.slope[:, :, i]
            lengths.append(length)
            shapes.append(
                MeasuredShape(
                    row=rows.shape[c, i],
                    mode=int(rows.mode[rows.shape[c, i][0]]),
                    shape=own.u[:, i],
                    std=np.hypot(uncertain, scattered),
                    slope=slope.reshape(len(own.u), -1),
                    mixing=mixing,
                )
            )
    usual = float(np.median(lengths))
    return Spread(
        frequency=np.concatenate(std["frequency"]),
        damping=np.concatenate(std["damping"]),
        shape=tuple(replace(own, mixing=own.mixing.over(usual)) for own in shapes),
    )


def _values(parameters: Sequence[Parameter], coordinate: Vector | None) -> dict[str, tuple[float, float]]:
    """Return values of effect parameters with their derivatives by the coordinates."""
    z = np.zeros(len(parameters)) if coordinate is None else coordinate
    return {p.name: scaled(p, float(x)) for p, x in zip(parameters, z, strict=True)}


def together(evidence: Evidence) -> tuple[tuple[int, ...], ...]:
    """Return configurations that have the model's modes in common: levels of one state, seen at the same points."""
    groups: dict[tuple[str, bytes], list[int]] = {}
    for c, (own, observed) in enumerate(zip(evidence.tested, evidence.observed, strict=True)):
        groups.setdefault((own.assembled, observed.reduced_rows.tobytes()), []).append(c)
    return tuple(map(tuple, groups.values()))


def _every_compared(
    evidence: Evidence, nuisance: Vector, effect: Mapping[str, tuple[float, float]]
) -> list[_Compared]:
    """Put every configuration beside the model, which is solved once for those that have their modes in common."""
    found = {}
    for group in together(evidence):
        modes = _modes_of(evidence, group, nuisance, effect)
        found.update({c: _compared(evidence, c, nuisance, effect, modes) for c in group})
    return [found[c] for c in range(len(evidence.tested))]


def _modes_of(
    evidence: Evidence, group: Sequence[int], nuisance: Vector, effect: Mapping[str, tuple[float, float]]
) -> Modes:
    """Return the modes that some configurations have in common, with derivatives of those that any of them measured."""
    c = group[0]
    theta = evidence.theta(nuisance, c)
    values = {**theta, **{name: v for name, (v, _) in effect.items()}}

    def partners(frequency: Vector, shape: Vector) -> NDArray[np.int64]:
        return np.unique(np.concatenate([_partners(evidence, i, nuisance, frequency, shape) for i in group]))

    return solved(evidence, c, _linear_part(evidence, c, values), (*theta, *effect), differentiated=partners)


def _partners(
    evidence: Evidence, c: int, nuisance: Vector, frequency: Vector, shape: Vector
) -> NDArray[np.int64]:
    """Return the model's modes that the measured ones of a configuration are, as its sensors see them."""
    used, measured = evidence.used[c], evidence.tested[c].modes
    seen = _gain(evidence, c, nuisance)[:, None] * shape
    return pair(measured.shape[:, used], measured.frequency[used], seen, frequency)[1]


def _gain(evidence: Evidence, c: int, nuisance: Vector) -> Vector:
    """Return what each shape component of a configuration is multiplied by for its sensor, (n_dof,)."""
    return np.exp(evidence.by_gain(c) @ nuisance[evidence.n_sized : evidence.n_common - 2])


def _compared(
    evidence: Evidence, c: int, nuisance: Vector, effect: Mapping[str, tuple[float, float]], modes: Modes
) -> _Compared:
    """Put one configuration beside the model's modes."""
    n_shared, n_sized, n_common = len(evidence.shared), evidence.n_sized, evidence.n_common
    theta = evidence.theta(nuisance, c)
    by_gain, gain = evidence.by_gain(c), _gain(evidence, c, nuisance)
    moved, decay = nuisance[n_common - 2 : n_common]
    used, measured, shift = evidence.used[c], evidence.tested[c].modes, evidence.shift[c]
    place = [modes.parameter.index(name) for name in (*theta, *effect)]
    column = _partners(evidence, c, nuisance, modes.frequency, modes.shape)
    shape = gain[:, None] * modes.shape
    gradient = gain[:, None, None] * modes.shape_gradient[:, column]

    def spread(derivative: Vector) -> Vector:
        return _by_coordinates(evidence, c, theta, effect, derivative[..., place])

    def logarithms(kind: str, modelled: Vector, slope: Vector) -> tuple[Vector, Vector]:
        value = getattr(measured, kind)[used]
        safe = np.maximum(modelled[column], _LEAST * value)  # damping of a step too far may be negative
        return np.log(value / safe), -spread(slope[column]) / safe[:, None]

    frequency, frequency_rows = logarithms("frequency", modes.pole_frequency, modes.frequency_gradient)
    slip = _slip(evidence, c, effect, theta["G_f"], modes, column)
    frequency_rows[:, len(evidence.nuisances) :] -= slip.root_slope / slip.root[:, None]
    frequency_rows[:, n_shared:n_sized] = -shift.slope[used]
    frequency -= np.log(slip.root) + shift.mesh[used] + shift.slope[used] @ nuisance[n_shared:n_sized]
    by_decay = 0.5 / (np.pi * modes.frequency)
    damped = modes.damping + decay * by_decay
    damped[column], by_slip = slip.damping(damped[column])
    damping, damping_rows = logarithms("damping", damped, modes.damping_gradient)
    least = np.maximum(damped[column], _LEAST * measured.damping[used])
    damping_rows[:, len(evidence.nuisances) :] -= by_slip / least[:, None]
    damping_rows[:, n_common - 1] = -by_decay[column] / least
    u, unit, length = unit_shapes(measured.shape[:, used], shape[:, column])
    along = gain[:, None, None] * (evidence.place_slope[c] @ motion(modes, u, shape, column))
    v = unit + shift.mesh_shape[:, used] + moved * along[:, 0]
    rows = []
    for i, m in enumerate(column):
        slope = spread(_without_twins(gradient[:, i], shape, modes.frequency, int(m))) / length[i]
        slope[:, n_sized : n_common - 2] = by_gain * unit[:, i, None]
        # at unit length: else mass, by which modes are normalised, would seem to shrink what shapes differ by
        slope -= np.outer(unit[:, i], unit[:, i] @ slope)
        slope[:, n_common - 2] = along[:, 0, i]
        rows.append(-slope)
    return _Compared(
        frequency=(frequency, frequency_rows),
        damping=(damping, damping_rows) if evidence.touching else (damping[:0], damping_rows[:0]),
        shape=((u - v).T, np.stack(rows)),
        u=u,
        v=v,
        slope=along,
        modes=modes,
        column=column,
    )


def _linear_part(evidence: Evidence, c: int, values: Mapping[str, float]) -> dict[str, float]:
    """Return parameters without those of slip, where each mode has its own: the linear model's are left."""
    effect = None if evidence.tested[c].strain is None else slip_effect(evidence.effects)
    own = {p.name for p in effect.parameters} if effect else set()
    return {name: value for name, value in values.items() if name not in own}


def _slip(
    evidence: Evidence,
    c: int,
    values: Mapping[str, tuple[float, float]],
    G_f: float,
    modes: Modes,
    column: NDArray[np.int64],
) -> Slipped:
    """Return what slip does to the modes that are used, by the coordinates of all effects; nothing at one level."""
    strain, effect = evidence.tested[c].strain, slip_effect(evidence.effects)
    own = () if effect is None else tuple(p.name for p in effect.parameters)
    slopes = np.zeros((2, column.size, len(values)))
    if strain is None or effect is None or not set(own) <= values.keys():
        nothing = np.zeros(column.size)
        return Slipped(root=nothing + 1.0, added=nothing, root_slope=slopes[0], added_slope=slopes[1])
    by_stiffness = modes.frequency_gradient[column, modes.parameter.index("G_f")]
    held = 2.0 * G_f * by_stiffness / modes.frequency[column]
    found = slipped(effect, {n: values[n][0] for n in own}, strain[evidence.used[c]], held)
    for i, name in enumerate(own):
        at = list(values).index(name)
        slopes[0, :, at] = values[name][1] * found.root_slope[:, i]
        slopes[1, :, at] = values[name][1] * found.added_slope[:, i]
    return replace(found, root_slope=slopes[0], added_slope=slopes[1])


def _by_coordinates(
    evidence: Evidence,
    c: int,
    theta: Mapping[str, float],
    effect: Mapping[str, tuple[float, float]],
    derivative: Vector,
) -> Vector:
    """Return derivatives by the coordinates, (..., n_coordinate), from those by model parameters, nuisances first."""
    per = [
        *(theta[name] for name in SHARED),
        *(1.0 for _ in evidence.places),
        *(slope for _, slope in effect.values()),
    ]
    n_shared, n_common, n_nuisance = len(evidence.shared), evidence.n_common, len(evidence.nuisances)
    own = derivative * np.array(per)
    full = np.zeros((*own.shape[:-1], n_nuisance + len(effect)))
    full[..., :n_shared], full[..., n_nuisance:] = own[..., :n_shared], own[..., n_shared:]
    if len(evidence.states) > 1:
        state = n_common + evidence.state_of(c)
        full[..., state] = own[..., 0]
        full[..., state + len(evidence.states)] = own[..., 1]
    return full


def _without_twins(gradient: Vector, shape: Vector, frequency: Vector, m: int) -> Vector:
    """Return the derivatives (n_dof, n_parameter) of a shape without its turning into modes at the same frequency.

    Any change turns these into each other, at no rate that holds for a step: their subspace alone is compared.
    """
    twin = np.abs((frequency / frequency[m]) ** 2 - 1.0) < 1.0 / CLOSEST
    twin[m] = False
    if not np.any(twin):
        return gradient
    q = np.linalg.qr(shape[:, twin])[0]
    return np.asarray(gradient - q @ (q.T @ gradient))


def unit_shapes(measured: NDArray[np.complex128] | Vector, modelled: Vector) -> tuple[Vector, Vector, Vector]:
    """Return measured and modelled shapes at unit length, (n_dof, n_mode) each.

    The modelled ones are turned as the measured ones are: a solver's own sign is by chance, and residuals are compared.
    Last is what they were divided by: their lengths, negative where they were turned.
    """
    u = unit_shape(measured)
    length = np.linalg.norm(modelled, axis=0) * np.where(np.sum(u * modelled, axis=0) < 0.0, -1.0, 1.0)
    return u, modelled / length, length
