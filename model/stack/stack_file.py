"""Reading a stack from its TOML file: the only place where other units than SI occur."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from lamella_shared import form_of, plain_text, read_form, toml_of
from model.stack import outline
from model.stack.errors import StackError
from model.stack.parts import (
    NO_CONTACT,
    PLATE_POISSON,
    Clamp,
    Contact,
    Distribution,
    Edge,
    EdgeSupport,
    Interlayer,
    Laminas,
    Material,
    Mesh,
    PatchSupport,
    Pressing,
    read_curve,
)
from model.stack.stack import Stack

_Large = Annotated[float, Field(le=1e12)]
"""A number in the units of a file: none of a real stack is as large, and products of such are still finite."""


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Material(_Table):
    young_GPa: _Large
    poisson: float
    density_kg_m3: _Large
    transverse_ratio: _Large = 1.0
    shear_ratio: _Large = 1.0


class _Contact(_Table):
    G_f: _Large | None = None
    d_f_s_per_Pa: _Large | None = None
    pressure_kPa: _Large | None = None
    torque_Nm: _Large | None = None
    torque_table: str | None = None
    normal_modulus_GPa: _Large | None = None


class _Clamp(_Table):
    mass_kg: _Large
    x_mm: float
    y_mm: float = 0.0
    distribution: Distribution = "height"
    footprint_mm: tuple[float, float] = (0.0, 0.0)
    force_N: _Large | None = None


class _Pressing(_Table):
    curve: str
    plate: Literal["rigid"] | None = None
    plate_thickness_mm: float | None = Field(default=None, gt=0, le=1e4)
    plate_young_GPa: _Large = 200.0


class _Interlayer(_Table):
    below: int
    thickness_mm: _Large
    shear_modulus_MPa: _Large
    normal_modulus_MPa: _Large
    density_kg_m3: _Large


class _Support(_Table):
    edge: Edge | None = None
    patch_mm: tuple[float, float, float, float] | None = None
    condition: Literal["clamped", "pinned", "elastic"] = "elastic"
    along_N_m2: float = 0.0
    across_N_m2: float = 0.0
    rotation_N: float = 0.0
    along_N_m3: float = 0.0
    across_N_m3: float = 0.0
    laminas: Laminas = "all"


class _Outline(_Table):
    kind: Literal["rectangle", "ring", "stator", "polygon", "mesh"] = "rectangle"
    outer_mm: float | None = None
    inner_mm: float | None = None
    slot_mm: float | None = None
    n_tooth: int | None = None
    tooth_width_mm: float | None = None
    hole_mm: float = 0.0
    hole_circle_mm: float = 0.0
    n_hole: int = 0
    boundary_mm: list[tuple[float, float]] | None = None
    holes_mm: list[list[tuple[float, float]]] = Field(default_factory=list)
    file: str | None = None


class _Mesh(_Table):
    n_x: int = Mesh.n_x
    n_y: int = Mesh.n_y


class StackFile(_Table):
    """The form of the whole file."""

    name: str
    length_mm: float | None = None
    width_mm: float | None = None
    height_mm: float
    n_lamina: int
    material: _Material
    contact: _Contact = Field(default_factory=_Contact)
    clamps: list[_Clamp] = Field(default_factory=list)
    mesh: _Mesh = Field(default_factory=_Mesh)
    outline: _Outline = Field(default_factory=_Outline)
    pressing: _Pressing | None = None
    interlayers: list[_Interlayer] = Field(default_factory=list)
    supports: list[_Support] = Field(default_factory=list)


def read_stack(path: str | Path) -> Stack:
    """Read a stack from a TOML file.

    Every key names its unit. Tables: `material`, `contact`, any number of `[[clamps]]`, and optionally `mesh`,
    `outline`, `pressing`, `[[interlayers]]` and `[[supports]]`. Files that it names are relative to it. A stack of one
    lamina needs no `contact`.

    The mean pressure is `contact.pressure_kPa`, or follows from `contact.torque_Nm` by the table
    `contact.torque_table`, or from the force of every clamp.

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
    raw = toml_of(path, StackError)
    if "matrices" in raw:
        raise StackError(
            f"{path}: is a structure of matrices, and this needs the model of a stack; ema, model, fit, diagnose, "
            "report and open take matrices"
        )
    given = form_of(path, raw, StackFile, StackError)
    try:
        return _to_si(given, path.parent)
    except StackError as error:
        raise StackError(f"{path}: {error}") from error


