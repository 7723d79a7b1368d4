"""Parts that many effects are made of: masses, springs and dashpots at places, and changes of the pressure field."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp

from lamella_shared import Reals
from model.contact.contact import contact_fields
from model.elements.equations import Assembly, Formula, Kron, Monomial, Product, Target, Term, Theta
from model.elements.mesh import FIELDS, Derivative, Field
from model.elements.terms import footprint_points, height_shares
from model.stack.effect import PRESSURE_REFERENCE, Parameter
from model.stack.errors import EffectError
from model.stack.parts import Clamp, Instruments
from model.stack.stack import Stack

Bell = Callable[[Reals, Reals], Reals]
"""From x and y, m, to a share that is 1 in the middle of something and falls to 0 about it."""

N_STATION = 11
"""Stations of accelerometers along the stack where no test is known: with four edges the 44 points of the paper."""


def clamps_of(assembly: Assembly, effect: str) -> tuple[Clamp, ...]:
    """Return the stack's clamps.

    Raises
    ------
    EffectError
        It has none.
    """
    if not assembly.stack.clamps:
        raise EffectError(f"{effect}: the stack has no clamps; add [[clamps]] to its file, with mass_kg = 0 if need be")
    return assembly.stack.clamps


def known_or_usual_instruments(stack: Stack) -> Instruments:
    """Return the stack's instruments; where no test is known, those of the paper's test.

    By default there are 44 points on the four long edges, and the shaker under the corner at the highest x and y.
    """
    if stack.instruments is not None:
        return stack.instruments
    x = np.linspace(-0.5, 0.5, N_STATION) * stack.length
    edges = itertools.product(x, (-stack.width / 2.0, stack.width / 2.0), (-stack.height / 2.0, stack.height / 2.0))
    return Instruments(
        shaker=(stack.length / 2.0, stack.width / 2.0, -stack.height / 2.0), sensor=np.array(list(edges))
    )


def again(
    assembly: Assembly,
    base: str,
    name: str,
    change: Callable[[Theta], Any],
    *,
    target: Target | None = None,
    krons: tuple[Kron, ...] | None = None,
) -> Term:
    """Return a term of the base model once more, `change` times as large: together they are 1 + `change` times it.

    Parameters
    ----------
    assembly : Assembly
        Equations of motion without effects.
    base : str
        Name of the base model's term.
    name : str
        Name of the new term.
    change : callable
        From the parameters to the change, as in `Formula`.
    target : "M", "C" or "K", optional
        Matrix that it is part of; by default that of the base model's term.
    krons : tuple of Kron, optional
        What takes the place of the term's products, where only a part of them changes.
    """
    term = assembly.term(base)
    return Term(
        name=name,
        target=term.target if target is None else target,
        factor=Product(first=term.factor, second=Formula(change)),
        krons=term.krons if krons is None else krons,
    )


def every_lamina(stack: Stack) -> sp.csr_array:
    """Return the matrix over the laminas that gives each an equal share of one."""
    return sp.eye_array(stack.n_lamina, format="csr") / stack.n_lamina


def mean_lamina(stack: Stack) -> sp.csr_array:
    """Return the matrix over the laminas that takes the square of their mean.

    What is stiff over the height moves as the laminas do in the mean; a part of it on each would move with that one
    alone, and where it is heavy bring motions over the height that no such body has.
    """
    return sp.csr_array(np.full((stack.n_lamina, stack.n_lamina), 1.0 / stack.n_lamina**2))


def tie(stack: Stack) -> sp.csr_array:
    """Return the matrix over the laminas of a spring from the bottom to the top of the stack.

    It takes the mean strain over the height, which is what a stiff bar on either face feels; the faces' laminas
    alone would give way under it.
    """
    row = reach(stack)
    return sp.csr_array(row.T @ row)


def reach(stack: Stack) -> Reals:
    """Return the row over the laminas, (1, n_lamina), that takes the mean strain over the height times the height.

    One lamina has none: its row is 0.
    """
    if stack.n_lamina == 1:
        return np.zeros((1, 1))
    return np.asarray(stack.lamina_z / np.sum(stack.lamina_z**2) * np.ptp(stack.lamina_z))[None]


def mean_over(
    assembly: Assembly,
    field: Field,
    centre: tuple[float, float],
    size: tuple[float, float],
    slope: Derivative = "",
    *,
    tapered: bool = False,
) -> sp.csr_matrix:
    """Return the row that takes the mean of a field, or of its slope, over a rectangle of the plan.

    With `tapered` the rectangle counts less towards its ends along x, and there not at all: an edge within an element
    is what a heavy or stiff part converges slowly by.
    """
    points, weights = _weighted(assembly, centre, size, tapered=tapered)
    return sp.csr_matrix(weights @ assembly.plan.point_rows(field, points, slope))


def _weighted(
    assembly: Assembly, centre: tuple[float, float], size: tuple[float, float], *, tapered: bool
) -> tuple[Reals, Reals]:
    """Return points, (n, 2), of a rectangle of the plan and their weights, which sum to 1."""
    points, weights = footprint_points(centre, size, assembly.plan)
    if tapered:
        weights = weights * (1.0 - (2.0 * (points[:, 0] - centre[0]) / size[0]) ** 2)
        weights /= weights.sum()
    return points, weights


def turn_of(
    assembly: Assembly,
    centre: tuple[float, float],
    size: tuple[float, float],
    axis: Literal["x", "y"],
    *,
    tapered: bool = False,
) -> sp.csr_matrix:
    """Return the row that takes the slope along an axis of the plane that lies closest to w over a rectangle.

    A stiff bar on the rectangle turns by it; on one without length it is the slope there. The mean slope is the
    difference of w along two edges alone, and converges three times more slowly with the mesh.

    Parameters
    ----------
    assembly : Assembly
        Equations of motion without effects.
    centre, size : (float, float)
        The rectangle, m.
    axis : "x" or "y"
        Along which the slope is taken.
    tapered : bool
        As in `mean_over`.
    """
    points, weights = _weighted(assembly, centre, size, tapered=tapered)
    along = points[:, "xy".index(axis)]
    arm = along - weights @ along
    if np.ptp(arm) == 0.0:
        return mean_over(assembly, "w", centre, size, axis)
    return sp.csr_matrix((weights * arm / (weights @ arm**2)) @ assembly.plan.point_rows("w", points))


def shear_spring(
    assembly: Assembly,
    centre: tuple[float, float],
    size: tuple[float, float],
    axis: Literal["x", "y"],
    over_z: tuple[Any, Any],
    *,
    tapered: bool = False,
) -> tuple[Kron, ...]:
    """Return a spring of stiffness 1 against shear at a rectangle of the plan.

    Its elongations are slip times the mean of u (v along y) over the rectangle plus turned times its turn about y
    (x): without the turning of the laminas a stack that turns as a whole would stretch it.

    Parameters
    ----------
    assembly : Assembly
        Equations of motion without effects.
    centre, size : (float, float)
        The rectangle, m.
    axis : "x" or "y"
        Direction of the shear.
    over_z : (slip, turned)
        Matrices over the laminas, (n_spring, n_lamina) each.
    tapered : bool
        As in `mean_over`.
    """
    slip, turned = (sp.csr_array(matrix) for matrix in over_z)
    field: Field = "u" if axis == "x" else "v"
    along = mean_over(assembly, field, centre, size, tapered=tapered)
    slope = turn_of(assembly, centre, size, axis, tapered=tapered)
    return (
        square(field, along, slip.T @ slip),
        Kron(row=field, column="w", z=slip.T @ turned, planar=(along.T @ slope).tocsr()),
        square("w", slope, turned.T @ turned),
    )


def square(field: Field, row: sp.csr_matrix, z: sp.csr_array, strength: float = 1.0) -> Kron:
    """Return strength times the square of what a row takes of a field."""
    return Kron(row=field, column=field, z=strength * z, planar=(row.T @ row).tocsr())


def clamp_unit_mass(assembly: Assembly, clamp: Clamp) -> tuple[Kron, ...]:
    """Return a mass of 1 kg that moves with what a clamp presses, spread over the height as the clamp's own is."""
    z = sp.diags_array(height_shares(clamp, assembly.stack.n_lamina)).tocsr()
    place = (clamp.x, clamp.y)
    return tuple(square(field, mean_over(assembly, field, place, clamp.footprint), z) for field in FIELDS)


