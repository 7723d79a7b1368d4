"""Whether the modes explain what was measured: share of the power, per channel and band, and the peaks left over."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ema.quality.verdict import Verdict
from ema.types.frf import FRF
from ema.types.modal_model import ModalModel, synthesize

WARN, FAIL = 0.9, 0.7
"""Shares of the power explained below which a set is warned of, and below which its identification has failed."""
_LISTED = 6


def explained_power(frf: FRF, modal_model: ModalModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Share of the measured power that the modes explain.

    Parameters
    ----------
    frf : FRF
        What was identified, at the outputs and inputs of the model.
    modal_model : ModalModel

    Returns
    -------
    edge : (n_mode + 1,) float
        Ends of the bands, Hz: half way between neighbouring modes.
    share : (n_output, n_mode) float
        One less the power of measured less synthesised functions over that of the measured ones, in each band.
    """
    lines = frf.band(max(modal_model.band[0], np.finfo(float).tiny), modal_model.band[1])
    rest = np.abs(lines.value - synthesize(modal_model, lines.frequency, lines.quantity)) ** 2
    power = np.abs(lines.value) ** 2
    middle = 0.5 * (modal_model.frequency[1:] + modal_model.frequency[:-1])
    edge = np.concatenate([modal_model.band[:1], middle, modal_model.band[1:]])
    place = np.clip(np.searchsorted(edge, lines.frequency, side="right") - 1, 0, edge.size - 2)
    share = np.full((frf.output.node.size, edge.size - 1), np.nan)
    for k in np.unique(place):
        own = place == k
        share[:, k] = 1.0 - rest[..., own].sum(axis=(1, 2)) / power[..., own].sum(axis=(1, 2))
    return edge, share


def check_explained(frf: FRF, modal_model: ModalModel) -> tuple[Verdict, ...]:
    """Say how much of the measured power the modes explain, and which peaks they leave.

    Parameters
    ----------
    frf : FRF
        What was identified; verdicts name its outputs.
    modal_model : ModalModel

    Returns
    -------
    tuple of Verdict
        One for the set: a warning below 0.9 and a failure of the identification below 0.7 in the mean over the
        channels; then one warning for each peak that no mode was found for.
    """
    return (*_whole(frf, modal_model), *_peaks(frf, modal_model))


def _whole(frf: FRF, modal_model: ModalModel) -> Iterator[Verdict]:
    per_channel = 1.0 - np.mean(modal_model.error**2, axis=1)
    mean = float(per_channel.mean())
    edge, share = explained_power(frf, modal_model)
    text = f"the modes explain {mean:.3f} of the measured power in the mean over the channels"
    poor = np.flatnonzero(per_channel < WARN)
    if poor.size:
        text += f"; {_listed([f'{frf.output.name(int(c))} {per_channel[c]:.2f}' for c in poor])}"
    if mean >= WARN:
        yield Verdict(check="explained", level="pass", channel=(), band=None, message=text)
        return
    per_band = np.nanmean(share, axis=0)
    weak = [k for k in np.argsort(per_band) if per_band[k] < WARN]
    bands = [f"{edge[k]:.5g}-{edge[k + 1]:.5g} Hz {per_band[k]:.2f}" for k in weak]
    text += f"; least in {_listed(bands)}" if bands else ""
    level = "warn" if mean >= FAIL else "fail"
    yield Verdict(
        check="explained",
        level=level,  # type: ignore[arg-type]  # one of the two
        channel=tuple(int(c) for c in poor) if level == "warn" else (),
        band=None,
        message=f"{text}: modes are missing, runs differ, or the structure is not linear",
    )


def _peaks(frf: FRF, modal_model: ModalModel) -> Iterator[Verdict]:
    for peak in modal_model.unexplained:
        names = _listed([frf.output.name(c) for c in peak.channel])
        text = (
            f"the functions show a peak at {peak.frequency:.5g} Hz that no mode was found for, "
            f"{100 * peak.share:.0f} % of its power unexplained{f' (in {names})' if names else ''}: {peak.reason}"
        )
        band = (peak.frequency, peak.frequency)
        yield Verdict(check="peak", level="warn", channel=peak.channel, band=band, message=text)


def _listed(names: list[str]) -> str:
    return ", ".join(names[:_LISTED]) + (", ..." if len(names) > _LISTED else "")
