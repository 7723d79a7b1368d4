"""Whether an effect is what the equations of motion need: the conformance check of the catalogue and of users' effects.

Every check is made on a small stack, `CLAMPED`, or `HELD` for effects that need a support, at several strengths and two
pressures.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import re
from collections.abc import Iterator, Sequence

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from model.effects.catalogue import catalogue
from model.elements.equations import OMEGA, Assembly, Riding, Target, Term
from model.elements.mesh import FIELDS
from model.elements.terms import rigid_body_modes
from model.modes.modes import Modes, Observation, observe, solve_modes
from model.reduction.reduction import assemble, reduce
from model.stack.effect import OMEGA_REFERENCE, Effect, Parameter
from model.stack.errors import EffectError
from model.stack.parts import Clamp, Contact, EdgeSupport, Material, Mesh
from model.stack.stack import Stack

SECTIONS = ("Enters:", "Range:", "Does:", "Mistaken for:")
"""Paragraphs that an effect's description has."""

CLAMPED = Stack(
    name="check",
    length=0.4,
    width=0.06,
    height=0.06,
    n_lamina=4,
    material=Material(young=200e9, poisson=0.28, density=7650.0),
    contact=Contact(G_f=1500.0, d_f=1.5e-11, pressure=160e3, normal_modulus=1e9),
    clamps=tuple(Clamp(mass=1.5, x=x, y=0.0, footprint=(0.04, 0.05)) for x in (-0.1, 0.1)),
    mesh=Mesh(n_x=4, n_y=2),
)
"""Four thick laminas with two clamps."""
HELD = dataclasses.replace(CLAMPED, supports=(EdgeSupport(edge="left", across=np.inf, rotation=np.inf),))
"""The same, held at one end."""

_PRESSURES = (160e3, 320e3)
# Of the range: where derivatives are compared, off round numbers, where laws may have kinks
_INSIDE = (0.37, 0.81)
_STEP = 1e-4  # of a parameter's range, of differences
_FIVE_POINT = {-2: 1.0 / 12.0, -1: -8.0 / 12.0, 1: 8.0 / 12.0, 2: -1.0 / 12.0}

_LABEL = re.compile(r"[^\WA-Z_][^\n]*[^\s.]")  # begins in lower case, one line, no full stop

_TARGETS: tuple[Target, ...] = ("M", "C", "K")


def effect_faults(effect: Effect) -> tuple[str, ...]:
    """Check an effect and return what is wrong with it, one sentence each; empty if nothing is.

    Checked are: a label that no other effect of the catalogue has, and a description with its four sections; terms
    that the equations can take; matrices that are symmetric; at the neutral value exactly the base model; a
    difference at the bounds; positive mass and no negative stiffness or damping, in total, at all combinations of
    bounds and nominal values; no force on rigid-body motion unless the effect is grounded, and one if it is;
    dependence on frequency as stated; derivatives of factors, and gradients of the modes' frequencies and damping
    ratios, equal to finite differences.
    """
    found = list(_text_faults(effect))
    try:
        base, assembly = _assembled(effect)
        structure = list(_structure(effect, base, assembly))
        if structure:  # the matrices cannot be formed
            return (*found, *structure)
        for check in (_neutral, _symmetry, _definiteness, _rigid, _frequency, _derivatives):
            found += check(effect, base, assembly)
        if not found:
            found += _gradients(effect, base.stack)
    except Exception as error:  # what a user's own terms raise
        found.append(f"its terms cannot be evaluated: {type(error).__name__}: {error}")
    return tuple(found)


def _assembled(effect: Effect) -> tuple[Assembly, Assembly]:
    """Return the equations of motion of a stack that suits the effect, without and with it."""
    try:
        return _base(CLAMPED), assemble(CLAMPED.with_effects(effect))
    except EffectError:
        return _base(HELD), assemble(HELD.with_effects(effect))


@functools.cache
def _base(stack: Stack) -> Assembly:
    return assemble(stack)