def rigid_clamp(assembly: Assembly, clamp: Clamp) -> tuple[Kron, ...]:
    """Return what a rigid mass of 1 kg moves as: the mean of what a clamp presses, and its rocking over the height.

    The part of `clamp_unit_mass` that is a rigid body's.
    """
    share = height_shares(clamp, assembly.stack.n_lamina)
    height = np.linspace(-0.5, 0.5, share.size)
    rocking = share * height / np.sqrt(share @ height**2) if share.size > 1 else None
    place = (clamp.x, clamp.y)
    rows = {field: mean_over(assembly, field, place, clamp.footprint) for field in FIELDS}
    krons = [square(field, row, sp.csr_array(np.outer(share, share))) for field, row in rows.items()]
    if rocking is not None:
        z = sp.csr_array(np.outer(rocking, rocking))
        krons += [square(field, rows[field], z) for field in ("u", "v")]
    return tuple(krons)


def clamp_bells(stack: Stack, clamp: Clamp) -> tuple[Bell, Bell]:
    """Return how the pressure of a clamp falls about it from 1 in its middle: as narrow and as wide as it may be.

    The narrow bell is as wide as the cone of 30 degrees in which pressure spreads down to half the height, the wide
    one as half the clamps' mean spacing: clamps are as stiff as that where they press evenly.
    """
    # Of the cone in which pressure spreads from what presses (Shigley, Mechanical Engineering Design, bolted joints)
    slope = math.tan(math.radians(30.0))
    cone = [0.5 * (side + slope * stack.height) / math.sqrt(3.0) for side in clamp.footprint]
    spaced = max(0.5 * stack.length / len(stack.clamps), *cone)

    def bell(x: Reals, y: Reals, width: Sequence[float]) -> Reals:
        away = ((x - clamp.x) / width[0]) ** 2 + ((y - clamp.y) / width[1]) ** 2
        return np.asarray(np.exp(-0.5 * away))

    return partial(bell, width=cone), partial(bell, width=(spaced, spaced))


