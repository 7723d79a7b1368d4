"""The configurations of a campaign side by side: modes followed, repeats of a state, statements that they contradict.

An interval of a single run is what the noise of that run leaves open. What changes between runs, as temperature,
settling, support and sensors taken off and put back, is not in it, and is seen only when a state is measured again.

A stack that is pressed more is stiffer, pressure grows with torque, and mode shapes of unit modal mass hardly change,
at the places of one sensor as at those of the others: what contradicts this was stated wrongly, or stands in the wrong
place.

A change moves frequencies, so that modes may cross, and turns shapes. Where two modes lie close, the smallest change
mixes them: either of them may then look like any mixture of both, and only the plane that they span stays.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
import scipy.linalg as la
from numpy.typing import ArrayLike

from ema.campaign.campaign import Configuration
from ema.modal.mac import mac
from ema.types.frf import shared_dofs
from ema.types.modal_model import ModalModel
from lamella_shared import Booleans, Complexes, Integers, Reals, arrays


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"n": "frequency scatter stated damping_scatter damping_stated"})
class Repeats:
    """Configurations that state one and the same condition of the structure.

    Attributes
    ----------
    name : tuple of str
        The configurations, in the order of the campaign.
    frequency : (n_mode,) float
        Mean natural frequency of each mode that at least two of them have, Hz.
    scatter : (n_mode,) float
        Standard deviation of it from repeat to repeat, Hz.
    stated : (n_mode,) float
        Root mean square of the standard deviations that the repeats state each, Hz.
    damping_scatter, damping_stated : (n_mode,) float
        The same of the damping ratio.
    """

    name: tuple[str, ...]
    frequency: Reals
    scatter: Reals
    stated: Reals
    damping_scatter: Reals
    damping_stated: Reals

    @property
    def finding(self) -> str:
        """What a user should read."""
        names = ", ".join(self.name)
        if not self.frequency.size:
            return f"{names} state the same condition, but share no mode"
        relative = self.scatter / self.frequency
        k = int(np.argmax(relative))
        return (
            f"{names} state the same condition: frequencies scatter by {100 * np.median(relative):.2g} % in the "
            f"median and {100 * relative[k]:.2g} % at {self.frequency[k]:.5g} Hz, which is "
            f"{np.median(self.scatter / self.stated):.2g} times what the noise of each run leaves open; "
            "a frequency of this campaign is known no better than that"
        )


def repeats(configurations: Sequence[Configuration], comparison: Comparison) -> tuple[Repeats, ...]:
    """Compare the configurations that repeat one another, or state the same stack, torque, pressure and height.

    A state that has a reference is no repeat of it, whatever both state of torque and pressure.

    Parameters
    ----------
    configurations : sequence of Configuration
        Those of the comparison, in its order. One that states neither torque nor pressure is no repeat, unless it
        says what it repeats.
    comparison : Comparison

    Returns
    -------
    tuple of Repeats
        One for each condition that more than one of them states.
    """
    groups: dict[tuple[object, ...], list[int]] = {}
    repeated = {configuration.repeat_of for configuration in configurations} - {None}
    for k, configuration in enumerate(configurations):
        if configuration.repeat_of is not None or configuration.name in repeated:
            groups.setdefault((configuration.repeat_of or configuration.name,), []).append(k)
        elif configuration.compare_to:
            continue
        elif configuration.torque is not None or configuration.pressure is not None:
            groups.setdefault(
                (configuration.stack, configuration.torque, configuration.pressure, configuration.height), []
            ).append(k)
    return tuple(_compared(comparison, np.array(group)) for group in groups.values() if len(group) > 1)


def _compared(comparison: Comparison, group: Integers) -> Repeats:
    shared = np.count_nonzero(np.isfinite(comparison.frequency[group]), axis=0) > 1
    cells = np.ix_(group, shared)
    return Repeats(
        name=tuple(comparison.name[k] for k in group),
        frequency=np.nanmean(comparison.frequency[cells], axis=0),
        scatter=np.nanstd(comparison.frequency[cells], axis=0, ddof=1),
        stated=np.sqrt(np.nanmean(comparison.frequency_std[cells] ** 2, axis=0)),
        damping_scatter=np.nanstd(comparison.damping[cells], axis=0, ddof=1),
        damping_stated=np.sqrt(np.nanmean(comparison.damping_std[cells] ** 2, axis=0)),
    )


def factor_text(factor: float, *, near: float = 0.15) -> str:
    """Return a factor as text, with the units that it is the ratio of, such as ``9.7 times (g for m/s²)``.

    `near`: difference of the logarithms.
    """
    # Ratios of units that are taken for each other.
    known = {9.80665: "g for m/s²", 4.448222: "N for lbf", 1000.0: "a prefix, as in mm", 2.0 * np.pi: "rad/s for Hz"}
    said = f"{factor:.3g} times"
    for ratio, what in known.items():
        if abs(abs(np.log(factor)) - np.log(ratio)) < near:
            return f"{said} ({what} would do this)"
    return said


_MORE = 1.02  # ratio of two pressures or torques from which one is more
_FEWEST_PER_SENSOR = 3


def contradicted(
    configurations: Sequence[Configuration], models: Sequence[ModalModel], comparison: Comparison
) -> tuple[str, ...]:
    """Say what the configurations of a campaign state that contradicts each other or their modes.

    Parameters
    ----------
    configurations : sequence of Configuration
        In the order of the comparison.
    models : sequence of ModalModel
        Their modes.
    comparison : Comparison
        Modes followed through them.
    """
    return (
        *_out_of_proportion(configurations),
        *_softer(configurations, comparison),
        *_out_of_scale(models, comparison),
        *_sensor_changed(models, comparison),
    )


def _pairs(configurations: Sequence[Configuration], key: Literal["pressure", "torque"]) -> Iterator[tuple[int, int]]:
    """Yield pairs of configurations of one stack that follow each other as pressure or torque grows."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for k, configuration in enumerate(configurations):
        if getattr(configuration, key) is not None:
            groups.setdefault((configuration.stack, configuration.height), []).append(k)
    for group in groups.values():
        ordered = sorted(group, key=lambda k: float(getattr(configurations[k], key)))
        for low, high in itertools.pairwise(ordered):
            if getattr(configurations[high], key) > _MORE * getattr(configurations[low], key):
                yield low, high


