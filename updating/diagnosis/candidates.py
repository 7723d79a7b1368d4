"""The reduced model of a stack with all effects that it can have: what every explanation is computed with."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.types.modal_model import ModalModel
from model import (
    Assembly,
    Effect,
    EffectError,
    Instruments,
    ReducedEquations,
    ReducedSystem,
    Stack,
    assemble,
    reduce,
    reduced_terms,
)
from updating.diagnosis.rig import clamp_places
from updating.errors import PairingError
from updating.workers.workers import distribute

_LOG = logging.getLogger(__name__)

G_F_RANGE = (300.0, 6000.0)
"""Contact stiffness parameters, Pa/Pa, for which the model is reduced: three times beyond Table 6 of the paper."""
N_SNAPSHOT = 4
N_MODEL = 20
"""Modes, rigid-body modes included, that the reduced model is made for."""
MESSAGES = 8
"""In which work is sent to other processes: each holds a model, some 40 MB."""
DIMENSIONS = ("length", "width", "height")
_RESIZED = 1e-6  # relative change of a dimension from which its influence is taken
_FINER = 5 / 3  # elements along each side of the finer mesh; with fewer, some stay as long
_ORDER = 3  # of the error of frequencies in the size of the elements, as 12 x 3 to 48 x 12 show it
EXTRAPOLATED = 1.0 / (1.0 - _FINER**-_ORDER)
"""What the whole error of a mesh is of what the finer one takes away (Richardson 1911)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CandidateModel:
    """The reduced model of a stack with all effects that it can have.

    Attributes
    ----------
    stack : Stack
        Without effects.
    system : ReducedSystem
        With all of them, neutral.
    effects : mapping of str to Effect
        Those that this stack can have.
    impossible : mapping of str to str
        Why the others cannot be.
    resized : mapping of str to ReducedEquations
        The stack without effects with one dimension changed, in the basis of `system`.
    finer : ReducedSystem, optional
        The stack without effects on a finer mesh; none where an outline decides the mesh.
    places : tuple of str
        Parameters of `system` that say how far parts of the rig are from where the files have them, m.
    """

    stack: Stack
    system: ReducedSystem
    effects: Mapping[str, Effect]
    impossible: Mapping[str, str]
    resized: Mapping[str, ReducedEquations]
    finer: ReducedSystem | None
    places: tuple[str, ...]


def candidate_model(
    stack: Stack,
    instruments: Instruments,
    effects: Mapping[str, Effect],
    aids: Sequence[Effect] = (),
    executor: Executor | None = None,
) -> CandidateModel:
    """Reduce the model of a stack so that it holds for all effects that the stack can have.

    Parameters
    ----------
    stack : Stack
        Of the stack file.
    instruments : Instruments
        Where the test's instruments touch it.
    effects : mapping of str to Effect
        What to consider.
    aids : sequence of Effect
        What further tests could do to the stack; the reduction holds for them too.
    executor : Executor, optional
        What reduces the stack on a finer mesh while this process reduces it with all effects.
    """
    _LOG.info("reduce the model with %d effects", len(effects))
    base = replace(stack, instruments=instruments)
    small = assemble(replace(base, mesh=replace(base.mesh, n_x=2, n_y=1)))
    possible, impossible = {}, {}
    for name, effect in effects.items():
        reason = _why_not(effect, small)
        if reason is None:
            possible[name] = effect
        else:
            impossible[name] = reason
    finer = distribute(_plain, _finer(base), executor)  # begins at once where there is an executor
    placed = clamp_places(base)
    system = reduce(
        base.with_effects(*possible.values(), *aids, *placed),
        G_f_range=G_F_RANGE,
        n_snapshot=N_SNAPSHOT,
        n_mode=N_MODEL,
        local=[effect for effect in possible.values() if effect.n_sampled],
    ).ranged()
    return CandidateModel(
        stack=base,
        system=system,
        effects=possible,
        impossible=impossible,
        resized=_resized(base, system),
        finer=next(finer, None),
        places=tuple(effect.name for effect in placed),
    )


