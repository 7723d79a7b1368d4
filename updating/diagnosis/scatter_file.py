"""The file (TOML) in which a laboratory states what separates its right models from its right measurements."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, create_model

from ema.io.files import Section, read_form
from updating.diagnosis.evidence import DiagnosisScatter
from updating.errors import FitError

_KEYS: dict[str, Any] = {
    field.name: (Annotated[float, Field(gt=0, lt=1)], field.default) for field in fields(DiagnosisScatter)
}
ScatterFile = create_model("ScatterFile", __base__=Section, __doc__="The form of the whole file.", **_KEYS)


def read_scatter(path: Path) -> DiagnosisScatter:
    """Read standard deviations, relative to the value, under the names of `DiagnosisScatter`; what is not stated stays.

    Raises
    ------
    FitError
        The file is missing, is not TOML, or has a key that is unknown or no number between 0 and 1.
    """
    return DiagnosisScatter(**read_form(path, ScatterFile, FitError).model_dump())