def stack_inputs(path: Path) -> tuple[Path, ...]:
    """Return the file of a stack, which `read_stack` accepts, and the files that it names."""
    given = read_form(path, StackFile, StackError)
    named = (given.contact.torque_table, given.outline.file, None if given.pressing is None else given.pressing.curve)
    return (path, *(path.parent / name for name in named if name is not None))


def _to_si(given: StackFile, folder: Path) -> Stack:
    material = given.material
    mesh = Mesh(n_x=given.mesh.n_x, n_y=given.mesh.n_y)
    length, width, shape = _outline(given, folder)
    _check_footprints(given.clamps, (1e3 * length, 1e3 * width))
    area = length * width if shape is None else shape.area
    pressing = None if given.pressing is None else _pressing(given.pressing, folder)
    return Stack(
        name=given.name,
        length=length,
        width=width,
        height=given.height_mm * 1e-3,
        n_lamina=given.n_lamina,
        material=Material(
            young=material.young_GPa * 1e9,
            poisson=material.poisson,
            density=material.density_kg_m3,
            transverse_ratio=material.transverse_ratio,
            shear_ratio=material.shear_ratio,
        ),
        contact=NO_CONTACT if given.n_lamina == 1 else _contact(given, area, pressing, folder),
        clamps=tuple(
            Clamp(
                mass=clamp.mass_kg,
                x=clamp.x_mm * 1e-3,
                y=clamp.y_mm * 1e-3,
                distribution=clamp.distribution,
                footprint=(clamp.footprint_mm[0] * 1e-3, clamp.footprint_mm[1] * 1e-3),
                share=1.0 if clamp.force_N is None else clamp.force_N,
            )
            for clamp in given.clamps
        ),
        mesh=mesh,
        interlayers=tuple(
            Interlayer(
                below=layer.below,
                thickness=layer.thickness_mm * 1e-3,
                shear_modulus=layer.shear_modulus_MPa * 1e6,
                normal_modulus=layer.normal_modulus_MPa * 1e6,
                density=layer.density_kg_m3,
            )
            for layer in given.interlayers
        ),
        pressing=pressing,
        supports=tuple(_support(i, support) for i, support in enumerate(given.supports)),
        outline=shape,
    )


def _check_footprints(clamps: list[_Clamp], size_mm: tuple[float, float]) -> None:
    """Refuse clamps that press what is not there, or what another one presses."""
    touching_mm = 1e-6  # of rounding
    for i, clamp in enumerate(clamps):
        for axis, side, whole in zip("xy", clamp.footprint_mm, size_mm, strict=True):
            if side > whole + touching_mm:
                raise StackError(
                    f"clamps[{i + 1}]: footprint_mm is {side:g} mm along {axis}, but the stack is {whole:g} mm; give "
                    "the part that lies on it"
                )
        for j, other in enumerate(clamps[:i]):
            apart = (abs(clamp.x_mm - other.x_mm), abs(clamp.y_mm - other.y_mm))
            reach = zip(clamp.footprint_mm, other.footprint_mm, strict=True)
            shared = [(p + q) / 2.0 - gap for (p, q), gap in zip(reach, apart, strict=True)]
            if max(apart) > 0.0 and min(shared) > touching_mm:  # at the same place they are one that is heavier
                raise StackError(
                    f"clamps[{j + 1}] and clamps[{i + 1}]: their footprints overlap by {shared[0]:g} mm along x and "
                    f"{shared[1]:g} mm along y; check x_mm, y_mm and footprint_mm"
                )


