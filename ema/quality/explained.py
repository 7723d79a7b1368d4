"""Whether the modes explain what was measured: share of the power, per channel and band, and the peaks left over."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ema.quality.peaks import whitest
from ema.quality.verdict import Verdict, listing
from ema.types.frf import FRF, Dofs, Quantity
from ema.types.modal_model import ModalModel, synthesize_runs
from lamella_shared import Reals, readonly


@dataclass(frozen=True, eq=False, kw_only=True)
class ExplainedPower:
    """Share of the measured power that the modes explain.

    It is one less the power of measured less synthesised functions over that of the measured ones, both as the quantity
    whose noise is even, in which the modes are fitted: the first lines of a receptance, where integrated noise grows
    without limit, would hold all of it.

    Attributes
    ----------
    channel : tuple of str
        The outputs of the modal model, as a campaign file writes them.
    edge : (n_mode + 1,) float
        Ends of the bands, Hz: half way between neighbouring modes.
    share : (n_channel, n_mode) float
        Share in each band over the inputs; NaN where a band holds no line.
    whole : (n_channel,) float
        Share in the whole band.
    quantity : {"receptance", "mobility", "accelerance"}
        As which the power is counted.
    power : (n_channel, n_mode) float, optional
        Power of each channel in each band, of all its power. Where not given, all bands hold as much.

    Notes
    -----
    Every function counts by its power over that of the whole band, so that all count alike in it. A share is always of
    the power of all lines and functions together that it stands for: the mean of single shares, weighted by `power`.
    A channel that is at rest in a band has little power there, and what is left of it is little as well.
    """

    channel: tuple[str, ...]
    edge: Reals
    share: Reals
    whole: Reals
    quantity: Quantity
    power: Reals | None = None

    def __post_init__(self) -> None:
        n_channel, n_band = len(self.channel), np.size(self.edge) - 1
        if self.power is None:
            object.__setattr__(self, "power", np.full((n_channel, n_band), 1.0 / n_band))
        shapes = {"edge": (None,), "share": (n_channel, n_band), "whole": (n_channel,), "power": (n_channel, n_band)}
        for name, shape in shapes.items():
            object.__setattr__(self, name, readonly("ExplainedPower", name, getattr(self, name), shape))

    @property
    def mean(self) -> float:
        """Share in the whole band over all channels."""
        return float(np.mean(self.whole))

    @property
    def around(self) -> Reals:
        """Share in each band over all channels, ``(n_mode,)``; NaN where a band holds no line."""
        assert self.power is not None
        power = self.power.sum(axis=0)
        explained = np.where(self.power > 0.0, self.power * self.share, 0.0).sum(axis=0)
        return np.where(power > 0.0, explained / np.where(power > 0.0, power, 1.0), np.nan)


def explained_power(frf: FRF, modal_model: ModalModel) -> ExplainedPower:
    """Compare what was identified, at the outputs and inputs of the model, with what the model stands for."""
    at_once = 1024  # that are compared at a time: all functions may be large
    lines = frf.band(max(modal_model.band[0], np.finfo(float).tiny), modal_model.band[1])
    quantity = whitest(lines)
    middle = 0.5 * (modal_model.frequency[1:] + modal_model.frequency[:-1])
    edge = np.concatenate([modal_model.band[:1], middle, modal_model.band[1:]])
    left, held = np.zeros((2, *lines.value.shape[:2], edge.size - 1))
    for first in range(0, lines.frequency.size, at_once):
        block = lines.frequency[first : first + at_once]
        part = lines.band(block[0], block[-1]).convert(quantity)
        place = np.clip(np.searchsorted(edge, part.frequency, side="right") - 1, 0, edge.size - 2)
        of_band = (place[:, None] == np.arange(edge.size - 1)).astype(float)
        rest = part.value - synthesize_runs(modal_model, part.frequency, quantity, part.run)
        left += np.abs(rest) ** 2 @ of_band
        held += np.abs(part.value) ** 2 @ of_band
    size = held.sum(axis=2, keepdims=True) * held.shape[1]
    left, held = (left / size).sum(axis=1), (held / size).sum(axis=1)
    output = Dofs(node=modal_model.node, direction=modal_model.direction)
    return ExplainedPower(
        channel=tuple(output.name(c) for c in range(output.node.size)),
        edge=edge,
        share=np.where(held > 0.0, 1.0 - left / np.where(held > 0.0, held, 1.0), np.nan),
        whole=1.0 - left.sum(axis=1),
        quantity=quantity,
        power=held,
    )


def check_explained(explained: ExplainedPower, modal_model: ModalModel) -> tuple[Verdict, ...]:
    """Say how much of the measured power the modes explain, and which peaks they leave.

    Parameters
    ----------
    explained : ExplainedPower
    modal_model : ModalModel

    Returns
    -------
    tuple of Verdict
        One for the set: a warning below 0.9 of all power or around any mode, and a failure of the identification below
        0.7 of all; then one warning for each peak that no mode was found for. They name outputs of the model.
    """
    return (_whole(explained, modal_model.quantity), *_peaks(explained.channel, modal_model))


def _whole(
    explained: ExplainedPower,
    measured: Quantity,
    *,
    # Shares of the power explained below which a set is warned of, and below which its identification has failed.
    warn: float = 0.9,
    fail: float = 0.7,
) -> Verdict:
    mean = explained.mean
    counted = "" if explained.quantity == measured else f", as {explained.quantity},"
    text = f"the modes explain {mean:.3f} of the measured power{counted} in the mean over the channels"
    poor = np.flatnonzero(explained.whole < warn)
    if poor.size:
        text += f"; {listing([f'{explained.channel[c]} {explained.whole[c]:.2f}' for c in poor], 6)}"
    around, edge = explained.around, explained.edge
    weak = [k for k in np.argsort(around) if around[k] < warn]
    bands = [f"{edge[k]:.5g}-{edge[k + 1]:.5g} Hz {around[k]:.2f}" for k in weak]
    text += f"; least in {listing(bands, 6)}" if bands else ""
    if mean >= warn and not weak:
        return Verdict(check="explained", level="pass", message=text)
    if mean >= warn:
        band = (float(edge[min(weak)]), float(edge[max(weak) + 1]))
        text += ": noise, modes that are missing, or runs that differ"
        return Verdict(check="explained", level="warn", band=band, message=text)
    text += ": modes are missing, runs differ, or the structure is not linear"
    if mean >= fail:
        channels = tuple(int(c) for c in poor)
        return Verdict(check="explained", level="warn", channel=channels, message=text)
    text = f"the identification has failed: {text}; do not use these modes"
    return Verdict(check="explained", level="fail", message=text)


def _peaks(
    channel: tuple[str, ...],
    modal_model: ModalModel,
    *,
    # Peaks that are reported one by one.
    most_listed: int = 12,
) -> Iterator[Verdict]:
    listed, further = modal_model.unexplained[:most_listed], modal_model.unexplained[most_listed:]
    for peak in listed:
        names = listing([channel[c] for c in peak.channel], 6)
        beside = _beside(peak.frequency, modal_model)
        where = "that no mode was found for" if beside is None else f"in the resonance of the mode at {beside:.5g} Hz"
        text = (
            f"the functions show a peak at {peak.frequency:.5g} Hz {where}, "
            f"{_unexplained(peak.share)}{f' (in {names})' if names else ''}: {peak.reason}"
        )
        band = (peak.frequency, peak.frequency)
        yield Verdict(check="peak", level="warn", channel=peak.channel, band=band, message=text)
    if further:
        band = (min(peak.frequency for peak in further), max(peak.frequency for peak in further))
        text = (
            f"{len(further)} further and smaller peaks from {band[0]:.5g} to {band[1]:.5g} Hz that no mode was found "
            "for; so many are those of noise or of a rattle: give a 'band' that ends before it"
        )
        yield Verdict(check="peak", level="warn", band=band, message=text)


def _unexplained(share: float) -> str:
    if share <= 1.0:
        return f"{100 * share:.0f} % of its power unexplained"
    return f"the modes are off by {share:.3g} times its power"


def _beside(frequency: float, modal_model: ModalModel, *, beside: float = 2.0) -> float | None:
    """Return the frequency of the mode in whose resonance, of all runs or of some, a frequency lies; None of none.

    `beside`: half bandwidths of a mode within which a further peak is of its resonance, or of what stands for two.
    """
    pole = np.concatenate([modal_model.pole[None], modal_model.run_pole])
    half = -pole.real.min(axis=0) / (2.0 * np.pi)
    lowest, highest = (extreme(np.abs(pole), axis=0) / (2.0 * np.pi) for extreme in (np.min, np.max))
    off = np.maximum(lowest - frequency, frequency - highest) / half
    return float(modal_model.frequency[np.argmin(off)]) if off.min(initial=np.inf) < beside else None
