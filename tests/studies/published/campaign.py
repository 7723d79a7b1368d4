"""The published campaign of 18 stacks: what is fitted, with effects that all stacks share, and how contact grows."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from lamella_shared import arrays
from model import Stack, find_effects, read_stack
from model.stack.parts import Mesh
from tests.studies.published.modal_table import ModalTable, fit_row_by, read_modal_table
from tests.studies.published.shared_opt_G import SharedFit, fit_shared_opt_G
from tests.studies.published.target import Prepared, prepare, solve_target, target_of_table
from updating.errors import FitError
from updating.fitting.fit import (
    D_F_BOUNDS,
    G_F_BOUNDS,
    Prediction,
    estimate_damping,
    estimate_stiffness,
    frequency_error,
)

_RANGE = (-1.0, 2.0)  # of the exponent: stiffness that falls with pressure must not be excluded beforehand


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"stack": "own", "stack any": "measured linear power refitted"})
class PressureLaw:
    """The exponent n of G ~ p^n, one for all stacks, and what it does to predicting one torque from another.

    Attributes
    ----------
    exponent, std : float
        Estimate and standard deviation.
    interval : (float, float)
        Of 95 %, Student's.
    jackknife : (float, float)
        Of 95 %, from the estimates without each stack in turn: it counts how much stacks differ.
    stack : tuple of str
        The stacks.
    own : (n_stack,) float
        Exponent of each stack alone.
    measured : (n_stack, n_mode) float
        Frequencies at the lower torque, Hz; NaN where not measured.
    linear, power : (n_stack, n_mode) float
        The same predicted from the higher torque and all other stacks, with n = 1 and with n, Hz.
    refitted : (n_stack, n_mode) float
        The same with G_f fitted at the lower torque itself: the least error that any law could have.
    """

    exponent: float
    std: float
    interval: tuple[float, float]
    jackknife: tuple[float, float]
    stack: tuple[str, ...]
    own: NDArray[np.float64]
    measured: NDArray[np.float64]
    linear: NDArray[np.float64]
    power: NDArray[np.float64]
    refitted: NDArray[np.float64]

    def error(self, law: str) -> float:
        """Return the mean relative error, eq. (2), at the lower torque by "linear", "power" or "refitted"."""
        return float(np.nanmean(np.abs(getattr(self, law) / self.measured - 1.0)))


def pressure_law(prepared: Sequence[Prepared], *, effects: Collection[str] = ()) -> PressureLaw:
    """Fit n by opt_G to stacks measured at two pressures, G_f of each stack its own and the effects' parameters shared.

    Parameters
    ----------
    prepared : sequence of Prepared
        Two configurations of each specimen, with the effect pressure_exponent on their stacks.
    effects : collection of str
        Further effects.

    Raises
    ------
    FitError
        A fit fails.
    """
    low, high = _pairs(prepared)
    states = [state for pair in zip(low, high, strict=True) for state in pair]
    power, linear = _fit(states, effects, {}), _fit(states, effects, {"exponent": 1.0})
    refitted, without, by_stack = [], [], []
    shared = {p.name: p.value for p in power.parameter}
    for i, (weak, strong) in enumerate(zip(low, high, strict=True)):
        rest = {name: value for name, value in shared.items() if name != "exponent"}
        by_stack.append(_exponent(_fit([weak, strong], effects, rest, first=power))[0])
        rest_of_stacks = states[: 2 * i] + states[2 * i + 2 :]
        known = _fit(rest_of_stacks, effects, {}, first=power)
        without.append(_exponent(known)[0])
        fixed = {p.name: p.value for p in known.parameter}
        refitted.append(_fit([weak], effects, fixed, first=power).frequency[0])
    n, std, interval = _exponent(power)
    spread = float(np.sqrt((len(low) - 1) * np.var(without)) * scipy.special.stdtrit(len(low) - 1, 0.975))
    return PressureLaw(
        exponent=n,
        std=std,
        interval=interval,
        jackknife=(n - spread, n + spread),
        stack=tuple(state.target.specimen for state in low),
        own=np.array(by_stack),
        measured=np.array([state.target.frequency for state in low]),
        linear=np.array(linear.left_out[::2]),
        power=np.array(power.left_out[::2]),
        refitted=np.array(refitted),
    )


def _fit(
    prepared: Sequence[Prepared],
    effects: Collection[str],
    fixed: Mapping[str, float],
    *,
    first: SharedFit | None = None,
) -> SharedFit:
    """Fit from everywhere, with configurations left out in turn; or only from another fit, without."""
    return fit_shared_opt_G(
        prepared,
        (*effects, "pressure_exponent"),
        fixed=fixed,
        bounds={"exponent": _RANGE},
        first=first,
        anew=first is None,
        left_out=first is None,
    )


def _exponent(fit: SharedFit) -> tuple[float, float, tuple[float, float]]:
    """Return the exponent, its standard deviation and interval."""
    (j,) = (j for j, p in enumerate(fit.parameter) if p.name == "exponent")
    p = fit.parameter[j]
    return p.value, fit.std[j], (p.lower, p.upper)


def _pairs(prepared: Sequence[Prepared]) -> tuple[list[Prepared], list[Prepared]]:
    """Return the configuration of lower and of higher pressure of each specimen that has both."""
    specimens = dict.fromkeys(state.target.specimen for state in prepared)
    low, high = [], []
    for specimen in specimens:
        both = sorted(
            (state for state in prepared if state.target.specimen == specimen),
            key=lambda state: state.target.stack.contact.pressure,
        )
        if len(both) == 2:
            low.append(both[0])
            high.append(both[1])
    return low, high


CALIBRATIONS = ("C0", "C1", "C2", "C3")
"""Planforms and clamps of data/pirnat2013 that explain the published numerical frequencies."""

MESH = Mesh(n_x=12, n_y=3)
"""Coarser than the calibrations' 16 x 4; under C1 the four frequencies of stack 6 change by at most 0.02 %."""

