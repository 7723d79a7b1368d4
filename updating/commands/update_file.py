"""The file that describes an updating (TOML): which campaigns, which parameters are free, and how they are fitted."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from ema.io.form import Section, read_form
from updating.errors import FitError
from updating.fitting.intervals import Method
from updating.fitting.joint_problem import RATIOS, Scope
from updating.fitting.sensitivity import Scatter


class CampaignSection(Section):
    """One campaign; `file` is relative to the file that names it.

    By default all its configurations take part, and it is known by the name in its file. Its configurations are
    one stack, but the rows of a modal table are one each.
    """

    file: str
    name: str | None = None
    configurations: Annotated[tuple[str, ...], Field(min_length=1)] | None = None


class ParameterSection(Section):
    """What is known of one parameter: who shares it, its bounds, a prior (mean, standard deviation), or its value."""

    scope: Scope | None = None
    bounds: tuple[float, float] | None = None
    prior: tuple[float, Annotated[float, Field(gt=0)]] | None = None
    start: float | None = None
    fixed: float | None = None

    @model_validator(mode="after")
    def _fixed_alone(self) -> ParameterSection:
        if self.fixed is not None and len(self.model_fields_set) > 1:
            further = ", ".join(sorted(self.model_fields_set - {"fixed"}))
            message = f"a fixed parameter is not fitted; take out 'fixed' or {further}"
            raise ValueError(message)
        return self


class ScatterSection(Section):
    """Standard deviations beyond the identification's; see `Scatter`."""

    frequency: Annotated[float, Field(gt=0)] = Scatter.frequency
    damping: Annotated[float, Field(gt=0)] = Scatter.damping
    shape: Annotated[float, Field(gt=0)] = Scatter.shape
    pressure: Annotated[float, Field(ge=0)] = Scatter.pressure


class UpdateFile(Section):
    """An updating as its file describes it.

    Attributes
    ----------
    name : str
        Its title.
    effects : tuple of str
        Effects whose parameters are fitted.
    damping : bool
        Whether damping ratios take part.
    threshold : float
        Smallest MAC that makes a pair.
    starts, seed, intervals
        As in `joint_fit`.
    campaign : tuple of CampaignSection
        The campaigns.
    parameter : mapping of str to ParameterSection
        What differs from the defaults. A ratio such as `young` is free when it is named here.
    hold_out : mapping of str to tuple of int
        Modes by configuration, counted from 1, that are predicted instead of fitted. With several campaigns a
        configuration is called "campaign/configuration".
    scatter : ScatterSection
        Weights.
    """

    name: str
    effects: tuple[str, ...] = ()
    damping: bool = True
    threshold: Annotated[float, Field(ge=0, le=1)] = 0.8
    starts: Annotated[int, Field(ge=1)] | None = None
    seed: Annotated[int, Field(ge=0)] = 0
    intervals: Method = "normal"
    campaign: Annotated[tuple[CampaignSection, ...], Field(min_length=1)]
    parameter: Mapping[str, ParameterSection] = Field(default_factory=dict)
    hold_out: Mapping[str, tuple[Annotated[int, Field(ge=1)], ...]] = Field(default_factory=dict)
    scatter: ScatterSection = ScatterSection()

    @property
    def free(self) -> tuple[str, ...]:
        """Ratios of the stack's properties that are fitted."""
        return tuple(n for n in RATIOS if n in self.parameter and self.parameter[n].fixed is None)

    @property
    def scope(self) -> dict[str, Scope]:
        """Who shares a parameter, where that is said."""
        return {name: p.scope for name, p in self.parameter.items() if p.scope is not None}

    @property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """Bounds, where they are said."""
        return {name: p.bounds for name, p in self.parameter.items() if p.bounds is not None}

    @property
    def priors(self) -> dict[str, tuple[float, float]]:
        """Means and standard deviations of priors."""
        return {name: p.prior for name, p in self.parameter.items() if p.prior is not None}

    @property
    def first(self) -> dict[str, float]:
        """Values of effects' parameters that the first descent begins with."""
        return {name: p.start for name, p in self.parameter.items() if p.start is not None}

    @property
    def fixed(self) -> dict[str, float]:
        """Values of parameters that are not fitted."""
        return {name: p.fixed for name, p in self.parameter.items() if p.fixed is not None}


def read_update_file(path: Path) -> UpdateFile:
    """Read the description of an updating.

    Raises
    ------
    FitError
        The file is missing, is not TOML, or has a key that is unknown, missing or impossible.
    """
    return read_form(path, UpdateFile, FitError)
