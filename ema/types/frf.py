"""Frequency-response functions of one configuration as one small data type."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ema.types.geometry import Dofs
from lamella_shared import arrays, frozen

Quantity = Literal["receptance", "mobility", "accelerance"]
"""Response over force: displacement (m/N), velocity (m/(N s)) or acceleration (m/(N s2))."""

DERIVATIVE: dict[Quantity, int] = {"receptance": 0, "mobility": 1, "accelerance": 2}
"""How often displacement is differentiated in time."""


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"any": "frequency", "output.node input.node frequency": "value coherence", "output.node": "run"})
class FRF:
    """A block of frequency-response functions on a common, uniform frequency axis, in SI units.

    Attributes
    ----------
    frequency : (n_frequency,) float
        Frequency lines, Hz, ascending.
    value : (n_output, n_input, n_frequency) complex
        Response of each output over force at each input.
    quantity : {"receptance", "mobility", "accelerance"}
        What the response is.
    output, input : Dofs
        Response and force DOFs, `n_output` and `n_input` of them.
    run : (n_output,) int
        Roving run in which each output was measured, counted from 0 in reading order.
    source : tuple of str
        Where each output comes from (file and data set), for messages; `n_output` entries.
    coherence : (n_output, n_input, n_frequency) float or None
        Ordinary coherence of each function, or None when the test system did not store it.
    decay_rate : float
        What an exponential window on the responses adds to the decay rate of every mode, 1/s.
    reciprocal : bool
        Whether responses and forces have changed places, as for a roving hammer: outputs are then where it struck.
    """

    frequency: NDArray[np.float64]
    value: NDArray[np.complex128]
    quantity: Quantity
    output: Dofs
    input: Dofs
    run: NDArray[np.int64]
    source: tuple[str, ...]
    coherence: NDArray[np.float64] | None = None
    decay_rate: float = 0.0
    reciprocal: bool = False

    def __post_init__(self) -> None:
        if len(self.source) != self.output.node.size:
            raise ValueError(f"FRF.source: expected {self.output.node.size} entries, got {len(self.source)}")

    def band(self, lower: float, upper: float) -> FRF:
        """Return the lines with ``lower <= frequency <= upper`` (Hz)."""
        return self._lines((self.frequency >= lower) & (self.frequency <= upper))

    def outputs(self, keep: NDArray[np.bool_]) -> FRF:
        """Return the outputs for which `keep` (n_output,) is true."""
        if np.all(keep):
            return self
        return replace(
            self,
            value=frozen(self.value[keep]),
            output=Dofs(node=self.output.node[keep], direction=self.output.direction[keep]),
            run=self.run[keep],
            source=tuple(s for s, k in zip(self.source, keep, strict=True) if k),
            coherence=None if self.coherence is None else self.coherence[keep],
        )

    def by_reciprocity(self) -> FRF:
        """Exchange response and force where there are more inputs than outputs."""
        n_output, n_input, _ = self.value.shape
        if n_input <= n_output:
            return self
        return FRF(
            frequency=self.frequency,
            value=self.value.swapaxes(0, 1),
            quantity=self.quantity,
            output=self.input,
            input=self.output,
            run=np.zeros(n_input, dtype=int),
            source=(", ".join(dict.fromkeys(self.source)),) * n_input,
            coherence=None if self.coherence is None else self.coherence.swapaxes(0, 1),
            decay_rate=self.decay_rate,
            reciprocal=True,
        )

    @property
    def sensor(self) -> NDArray[np.int64]:
        """Number of each output among those of its run, from 0: the accelerometer where some rove."""
        return place_in_run(self.run)

    def convert(self, quantity: Quantity) -> FRF:
        """Return the same functions as another quantity.

        Differentiation in time is multiplication by ``i omega``. Integration divides by it, so the line
        at 0 Hz, where the result does not exist, is then left out.
        """
        power = DERIVATIVE[quantity] - DERIVATIVE[self.quantity]
        if power == 0:
            return self
        lines = self._lines(self.frequency > 0) if power < 0 else self
        factor = (2j * np.pi * lines.frequency) ** power
        return replace(lines, value=frozen(lines.value * factor), quantity=quantity)

    def _lines(self, keep: NDArray[np.bool_]) -> FRF:
        (at,) = np.nonzero(keep)
        chosen: slice | NDArray[np.bool_] = keep
        if at.size and at[-1] - at[0] + 1 == at.size:
            chosen = slice(int(at[0]), int(at[-1]) + 1)  # the same memory
        return replace(
            self,
            frequency=self.frequency[chosen],
            value=frozen(self.value[..., chosen]),
            coherence=None if self.coherence is None else self.coherence[..., chosen],
        )


def place_in_run(run: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the number of each output, (n_output,), among those of its run, from 0."""
    return np.array([np.count_nonzero(run[:i] == number) for i, number in enumerate(run)], dtype=np.int64)