def _out_of_proportion(configurations: Sequence[Configuration], *, in_proportion: float = 0.1) -> Iterator[str]:
    """Say where pressure does not grow with torque as it does at the other configurations of a stack.

    `in_proportion`: relative difference of two pressures per torque up to which bolts and clamps are the same.
    """
    for low, high in _pairs(configurations, "torque"):
        one, other = configurations[low], configurations[high]
        if one.pressure is None or other.pressure is None or not one.torque or not other.torque:
            continue
        if other.pressure * _MORE < one.pressure:
            yield (
                f"{_said(one)} and {_said(other)}: the pressure falls as the torque rises; one of the four numbers is "
                "wrong, or two are exchanged"
            )
        elif abs(np.log(other.pressure * one.torque / (one.pressure * other.torque))) > in_proportion:
            yield (
                f"{_said(one)} and {_said(other)}: that is {1e-3 * one.pressure / one.torque:.4g} and "
                f"{1e-3 * other.pressure / other.torque:.4g} kPa for each N m, but with the same bolts and clamps "
                "pressure is proportional to torque; check both"
            )


def _said(one: Configuration) -> str:
    return f"{one.name} states {one.torque:g} N m and {1e-3 * (one.pressure or 0.0):g} kPa"


def _softer(configurations: Sequence[Configuration], comparison: Comparison, *, fall: float = -2e-3) -> Iterator[str]:
    """Say where a stack gets softer under more pressure or, where none is stated, more torque.

    `fall`: median change of the logarithms of frequencies under more pressure, below which a stack gets softer: a
    repeat of one state scatters less.
    """
    for key, unit, factor in (("pressure", "kPa", 1e-3), ("torque", "N m", 1.0)):
        for low, high in _pairs(configurations, key):  # type: ignore[arg-type]
            one, other = configurations[low], configurations[high]
            if key == "torque" and None not in (one.pressure, other.pressure):
                continue
            change = np.log(comparison.frequency[high] / comparison.frequency[low])
            change = change[np.isfinite(change)]
            if change.size and np.median(change) < fall:
                values = (f"{factor * getattr(c, key):g}" for c in (one, other))
                yield (
                    f"the stack gets softer under pressure: from {one.name} to {other.name} the stated {key} rises "
                    f"({' to '.join(values)} {unit}), but frequencies fall by "
                    f"{100.0 * -np.expm1(np.median(change)):.2g} % in the median of {change.size} modes; the "
                    f"{key}s or the files of the two are exchanged, or one is stated wrongly"
                )