def point_mass(assembly: Assembly, effect: str, parameter: str, points: Reals, share: float = 1.0) -> tuple[Term, ...]:
    """Return the term of masses at points (n, 2) of the plan, spread over the height, in all directions.

    Each point gets a `share` of the mass that the parameter states.
    """
    z = share * every_lamina(assembly.stack)
    krons = tuple(square(field, assembly.plan.point_rows(field, points), z) for field in FIELDS)
    return (Term(name=effect, target="M", factor=Monomial(exponent={parameter: 1}), krons=krons),)


def centred(weight: Reals, dx: Reals, corner: Reals) -> Reals:
    """Return a change of pressure that keeps the force: without mean, and -1 where pressure falls most.

    That may be at a `corner` of an element: by its values at the quadrature points alone, a loss at the ends would
    mean something else on every mesh.
    """
    mean = float(np.sum(weight * dx) / np.sum(dx))
    return np.asarray((weight - mean) / (mean - min(weight.min(), corner.min())))


def everywhere(t: Theta) -> Any:  # noqa: ARG001
    """Return 1: the whole of a change, wherever it acts."""
    return 1.0


Krons = Callable[[str], tuple[Kron, ...]]
"""From the axes of slip, "xy" or "y", to the products of a field of the contact."""


def contact_change(
    assembly: Assembly,
    name: str,
    change: Callable[[Theta], Any],
    stiffness: Krons,
    damping: tuple[Krons, Krons],
    share: Callable[[Theta], Any] = everywhere,
) -> tuple[Term, ...]:
    """Return the terms of tangential contact under a pressure p (1 + a f) in place of p, under every contact law.

    The modulus follows p**n with the exponent n of `pressure_exponent`, the product of modulus and d_f p that loses
    energy p**(n + 1), and along y the ratio of `contact_direction` multiplies both. The powers are taken as linear, and
    as quadratic, in f, right where f is 0 or -1.

    Parameters
    ----------
    assembly : Assembly
        Equations of motion without effects.
    name : str
        What the terms are called.
    change : callable
        From the parameters to the amplitude a.
    stiffness : callable
        The stiffness with the field f.
    damping : (callable, callable)
        The damping with f and with its square.
    share : callable
        From the parameters to the share of all this that acts, 0 to 1, of what may act at several locations.
    """
    parts = (
        ("tangential contact", f"{name} stiffness", _first, stiffness),
        ("tangential contact damping", f"{name} damping", _twice, damping[0]),
        ("tangential contact damping", f"{name} damping, squared", _squared, damping[1]),
    )
    return tuple(
        term
        for base, called, factor, krons in parts
        for term in under_laws(
            assembly, base, called, partial(_share_of, of=partial(factor, of=change), share=share), krons
        )
    )