@functools.cache
def _reference(base: Assembly, pressure: float) -> tuple[sp.csr_matrix, dict[Target, float]]:
    """Return the mass matrix and, in units of it, how negative M, C and K may be for rounding."""
    negative = 1e-4  # of the first elastic mode's: stiffness or damping below minus this is negative
    mass = _base_matrix(base, "M", pressure)
    stiffness = _base_matrix(base, "K", pressure)
    values, vectors = la.eigh(stiffness.toarray(), mass.toarray(), subset_by_index=[0, 6])
    damping = float(vectors[:, 6] @ _base_matrix(base, "C", pressure) @ vectors[:, 6])
    return mass, {"M": 0.0, "C": negative * damping, "K": negative * float(values[6])}


def _text_faults(effect: Effect) -> Iterator[str]:
    longest_label = 60
    label = effect.label
    if not _LABEL.fullmatch(label) or len(label) > longest_label or label == effect.name:
        yield (
            f"its label must be a noun phrase in lower case of at most {longest_label} characters, such as 'clamp "
            f"rotary inertia', got {label!r}"
        )
    alike = [other.name for other in catalogue().values() if other.label == label and other.name != effect.name]
    if alike:
        yield f"its label {label!r} is that of {alike[0]} too; say what sets it apart"
    if not effect.summary.strip() or "\n" in effect.summary:
        yield "its summary must be one line"
    for section in SECTIONS:
        paragraphs = [p.split() for p in effect.description.split("\n") if p.startswith(section)]
        if not any(len(words) > len(section.split()) for words in paragraphs):
            yield f"its description lacks a paragraph that begins with {section!r}"


def _structure(effect: Effect, base: Assembly, assembly: Assembly) -> Iterator[str]:
    sizes = {field: base.plan.size(field) for field in FIELDS}
    taken = [p.name for p in effect.parameters if p.name in (*base.theta, OMEGA)]
    if taken:
        yield f"its parameter {taken[0]} has the name of a parameter of the base model"
    names = [term.name for term in assembly.terms]
    for term in _own(assembly, base):
        if names.count(term.name) > 1:
            yield f"two terms have the name {term.name!r}"
        if term.target not in _TARGETS:
            yield f"term {term.name!r}: target must be M, C or K, got {term.target!r}"
        for kron in term.krons:
            expected = (base.stack.n_lamina,) * 2, (sizes[kron.row], sizes[kron.column])
            if (kron.z.shape, kron.planar.shape) != expected:
                yield (
                    f"term {term.name!r}: z and planar of {kron.row}, {kron.column} must be of shapes {expected[0]} "
                    f"and {expected[1]}, got {kron.z.shape} and {kron.planar.shape}"
                )
    if not _own(assembly, base):
        yield "it adds no term"


def _neutral(effect: Effect, base: Assembly, assembly: Assembly) -> Iterator[str]:
    neutral = {p.name: p.neutral for p in effect.parameters}
    changed = False
    for pressure, target in itertools.product(_PRESSURES, _TARGETS):
        theta = {**assembly.theta, "pressure": pressure, "young": 1.02, "density": 0.98}
        if abs(_added(base, assembly, target, {**theta, **neutral})).max() > 0.0:
            yield f"at its neutral value the matrix {target} is not the base model's"
        changed = changed or any(
            abs(_added(base, assembly, target, {**theta, **strong})).max() > 0.0 for strong in _corners(effect)
        )
    if not changed:
        yield "it changes nothing at any strength"


def _symmetry(_: Effect, base: Assembly, assembly: Assembly) -> Iterator[str]:
    symmetric = 1e-12
    for term in _own(assembly, base):
        total = _sum(assembly, term)
        if not np.all(np.isfinite(total.data)):
            yield f"term {term.name!r}: its matrix is not finite"
        elif abs(total - total.T).max() > symmetric * abs(total).max():
            yield f"term {term.name!r}: its matrix is not symmetric"


def _definiteness(effect: Effect, base: Assembly, assembly: Assembly) -> Iterator[str]:
    words = {"M": "not positive", "C": "negative for some motion", "K": "negative for some motion"}
    targets = dict.fromkeys(term.target for term in _own(assembly, base))
    # What rides on a spring has a negative apparent mass above its resonance, as it must.
    steady = tuple(term for term in assembly.terms if not isinstance(term.factor, Riding))
    assembly = dataclasses.replace(assembly, terms=steady)
    for pressure in _PRESSURES:
        mass, allowed = _reference(base, pressure)
        positive = dict[tuple[Target, tuple[float, ...]], bool]()  # of factors, which corners may share
        for strong, target in itertools.product(_corners(effect), targets):
            theta = {**assembly.theta, "pressure": pressure, **strong}
            key = target, tuple(t.factor(theta) for t in _own(assembly, base) if t.target == target)
            if key not in positive:
                matrix = _base_matrix(base, target, pressure) + _added(base, assembly, target, theta)
                positive[key] = _is_positive(matrix + allowed[target] * mass)
            if not positive[key]:
                at = ", ".join(f"{name} = {value:g}" for name, value in strong.items())
                yield f"at {at} and {pressure / 1e3:g} kPa the matrix {target} is {words[target]}"


