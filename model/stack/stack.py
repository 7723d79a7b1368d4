"""The laminated stack: its size, sheets and parts, as plain values in SI units.

Coordinates have their origin at the centre of the stack: x along the length, y along the width, z along the
height, in which the laminas are stacked.
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lamella_shared import Reals, Shown
from model.stack.effect import Effect, shared_parameters
from model.stack.errors import EffectError, StackError
from model.stack.outline import Outline, Triangulation
from model.stack.parts import (
    NO_CONTACT,
    Clamp,
    Contact,
    EdgeSupport,
    Instruments,
    Interlayer,
    Material,
    Mesh,
    PatchSupport,
    Pressing,
    PressureDistribution,
    require_positive,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Stack(Shown):
    """A laminated stack.

    Attributes
    ----------
    name : str
        What the stack is called in tables and reports.
    length, width, height : float
        Outer size along x, y and z, m.
    n_lamina : int
        Number of laminas.
    outline : Outline, Triangulation or None
        Shape of the laminas in a bounding box of `length` by `width` around the origin; None is a rectangle.
    material : Material
        The sheets.
    contact : Contact
        What joins them; one lamina needs none.
    clamps : tuple of Clamp
        Masses that ride on the stack.
    mesh : Mesh
        Mesh of one lamina.
    interlayers : tuple of Interlayer
        Soft layers between laminas; `height` includes them.
    pressing : Pressing, PressureDistribution or None
        What makes the pressure uneven: how the clamps press, or the field itself. None is uniform pressure.
    supports : tuple of EdgeSupport or PatchSupport
        What holds it to the ground; without any it floats.
    effects : tuple of Effect
        Physical effects beyond the base model; `with_effects` adds them.
    effect_values : mapping of str to float
        Values of the effects' parameters.
    instruments : Instruments or None
        Where the test's instruments touch it; None where no test is known.
    """

    name: str
    length: float
    width: float
    height: float
    n_lamina: int
    material: Material
    contact: Contact = NO_CONTACT
    clamps: tuple[Clamp, ...] = ()
    mesh: Mesh = dataclasses.field(default_factory=Mesh)
    interlayers: tuple[Interlayer, ...] = ()
    pressing: Pressing | PressureDistribution | None = None
    supports: tuple[EdgeSupport | PatchSupport, ...] = ()
    outline: Outline | Triangulation | None = None
    effects: tuple[Effect, ...] = ()
    effect_values: Mapping[str, float] = dataclasses.field(default_factory=dict)
    instruments: Instruments | None = None

    def __post_init__(self) -> None:
        require_positive("stack", self, "length", "width", "height", "n_lamina")
        _check_contact(self)
        _check_outline(self)
        _check_interlayers(self)
        _check_pressure(self)
        _check_pitch(self)
        _check_clamps(self)

    @property
    def pitch(self) -> float:
        """Distance of the mid-planes of laminas that touch, m: the height that the laminas share."""
        return (self.height - sum(layer.thickness for layer in self.interlayers)) / self.n_lamina

    @property
    def spacing(self) -> Reals:
        """Distance of neighbouring lamina mid-planes, (n_lamina - 1,) m, the lowest one first."""
        spacing = np.full(self.n_lamina - 1, self.pitch)
        for layer in self.interlayers:
            spacing[layer.below - 1] += layer.thickness
        return spacing

    @property
    def touching(self) -> Reals:
        """1 where neighbouring laminas touch, 0 where a soft layer parts them, (n_lamina - 1,)."""
        parted = np.isin(np.arange(1, self.n_lamina), [layer.below for layer in self.interlayers])
        return np.where(parted, 0.0, 1.0)

    @property
    def lamina_z(self) -> Reals:
        """Heights of the lamina mid-planes, (n_lamina,) m, the bottom one first."""
        bottom = (self.pitch - self.height) / 2.0
        return np.asarray(bottom + np.concatenate([[0.0], np.cumsum(self.spacing)]), dtype=np.float64)

    @property
    def area(self) -> float:
        """Area of the plan, m2."""
        return self.length * self.width if self.outline is None else self.outline.area

    @property
    def mass(self) -> float:
        """Mass of sheets, layers and clamps together, kg."""
        per_area = self.material.density * self.pitch * self.n_lamina
        per_area += sum(layer.density * layer.thickness for layer in self.interlayers)
        return self.area * per_area + sum(clamp.mass for clamp in self.clamps)

    def with_contact(self, **values: float) -> Stack:
        """Return the stack with some of `G_f`, `d_f`, `pressure`, `normal_modulus` replaced."""
        return dataclasses.replace(self, contact=dataclasses.replace(self.contact, **values))

    def with_effects(self, *effects: Effect, **values: float) -> Stack:
        """Return the stack with further effects, and with values of effects' parameters.

        Parameters
        ----------
        *effects : Effect
            Such as those of `model.find_effects`. One that the stack has already stays once.
        **values : float
            Values by parameter name. Those of a new effect that are not given are neutral: it changes
            nothing until it is fitted or given a strength.

        Raises
        ------
        EffectError
            An effect or parameter is unknown, or effects disagree about a shared parameter.
        """
        for effect in effects:
            if not isinstance(effect, Effect):
                raise EffectError(f"with_effects: {effect!r} is no effect; give *model.find_effects([{effect!r}])")
        chosen = {effect.name: effect for effect in (*self.effects, *effects)}
        parameters = shared_parameters(chosen.values())
        for name in values:
            if name not in parameters:
                close = difflib.get_close_matches(name, parameters, n=1)
                there = ", ".join(parameters) or "none"
                hint = f"did you mean {close[0]}?" if close else f"there are {there}"
                raise EffectError(f"no effect of the stack has a parameter {name!r}; {hint}")
        neutral = {name: parameter.neutral for name, parameter in parameters.items()}
        return dataclasses.replace(
            self, effects=tuple(chosen.values()), effect_values={**neutral, **self.effect_values, **values}
        )


def _check_contact(stack: Stack) -> None:
    if stack.n_lamina > 1 and stack.contact is NO_CONTACT:
        raise StackError(f"stack: contact is missing; {stack.n_lamina} laminas need it")
    if stack.n_lamina == 1 and stack.pressing is not None:
        raise StackError("pressing: one lamina has no other that it could be pressed against")


def _check_outline(stack: Stack) -> None:
    if stack.outline is not None:
        box = np.array([stack.length, stack.width])[:, None] * [-0.5, 0.5]
        if np.abs(stack.outline.bounds - box).max() > 1e-6 * stack.length:
            (x0, x1), (y0, y1) = stack.outline.bounds
            raise StackError(
                f"stack: its outline reaches from {x0:g} to {x1:g} m along x and {y0:g} to {y1:g} m along y; "
                f"it must fill a box of {stack.length:g} by {stack.width:g} m around the origin"
            )


def _check_interlayers(stack: Stack) -> None:
    places = [layer.below for layer in stack.interlayers]
    for i, below in enumerate(places):
        if not below < stack.n_lamina or below in places[:i]:
            raise StackError(
                f"interlayers[{i + 1}]: below = {below}; each place between two laminas, from 1 to "
                f"{stack.n_lamina - 1}, can hold one layer"
            )


def _check_pressure(stack: Stack) -> None:
    if not (stack.pressing is None or isinstance(stack.pressing, Pressing)):
        mean = stack.pressing.mean
        if abs(mean - stack.contact.pressure) > 1e-6 * mean:
            raise StackError(
                f"stack: its pressure field has a mean of {mean / 1e3:.6g} kPa, its contact a pressure of "
                f"{stack.contact.pressure / 1e3:.6g} kPa; press the stack anew at that pressure"
            )


def _check_pitch(stack: Stack) -> None:
    thinnest = 1e-6  # m; a lamina that is thinner is a slip, and as many of them would fill the memory
    if stack.pitch <= 0.0:
        raise StackError(f"stack: height {stack.height:g} m leaves no room for laminas between the interlayers")
    if stack.pitch < thinnest:
        raise StackError(
            f"stack: n_lamina = {stack.n_lamina} in a height of {stack.height:g} m makes laminas {stack.pitch:.2g} m "
            "thick; electrical steel has 1e-4 to 1e-3 m"
        )


def _check_clamps(stack: Stack) -> None:
    for i, clamp in enumerate(stack.clamps):
        for axis, position, size in (("x", clamp.x, stack.length), ("y", clamp.y, stack.width)):
            if abs(position) > size / 2.0:
                raise StackError(
                    f"clamps[{i + 1}]: {axis} = {position:g} m lies outside the stack, which reaches from "
                    f"{-size / 2:g} to {size / 2:g} m"
                )