def _out_of_scale(models: Sequence[ModalModel], comparison: Comparison, *, scale: float = 1.5) -> Iterator[str]:
    """Say of which configurations all functions are larger than those of the first by one factor, or turned.

    `scale`: ratio of the functions of two configurations from which they are not of one calibration: sensors agree to
    some per cent, and shapes of unit modal mass hardly change with the contact.
    """
    turned = np.pi / 4.0
    for k in range(1, len(models)):
        ratio = _ratios(models[0], models[k], comparison.frequency[[0, k]])
        if not ratio.size:
            continue
        size, phase = (float(np.exp(np.median(np.log(np.abs(ratio))))), float(np.angle(np.sum(ratio / np.abs(ratio)))))
        name, first = models[k].name, models[0].name
        if abs(np.log(size)) > np.log(scale):
            yield (
                f"all functions of {name} are {factor_text(size)} as large as those of {first} ({ratio.size} modes in "
                "common), though the structure is the same: units or calibration differ"
            )
        if abs(phase) > np.pi - turned:
            yield (
                f"all functions of {name} have the opposite sign to those of {first}: the force or all sensors "
                "were turned, or their directions are stated the other way round"
            )
        elif abs(phase) > turned:
            yield (
                f"all functions of {name} are turned by {np.degrees(phase):.0f} degrees against those of {first}: "
                "one holds another quantity than stated (velocity for acceleration turns by 90 degrees)"
            )


def _sensor_changed(
    models: Sequence[ModalModel],
    comparison: Comparison,
    *,
    gain: float = 0.03,
    certain: float = 5.0,
    fewest_modes: int = 4,
) -> Iterator[str]:
    """Say of which configurations a sensor that roves reads more beside the others than in the first.

    `gain`, `certain`: change of the logarithm of a sensor's gain beside the others' from which its calibration changed
    between two configurations: a sensor keeps it within 1 %.
    `fewest_modes`: modes that say something of one sensor.
    """
    for k in range(1, len(models)):
        constants = _constants(models[0], models[k], comparison.frequency[[0, k]])
        if constants is None or constants[0].shape[1] < fewest_modes:
            continue
        one, other, sensor = constants
        number = int(sensor.max()) + 1
        if number == 1 or np.bincount(sensor).min() < _FEWEST_PER_SENSOR:
            continue
        for position in range(1 if number == 2 else 0, number):  # of two, one beside the other says all
            change = np.log(np.abs(_ratio(one, other, sensor == position) / _ratio(one, other, sensor != position)))
            median = float(np.median(change))
            error = 1.4826 * float(np.median(np.abs(change - median))) / np.sqrt(change.size)
            if abs(median) > max(gain, certain * error):
                yield (
                    f"sensor {position + 1} of each run reads {np.exp(median):.3g} times as much beside the others in "
                    f"{models[k].name} as in {models[0].name} (median of {change.size} modes), though the structure is "
                    "the same: its calibration, range or mounting changed between the two"
                )


def _ratio(one: Complexes, other: Complexes, of: Booleans) -> Complexes:
    """Return for each mode what constants at some components are over others, by least squares."""
    return np.asarray(np.sum(one[of].conj() * other[of], axis=0) / np.sum(np.abs(one[of]) ** 2, axis=0))


def _ratios(first: ModalModel, other: ModalModel, frequency: Reals) -> Complexes:
    """Return for each mode in common what the modal constants of a model are over those of the first."""
    constants = _constants(first, other, frequency)
    return (
        np.empty(0, complex)
        if constants is None
        else _ratio(constants[0], constants[1], np.ones(len(constants[2]), bool))
    )


def _constants(first: ModalModel, other: ModalModel, frequency: Reals) -> tuple[Complexes, Complexes, Integers] | None:
    """Return the modal constants of the modes in common at shared DOFs, and the sensor of each; None without any.

    The modal constant ``2 i omega_d A`` of a real mode of unit modal mass is ``phi_o phi_i`` (Ewins, Modal Testing,
    2nd ed., sec. 2.8).
    """
    if first.input.name(0) != other.input.name(0):
        return None
    rows = shared_dofs((first, other))
    common = np.flatnonzero(np.isfinite(frequency).all(axis=0))
    if rows[0].size < _FEWEST_PER_SENSOR or not common.size:
        return None
    constant = []
    for model, at, row in ((first, frequency[0], rows[0]), (other, frequency[1], rows[1])):
        mode = [int(np.flatnonzero(model.frequency == at[t])[0]) for t in common]
        constant.append(2j * model.pole[mode].imag * model.residue[row, 0][:, mode])
    if not np.all(np.any(constant[0] != 0.0, axis=0)):
        return None
    sensors = [model.sensor[row] for model, row in zip((first, other), rows, strict=True)]
    one_alike = np.where(sensors[0] == sensors[1], sensors[0], 0)  # those that another one took there tell nothing
    return constant[0], constant[1], one_alike