def _why_not(effect: Effect, small: Assembly) -> str | None:
    """Return why a stack cannot have an effect, `small` being its equations on a coarse mesh; None where it can."""
    try:
        terms = effect.terms(small)
    except EffectError as error:
        return str(error)
    acting = {
        term.target
        for term in terms
        for kron in term.krons
        if abs(kron.z).max() > 0.0 and abs(kron.planar).max() > 0.0
    }
    single = small.stack.n_lamina == 1
    if not acting:
        why = "one lamina has no contact with another" if single else "nothing of this stack changes with it"
        return f"{effect.name}: {why}"
    if single and acting == {"C"}:
        return f"{effect.name}: damping is not compared, for the model of one lamina has no loss of its own"
    return None


def _resized(base: Stack, system: ReducedSystem) -> dict[str, ReducedEquations]:
    """Return the equations of a stack with one dimension changed by `_RESIZED`, by the name of each that may change.

    They are in its own basis, stretched with it: modes differ little, and a Rayleigh quotient by their square.
    """
    by_dimension = {}
    for name in DIMENSIONS if base.outline is None else ("height",):
        for change in (_RESIZED, -_RESIZED):  # smaller where a larger one has more elements
            stack = replace(base, **{name: (1.0 + change) * getattr(base, name)})
            assembly = assemble(stack).project_z(system.phi)
            if assembly.size == system.assembly.size:
                break
        by_dimension[name] = ReducedEquations(
            stack=assembly.stack,
            terms=reduced_terms(assembly, _stretch(system, name, assembly)[:, None] * system.basis),
            theta=assembly.theta,
            ranges=system.ranges,
        )
    return by_dimension


def _stretch(system: ReducedSystem, name: str, resized: Assembly) -> NDArray[np.float64]:
    """Return what degrees of freedom are multiplied by where a mode is stretched with a dimension, (assembly.size,).

    The deflection stays; slopes along the dimension fall as it grows, and in-plane displacements with them, so that
    hardly any stiffness is called on that the mode spares.
    """
    ratio = getattr(resized.stack, name) / getattr(system.stack, name)
    factor = np.ones(system.assembly.size)
    where, plan = system.assembly.slices(), system.assembly.plan
    if name == "height":
        factor[where["u"]] = factor[where["v"]] = ratio
        return factor
    axis = "x" if name == "length" else "y"
    factor[where["u" if axis == "x" else "v"]] = 1.0 / ratio
    deflection = np.ones(plan.size("w"))
    for dof_name, dofs in zip(plan.plate.elem.dofnames, plan.plate.nodal_dofs, strict=True):
        if axis in dof_name:
            deflection[dofs] = 1.0 / ratio
    factor[where["w"]] = np.tile(deflection, system.assembly.n_z["w"])
    return factor


def _finer(base: Stack) -> tuple[Stack, ...]:
    """Return a stack with a finer mesh; none where an outline decides the mesh."""
    if base.outline is not None:
        return ()
    mesh = replace(base.mesh, n_x=round(_FINER * base.mesh.n_x), n_y=round(_FINER * base.mesh.n_y))
    return (replace(base, mesh=mesh),)


def _plain(stack: Stack) -> ReducedSystem:
    """Reduce a stack without effects."""
    return reduce(stack, G_f_range=G_F_RANGE, n_snapshot=N_SNAPSHOT, n_mode=N_MODEL)


def instruments_of(modes: ModalModel) -> Instruments:
    """Return where the instruments of a test touched the stack; the sensors' points are known to be listed."""
    place = {int(n): i for i, n in enumerate(modes.geometry.node)}
    if int(modes.input.node[0]) not in place:
        raise PairingError(
            f"{modes.name}: point {int(modes.input.node[0])} of the force has no coordinates, which a diagnosis needs "
            "to place what hangs on the shaker. Add it to the points file."
        )
    x, y, z = modes.geometry.coordinate[place[int(modes.input.node[0])]]
    sensor = modes.geometry.coordinate[[place[int(n)] for n in modes.node]]
    return Instruments(shaker=(float(x), float(y), float(z)), sensor=sensor)