def _contact(given: StackFile, area: float, pressing: Pressing | None, folder: Path) -> Contact:
    """Return the contact between laminas; `area` is that of the plan, m2."""
    contact = given.contact
    if contact.G_f is None or contact.d_f_s_per_Pa is None:
        name = "G_f" if contact.G_f is None else "d_f_s_per_Pa"
        raise StackError(f"key contact.{name} is missing; it must be given")
    if pressing is None and contact.normal_modulus_GPa is None:
        raise StackError("contact.normal_modulus_GPa is missing; it, or a curve in [pressing], must be given")
    pressure = _pressure(contact, [clamp.force_N for clamp in given.clamps], area, folder)
    if contact.normal_modulus_GPa is not None:
        normal_modulus = contact.normal_modulus_GPa * 1e9
    elif pressing is not None:
        normal_modulus = float(pressing.curve.evaluate(np.array(pressing.curve.strain_at(pressure)))[1])
    return Contact(G_f=contact.G_f, d_f=contact.d_f_s_per_Pa, pressure=pressure, normal_modulus=normal_modulus)


def _outline(given: StackFile, folder: Path) -> tuple[float, float, outline.Outline | outline.Triangulation | None]:
    """Return length, width and shape of the laminas, the shape around the centre of its bounding box."""
    table = given.outline
    box = {"length_mm": given.length_mm, "width_mm": given.width_mm}
    if table.kind == "rectangle":
        missing = [name for name, value in box.items() if value is None]
        if missing or given.length_mm is None or given.width_mm is None:
            raise StackError(f"key {missing[0]} is missing; a rectangle needs it")
        return given.length_mm * 1e-3, given.width_mm * 1e-3, None
    extra = [name for name, value in box.items() if value is not None]
    if extra:
        raise StackError(f"{extra[0]} does not go with outline.kind = {table.kind!r}, which has its own size")

    def need(name: str) -> Any:
        value = getattr(table, name)
        if value is None:
            raise StackError(f"outline.{name} is missing; outline.kind = {table.kind!r} needs it")
        return value

    shape: outline.Outline | outline.Triangulation
    n_side = math.ceil(math.pi * given.mesh.n_x / 4.0) * 4  # sides as long as the elements, alike in four quarters
    if table.kind == "ring":
        shape = outline.ring(need("outer_mm") * 1e-3, need("inner_mm") * 1e-3, n_side)
    elif table.kind == "stator":
        shape = outline.stator(
            outer=need("outer_mm") * 1e-3,
            inner=need("inner_mm") * 1e-3,
            slot=need("slot_mm") * 1e-3,
            n_tooth=need("n_tooth"),
            tooth_width=need("tooth_width_mm") * 1e-3,
            holes=_bolt_holes(table),
            n_side=n_side,
        )
    elif table.kind == "polygon":
        shape = outline.Outline(
            boundary=[(x * 1e-3, y * 1e-3) for x, y in need("boundary_mm")],  # type: ignore[arg-type]
            holes=tuple([(x * 1e-3, y * 1e-3) for x, y in hole] for hole in table.holes_mm),  # type: ignore[misc]
        )
    else:
        shape = outline.read_mesh(folder / need("file"))
    shape = outline.centred(shape)
    (x0, x1), (y0, y1) = shape.bounds
    return float(x1 - x0), float(y1 - y0), shape


def _bolt_holes(table: _Outline) -> outline.BoltHoles | None:
    if table.n_hole == 0:
        return None
    return outline.BoltHoles(number=table.n_hole, diameter=table.hole_mm * 1e-3, circle=table.hole_circle_mm * 1e-3)