def under_laws(
    assembly: Assembly, base: str, name: str, change: Callable[[Theta], Any], krons: Krons
) -> tuple[Term, ...]:
    """Return a part of the contact that changes, under the laws that change all of it: a power, a ratio along y."""
    terms = (again(assembly, base, name, partial(_under_power, of=change), krons=krons("xy")),)
    if "G_yz_ratio" not in assembly.stack.effect_values:
        return terms
    return (*terms, again(assembly, base, f"{name} along y", partial(_along_y, of=change), krons=krons("y")))


def _power(t: Theta) -> Any:
    return t.get("exponent", 1.0)


def contact_law(t: Theta) -> Any:
    """Return the factor of the contact's modulus by the power of `pressure_exponent`."""
    if "exponent" not in t:
        return 1.0
    return np.exp((t["exponent"] - 1.0) * np.log(t["pressure"] / PRESSURE_REFERENCE))


def _left(lost: Any, power: Any) -> Any:
    """Return what is left of a power of the pressure where a share of it is lost."""
    return (1.0 - lost) ** power


def _first(t: Theta, of: Callable[[Theta], Any]) -> Any:
    return 1.0 - _left(of(t), _power(t))


def _twice(t: Theta, of: Callable[[Theta], Any]) -> Any:
    return (_power(t) + 1.0) * of(t)


def _squared(t: Theta, of: Callable[[Theta], Any]) -> Any:
    return _left(of(t), _power(t) + 1.0) - 1.0 + (_power(t) + 1.0) * of(t)


def _under_power(t: Theta, of: Callable[[Theta], Any]) -> Any:
    return contact_law(t) * of(t)


def _along_y(t: Theta, of: Callable[[Theta], Any]) -> Any:
    return (t["G_yz_ratio"] - 1.0) * contact_law(t) * of(t)


def pressure_change(
    assembly: Assembly,
    effect: str,
    amplitude: str,
    shape: Callable[[Reals, Reals], Reals],
    share: Callable[[Theta], Any] = everywhere,
) -> tuple[Term, ...]:
    """Return the terms of a pressure p (1 + a f(x, y)) in place of p, with the amplitude a.

    The shear modulus and the damping of the contact change with it (see `contact_change`); the normal modulus stays.

    Parameters
    ----------
    assembly : Assembly
        Equations of motion without effects.
    effect : str
        Its name.
    amplitude : str
        Name of the parameter a.
    shape : callable
        From x and y, (n_element, n_point) m, to the change of pressure before `centred` keeps the clamping force.
    share : callable
        From the parameters to the share of the change that acts, 0 to 1, of one that may act at several locations.
    """
    plan = assembly.plan
    x, y = plan.quadrature_points
    f = centred(shape(x, y), np.asarray(plan.membrane.dx), shape(*plan.membrane.mesh.p))
    field = contact_fields(assembly.stack, plan)
    change = partial(_value, name=amplitude)
    tangential = contact_change(
        assembly,
        effect,
        change,
        partial(field["pressure"].tangential, f),
        (partial(field["pressure squared"].tangential, f), partial(field["pressure squared"].tangential, f**2)),
        share,
    )
    normal = partial(_share_of, of=change, share=share)
    mixed = field["pressure times normal"].normal(f)
    return (*tangential, again(assembly, "normal contact damping", f"{effect} normal damping", normal, krons=mixed))


