"""FRFs and coherence from time histories of one force or of several, and the hits of a hammer in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PositiveInt, model_validator

from ema.io.measured_function import parse_unit
from ema.types.errors import MeasurementError
from lamella_shared import Complexes, Integers, Reals, arrays


class Averaging(BaseModel):
    """How spectra are averaged; keys of ``[measurement.time]``.

    Attributes
    ----------
    estimator : {"H1", "H2", "Hv"}
        H1 is unbiased with noise on the response only, H2 with noise on the force only, Hv lies between.
    block_s : float or None
        Length of the averaged blocks, s; left out, each record is one block (impact testing).
    overlap : float
        Share of a block that the next one overlaps.
    before_hit_s : float or None
        For records of many hits of a hammer: each is found and gives one block that begins this long before it, s.
    window : {"boxcar", "hann"}
        Window on force and response: "hann" for continuous random excitation, "boxcar" where each block
        holds a whole transient or a whole number of periods.
    response_end : float
        For impact testing: value at the end of the block of an exponential window on the response (and the
        force, so that both are filtered alike), 1 for none. It adds a decay rate to every pole, which
        `FRFEstimate.decay_rate` states.
    force_s : float or None
        For impact testing: time after which the force is set to zero, s.
    force : int or tuple of int
        Position of the force, or of several that act at once, among the channels of a file, from 1, where the file does
        not tell.
    force_unit, response_unit : str or None
        Units of text files, and of files that do not state theirs.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    estimator: Literal["H1", "H2", "Hv"] = "H1"
    block_s: float | None = Field(default=None, gt=0)
    before_hit_s: float | None = Field(default=None, ge=0)
    overlap: float = Field(default=0.0, ge=0, lt=1)
    window: Literal["boxcar", "hann"]
    response_end: float = Field(default=1.0, gt=0, le=1)
    force_s: float | None = Field(default=None, gt=0)
    force: PositiveInt | Annotated[tuple[PositiveInt, ...], Field(min_length=1)] = 1
    force_unit: str | None = None
    response_unit: str | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Averaging:
        if self.before_hit_s is not None and (
            self.block_s is None or self.block_s <= self.before_hit_s or self.window != "boxcar" or self.overlap > 0
        ):
            raise ValueError("before_hit_s, of hits, needs a longer 'block_s', window = 'boxcar' and no overlap")
        if self.before_hit_s is not None and isinstance(self.force, tuple) and len(self.force) > 1:
            raise ValueError("before_hit_s is for one force: a hammer hits one point at a time")
        for key in ("force_unit", "response_unit"):
            label = getattr(self, key)
            try:
                unit = None if label is None else parse_unit(label)
            except MeasurementError as error:
                raise ValueError(str(error)) from error
            if unit is not None and not (unit.is_force if key == "force_unit" else unit.motion is not None):
                raise ValueError(f"{key}: {label!r} is not a unit of {'force' if key == 'force_unit' else 'motion'}")
        if self.block_s is not None and self.force_s is not None:
            raise ValueError(
                "force_s is of records that are one block each; it would end the force of all later blocks"
            )
        return self


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"line": "frequency", "function line": "value coherence"})
class FRFEstimate:
    """Functions estimated from averaged spectra.

    Attributes
    ----------
    frequency : (n_frequency,) float
        Hz.
    value : (n_output, n_frequency) complex
        Response over force in the units of the records.
    coherence : (n_output, n_frequency) float or None
        Ordinary coherence; None for a single average, where it would be 1 whatever the noise.
    n_average : int
        Number of averaged blocks.
    decay_rate : float
        What the exponential window adds to the decay rate of every pole, 1/s.
    """

    frequency: Reals
    value: Complexes
    coherence: Reals | None
    n_average: int
    decay_rate: float