_N_SNAPSHOT = 4

_D_F = 1e-10  # at which the damping's slope is taken; damping ratios are proportional to d_f


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"any": "measured published frequency"})
class Row:
    """One stack of Table 7 with the base model.

    Attributes
    ----------
    stack : str
        Its number.
    G_f, published_G_f : float
        Contact stiffness fitted by opt_G and that of Table 6 (NaN where it has none), Pa per Pa.
    measured, published, frequency : (n_mode,) float
        Frequencies measured, of the published model, and of ours, Hz.
    error, published_error : float
        Mean relative errors, eq. (2).
    model_misfit : float
        Eq. (2) of our model against the published one, G_f fitted to the latter.
    """

    stack: str
    G_f: float
    published_G_f: float
    measured: NDArray[np.float64]
    published: NDArray[np.float64]
    frequency: NDArray[np.float64]
    error: float
    published_error: float
    model_misfit: float


@dataclass(frozen=True, kw_only=True)
class Torque:
    """One stack at one torque, Table 4, fitted by opt_G and opt_d.

    Attributes
    ----------
    stack, torque : str
        Which.
    G_f, d_f : float
        Contact parameters, Pa per Pa and s/Pa.
    published_G_f, published_d_f : float
        Those of Table 6; NaN where it has none.
    error, damping_error : float
        Mean relative error of frequencies, eq. (2), and of damping ratios.
    """

    stack: str
    torque: str
    G_f: float
    d_f: float
    published_G_f: float
    published_d_f: float
    error: float
    damping_error: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Calibrated:
    """The campaign under one calibration of planform and clamps.

    Attributes
    ----------
    calibration : str
        Its name.
    row : tuple of Row
        Table 7 with the base model: each stack by opt_G.
    torque : tuple of Torque
        The stacks of Table 4 at both torques, with the base model.
    shared : SharedFit
        The 18 stacks with effects that they share, by opt_G over all of them.
    law : PressureLaw
        How contact stiffness grows with pressure, with the effects.
    """

    calibration: str
    row: tuple[Row, ...]
    torque: tuple[Torque, ...]
    shared: SharedFit
    law: PressureLaw

    @property
    def error(self) -> float:
        """Mean error, eq. (2), of the base model over Table 7."""
        return float(np.mean([f.error for f in self.row]))

    @property
    def misfit(self) -> float:
        """Mean distance of the base model to the published model's frequencies, eq. (2)."""
        return float(np.mean([f.model_misfit for f in self.row]))


@dataclass(frozen=True, eq=False, kw_only=True)
class Published:
    """The published tables.

    Attributes
    ----------
    table : ModalTable
        Table 7, with heights and published contact parameters.
    both : tuple of dict
        Rows of Table 4.
    contact : mapping of stack to mapping of str to float
        Rows of Table 6.
    pressure : mapping of torque to float
        Table 2, Pa.
    folder : Path
        Where they are.
    """

    table: ModalTable
    both: tuple[Mapping[str, str], ...]
    contact: Mapping[str, Mapping[str, float]]
    pressure: Mapping[str, float]
    folder: Path


def read_published(folder: Path) -> Published:
    """Read the tables of data/pirnat2013.

    Raises
    ------
    FitError
        A file is missing or not as its README says.
    """
    table = read_modal_table(folder / "table7.toml")
    try:
        return Published(
            table=table,
            both=tuple(_rows(folder / "table4_modal_parameters.csv")),
            contact={
                row["stack"]: {name: float(row[name]) for name in row if name != "stack"}
                for row in _rows(folder / "table6_contact_parameters.csv")
            },
            pressure={row["torque"]: 1e3 * float(row["pressure_kPa"]) for row in _rows(folder / "table2_pressure.csv")},
            folder=folder,
        )
    except (OSError, KeyError, TypeError, ValueError, csv.Error) as error:
        message = f"{folder}: cannot read the published tables: {error}"
        raise FitError(message) from error