@dataclass(frozen=True, kw_only=True)
class Size:
    """A size of a field that is known to some octaves: fields are interpolated on an even grid of these.

    What a joint has lost or gained has the shape of no formula. With a size that is free a bell comes near what falls
    in steps, whose other half a second effect would take else.

    Attributes
    ----------
    name : str
        Parameter that states it.
    usual : float
        Value where nothing better is known.
    octaves : (float, float)
        Logarithms to the base of 2 of the least and the greatest value over the usual one.
    n : int
        Sizes of the grid.
    """

    name: str
    usual: float
    octaves: tuple[float, float]
    n: int

    @property
    def fields(self) -> list[tuple[float, Callable[[Theta], Any]]]:
        """The sizes of the grid, and the share that each has in the field."""
        grid = np.linspace(*self.octaves, self.n)
        share = partial(_of_size, name=self.name, usual=self.usual, octaves=self.octaves, n=self.n)
        return [(self.usual * 2.0**octave, partial(share, i=i)) for i, octave in enumerate(grid.tolist())]

    def parameter(self, source: str, n_start: int = 3) -> Parameter:
        """Return the parameter, a plain number."""
        least, greatest = (self.usual * 2.0**octave for octave in self.octaves)
        return Parameter(
            name=self.name,
            unit="1",
            nominal=self.usual,
            lower=least,
            upper=greatest,
            neutral=self.usual,
            scale="log",
            source=source,
            n_start=n_start,
        )


def _of_size(t: Theta, name: str, usual: float, octaves: tuple[float, float], n: int, i: int) -> Any:
    return _interpolated(np.log2(t[name] / usual), n, *octaves)[i]


def _value(t: Theta, name: str) -> Any:
    return t[name]


def _share_of(t: Theta, of: Callable[[Theta], Any], share: Callable[[Theta], Any]) -> Any:
    return of(t) * share(t)


@lru_cache(maxsize=128)
def _interpolated(position: complex, n: int, first: float, last: float) -> tuple[Any, ...]:
    """Return shares as `shared_among` has them, but at a place of the grid 1 of that place and 0 of the others."""
    at_places = [shared_among(place, n, first, last) for place in np.linspace(first, last, n).tolist()]
    return tuple(np.array(shared_among(position, n, first, last)) @ np.linalg.inv(at_places))


@lru_cache(maxsize=128)
def shared_among(position: complex, n: int, first: float = 0.0, last: float = 1.0) -> tuple[Any, ...]:
    """Return the shares of what is at a position that each of n places on an even grid has, real or complex.

    They are quadratic B-splines (de Boor, A Practical Guide to Splines, 1978, chapter IX): they sum to 1, neither they
    nor their slopes jump, and whatever the position, they spread it alike, with a variance of a quarter of the square
    of the spacing. What would be shared beyond an end is at the end. Many terms of an effect ask for the same shares.
    """
    h = (last - first) / (n - 1)
    i = min(max(round(float((np.real(position) - first) / h)), 0), n - 1)
    u = (position - first) / h - i
    shares: list[Any] = [0.0] * n
    for place, share in ((i - 1, (0.5 - u) ** 2 / 2.0), (i, 0.75 - u**2), (i + 1, (0.5 + u) ** 2 / 2.0)):
        shares[min(max(place, 0), n - 1)] += share
    return tuple(shares)
