"""Sound files (WAV) as time histories: the rate is in the header, the calibration in the campaign file."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.io.files import plain_bytes
from ema.io.measured_function import MeasuredFunction
from ema.types.errors import MeasurementError

_FULL = {"int16": 2.0**15, "int32": 2.0**31, "int64": 2.0**63, "uint8": 2.0**7}
"""Full scale of whole numbers; SciPy gives those of 24 bits as the upper ones of 32."""
_MIDDLE = 2.0**7  # of whole numbers of 8 bits, which have no sign


def read_wav(path: Path, full_scale: tuple[float, ...]) -> tuple[MeasuredFunction, ...]:
    """Read the channels of a sound file as time histories.

    They come as functions of kind "response", since only the user knows which channel is the force.

    Parameters
    ----------
    path : Path
        WAV file of 8 to 64 bits, whole numbers or floating point.
    full_scale : tuple of float
        What full scale means in each channel, in the unit that the campaign file states; one number for all.

    Raises
    ------
    MeasurementError
        It cannot be read, or has another number of channels; the message names file and channel.
    """
    rate, data = _content(path)
    if len(full_scale) not in (1, data.shape[1]):
        message = (
            f"{path}: has {data.shape[1]} channels, and 'full_scale' of the campaign file {len(full_scale)} numbers; "
            "give one for each channel, or one for all"
        )
        raise MeasurementError(message)
    if rate <= 0 or data.shape[0] < 2 or not np.isfinite(data).all():
        message = (
            f"{path}: holds {data.shape[0]} samples at {rate:g} Hz, or values that are not finite; expected a record "
            "with its sampling rate in the header"
        )
        raise MeasurementError(message)
    time = np.arange(data.shape[0]) / rate
    return tuple(
        MeasuredFunction(
            kind="response", abscissa=time, value=data[:, c] * full_scale[c if len(full_scale) > 1 else 0],
            quantity=None, output=None, input=None, source=f"{path}: channel {c + 1}",
        )
        for c in range(data.shape[1])
    )  # fmt: skip


def _content(path: Path) -> tuple[float, NDArray[np.float64]]:
    """Return the sampling rate, Hz, and the samples over full scale, (n_sample, n_channel)."""
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("error", message="Reached EOF prematurely")  # what is cut off
            warnings.filterwarnings("ignore", message="Chunk")  # of text beside the samples
            rate, raw = scipy.io.wavfile.read(io.BytesIO(plain_bytes(path)))
        samples: NDArray[Any] = np.atleast_1d(raw)
        full = _FULL.get(samples.dtype.name, 1.0)
        middle = _MIDDLE if samples.dtype.name == "uint8" else 0.0
        return float(rate), ((samples.astype(float) - middle) / full).reshape(len(samples), -1)
    except Exception as error:  # SciPy raises what it likes at damaged headers
        message = (
            f"{path}: cannot be read as a WAV file: {getattr(error, 'strerror', None) or error}; expected the whole of "
            "a file of 8 to 64 bits, not compressed"
        )
        raise MeasurementError(message) from error
