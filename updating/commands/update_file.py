"""The file that describes an updating (TOML): which campaigns, which parameters are free, and how they are fitted."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from ema.io.files import Section, read_form
from updating.diagnosis.evidence import DiagnosisScatter
from updating.diagnosis.fit_settings import CONTACT, RATIOS, FitSettings, Scope
from updating.errors import FitError

_WITHOUT = {
    "threshold": "a fit pairs no modes",
    "starts": "a fit starts wherever a screening of the effect promises something",
    "seed": "nothing is drawn",
    "intervals": "all hold the size of what the model misses, which is integrated out, and are normal in the logarithm "
    "of contact parameters",
    "start of contact parameters": "every fit starts where frequencies are met best",
    "scatter.shape": "the noise of shapes is estimated from what no mode of the model reaches",
}
"""What is said of keys that an earlier fit took."""
_LEAST = 1e-6  # relative standard deviation of what is known exactly


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
    """Standard deviations of what separates a right model from a right measurement; see `DiagnosisScatter`.

    Those of `frequency` and `damping` are estimated where they are not stated. `pressure` is that of the contact's
    stiffness from torque to torque. The noise of shapes is estimated, and `shape` means nothing any more.
    """

    frequency: Annotated[float, Field(gt=0)] | None = None
    damping: Annotated[float, Field(gt=0)] | None = None
    shape: Annotated[float, Field(gt=0)] | None = None
    pressure: Annotated[float, Field(ge=0)] | None = None


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
    threshold, starts, seed, intervals
        What they said means nothing any more, and is said so: see `without_meaning`.
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
    threshold: Annotated[float, Field(ge=0, le=1)] | None = None
    starts: Annotated[int, Field(ge=1)] | None = None
    seed: Annotated[int, Field(ge=0)] | None = None
    intervals: Literal["normal", "profile", "bootstrap"] | None = None
    campaign: Annotated[tuple[CampaignSection, ...], Field(min_length=1)]
    parameter: Mapping[str, ParameterSection] = Field(default_factory=dict)
    hold_out: Mapping[str, tuple[Annotated[int, Field(ge=1)], ...]] = Field(default_factory=dict)
    scatter: ScatterSection = ScatterSection()

    @property
    def without_meaning(self) -> tuple[str, ...]:
        """What is said of keys that are given and mean nothing any more, a sentence each."""
        given = {
            name: getattr(self, name) is not None for name in ("threshold", "starts", "seed", "intervals")
        }
        given["scatter.shape"] = self.scatter.shape is not None
        given["start of contact parameters"] = any(
            name in self.parameter and self.parameter[name].start is not None for name in (*CONTACT, *RATIOS)
        )
        return tuple(
            f"{n} has no meaning any more: {_WITHOUT[n]}." for n, is_there in given.items() if is_there
        )

    def settings(self, hold_out: Mapping[str, tuple[int, ...]]) -> FitSettings:
        """Return what is known of parameters beforehand, and the modes that are held out, counted from 0."""
        of = self.parameter
        usual, stated = DiagnosisScatter(), self.scatter
        return FitSettings(
            scope={name: p.scope for name, p in of.items() if p.scope is not None},
            fixed={name: p.fixed for name, p in of.items() if p.fixed is not None},
            bounds={name: p.bounds for name, p in of.items() if p.bounds is not None},
            priors={name: p.prior for name, p in of.items() if p.prior is not None},
            free=[n for n in RATIOS if n in of and of[n].fixed is None and of[n].prior is None],
            start={name: p.start for name, p in of.items() if p.start is not None},
            hold_out=hold_out,
            damping=self.damping,
            scatter=DiagnosisScatter(
                frequency=stated.frequency,
                damping=stated.damping,
                stiffness=usual.stiffness if stated.pressure is None else max(stated.pressure, _LEAST),
            ),
        )


def read_update_file(path: Path) -> UpdateFile:
    """Read the description of an updating.

    Raises
    ------
    FitError
        The file is missing, is not TOML, or has a key that is unknown, missing or impossible.
    """
    return read_form(path, UpdateFile, FitError)