def _rigid(effect: Effect, base: Assembly, assembly: Assembly) -> Iterator[str]:
    least_force = 1e-9  # of the forces that cancel: above it rigid-body motion meets a force
    rigid = rigid_body_modes(assembly, base.stack, dict.fromkeys(FIELDS, np.eye(base.stack.n_lamina)))
    meets = False
    for term in _own(assembly, base):
        if term.target != "M":
            matrix = _sum(assembly, term)
            force = np.abs(matrix @ rigid).max(axis=0)
            cancelling = (abs(matrix) @ np.abs(rigid)).max(axis=0)
            turned = np.flatnonzero(force > least_force * cancelling)
            meets |= turned.size > 0
            if turned.size and not effect.grounded:
                motion = ("moving along x", "moving along y", "moving along z",
                          "turning about x", "turning about y", "turning about z")[turned[0]]  # fmt: skip
                yield f"term {term.name!r}: the whole stack {motion} meets a force, but the effect is not grounded"
    if effect.grounded and not meets:
        yield "it is said to be grounded, but no rigid-body motion meets a force"


def _frequency(effect: Effect, base: Assembly, assembly: Assembly) -> Iterator[str]:
    depends, alone = False, set[str]()
    for theta in _inside(effect, assembly):
        there = {OMEGA: OMEGA_REFERENCE, **theta}
        for term in _own(assembly, base):
            moves = term.factor(there) != term.factor({**there, OMEGA: 1.3 * OMEGA_REFERENCE})
            depends |= moves
            alone |= {term.name} if moves and term.target == "M" and not isinstance(term.factor, Riding) else set()
    for name in sorted(alone):
        yield f"term {name!r}: a mass that depends on frequency is one on a spring, whose factor is a Riding"
    if depends != effect.frequency_dependent:
        yield f"frequency_dependent is {effect.frequency_dependent}, but its factors say {depends}"


def _derivatives(effect: Effect, base: Assembly, assembly: Assembly) -> Iterator[str]:
    factor_error = 1e-5
    of = {p.name: p for p in effect.parameters}
    for theta, term in itertools.product(_inside(effect, assembly), _own(assembly, base)):
        for name, value in theta.items():
            span = _span(of[name], value) if name in of else value
            step = _STEP * span
            at = {k: term.factor({**theta, name: value + k * step}) for k in _FIVE_POINT}
            difference = sum(weight * at[k] for k, weight in _FIVE_POINT.items()) / step
            size = max(abs(difference), abs(term.factor(theta)) / abs(span))
            if not abs(term.factor.derivative(theta, name) - difference) <= factor_error * size:
                yield (
                    f"term {term.name!r}: the derivative of its factor by {name} is "
                    f"{term.factor.derivative(theta, name):.6g}, finite differences say {difference:.6g}"
                )
                return


