"""Poles in a text file that can be edited: choosing them by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.io.files import plain_bytes, whole
from ema.types.errors import IdentificationError

HEADER = (
    "# Poles, one a line: natural frequency in Hz and damping ratio (0.01 is 1 %).\n"
    "# Add and take away lines and give the file back to the identification.\n"
)


def write_poles(path: Path, pole: NDArray[np.complex128]) -> None:
    """Write poles (rad/s) to a text file of natural frequencies and damping ratios."""
    lines = [f"{abs(p) / (2.0 * np.pi):.10g}  {-p.real / abs(p):.6g}\n" for p in pole]
    with whole(path, IdentificationError) as part:
        part.write_text(HEADER + "".join(lines), encoding="utf-8")


def read_poles(path: Path) -> NDArray[np.complex128]:
    """Read poles (rad/s) from a text file of natural frequencies (Hz) and damping ratios, a pole a line.

    Raises
    ------
    IdentificationError
        The file cannot be read or holds no pole, or a line does not hold two numbers in range; the message names file
        and line.
    """
    try:
        lines = plain_bytes(path).decode("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        message = f"{path}: cannot be read: {error}"
        raise IdentificationError(message) from error
    found: list[complex] = []
    for number, line in enumerate(lines, start=1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        try:
            frequency, damping = (float(w) for w in words)
        except ValueError:
            message = (
                f"{path}, line {number}: expected a frequency in Hz and a damping ratio, got {line.strip()!r}"
            )
            raise IdentificationError(message) from None
        if not (frequency > 0.0 and 0.0 < damping < 1.0):
            message = (
                f"{path}, line {number}: frequency must be above 0 Hz and the damping ratio between 0 and 1 "
                f"(0.01 is 1 %), got {frequency:g} and {damping:g}"
            )
            raise IdentificationError(message)
        found.append(2.0 * np.pi * frequency * complex(-damping, np.sqrt(1.0 - damping**2)))
    if not found:
        message = f"{path}: holds no pole; give one a line, as frequency in Hz and damping ratio"
        raise IdentificationError(message)
    return np.array(sorted(found, key=abs))