MANY_DOFS = 5
"""Shared DOFs from which shapes alone tell modes apart: random shapes reach a MAC of 0.8 at five of them in 2 %."""


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"name mode": "frequency frequency_std damping damping_std mac"})
class Comparison:
    """Every mode of a campaign, one column each, over the configurations, one row each.

    Attributes
    ----------
    name : tuple of str
        The configurations.
    frequency, frequency_std : (n_configuration, n_mode) float
        Natural frequencies and their standard deviations, Hz; NaN where a configuration lacks the mode.
    damping, damping_std : (n_configuration, n_mode) float
        Damping ratios and their standard deviations; NaN likewise.
    mac : (n_configuration, n_mode) float
        MAC with the same mode in the nearest earlier configuration that has it; 1 in the first one, NaN where the
        two share a single DOF, over which MAC is 1 for any two modes.
    """

    name: tuple[str, ...]
    frequency: Reals
    frequency_std: Reals
    damping: Reals
    damping_std: Reals
    mac: Reals


def compare(models: Sequence[ModalModel], *, threshold: float = 0.8) -> Comparison:
    """Follow modes from configuration to configuration.

    Each mode goes on as the one of the next configuration with which its shape, at the DOFs that both
    have, makes the largest sum of MAC values; below `threshold` it ends and the other one begins. Where few DOFs
    are shared, different modes look alike there, so that frequencies must agree to 10 % too, and the nearest one wins.

    Parameters
    ----------
    models : sequence of ModalModel
        The configurations in order.
    threshold : float
        Smallest MAC of a shape with itself in the next configuration.

    Returns
    -------
    Comparison
        Its columns are in ascending order of the mean frequency.
    """
    tracks: list[dict[int, tuple[int, float]]] = []  # of each mode: configuration -> (its number there, MAC)
    for c, model in enumerate(models):
        values, score = np.zeros((2, len(tracks), model.frequency.size))
        for t, track in enumerate(tracks):
            before = max(track)
            values[t], score[t] = _likeness_of_mode(models[before], track[before][0], model)
        score = np.where(score >= threshold, score, 0.0)
        rows, columns = scipy.optimize.linear_sum_assignment(score, maximize=True)
        taken = set()
        for t, r in zip(rows, columns, strict=True):
            if score[t, r] >= threshold:
                tracks[t][c] = (int(r), float(values[t, r]))
                taken.add(int(r))
        tracks += [{c: (r, 1.0)} for r in range(model.frequency.size) if r not in taken]

    def table(name: str) -> Reals:
        matched = np.full((len(models), len(tracks)), np.nan)
        for t, track in enumerate(tracks):
            for c, (r, _) in track.items():
                matched[c, t] = getattr(models[c], name)[r]
        return matched

    order = np.argsort([np.mean([models[c].frequency[r] for c, (r, _) in track.items()]) for track in tracks])
    values = np.full((len(models), len(tracks)), np.nan)
    for t, track in enumerate(tracks):
        for c, (_, value) in track.items():
            values[c, t] = value
    return Comparison(
        name=tuple(model.name for model in models),
        frequency=table("frequency")[:, order],
        frequency_std=table("frequency_std")[:, order],
        damping=table("damping")[:, order],
        damping_std=table("damping_std")[:, order],
        mac=values[:, order],
    )


def _likeness_of_mode(
    first: ModalModel, mode: int, second: ModalModel, *, near_by_shape: float = 0.1
) -> tuple[Reals, Reals]:
    """MAC ``(n_mode,)`` of one mode with those of another model over the DOFs that both have, and its use as a score.

    The score is 0 without a shared DOF; over few of them it falls with the distance of the frequencies.
    """
    rows, columns = shared_dofs((first, second))
    if not rows.size:
        nothing = np.zeros(second.frequency.size)
        return nothing, nothing
    value = mac(first.shape[rows][:, [mode]], second.shape[columns])[0]
    if rows.size >= MANY_DOFS:
        return value, value
    apart = np.abs(np.log(second.frequency / first.frequency[mode]))
    score = np.where(apart <= near_by_shape, value * (1.0 - apart), 0.0)
    return (value if rows.size > 1 else np.full_like(value, np.nan)), score