def _gradients(effect: Effect, stack: Stack) -> Iterator[str]:
    """Compare gradients of frequencies and damping ratios by each parameter with differences."""
    central = {-1: -0.5, 1: 0.5}
    n_mode = 12
    tiny = 1e-6  # of the largest damping ratio: motion without contact has hardly any
    gradient_error = 1e-4  # of the range's effect on the frequency; differences keep some six digits
    # Of five-point ones: stiff supports' rounding spoils narrow differences, kinks wide ones
    wide_step = 1e-3
    system = reduce(stack.with_effects(effect), n_snapshot=1, n_mode=n_mode, z_tolerance=1e-2)
    somewhere = Observation(node=np.zeros(1, int), location=np.zeros((1, 3)), direction=np.array([[0.0, 0.0, 1.0]]))
    observed = observe(system, somewhere)

    def modes(values: dict[str, float], by: Sequence[str] = ()) -> Modes:
        return solve_modes(
            system, G_f=stack.contact.G_f, d_f=stack.contact.d_f, n_mode=n_mode, observation=observed,
            parameters=values, by=by,
        ).elastic()  # fmt: skip

    for share in _INSIDE:
        values = {p.name: _between(p, share) for p in effect.parameters}
        found = modes(values, [p.name for p in effect.parameters])
        columns = [found.parameter.index(p.name) for p in effect.parameters]
        at = np.array([found.frequency, found.damping])
        gradient = np.array([found.frequency_gradient, found.damping_gradient])[:, :, columns]
        for j, parameter in enumerate(effect.parameters):
            value, span = values[parameter.name], _span(parameter, values[parameter.name])
            for step, weights in ((_STEP, central), (wide_step, _FIVE_POINT)):
                near = [modes({**values, parameter.name: value + n * step * span}) for n in weights]
                moved = [[one.frequency, one.damping] for one in near]
                slope = np.tensordot(np.array(list(weights.values())) / step, moved, axes=1)
                error = np.abs(span * gradient[:, :, j] - slope)
                sizes = at + tiny * at.max(axis=1, keepdims=True) + np.abs(slope).max(axis=1, keepdims=True)
                limit = gradient_error * sizes
                if np.all(error <= limit):
                    break
            if np.any(error > limit):
                quantity, r = np.argwhere(error > limit)[0]
                yield (
                    f"the gradient of {('the frequency', 'the damping ratio')[quantity]} of elastic mode {r + 1} by "
                    f"{parameter.name} is {gradient[quantity, r, j]:.6g}, finite differences say "
                    f"{slope[quantity, r] / span:.6g}"
                )
                return


@functools.cache
def _base_matrix(base: Assembly, target: Target, pressure: float) -> sp.csr_matrix:
    """Return a matrix of the base model at its nominal values and a pressure, (size, size)."""
    return base.matrix(target, {**base.theta, "pressure": pressure})


@functools.lru_cache(maxsize=32)  # of the terms of one effect: all strengths share them
def _sum(assembly: Assembly, term: Term) -> sp.csr_matrix:
    """Return the matrix of a term at factor 1, (size, size)."""
    return assembly.sparse_sum(term.krons)


def _added(base: Assembly, assembly: Assembly, target: Target, theta: dict[str, float]) -> sp.csr_matrix:
    """Return what the terms of the effect add to a matrix, (size, size)."""
    added = sp.csr_matrix((assembly.size, assembly.size))
    for term in _own(assembly, base):
        factor = term.factor(theta) if term.target == target else 0.0
        if factor != 0.0:
            added = added + factor * _sum(assembly, term)
    return added


def _own(assembly: Assembly, base: Assembly) -> tuple[Term, ...]:
    return assembly.terms[len(base.terms) :]


def _corners(effect: Effect) -> list[dict[str, float]]:
    """Return all combinations of bounds and nominal values."""
    return list(effect.combinations(lambda p: (p.lower, p.nominal, p.upper)))


def _inside(effect: Effect, assembly: Assembly) -> list[dict[str, float]]:
    """Return all parameters, the effect's inside of their ranges and the pressure off the reference."""
    return [
        {**assembly.theta, "pressure": 1.3 * _PRESSURES[0], **{p.name: _between(p, share) for p in effect.parameters}}
        for share in _INSIDE
    ]


def _between(p: Parameter, share: float) -> float:
    """Return the value at a share of a parameter's range, by its scale."""
    if p.scale == "log":
        return float(p.lower * (p.upper / p.lower) ** share)
    return p.lower + share * (p.upper - p.lower)


def _span(p: Parameter, value: float) -> float:
    """Return the range of a parameter, by its scale: that of the logarithm, times the value."""
    return float(value * np.log(p.upper / p.lower)) if p.scale == "log" else p.upper - p.lower


def _is_positive(matrix: sp.csr_matrix) -> bool:
    """Tell whether the symmetric part of a matrix is finite and positive definite."""
    if not np.all(np.isfinite(matrix.data)):
        return False
    dense = ((matrix + matrix.T) / 2.0).toarray(order="F")
    _, failed = la.lapack.dpotrf(dense, clean=False, overwrite_a=True)  # in place: `cholesky` copies it twice
    return bool(failed == 0)
