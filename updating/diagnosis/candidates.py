"""The reduced model of a stack with all effects that it can have: what every explanation is computed with."""

from __future__ import annotations

import functools
import itertools
import logging
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from ema.types.modal_model import ModalModel
from model import (
    Assembly,
    Clamp,
    Effect,
    EffectError,
    Instruments,
    Kron,
    Monomial,
    Observation,
    Parameter,
    ReducedEquations,
    ReducedSystem,
    Stack,
    Term,
    assemble,
    observe,
    reduce,
    reduced_terms,
)
from model.effects.parts import mean_over
from model.elements.mesh import FIELDS, Field
from model.elements.terms import height_shares
from updating.errors import PairingError
from updating.workers.workers import distribute

_AT = np.array([-0.016, -0.005, 0.005, 0.016])  # m, where means are taken for the polynomials
_DEGREE = (3, 2)  # of those along x and y: a parabola is right to 2 % of frequencies at 20 mm, a cubic to 0.1 %


def clamp_locations(stack: Stack) -> tuple[Effect, ...]:
    """Return for each clamp of a stack what it does to the equations of motion that it sits farther along x or y.

    Its mass is taken from where the file has it and put where it is. What it moves with is the mean displacement under
    it, of third order in the distance (m) along x: at the crest of a mode, the first order alone says that nothing
    changes, and then the square of the slope counts that comes from where the mode has a node.
    """
    return tuple(_placed(i, clamp, axis) for i, clamp in enumerate(stack.clamps) if clamp.mass > 0.0 for axis in (0, 1))


def _name(i: int, axis: int) -> str:
    return f"clamp_{i + 1}_{'xy'[axis]}"


@functools.lru_cache(maxsize=len(FIELDS))  # those along y are asked for after those along x
def _powers(assembly: Assembly, field: Field, clamp: Clamp) -> dict[tuple[int, int], sp.csr_matrix]:
    """Return the rows whose sum, each times powers of the distances along x and y, takes the mean under a clamp.

    Along each axis it is the polynomial through the mean here that comes nearest to those at some other locations, the
    nearer the better. Off the stack a clamp has no place, and moves with the edge: shapes that are continued beyond it
    turn millimetres into an inertia that no clamp has. Near an edge, where that is a kink, all locations count.
    """

    def mean_at(x: float, y: float) -> sp.csr_matrix:
        return mean_over(assembly, field, (x, y), clamp.footprint)

    rows = {(0, 0): mean_at(clamp.x, clamp.y)}
    for along, location, size, degree in (
        ((1, 0), clamp.x, assembly.stack.length, _DEGREE[0]),
        ((0, 1), clamp.y, assembly.stack.width, _DEGREE[1]),
    ):
        within = np.clip(_AT, -size / 2.0 - location, size / 2.0 - location)
        changes = [mean_at(clamp.x + d * along[0], clamp.y + d * along[1]) - rows[0, 0] for d in within.tolist()]
        powers = np.arange(1, degree + 1)
        weight = np.abs(_AT) ** (-4.0 if np.all(within == _AT) else -1.0)
        shares = np.linalg.pinv(weight[:, None] * _AT[:, None] ** powers) * weight
        for power, share in zip(powers.tolist(), shares.tolist(), strict=True):
            parts = (part * change for part, change in zip(share, changes, strict=True))
            rows[power * along[0], power * along[1]] = sum(parts, start=0.0 * rows[0, 0])
    return rows


def _placed(i: int, clamp: Clamp, axis: int) -> Effect:
    farthest = 0.02  # m
    name, what = _name(i, axis), f"clamp {i + 1} sits farther along {'xy'[axis]}"

    def terms(assembly: Assembly) -> tuple[Term, ...]:
        z = sp.diags_array(clamp.mass * height_shares(clamp, assembly.stack.n_lamina)).tocsr()
        krons: dict[tuple[int, int], list[Kron]] = {}
        for field in FIELDS:
            rows = _powers(assembly, field, clamp)
            products: dict[tuple[int, int], sp.csr_matrix] = {}
            # the mass stays positive, for it is that of the square of one displacement with all its powers
            for (m, first), (n, second) in itertools.product(rows.items(), repeat=2):
                power = (m[0] + n[0], m[1] + n[1])
                products[power] = products.get(power, 0.0 * (first.T @ first)) + first.T @ second
            for power, planar in products.items():
                kron = Kron(row=field, column=field, z=z, planar=planar.tocsr())
                krons.setdefault(power, []).append(kron)
        return tuple(
            Term(
                name=f"{name} {power[0]} {power[1]}",
                target="M",
                factor=Monomial(exponent={_name(i, axis_of_power): n for axis_of_power, n in enumerate(power) if n}),
                krons=tuple(krons_of_power),
            )
            for power, krons_of_power in krons.items()
            if (power[1] > 0 if axis == 1 else power[0] > 0 == power[1])
        )

    parameter = Parameter(name=name, unit="m", nominal=2e-3, lower=-farthest, upper=farthest, source="a ruler")
    return Effect(
        name=name, label=what, family="inertia", summary=what, description=what, parameters=(parameter,), terms=terms
    )