def prepare_published(
    data: Published, calibration: str, effects: Collection[str] = (), *, both: bool = True
) -> tuple[tuple[Prepared, ...], tuple[Prepared, ...]]:
    """Reduce the models of the stacks of Table 7 and of Table 4 under a calibration.

    Stacks of the same height share one reduction. Without `both`, those of Table 4 are left out.

    Raises
    ------
    FitError
        There is no such calibration.
    """
    if calibration not in CALIBRATIONS:
        message = f"no calibration {calibration!r}; there are {', '.join(CALIBRATIONS)}"
        raise FitError(message)
    planform = read_stack(data.folder / f"stack_{calibration}.toml").with_effects(*find_effects(effects))
    planform = dataclasses.replace(planform, mesh=MESH)
    height = {row.name: row.stack.height for row in data.table.rows}

    def stack(name: str, torque: str) -> Stack:
        pressed = planform.with_contact(pressure=data.pressure[torque])
        return dataclasses.replace(pressed, name=f"stack {name} at {torque}", height=height[name])

    classes = data.table.shape_class
    sevens = [target_of_table(stack(row.name, "M2"), classes, row.frequency, name=row.name) for row in data.table.rows]
    fours = [
        target_of_table(
            stack(row["stack"], row["torque"]),
            classes,
            np.array([_number(row[f"f{r}_Hz"]) for r in range(1, 5)]),
            name=f"{row['stack']} {row['torque']}",
            specimen=row["stack"],
            damping=np.array([_number(row[f"xi{r}_percent"]) / 100.0 for r in range(1, 5)]),
        )
        for row in (data.both if both else ())
    ]
    prepared = prepare([*sevens, *fours], n_snapshot=_N_SNAPSHOT)
    return prepared[: len(sevens)], prepared[len(sevens) :]


def reproduce(data: Published, calibration: str, effects: Sequence[str]) -> Calibrated:
    """Reproduce the published tables under a calibration, then add effects that all stacks share.

    Parameters
    ----------
    data : Published
        The tables.
    calibration : str
        One of `CALIBRATIONS`.
    effects : sequence of str
        Effects whose parameters the stacks share.

    Raises
    ------
    FitError
        There is no such calibration, or a fit fails.
    """
    sevens, fours = prepare_published(data, calibration, (*effects, "pressure_exponent"))
    shared = fit_shared(sevens, effects)
    return Calibrated(
        calibration=calibration,
        row=base_rows(data, sevens),
        torque=tuple(_torque(data, state) for state in fours),
        shared=shared,
        law=pressure_law(fours, effects=effects),
    )


def base_rows(data: Published, sevens: Sequence[Prepared]) -> tuple[Row, ...]:
    """Fit G_f of every stack of Table 7 by opt_G with the base model."""
    rows = []
    for row, prepared in zip(data.table.rows, sevens, strict=True):
        fit = fit_row_by(row, _predictor(prepared))
        rows.append(
            Row(
                stack=row.name,
                G_f=fit.G_f.value,
                published_G_f=row.published_G_f,
                measured=row.frequency,
                published=row.published_frequency,
                frequency=fit.frequency,
                error=fit.error,
                published_error=fit.published_error,
                model_misfit=fit.model_misfit,
            )
        )
    return tuple(rows)


def fit_shared(sevens: Sequence[Prepared], effects: Sequence[str], *, left_out: bool = True) -> SharedFit:
    """Fit shared effects to all stacks, one more at a time: none may make the fit worse."""
    shared = None
    for n in range(1, len(effects) + 1):
        shared = fit_shared_opt_G(sevens, effects[:n], first=shared, left_out=left_out and n == len(effects))
    return fit_shared_opt_G(sevens, ()) if shared is None else shared


def _predictor(prepared: Prepared) -> Callable[[float], Prediction]:
    def predict(G_f: float) -> Prediction:
        modes, column = solve_target(prepared, {"G_f": G_f}, ("G_f",))
        if np.any(column < 0):
            message = f"{prepared.target.stack.name}: the model lacks a mode of a published class at G_f = {G_f:g}"
            raise FitError(message)
        return modes.frequency[column], modes.frequency_gradient[column, 0]

    return predict


def _torque(data: Published, prepared: Prepared) -> Torque:
    """Fit one stack at one torque as the paper does: opt_G, then opt_d."""
    target, known = prepared.target, np.isfinite(prepared.target.frequency)
    stack, torque = target.name.split()

    def predict(G_f: float) -> Prediction:
        frequency, gradient = _predictor(prepared)(G_f)
        return frequency[known], gradient[known]

    no_std = np.zeros(np.count_nonzero(known))
    G_f = estimate_stiffness(predict, target.frequency[known], no_std, bounds=G_F_BOUNDS)
    modes, column = solve_target(prepared, {"G_f": G_f.value, "d_f": _D_F}, ())
    slope = modes.damping[column][known] / _D_F
    damping = target.damping[known]
    d_f = estimate_damping(slope, damping, no_std, bounds=D_F_BOUNDS)
    published = data.contact.get(stack, {})
    return Torque(
        stack=stack,
        torque=torque,
        G_f=G_f.value,
        d_f=d_f.value,
        published_G_f=published.get(f"Gf_{torque}", float("nan")),
        published_d_f=published.get(f"df_{torque}", float("nan")),
        error=frequency_error(target.frequency[known], predict(G_f.value)[0]),
        damping_error=frequency_error(damping, slope * d_f.value),
    )


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _number(text: str) -> float:
    return float(text) if text.strip() else float("nan")
