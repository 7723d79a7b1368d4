"""Frequency-response functions from time histories of several forces at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.campaign.estimate import Averaging, block_of, spectrum_settings
from ema.types.arrays import readonly
from ema.types.errors import MeasurementError

LEAST_INDEPENDENT = 1e-3
"""Share of a force that the other ones do not hold below which its functions are not told from theirs."""


@dataclass(frozen=True, eq=False, kw_only=True)
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

    frequency: NDArray[np.float64]
    value: NDArray[np.complex128]
    partial_coherence: NDArray[np.float64]
    multiple_coherence: NDArray[np.float64]
    independent: NDArray[np.float64]
    n_average: int
    decay_rate: float

    def __post_init__(self) -> None:
        frequency = readonly("FRFMatrixEstimate", "frequency", self.frequency, (None,))
        value = readonly("FRFMatrixEstimate", "value", self.value, (None, None, frequency.size), complex)
        object.__setattr__(self, "frequency", frequency)
        object.__setattr__(self, "value", value)
        for name, shape in (
            ("partial_coherence", value.shape),
            ("multiple_coherence", (value.shape[0], frequency.size)),
            ("independent", (value.shape[1], frequency.size)),
        ):
            object.__setattr__(self, name, readonly("FRFMatrixEstimate", name, getattr(self, name), shape))


def estimate_frf_matrix(
    force: NDArray[np.float64], response: NDArray[np.float64], rate: float, averaging: Averaging
) -> FRFMatrixEstimate:
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
    frequency, g_ff, g_xf, g_xx = _spectra(force, response, rate, averaging)
    _require_independent(g_ff)
    auto = np.einsum("faa->fa", g_ff).real
    scale = np.sqrt(auto + np.finfo(float).tiny)
    correlation = g_ff / (scale[:, :, None] * scale[:, None, :]) + 1e-12 * np.eye(n_force)
    inverse = np.linalg.inv(correlation) / (scale[:, :, None] * scale[:, None, :])
    h1 = g_xf @ inverse  # (n_frequency, n_output, n_force)
    explained = np.einsum("foi,foi->fo", h1, g_xf.conj()).real
    with np.errstate(divide="ignore", invalid="ignore"):
        multiple = np.clip(np.nan_to_num(explained / g_xx), 0.0, 1.0)
        own = np.abs(h1) ** 2 / np.einsum("faa->fa", inverse).real[:, None, :]
        partial = np.nan_to_num(own / (own + (g_xx * (1.0 - multiple))[..., None]))
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


def _averages(
    force: NDArray[np.float64], response: NDArray[np.float64], rate: float, averaging: Averaging
) -> int:
    """Return the number of blocks; refuse what does not tell the parts of the forces."""
    n_force = force.shape[0]
    n_block, n_overlap, _ = block_of(force.shape[-1], rate, averaging)
    n_average = force.shape[1] * (1 + (force.shape[-1] - n_block) // (n_block - n_overlap))
    if averaging.estimator == "H2":
        message = (
            f"H2 is not defined for {n_force} forces and {response.shape[0]} responses; take 'H1' or 'Hv'"
        )
        raise MeasurementError(message)
    if n_average <= n_force:
        message = (
            f"{n_average} averages do not tell the parts of {n_force} forces in a response; give more records, or "
            "shorter blocks by 'block_s'"
        )
        raise MeasurementError(message)
    return n_average


def _spectra(
    force: NDArray[np.float64], response: NDArray[np.float64], rate: float, averaging: Averaging
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return lines and averaged spectra: G_ff (n_frequency, n_force, n_force), G_xf (..., n_output, n_force), G_xx."""
    from scipy import signal  # here: it takes long to import, and most tests come as FRFs

    settings = spectrum_settings(force.shape[-1], rate, averaging)
    frequency, g_ff = signal.csd(force[None], force[:, None], **settings)  # conj(F_b) F_a at [a, b]
    g_xf = signal.csd(force[None], response[:, None], **settings)[1]
    g_xx = signal.csd(response, response, **settings)[1].real.mean(axis=1)
    return frequency, *(np.moveaxis(g.mean(axis=2), -1, 0) for g in (g_ff, g_xf)), g_xx.T


def _independent(g_ff: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the share of each force, (n_frequency, n_force), that the others do not hold: 1 less its coherence."""
    auto = np.einsum("faa->fa", g_ff).real
    scale = np.sqrt(auto + np.finfo(float).tiny)
    correlation = g_ff / (scale[:, :, None] * scale[:, None, :])
    inverse = np.linalg.pinv(correlation, rcond=1e-10, hermitian=True)
    return np.asarray(1.0 / np.maximum(np.einsum("faa->fa", inverse).real, 1.0))


def _require_independent(g_ff: NDArray[np.complex128]) -> None:
    """Refuse forces that are zero, or that do the same at most lines."""
    auto = np.einsum("faa->fa", g_ff).real[1:-1]
    for k in range(auto.shape[1]):
        if not np.all(auto[:, k] > 0.0):
            message = f"force {k + 1} of {auto.shape[1]} is zero or not a number; no FRF can be estimated"
            raise MeasurementError(message)
    value = np.linalg.eigvalsh(g_ff[1:-1] / np.sqrt(auto[:, :, None] * auto[:, None, :]))
    if np.median(value[:, 0]) < LEAST_INDEPENDENT:
        message = (
            f"the {auto.shape[1]} forces are the same up to a factor at most lines, so their effects are not told "
            "apart; drive the shakers with independent signals, or state one of them as the force"
        )
        raise MeasurementError(message)


def _total_least_squares(
    g_ff: NDArray[np.complex128], g_xf: NDArray[np.complex128], g_xx: NDArray[np.float64]
) -> NDArray[np.complex128]:
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