_LOG = logging.getLogger(__name__)

G_F_RANGE = (300.0, 6000.0)
"""Contact stiffness parameters, Pa/Pa, for which the model is reduced: three times beyond Table 6 of the paper."""
N_SNAPSHOT = 4
N_MODEL = 20
"""Modes, rigid-body modes included, that the reduced model is made for."""
MESSAGES = 8
"""In which work is sent to other processes: each holds a model, some 40 MB."""
DIMENSIONS = ("length", "width", "height")
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
    clamp_locations : tuple of str
        Parameters of `system` that say how far parts of the rig are from where the files have them, m.
    """

    stack: Stack
    system: ReducedSystem
    effects: Mapping[str, Effect]
    impossible: Mapping[str, str]
    resized: Mapping[str, ReducedEquations]
    finer: ReducedSystem | None
    clamp_locations: tuple[str, ...]


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
    placed = clamp_locations(base)
    system = reduce(
        base.with_effects(*possible.values(), *aids, *placed),
        G_f_range=G_F_RANGE,
        n_snapshot=N_SNAPSHOT,
        n_mode=N_MODEL,
        local=[effect for effect in possible.values() if effect.n_sampled],
        ranged=True,
    )
    return CandidateModel(
        stack=base,
        system=system,
        effects=possible,
        impossible=impossible,
        resized=_resized(base, system),
        finer=next(finer, None),
        clamp_locations=tuple(effect.name for effect in placed),
    )


def _why_not(effect: Effect, small: Assembly) -> str | None:
    """Return why a stack cannot have an effect, `small` being its equations on a coarse mesh; None where it can."""
    try:
        terms = effect.terms(small)
    except EffectError as error:
        return str(error)
    acting = {
        term.target for term in terms for kron in term.krons if abs(kron.z).max() > 0.0 and abs(kron.planar).max() > 0.0
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
    resized = 1e-6  # relative change of a dimension from which its influence is taken
    by_dimension = {}
    for name in DIMENSIONS if base.outline is None else ("height",):
        for change in (resized, -resized):  # smaller where a larger one has more elements
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
    row = {int(n): i for i, n in enumerate(modes.geometry.node)}
    if int(modes.input.node[0]) not in row:
        raise PairingError(
            f"{modes.name}: point {int(modes.input.node[0])} of the force has no coordinates, which a diagnosis needs "
            "to place what hangs on the shaker. Add it to the points file."
        )
    x, y, z = modes.geometry.coordinate[row[int(modes.input.node[0])]]
    sensor = modes.geometry.coordinate[[row[int(n)] for n in modes.node]]
    return Instruments(shaker=(float(x), float(y), float(z)), sensor=sensor)


Vector = NDArray[np.float64]


class FinerMesh:
    """What an ever finer mesh adds to the stiffness between the base model's modes (Richardson 1911)."""

    def __init__(self, candidates: CandidateModel) -> None:
        self.finer = candidates.finer
        if self.finer is None:
            return
        stack = candidates.stack
        x, y = (np.linspace(-0.5, 0.5, n) * size for n, size in ((9, stack.length), (4, stack.width)))
        z = np.linspace(-0.5, 0.5, 5) * stack.height
        location = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
        n = len(location)
        everywhere = Observation(
            node=np.tile(np.arange(n), 3), location=np.tile(location, (3, 1)), direction=np.repeat(np.eye(3), n, axis=0)
        )
        self.rows = observe(candidates.system, everywhere).reduced_rows
        self.finer_rows = observe(self.finer, everywhere).reduced_rows
        self.finer_equations = self.finer.equations

    def change(
        self, theta: Mapping[str, float], eigenvalue: Vector, vectors: Vector, rigid: float, *, alike: float = 0.9
    ) -> Vector | None:
        """Return what an ever finer mesh adds to the modal stiffness, (m, m), of modes (n_basis, m).

        Nothing is added to rigid-body motion, of eigenvalues below `rigid`, nor to modes that the finer model was not
        reduced for: those beyond `N_MODEL`, and those of which it has less than `alike`, near the end of its list.
        """
        if self.finer is None:
            return None
        finer = self.finer_equations
        at = {name: theta[name] for name in finer.theta}
        value, vector = la.eigh(finer.matrix("K", at), finer.matrix("M", at))
        m, n = eigenvalue.size, min(eigenvalue.size, N_MODEL)
        raw = la.lstsq(self.rows @ vectors, self.finer_rows @ vector[:, :n])[0][:n]
        u, _, v = la.svd(raw)
        turn = u @ v
        finer_stiffness = turn @ np.diag(np.where(value[:n] < rigid, 0.0, value[:n])) @ turn.T
        change = np.zeros((m, m))
        change[:n, :n] = EXTRAPOLATED * (
            finer_stiffness - np.diag(np.where(eigenvalue[:n] < rigid, 0.0, eigenvalue[:n]))
        )
        lost = np.append(np.sum(raw**2, axis=1) < alike, np.ones(m - n, dtype=bool)) | (eigenvalue < rigid)
        change[lost] = 0.0
        change[:, lost] = 0.0
        return np.asarray((change + change.T) / 2.0)
