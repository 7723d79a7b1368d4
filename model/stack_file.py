"""Reading a stack from its TOML file: the only place where other units than SI occur."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from model.errors import StackError
from model.material import Material
from model.stack import Clamp, Contact, Distribution, Mesh, Stack


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Material(_Table):
    young_GPa: float
    poisson: float
    density_kg_m3: float
    transverse_ratio: float = 1.0
    shear_ratio: float = 1.0


class _Contact(_Table):
    G_f: float
    d_f_s_per_Pa: float
    pressure_kPa: float
    normal_modulus_GPa: float


class _Clamp(_Table):
    mass_kg: float
    x_mm: float
    y_mm: float = 0.0
    distribution: Distribution = "height"
    footprint_mm: tuple[float, float] = (0.0, 0.0)


class _Mesh(_Table):
    n_x: int = Mesh.n_x
    n_y: int = Mesh.n_y


class _Stack(_Table):
    name: str
    length_mm: float
    width_mm: float
    height_mm: float
    n_lamina: int
    material: _Material
    contact: _Contact
    clamps: list[_Clamp] = Field(default_factory=list)
    mesh: _Mesh = Field(default_factory=_Mesh)


_TABLES: dict[str, type[_Table]] = {
    "material": _Material,
    "contact": _Contact,
    "clamps": _Clamp,
    "mesh": _Mesh,
}


def _explain(path: Path, error: ValidationError) -> str:
    lines = []
    for item in error.errors():
        place = [part for part in item["loc"] if isinstance(part, str)]
        where = ".".join(str(part) for part in item["loc"])
        table = _TABLES.get(place[0], _Stack) if len(place) > 1 else _Stack
        allowed = sorted(table.model_fields)
        if item["type"] == "extra_forbidden":
            close = difflib.get_close_matches(place[-1], allowed, n=3, cutoff=0.5)
            hint = f"; did you mean {' or '.join(close)}?" if close else ""
            lines.append(f"{path}: unknown key {where}{hint} Allowed here: {', '.join(allowed)}")
        elif item["type"] == "missing":
            lines.append(f"{path}: key {where} is missing; it must be given")
        else:
            lines.append(f"{path}: {where} = {item['input']!r}: {item['msg']}")
    return "\n".join(lines)


def read_stack(path: str | Path) -> Stack:
    """Read a stack from a TOML file.

    Every key names its unit. Tables: `material`, `contact`, any number of `[[clamps]]`, and optionally
    `mesh`.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    Stack
        The stack in SI units.

    Raises
    ------
    StackError
        The file is missing, is not TOML, or has an unknown, missing or impossible key; the message names
        the file, the key and what is allowed.
    """
    path = Path(path)
    try:
        raw: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        message = f"{path}: cannot be read ({error.strerror})"
        raise StackError(message) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        message = f"{path}: not a TOML file: {error}"
        raise StackError(message) from error
    try:
        given = _Stack.model_validate(raw)
    except ValidationError as error:
        raise StackError(_explain(path, error)) from error
    try:
        return _to_si(given)
    except StackError as error:
        message = f"{path}: {error}"
        raise StackError(message) from error


def _to_si(given: _Stack) -> Stack:
    material, contact = given.material, given.contact
    return Stack(
        name=given.name,
        length=given.length_mm * 1e-3,
        width=given.width_mm * 1e-3,
        height=given.height_mm * 1e-3,
        n_lamina=given.n_lamina,
        material=Material(
            young=material.young_GPa * 1e9,
            poisson=material.poisson,
            density=material.density_kg_m3,
            transverse_ratio=material.transverse_ratio,
            shear_ratio=material.shear_ratio,
        ),
        contact=Contact(
            G_f=contact.G_f,
            d_f=contact.d_f_s_per_Pa,
            pressure=contact.pressure_kPa * 1e3,
            normal_modulus=contact.normal_modulus_GPa * 1e9,
        ),
        clamps=tuple(
            Clamp(
                mass=clamp.mass_kg,
                x=clamp.x_mm * 1e-3,
                y=clamp.y_mm * 1e-3,
                distribution=clamp.distribution,
                footprint=(clamp.footprint_mm[0] * 1e-3, clamp.footprint_mm[1] * 1e-3),
            )
            for clamp in given.clamps
        ),
        mesh=Mesh(n_x=given.mesh.n_x, n_y=given.mesh.n_y),
    )