def estimate_frf(force: Reals, response: Reals, rate: float, averaging: Averaging) -> FRFEstimate:
    """Estimate the FRFs between one force and several responses from averaged auto- and cross-spectra.

    With G the averaged spectra, H1 = G_fx / G_ff, H2 = G_xx / G_xf, and Hv, for noise in the same proportion
    on both, is their geometric mean (Rocklin, Crowley and Vold, A comparison of the H1, H2 and Hv frequency
    response functions, IMAC 1985).

    Parameters
    ----------
    force : (n_record, n_sample) float
        Force in each record.
    response : (n_output, n_record, n_sample) float
        Responses in the same records.
    rate : float
        Sampling rate, Hz.
    averaging : Averaging
        Estimator, blocks and windows.

    Raises
    ------
    MeasurementError
        Shapes do not fit, a block is longer than the records, or the force is zero.
    """
    force, response = np.asarray(force, float), np.asarray(response, float)
    if force.ndim != 2 or response.ndim != 3 or response.shape[1:] != force.shape:
        raise MeasurementError(
            "expected force (n_record, n_sample) and response (n_output, n_record, n_sample), "
            f"got {force.shape} and {response.shape}"
        )
    n_sample = force.shape[1]
    n_block, n_overlap, decay_rate = block_of(n_sample, rate, averaging)
    if averaging.force_s is not None:
        force = np.where(np.arange(n_sample) / rate <= averaging.force_s, force, 0.0)
    frequency, g_ff, g_fx, g_xx = _spectra_of_one(force, response, rate, averaging)
    if not np.all(g_ff[1:-1] > 0):
        raise MeasurementError("the force is zero or not a number; no FRF can be estimated")
    with np.errstate(divide="ignore", invalid="ignore"):
        h1 = g_fx / g_ff
        coherence = np.nan_to_num(np.abs(g_fx) ** 2 / (g_ff * g_xx))
        ratio = np.sqrt(np.where(coherence > 0, coherence, np.nan))
        value = {"H1": h1, "H2": h1 / ratio**2, "Hv": h1 / ratio}[averaging.estimator]
    n_average = force.shape[0] * (1 + (n_sample - n_block) // (n_block - n_overlap))
    return FRFEstimate(
        frequency=frequency,
        value=value,
        coherence=coherence if n_average > 1 else None,
        n_average=n_average,
        decay_rate=decay_rate,
    )


def block_of(n_sample: int, rate: float, averaging: Averaging) -> tuple[int, int, float]:
    """Return the samples of a block, those it shares with the next one, and the exponential window's decay rate, 1/s.

    Raises
    ------
    MeasurementError
        The records are shorter than a block.
    """
    n_block = n_sample if averaging.block_s is None else round(averaging.block_s * rate)
    if not 2 <= n_block <= n_sample:
        raise MeasurementError(f"block_s = {averaging.block_s} s is {n_block} samples, but the records hold {n_sample}")
    decay_rate = -np.log(averaging.response_end) * rate / n_block
    return n_block, int(averaging.overlap * n_block), float(decay_rate)


def spectrum_settings(n_sample: int, rate: float, averaging: Averaging) -> dict[str, Any]:
    """Return what `scipy.signal.csd` is to be called with for records of `n_sample` samples."""
    from scipy import signal  # here: it takes long to import, and most tests come as FRFs

    n_block, n_overlap, decay_rate = block_of(n_sample, rate, averaging)
    window = signal.get_window(averaging.window, n_block)
    return {
        "fs": rate,
        "window": window * np.exp(-decay_rate * (np.arange(n_block) / rate)),
        "nperseg": n_block,
        "noverlap": n_overlap,
        "detrend": "constant" if averaging.window == "hann" else False,
    }


def _spectra_of_one(
    force: Reals, response: Reals, rate: float, averaging: Averaging
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return the lines and the averaged spectra of force, of force and response, and of response."""
    from scipy import signal

    settings = spectrum_settings(force.shape[1], rate, averaging)
    frequency, g_ff = signal.csd(force, force, **settings)
    g_fx = signal.csd(force[None], response, **settings)[1].mean(axis=1)
    g_xx = signal.csd(response, response, **settings)[1].real.mean(axis=1)
    return frequency, g_ff.real.mean(axis=0), g_fx, g_xx


def clipped_share(record: Reals) -> float:
    """Return the share of samples of an overloaded record that stick to its largest or smallest value.

    A signal that is cut holds its extreme value again and again, but few values just inside it. So an extreme
    that occurs at least three times, and three times as often as the values in the next two percent (or the
    next step of the converter, if that is coarser), marks an overload; 0 for a sound or a constant record.
    Nothing, exactly, is no overload.
    """
    record = np.asarray(record, float)
    if record.size == 0 or not np.isfinite(record).all() or np.ptp(record) == 0:
        return 0.0
    stuck = 0
    for side in (record, -record):
        if side.max() == 0.0:  # a force that is gated to nothing between blows
            continue
        distance = side.max() - side
        inside = distance > 1e-6 * np.ptp(record)
        quantum = float(distance[inside].min())
        next_to = int(np.count_nonzero(distance[inside] <= max(quantum, 0.02 * abs(side.max()))))
        at_extreme = record.size - int(np.count_nonzero(inside))
        if at_extreme >= 3 and at_extreme > 3 * next_to:
            stuck += at_extreme
    return stuck / record.size


def double_hit(force: Reals) -> float:
    """Return the largest later pulse of an impact record over its main pulse; 0 where there is only one.

    The main pulse is followed down to a tenth of its peak; what rises again above a tenth is a second hit.
    """
    force = np.abs(np.asarray(force, float))
    peak = int(np.argmax(force))
    below = np.flatnonzero(force[peak:] < 0.1 * force[peak])
    if below.size == 0:
        return 0.0
    later = force[peak + int(below[0]) :]
    # a pulse rings on through the filter of the recorder, so only a new rise counts
    settled = np.flatnonzero(later < 0.05 * force[peak])
    if settled.size == 0:
        return 0.0
    second = float(later[int(settled[0]) :].max() / force[peak])
    return second if second > 0.1 else 0.0


LEAST_HIT = 0.1
"""Force of a hit over that of the strongest one in the record."""
AT_REST = 0.05
"""Median over largest force up to which a record is one of a hammer."""

FEWEST_SAMPLES = 4
"""Fewer samples of a pulse tell neither its size nor its time: half a sample is 70 degrees at a usual last line."""


def find_hits(force: Reals, n_block: int, *, above_noise: float = 20.0) -> Integers:
    """Return the first sample of each hit in a record; pulses within `n_block` samples of a hit belong to it.

    Parameters
    ----------
    force : (n_sample,) float
    n_block : int
        Samples that a hit and its response take.
    above_noise : float
        Least force of a hit over the median force of the record, which a hammer at rest has.
    """
    size = np.abs(np.asarray(force, float) - np.median(force))
    least = max(LEAST_HIT * size.max(), above_noise * float(np.median(size)))
    hits: list[int] = []
    for sample in np.flatnonzero(size > least):
        if not hits or sample >= hits[-1] + n_block:
            hits.append(int(sample))
    return np.array(hits, dtype=np.int64)


def cut_at_hits(value: Reals, n_block: int, n_before: int) -> tuple[Reals, int]:
    """Cut records at their hits.

    Parameters
    ----------
    value : (n_record, n_channel, n_sample) float
        Time histories, the force first.
    n_block : int
        Samples of a block.
    n_before : int
        Samples of it before the hit.

    Returns
    -------
    blocks : (n_hit, n_channel, n_block) float
    n_left_out : int
        Hits whose block begins before the record or reaches beyond it.

    Raises
    ------
    MeasurementError
        There is no whole hit.
    """
    blocks, left_out = [], 0
    for record in value:
        for hit in find_hits(record[0], n_block - n_before) - n_before:
            if hit < 0 or hit + n_block > record.shape[1]:
                left_out += 1
            else:
                blocks.append(record[:, hit : hit + n_block])
    if not blocks:
        raise MeasurementError(
            f"no hit with a whole block of {n_block} samples, {n_before} of them before it, is in the records; "
            "shorten 'block_s' or 'before_hit_s', and check which channel is the force"
        )
    return np.array(blocks), left_out


def second_pulse(force: Reals) -> float:
    """Return the largest other pulse of a hit over its main one, before or after it; 0 where there is none.

    A force that does not rest most of the time is no hit, but periodic excitation: 0.
    """
    size = np.abs(force - np.median(force))
    if np.median(size) > AT_REST * size.max():
        return 0.0
    return max(double_hit(force), double_hit(force[::-1]))


def pulse_samples(force: Reals) -> int:
    """Return the samples of a hit above a tenth of its peak; 0 where the force does not rest most of the time."""
    size = np.abs(force - np.median(force))
    if np.median(size) > AT_REST * size.max() or size.max() == 0.0:
        return 0
    peak = int(np.argmax(size))
    low = np.flatnonzero(size < LEAST_HIT * size[peak])
    before, after = low[low < peak], low[low > peak]
    return int((after[0] if after.size else size.size) - (before[-1] if before.size else -1) - 1)


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays(
    {
        "line": "frequency",
        "output input line": "value partial_coherence",
        "output line": "multiple_coherence",
        "input line": "independent",
    }
)
class FRFMatrixEstimate:
    """Functions of several forces estimated from averaged spectra.

    Attributes
    ----------
    frequency : (n_frequency,) float
        Hz.
    value : (n_output, n_force, n_frequency) complex
        Response over force in the units of the records.
    partial_coherence : (n_output, n_force, n_frequency) float
        Coherence of a response and a force without what the other forces do to both.
    multiple_coherence : (n_output, n_frequency) float
        Share of a response that all forces together explain.
    independent : (n_force, n_frequency) float
        Share of a force that is not in the other ones.
    n_average : int
        Number of averaged blocks.
    decay_rate : float
        What the exponential window adds to the decay rate of every pole, 1/s.
    """

    frequency: Reals
    value: Complexes
    partial_coherence: Reals
    multiple_coherence: Reals
    independent: Reals
    n_average: int
    decay_rate: float


def estimate_frf_matrix(force: Reals, response: Reals, rate: float, averaging: Averaging) -> FRFMatrixEstimate:
    """Estimate the FRFs between several forces that act at once and several responses.

    With G the averaged spectra, H1 = G_xf G_ff^-1 (Bendat and Piersol, Random Data, 4th ed., sec. 7.2; there the
    coherences, too). Hv is the total least squares of each response and all forces, each in units of its own spectrum
    (Rocklin, Crowley and Vold, IMAC 1985): the eigenvector of the smallest eigenvalue of their matrix.

    Parameters
    ----------
    force : (n_force, n_record, n_sample) float
        Forces in each record.
    response : (n_output, n_record, n_sample) float
        Responses in the same records.
    rate : float
        Sampling rate, Hz.
    averaging : Averaging
        Estimator, blocks and windows.

    Raises
    ------
    MeasurementError
        Shapes do not fit, a block is longer than the records, there are too few blocks, the estimator is H2, or a force
        is zero or, at most lines, a sum of the others.
    """
    force, response = np.asarray(force, float), np.asarray(response, float)
    _, _, decay_rate = block_of(force.shape[-1], rate, averaging)
    n_average = _averages(force, response, rate, averaging)
    n_force = force.shape[0]
    if averaging.force_s is not None:
        force = np.where(np.arange(force.shape[-1]) / rate <= averaging.force_s, force, 0.0)
    frequency, g_ff, g_xf, g_xx = _spectra_of_several(force, response, rate, averaging)
    _require_independent(g_ff)
    auto = np.einsum("faa->fa", g_ff).real
    scale = np.sqrt(auto + np.finfo(float).tiny)
    correlation = g_ff / (scale[:, :, None] * scale[:, None, :]) + 1e-12 * np.eye(n_force)
    inverse = np.linalg.inv(correlation) / (scale[:, :, None] * scale[:, None, :])
    h1 = g_xf @ inverse  # (n_frequency, n_output, n_force)
    explained = np.einsum("foi,foi->fo", h1, g_xf.conj()).real
    with np.errstate(divide="ignore", invalid="ignore"):
        multiple = np.clip(np.nan_to_num(explained / g_xx), 0.0, 1.0)
        alone = np.abs(h1) ** 2 / np.einsum("faa->fa", inverse).real[:, None, :]
        partial = np.nan_to_num(alone / (alone + (g_xx * (1.0 - multiple))[..., None]))
    value = h1 if averaging.estimator == "H1" else _total_least_squares(g_ff, g_xf, g_xx)
    return FRFMatrixEstimate(
        frequency=frequency,
        value=value.transpose(1, 2, 0),
        partial_coherence=partial.transpose(1, 2, 0),
        multiple_coherence=multiple.T,
        independent=_independent(g_ff).T,
        n_average=n_average,
        decay_rate=decay_rate,
    )


def _averages(force: Reals, response: Reals, rate: float, averaging: Averaging) -> int:
    """Return the number of blocks; refuse what does not tell the parts of the forces."""
    n_force = force.shape[0]
    n_block, n_overlap, _ = block_of(force.shape[-1], rate, averaging)
    n_average = force.shape[1] * (1 + (force.shape[-1] - n_block) // (n_block - n_overlap))
    if averaging.estimator == "H2":
        raise MeasurementError(
            f"H2 is not defined for {n_force} forces and {response.shape[0]} responses; take 'H1' or 'Hv'"
        )
    if n_average <= n_force:
        raise MeasurementError(
            f"{n_average} averages do not tell the parts of {n_force} forces in a response; give more records, or "
            "shorter blocks by 'block_s'"
        )
    return n_average


def _spectra_of_several(
    force: Reals, response: Reals, rate: float, averaging: Averaging
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return lines and averaged spectra: G_ff (n_frequency, n_force, n_force), G_xf (..., n_output, n_force), G_xx."""
    from scipy import signal  # here: it takes long to import, and most tests come as FRFs

    settings = spectrum_settings(force.shape[-1], rate, averaging)
    frequency, g_ff = signal.csd(force[None], force[:, None], **settings)  # conj(F_b) F_a at [a, b]
    g_xf = signal.csd(force[None], response[:, None], **settings)[1]
    g_xx = signal.csd(response, response, **settings)[1].real.mean(axis=1)
    return frequency, *(np.moveaxis(g.mean(axis=2), -1, 0) for g in (g_ff, g_xf)), g_xx.T


def _independent(g_ff: Complexes) -> Reals:
    """Return the share of each force, (n_frequency, n_force), that the others do not hold: 1 less its coherence."""
    auto = np.einsum("faa->fa", g_ff).real
    scale = np.sqrt(auto + np.finfo(float).tiny)
    correlation = g_ff / (scale[:, :, None] * scale[:, None, :])
    inverse = np.linalg.pinv(correlation, rcond=1e-10, hermitian=True)
    return np.asarray(1.0 / np.maximum(np.einsum("faa->fa", inverse).real, 1.0))


def _require_independent(g_ff: Complexes, *, least_independent: float = 1e-3) -> None:
    """Refuse forces that are zero, or that do the same at most lines.

    `least_independent`: share of a force that the others do not hold, below which its functions cannot be separated
    from theirs.
    """
    auto = np.einsum("faa->fa", g_ff).real[1:-1]
    for k in range(auto.shape[1]):
        if not np.all(auto[:, k] > 0.0):
            raise MeasurementError(f"force {k + 1} of {auto.shape[1]} is zero or not a number; no FRF can be estimated")
    value = np.linalg.eigvalsh(g_ff[1:-1] / np.sqrt(auto[:, :, None] * auto[:, None, :]))
    if np.median(value[:, 0]) < least_independent:
        raise MeasurementError(
            f"the {auto.shape[1]} forces are the same up to a factor at most lines, so their effects are not told "
            "apart; drive the shakers with independent signals, or state one of them as the force"
        )


def _total_least_squares(g_ff: Complexes, g_xf: Complexes, g_xx: Reals) -> Complexes:
    """Return Hv, (n_frequency, n_output, n_force)."""
    n_frequency, n_output, n_force = g_xf.shape
    value = np.empty(g_xf.shape, dtype=complex)
    for o in range(n_output):
        whole = np.empty((n_frequency, n_force + 1, n_force + 1), dtype=complex)
        whole[:, :-1, :-1] = g_ff
        whole[:, -1, :-1], whole[:, :-1, -1] = g_xf[:, o], g_xf[:, o].conj()
        whole[:, -1, -1] = g_xx[:, o]
        scale = np.sqrt(np.einsum("faa->fa", whole).real + np.finfo(float).tiny)
        vector = np.linalg.eigh(whole / (scale[:, :, None] * scale[:, None, :]))[1][:, :, 0]
        # G v = 0 is E[c c^H] v = 0: the conjugate of v is what the channels c do not do.
        ratio = -vector[:, :-1].conj() / vector[:, -1:].conj()
        value[:, o] = ratio * scale[:, -1:] / scale[:, :-1]
    return value
