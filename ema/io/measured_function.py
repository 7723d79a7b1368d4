"""One measured function as a file holds it: the common ground of all readers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ema.types.arrays import readonly
from ema.types.frf import Quantity

Kind = Literal["frf", "coherence", "response", "force", "other"]
"""What a function is: response and force are time histories, "other" (spectra, ...) is read but not used."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredFunction:
    """A function of frequency or time with the degrees of freedom that its file states.

    Attributes
    ----------
    kind : {"frf", "coherence", "response", "force", "other"}
        What the function is.
    abscissa : (n_value,) float
        Hz, or s for a time history.
    value : (n_value,) complex or float
        SI units.
    quantity : {"receptance", "mobility", "accelerance"} or None
        For an FRF what it is, for the time history of a response the FRF that it gives; None for the
        other kinds, and where the file does not say.
    output, input : (int, int) or None
        Point number and signed local direction (1, 2, 3 for +x, +y, +z) of response and force; None
        where the file does not state one.
    source : str
        File and data set, for messages.
    component : str
        Name of the part of the structure whose point the response is; empty where the file states none.
    """

    kind: Kind
    abscissa: NDArray[np.float64]
    value: NDArray[Any] = field(repr=False)
    quantity: Quantity | None
    output: tuple[int, int] | None
    input: tuple[int, int] | None
    source: str
    component: str = ""

    def __post_init__(self) -> None:
        abscissa = readonly("MeasuredFunction", "abscissa", self.abscissa, (None,))
        dtype = complex if np.iscomplexobj(self.value) else float
        object.__setattr__(self, "abscissa", abscissa)
        object.__setattr__(
            self, "value", readonly("MeasuredFunction", "value", self.value, abscissa.shape, dtype)
        )
