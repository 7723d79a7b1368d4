"""An estimated parameter as it is written and printed: with its 95 % interval."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class ParameterEstimate:
    """A parameter with its 95 % interval.

    Attributes
    ----------
    name, unit : str
        Which.
    value, lower, upper : float
        The estimate and the ends of its 95 % interval.
    at_bound : bool
        Whether it lies on an end of its plausible range: then the data ask for a value outside.
    determined : bool
        Whether the data say more of it than its range does.
    """

    name: str
    unit: str
    value: float
    lower: float
    upper: float
    at_bound: bool
    determined: bool = True

    @property
    def remark(self) -> str:
        """What must be said of it beside the interval; often nothing."""
        return "at its bound" if self.at_bound else "" if self.determined else "not determined"