Modes = tuple[Reals, Complexes]
"""Natural frequencies, Hz, (n_mode,), and shapes, (n_dof, n_mode)."""
CLOSE = 0.03
"""Relative gap of neighbouring frequencies below which modes are taken as a plane: a change of 6 % in stiffness closes
it."""


def match(
    first: Modes, second: Modes, *, alike: float = 0.5, width: float = 0.2, far: float = 0.7, near: float = 0.1
) -> tuple[Integers, Integers]:
    """Match the modes of two states.

    Parameters
    ----------
    first, second : Modes
        Of each state, at the DOFs that both have.
    alike : float
        MAC from which a mode is the same one: it then shares more of its shape with it than with all others together.
    width : float
        Difference of the logarithms of two frequencies that halves a likeness: the larger cuts of measured plates
        move a mode by that much.
    far : float
        Of these logarithms, beyond which no change leaves a mode the same.
    near : float
        The same where few DOFs are shared, over which all shapes are alike.

    Returns
    -------
    tuple of (n_pair,) int
        Numbers, from 0, of the modes that belong together in the first and in the second state.
    """
    apart = np.abs(np.log(second[0][None, :] / first[0][:, None]))
    n_dof = first[1].shape[0]
    if n_dof >= MANY_DOFS:
        likeness, farthest = _likeness(first, second), far
    else:  # shapes cannot tell modes apart: the nearest frequency does, unless its shape is another one
        likeness = mac(first[1], second[1]) if n_dof > 1 else np.ones(apart.shape)
        farthest = near
    possible = (likeness >= alike) & (apart <= farthest)
    score = np.where(possible, likeness * np.exp(-np.log(2.0) * (apart / width) ** 2), 0.0)
    rows, columns = scipy.optimize.linear_sum_assignment(score, maximize=True)
    matched = score[rows, columns] > 0.0
    return rows[matched].astype(np.int64), columns[matched].astype(np.int64)


def clusters(frequency: ArrayLike, close: float = CLOSE) -> tuple[Integers, ...]:
    """Split modes into clusters whose neighbours lie less than a relative gap apart.

    Parameters
    ----------
    frequency : (n_mode,) array_like
        Natural frequencies in any order, Hz; infinite ones stay alone.
    close : float
        Largest relative gap within a cluster.

    Returns
    -------
    tuple of (n,) int
        Column numbers, each cluster ascending in frequency; a mode alone is a cluster of one.
    """
    values = np.asarray(frequency, dtype=float)
    order = np.argsort(values, kind="stable")
    ascending = values[order]
    with np.errstate(invalid="ignore"):
        apart = ~(np.diff(ascending) <= close * ascending[1:])
    return tuple(part.astype(np.int64) for part in np.split(order, np.flatnonzero(apart) + 1) if part.size)


def sine(first: Complexes, second: Complexes, n: int) -> float:
    """Return the sine of the largest angle between the spans of two sets of shapes, (n_dof, any).

    `n`: how many shapes of each are to be the same, whatever the spans have beside.
    """
    return float(np.sin(la.subspace_angles(first, second)[-n]))  # they descend


def _likeness(first: Modes, second: Modes) -> Reals:
    """MAC of every two modes; of close ones at least most of what lies in the plane of their neighbours."""
    value = mac(first[1], second[1])
    planes = np.minimum(_in_planes(first, second[1]), _in_planes(second, first[1]).T)
    return np.maximum(value, 0.9 * planes)


def _in_planes(state: Modes, shape: Complexes) -> Reals:
    """Share of other shapes that lies in the plane of each mode with its close neighbours, (n_mode, n_other).

    It is 0 of a mode that has none: its MAC says it all.
    """
    share = np.zeros((state[0].size, shape.shape[1]))
    whole = np.sum(np.abs(shape) ** 2, axis=0)
    for group in clusters(state[0]):
        if group.size == 1:
            continue
        basis = la.orth(state[1][:, group] / np.linalg.norm(state[1][:, group], axis=0))
        share[group] = np.sum(np.abs(basis.conj().T @ shape) ** 2, axis=0) / whole
    return share