def _pressure(contact: _Contact, forces: list[float | None], area: float, folder: Path) -> float:
    """Return the mean pressure, Pa, from the one thing that the file gives for it."""
    given = [force for force in forces if force is not None]
    ways = {
        "contact.pressure_kPa": contact.pressure_kPa is not None,
        "contact.torque_Nm": contact.torque_Nm is not None,
        "clamps.force_N": bool(given),
    }
    named = [name for name, there in ways.items() if there]
    if len(named) != 1:
        raise StackError(
            f"the pressure must be given by one of {', '.join(ways)}; given are {', '.join(named) or 'none'}"
        )
    if contact.pressure_kPa is not None:
        return contact.pressure_kPa * 1e3
    if contact.torque_Nm is not None:
        if contact.torque_table is None:
            raise StackError("contact.torque_table is missing; torque_Nm needs it to become a pressure")
        return _pressure_at_torque(folder / contact.torque_table, contact.torque_Nm)
    if len(given) < len(forces):
        raise StackError(f"clamps.force_N: given for {len(given)} of {len(forces)} clamps; give it for all or for none")
    return sum(given) / area


def _pressure_at_torque(path: Path, torque: float) -> float:
    """Return the mean pressure, Pa, on the line from 0 through the table's columns torque_Nm and pressure_kPa."""
    try:
        table = csv.DictReader(plain_text(path).splitlines())
        rows = sorted((float(r["torque_Nm"]), float(r["pressure_kPa"])) for r in table)
    except OSError as error:
        raise StackError(f"{path}: cannot be read ({error.strerror})") from error
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        raise StackError(f"{path}: needs the columns torque_Nm and pressure_kPa with numbers") from error
    if not rows or not 0.0 < torque <= rows[-1][0]:
        raise StackError(f"{path}: contact.torque_Nm = {torque:g} lies outside the table, which ends at {rows[-1:]}")
    torques, pressures = zip((0.0, 0.0), *rows, strict=True)
    return float(np.interp(torque, torques, pressures)) * 1e3


def _pressing(given: _Pressing, folder: Path) -> Pressing:
    if (given.plate is None) == (given.plate_thickness_mm is None):
        raise StackError('pressing: give the plates either as plate = "rigid" or by plate_thickness_mm')
    rigidity = math.inf
    if given.plate_thickness_mm is not None:
        thickness = given.plate_thickness_mm * 1e-3
        rigidity = given.plate_young_GPa * 1e9 * thickness**3 / (12.0 * (1.0 - PLATE_POISSON**2))
    return Pressing(curve=read_curve(folder / given.curve), plate_rigidity=rigidity)


def _support(i: int, given: _Support) -> EdgeSupport | PatchSupport:
    stiffness = {"along", "across", "rotation"}
    if (given.edge is None) == (given.patch_mm is None):
        raise StackError(f"supports[{i + 1}]: give either edge or patch_mm = [x, y, length, width]")
    on_edge = {"along": given.along_N_m2, "across": given.across_N_m2, "rotation": given.rotation_N}
    on_patch = {"along": given.along_N_m3, "across": given.across_N_m3}
    used, unused = (on_edge, on_patch) if given.edge is not None else (on_patch, on_edge)
    if given.condition != "elastic":
        if any(on_edge.values()) or any(on_patch.values()):
            raise StackError(
                f'supports[{i + 1}]: stiffness goes with condition = "elastic", not with {given.condition!r}'
            )
        held = stiffness if given.condition == "clamped" else stiffness - {"rotation"}
        used = {name: math.inf if name in held else 0.0 for name in used}
    elif any(value for name, value in unused.items() if name not in used or value != used[name]):
        raise StackError(
            f"supports[{i + 1}]: an edge takes along_N_m2, across_N_m2, rotation_N; a patch along_N_m3, across_N_m3"
        )
    if given.edge is not None:
        return EdgeSupport(edge=given.edge, laminas=given.laminas, **used)
    x, y, along, across = (value * 1e-3 for value in given.patch_mm or ())
    return PatchSupport(x=x, y=y, size=(along, across), laminas=given.laminas, **used)
