"""The file (TOML) in which a laboratory states what separates its right models from its right measurements."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Annotated

from pydantic import Field, create_model

from ema.io.form import Section, read_form
from updating.diagnosis.evidence import DiagnosisScatter
from updating.errors import FitError


def read_scatter(path: Path) -> DiagnosisScatter:
    """Read standard deviations, relative to the value, under the names of `DiagnosisScatter`; what is not stated stays.

    Raises
    ------
    FitError
        The file is missing, is not TOML, or has a key that is unknown or no number between 0 and 1.
    """
    keys = {
        field.name: (Annotated[float, Field(gt=0, lt=1)], field.default) for field in fields(DiagnosisScatter)
    }
    form = create_model("_ScatterFile", __base__=Section, **keys)  # type: ignore[call-overload]  # named only here
    return DiagnosisScatter(**read_form(path, form, FitError).model_dump())
