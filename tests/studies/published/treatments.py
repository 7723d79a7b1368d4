"""What the treatments of the paper changed, from differences between a treated stack and its untreated twin.

The model's error is the same in both and cancels. With s_r = d ln f_r / d ln G_f, a change of the contact's
stiffness by g moves ln f_r by s_r g, and with damping of the contact alone, zeta_r = d_f p omega_r s_r, so that what
ln zeta_r moves by beside ln(f_r s_r) is that of ln d_f. Modes of a pair scatter about that; intervals of 95 % are
Student's, with as many degrees of freedom as there are modes but one. Where several stacks had one treatment, they are
no narrower than by the scatter between these.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.campaign.campaign_file import Reassembly
from tests.studies.published.campaign import Calibrated, Published, prepare_published
from tests.studies.published.target import Prepared, solve_target

Vector = NDArray[np.float64]

PAIRS: tuple[tuple[str, tuple[tuple[str, str], ...]], ...] = (
    ("lateral rolling direction", (("11", "2"),)),
    ("two silicone layers", (("12", "2"),)),
    ("four silicone layers", (("13", "2"),)),
    ("adhesive at the edges", (("14", "5"), ("15", "4"))),
    ("lubricant", (("16", "8"), ("17", "3"), ("18", "1"))),
)
"""Treatments with the stacks that had them and their twins: same manufacturer, steel and height (Table 1)."""
STATED = {
    "two silicone layers": "d_f falls (fig. 13)",
    "four silicone layers": "d_f falls (fig. 13)",
    "adhesive at the edges": "d_f rises drastically, G_f hardly changes (fig. 14)",
    "lubricant": "d_f rises by as much as 150 %, G_f practically not (fig. 15)",
}
"""What the text of the paper states; its figures have no numbers but those of Table 6."""
_BETWEEN_TWO = 2.0**0.5
"""Scatter between two stacks over that of one stack by reassembly, the least that it can be."""


@dataclass(frozen=True, kw_only=True)
class Shift:
    """A change of a logarithm with the ends of its interval of 95 %; NaN where nothing was measured."""

    value: float
    lower: float
    upper: float

    @property
    def text(self) -> str:
        """The change in per cent."""
        if not np.isfinite(self.value):
            return "not measured"
        return "{:+.0f} % ({:+.0f} to {:+.0f})".format(
            *(100.0 * np.expm1(min(v, 4.0)) for v in (self.value, self.lower, self.upper))
        )


@dataclass(frozen=True, kw_only=True)
class Treatment:
    """What a treatment changes.

    Attributes
    ----------
    name : str
        The treatment.
    pairs : tuple of (str, str)
        Treated stacks and their twins.
    stiffness, damping : Shift
        Of ln G_f and ln d_f.
    exponent : Shift
        Of the exponent n of G ~ p**n, itself, where both torques were measured.
    published : tuple of (str, float, float)
        Pairs of which Table 6 has both, with the changes of ln G_f and ln d_f there.
    """

    name: str
    pairs: tuple[tuple[str, str], ...]
    stiffness: Shift
    damping: Shift
    exponent: Shift
    published: tuple[tuple[str, float, float], ...]

    @property
    def sentence(self) -> str:
        """Say it, and what the paper says."""
        stacks = " and ".join(f"{a} against {b}" for a, b in self.pairs)
        text = f"{self.name} ({stacks}): G_f {self.stiffness.text}, d_f {self.damping.text}"
        if np.isfinite(self.exponent.value):
            text += (
                f", exponent of pressure {self.exponent.value:+.2f} ({self.exponent.lower:+.2f} to "
                f"{self.exponent.upper:+.2f})"
            )
        for pair, g, d in self.published:
            text += f"; Table 6, {pair}: G_f {100 * np.expm1(g):+.0f} %, d_f {100 * np.expm1(d):+.0f} %"
        return f"{text}; the paper: {STATED[self.name]}." if self.name in STATED else f"{text}."


def treated(data: Published, calibrated: Calibrated) -> tuple[Treatment, ...]:
    """Return what every treatment changes, with the base model of a calibration as it was fitted."""
    sevens, fours = prepare_published(data, calibrated.calibration)
    return treatments(data, sevens, fours, {row.stack: row.G_f for row in calibrated.row})


def treatments(
    data: Published, sevens: Sequence[Prepared], fours: Sequence[Prepared], G_f: dict[str, float]
) -> tuple[Treatment, ...]:
    """Return what every treatment changes.

    Parameters
    ----------
    data : Published
        The tables.
    sevens, fours : sequence of Prepared
        Models of the stacks of Table 7, and of those of Table 4 at both torques.
    G_f : dict
        Contact stiffness fitted to each stack of Table 7, about which the models are linear.
    """
    at_320 = {prepared.target.name: prepared for prepared in sevens}
    both = {prepared.target.name: prepared for prepared in fours}
    return tuple(_treatment(data, name, pairs, (at_320, both), G_f) for name, pairs in PAIRS)


def _treatment(
    data: Published,
    name: str,
    pairs: tuple[tuple[str, str], ...],
    models: tuple[dict[str, Prepared], dict[str, Prepared]],
    G_f: dict[str, float],
) -> Treatment:
    at_320, both = models
    stiffness, damping, exponent = list[Shift](), list[Shift](), list[Shift]()
    for treated, twin in pairs:
        s = np.sqrt(_sensitivity(at_320[twin], G_f[twin]) * _sensitivity(at_320[treated], G_f[treated]))
        moved = _log(at_320[treated].target.frequency) - _log(at_320[twin].target.frequency)
        stiffness.append(slope(s, moved, _BETWEEN_TWO * Reassembly().frequency))
        if f"{treated} M1" in both and f"{twin} M1" in both:
            damping.append(_damping(both, treated, twin, G_f))
            ratio = [
                _log(both[f"{stack} M2"].target.frequency) - _log(both[f"{stack} M1"].target.frequency)
                for stack in (treated, twin)
            ]
            doubled = np.log(data.pressure["M2"] / data.pressure["M1"])
            exponent.append(slope(s * doubled, ratio[0] - ratio[1], _BETWEEN_TWO * Reassembly().frequency))
    listed = list[tuple[str, float, float]]()
    for treated, twin in pairs:
        if treated in data.contact and twin in data.contact:
            with_treatment, without = data.contact[treated], data.contact[twin]
            stiffer, lossier = (float(np.log(with_treatment[key] / without[key])) for key in ("Gf_avg", "df_avg"))
            listed.append((f"{treated} against {twin}", stiffer, lossier))
    return Treatment(
        name=name,
        pairs=pairs,
        stiffness=together(stiffness),
        damping=together(damping),
        exponent=together(exponent),
        published=tuple(listed),
    )


def _damping(both: dict[str, Prepared], treated: str, twin: str, G_f: dict[str, float]) -> Shift:
    """Return the change of ln d_f, from all modes at both torques."""
    moved = []
    for torque in ("M1", "M2"):
        with_treatment, without = both[f"{treated} {torque}"], both[f"{twin} {torque}"]
        per_d_f = [
            _log(prepared.target.damping) - _log(prepared.target.frequency) - _log(_sensitivity(prepared, G_f[name]))
            for prepared, name in ((with_treatment, treated), (without, twin))
        ]
        moved.append(per_d_f[0] - per_d_f[1])
    changes = np.concatenate(moved)
    return slope(np.ones(changes.size), changes, _BETWEEN_TWO * Reassembly().damping)


def _log(values: Vector | None) -> Vector:
    assert values is not None
    return np.log(np.where(values > 0.0, values, np.nan))


def _sensitivity(prepared: Prepared, G_f: float) -> Vector:
    """Return d ln f / d ln G_f of the modes of a table."""
    modes, column = solve_target(prepared, {"G_f": G_f}, ("G_f",))
    gradient = modes.frequency_gradient[column, 0] * G_f / modes.frequency[column]
    return np.asarray(np.where(column < 0, np.nan, gradient))


def slope(x: Vector, y: Vector, least: float) -> Shift:
    """Return the slope of a line through the origin with Student's interval of 95 %.

    Parameters
    ----------
    x, y : (n,)
        Those that are NaN are left out.
    least : float
        Standard deviation below which `y` does not scatter.
    """
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    if x.size < 2:
        return Shift(value=float("nan"), lower=float("nan"), upper=float("nan"))
    square = float(x @ x)
    value = float(x @ y) / square
    scatter = max(float(np.sum((y - value * x) ** 2)) / (x.size - 1), least**2)
    half = float(scipy.special.stdtrit(x.size - 1, 0.975)) * np.sqrt(scatter / square)
    return Shift(value=value, lower=value - half, upper=value + half)


def together(shifts: Sequence[Shift]) -> Shift:
    """Return the mean of several stacks, whose interval is not narrower than by the scatter between them."""
    known = [shift for shift in shifts if np.isfinite(shift.value)]
    if len(known) < 2:
        return known[0] if known else Shift(value=float("nan"), lower=float("nan"), upper=float("nan"))
    values = np.array([shift.value for shift in known])
    n = len(known)
    within = np.sqrt(np.sum([(shift.upper - shift.value) ** 2 for shift in known])) / n
    between = float(scipy.special.stdtrit(n - 1, 0.975)) * float(values.std(ddof=1)) / np.sqrt(n)
    half, value = max(float(within), between), float(values.mean())
    return Shift(value=value, lower=value - half, upper=value + half)


def treatments_csv(changes: Sequence[Treatment]) -> bytes:
    """Return changes of G_f and d_f as shares, and of the exponent, with intervals of 95 %."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    what = ("G_f", "d_f", "exponent")
    writer.writerow(
        ["treatment", "stacks", *(f"{quantity}{end}" for quantity in what for end in ("", "_lower", "_upper"))]
    )
    for change in changes:
        shares = [
            f"{np.expm1(v):.4g}"
            for shift in (change.stiffness, change.damping)
            for v in (shift.value, shift.lower, shift.upper)
        ]
        law = [f"{v:.4g}" for v in (change.exponent.value, change.exponent.lower, change.exponent.upper)]
        writer.writerow([change.name, " ".join(f"{a}/{b}" for a, b in change.pairs), *shares, *law])
    return text.getvalue().encode()
