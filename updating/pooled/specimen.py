"""Specimens, one stack each in the rig that all share, and tables of modes that describe them."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ema.io.found_modes import FoundModes, poles_in_table, read_modes_table
from ema.modal.read_modes import modal_model_of
from ema.types.frf import Dof, Dofs, Geometry
from ema.types.modal_model import ModalModel
from lamella_shared import Complexes, Integers, Reals
from model import Effect, ReducedSystem, Stack, observe, reduce
from updating.correlation.pairing import require_points
from updating.correlation.registration import register
from updating.correlation.shape_class import CLASS_ROWS, CLASS_STATIONS, class_grid, solve_by_class
from updating.diagnosis.candidates import (
    G_F_RANGE,
    MESSAGES,
    N_SNAPSHOT,
    CandidateModel,
    candidate_model,
    instruments_of,
)
from updating.diagnosis.evidence import DiagnosisScatter, Tested, assemble_evidence
from updating.diagnosis.experiment import aids
from updating.diagnosis.stack_model import StackModel
from updating.errors import FitError
from updating.results.pooled import LevelKind
from updating.results.store import digest
from updating.workers.workers import distribute

if TYPE_CHECKING:
    from updating.diagnosis.evidence import Campaigned

UNTREATED = ("", "none", "no", "-")
"""Notes that say that there is nothing: no group."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Specimen:
    """One stack in the rig.

    Attributes
    ----------
    name : str
        Unique in its campaign.
    stack : Stack
        Its model with the rig, without effects.
    tested : tuple of (str, float, ModalModel)
        Name, pressure in Pa and identified modes of each configuration; configurations of other specimens at the same
        torque have the same name.
    notes : mapping of str to str
        What was noted of it, such as its treatment.
    classed : bool
        Whether the model's shapes of some classes stand for shapes that were not measured.
    """

    name: str
    stack: Stack
    tested: tuple[Campaigned, ...]
    notes: Mapping[str, str] = field(default_factory=dict)
    classed: bool = False


@dataclass(frozen=True, kw_only=True)
class Level:
    """Which specimens have something.

    Attributes
    ----------
    kind : "rig", "group" or "specimen"
        All of them the same; those of a group the same; one alone.
    of : str
        Which group, such as "treatment = glued", or which specimen; empty where it is all.
    members : tuple of int
        Places of the specimens.
    """

    kind: LevelKind
    of: str
    members: tuple[int, ...]


def levels_of(specimens: Sequence[Specimen]) -> tuple[Level, ...]:
    """Return all levels at which something can be: the rig, groups by each column of the notes, and specimens.

    Specimens of one note in one column are a group, if they are two or more and not all; of groups with the same
    members the first one counts.
    """
    fewest = 2  # specimens that make a group
    all_members = tuple(range(len(specimens)))
    levels = [Level(kind="rig", of="", members=all_members)]
    if len(specimens) < fewest:
        return tuple(levels)
    known = {all_members}
    for column in dict.fromkeys(name for specimen in specimens for name in specimen.notes):
        values = [specimen.notes.get(column, "") for specimen in specimens]
        for value, count in Counter(values).items():
            members = tuple(i for i in all_members if values[i] == value)
            if count >= fewest and value not in UNTREATED and members not in known:
                known.add(members)
                levels.append(Level(kind="group", of=f"{column} = {value}", members=members))
    levels += [Level(kind="specimen", of=specimen.name, members=(i,)) for i, specimen in enumerate(specimens)]
    return tuple(levels)


_LOG = logging.getLogger(__name__)

HEIGHTS_ALIKE = 0.06
"""Relative difference of heights up to which specimens share the model of the middle one; the rest is taken to first
order, which is wrong by less than 0.1 % of a frequency."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Group:
    """Specimens with the model that they share.

    Attributes
    ----------
    members : tuple of int
        Places of the specimens.
    model : StackModel
        Of all their states, specimen by specimen; what belongs to one state is named by its configuration.
    first : tuple of int
        The first state of each specimen, and behind them the number of states.
    start : (2,) float
        ln G_f and ln d_f over the stated ones, near those of one of the specimens.
    """

    members: tuple[int, ...]
    model: StackModel
    first: tuple[int, ...]
    start: tuple[float, float]


def groups_of(
    specimens: Sequence[Specimen],
    effects: Mapping[str, Effect],
    *,
    scatter: DiagnosisScatter | None = None,
    executor: Executor | None = None,
    reduced: Callable[..., CandidateModel] = candidate_model,
) -> tuple[tuple[Group, ...], dict[str, str]]:
    """Put specimens beside the models that they share, and say why effects cannot be.

    Parameters
    ----------
    specimens : sequence of Specimen
        All.
    effects : mapping of str to Effect
        The catalogue.
    scatter : DiagnosisScatter, optional
        What a laboratory knows of what separates a right model from a right measurement.
    executor : Executor, optional
        Where models are reduced.
    reduced : callable
        `candidate_model`, or one that caches.

    Raises
    ------
    FitError
        No measured mode of a specimen resembles one of its model.
    PairingError
        Measured points do not lie on a stack, or are fewer than the modes.
    """
    alike = _alike(specimens)
    for members in alike:
        _LOG.info("the model of %s", ", ".join(specimens[i].name for i in members))
    make = partial(_candidates, specimens, effects, reduced)
    single = len(alike) == 1  # then the executor takes its parts
    models = [make(alike[0], executor)] if single else list(distribute(make, alike, executor, MESSAGES))
    possible = [name for name in effects if all(name in candidates.effects for candidates in models)]
    grouped = [
        _group(specimens, candidates, members, scatter or DiagnosisScatter())
        for candidates, members in zip(models, alike, strict=True)
    ]
    silent = {name: why for _, reasons in grouped for name, why in reasons.items()}
    kept = [name for name in possible if name not in silent]
    n_equation = max(group.model.n_equation for group, _ in grouped)
    groups = tuple(replace(group, model=_with(group.model, kept, n_equation)) for group, _ in grouped)
    return groups, {**{n: why for candidates in models for n, why in candidates.impossible.items()}, **silent}


def _candidates(
    specimens: Sequence[Specimen],
    effects: Mapping[str, Effect],
    reduced: Callable[..., CandidateModel],
    members: Sequence[int],
    executor: Executor | None = None,
) -> CandidateModel:
    """Return the model of the middle one of some specimens."""
    for i in members:
        for _, _, modes in specimens[i].tested:
            require_points(modes)
    first = specimens[members[len(members) // 2]]
    return reduced(first.stack, instruments_of(first.tested[0][2]), effects, aids(), executor)


def _group(
    specimens: Sequence[Specimen], candidates: CandidateModel, members: Sequence[int], scatter: DiagnosisScatter
) -> tuple[Group, Mapping[str, str]]:
    """Return some specimens beside a model, and why effects cannot show in them."""
    middle = specimens[members[len(members) // 2]]
    try:
        evidence = assemble_evidence(candidates, middle.tested, scatter=scatter)
    except FitError as error:
        raise FitError(f"specimen {middle.name}: {error}") from error
    tested, observation, first = [], [], [0]
    for i in members:
        for name, pressure, modes in specimens[i].tested:
            tested.append(Tested(name=f"{specimens[i].name} {name}", pressure=pressure, modes=modes, state=name))
            observation.append(register(candidates.stack, modes.geometry, modes.node, modes.direction).observation)
        first.append(len(tested))
    start = (evidence.start["G_f"], evidence.start["d_f"])
    model = StackModel(candidates, tested, observation, scatter, evidence.effects, start=start[0])
    group = Group(members=tuple(members), model=model, first=tuple(first), start=start)
    return group, {n: why for n, why in evidence.impossible.items() if n not in candidates.impossible}


def _with(model: StackModel, names: Sequence[str], n_equation: int) -> StackModel:
    """Return a model with some of its effects, so many equations of which are looked at."""
    return StackModel(
        model.candidates,
        model.tested,
        model.observation,
        model.scatter,
        {name: model.effects[name] for name in names},
        start=model.start,
        n_equation=n_equation,
        like=model if model.n_equation == n_equation else None,
    )


def _alike(specimens: Sequence[Specimen]) -> list[list[int]]:
    """Return which specimens share a model, by height ascending: at most `HEIGHTS_ALIKE` apart."""
    groups: list[list[int]] = []
    key = [_key(specimen) for specimen in specimens]
    for i in sorted(range(len(specimens)), key=lambda i: (key[i], specimens[i].stack.height)):
        height = specimens[i].stack.height
        last = groups[-1][0] if groups else -1
        if last >= 0 and key[last] == key[i] and height / specimens[last].stack.height <= 1.0 + HEIGHTS_ALIKE:
            groups[-1].append(i)
        else:
            groups.append([i])
    return groups


def _key(specimen: Specimen) -> str:
    """Return what distinguishes the models of two stacks, but for their height."""
    stack: Stack = replace(specimen.stack, name="", height=specimen.stack.width)
    instruments = instruments_of(specimen.tested[0][2])
    x, y, z = instruments.shaker
    digits = 4  # in m, to which shakers are at the same location
    location = (round(x, digits), round(y, digits), z > 0.0)
    return digest({"stack": stack, "shaker": location, "sensors": len(instruments.sensor)})


def height_ratio(specimen: Specimen, model: StackModel) -> float:
    """Return the logarithm of a specimen's stated height over that of the model that it shares."""
    return float(np.log(specimen.stack.height / model.stack.height))


def modal_model(
    name: str, of: Mapping[str, str], modes: Path, shapes: Path, geometry: Geometry, force: Dof
) -> ModalModel:
    """Return modes with shapes as an identification gives them.

    Parameters
    ----------
    name : str
        The configuration.
    of : mapping of str to str
        Whose rows of the tables, see `ema.io.found_modes.read_modes_table`.
    modes : Path
        Columns `frequency_Hz` and, where they are known, `frequency_std_Hz`, `damping`, `damping_std`, and
        `shape_std`, relative to the root mean square of the shape's components.
    shapes : Path
        Columns `node`, `x`, `y`, `z` (the direction) and, for each mode, `mode_1_real`, `mode_1_imag` and so on;
        `sensor` counts the accelerometers of a run from 0.
    geometry : Geometry
        The measured points.
    force : Dof
        Where and along which direction the force acts.

    Raises
    ------
    MeasurementError
        A file cannot be read, lacks a column, or holds something that is not a number.
    FitError
        A point is not among the measured ones.
    """
    found = read_modes_table((modes, shapes), of)
    absent = sorted(set(found.node.tolist()) - set(geometry.node.tolist()))
    if absent:
        raise FitError(f"{shapes}: points {absent} are not in the list of points of the campaign file")
    return replace(modal_model_of(found, name=name, geometry=geometry, force=force), read_from="")


def classes(path: Path, of: Mapping[str, str]) -> tuple[tuple[str, ...], Reals]:
    """Return the classes of the modes of a table without shapes, and their frequencies, damping and deviations.

    Parameters
    ----------
    path : Path
        The table.
    of : mapping of str to str
        Whose rows, see `ema.io.found_modes.read_modes_table`.

    Returns
    -------
    (n_mode,) str, (4, n_mode) float
        Such as "bending 1"; frequencies, their standard deviations, Hz, damping ratios and theirs, NaN where unstated.

    Raises
    ------
    MeasurementError
        The table cannot be read, or lacks `shape_class`.
    FitError
        It names a class twice.
    """
    names, poles = poles_in_table(path, "shape_class", of)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise FitError(f"{path}: shape_class {', '.join(map(repr, twice))} stands in more than one row")
    return names, poles


def assembled(
    name: str,
    poles: Reals,
    shapes: tuple[Complexes | Reals, Reals],
    *,
    geometry: Geometry,
    dofs: Dofs,
    sensor: Integers,
    force: Dof | None,
) -> ModalModel:
    """Return modes as an identification gives them that has no functions.

    Parameters
    ----------
    name : str
        The configuration.
    poles : (4, n_mode)
        Frequencies, their standard deviations, Hz, damping ratios and theirs.
    shapes : ((n_dof, n_mode), (n_dof, n_mode))
        Shapes and the standard deviations of their components.
    geometry, dofs, sensor, force
        As `ema.ModalModel` has them, the force one DOF.
    """
    shape, std = np.asarray(shapes[0], complex), np.asarray(shapes[1])
    frequency, frequency_std, damping, damping_std = poles
    n, order = frequency.size, np.argsort(frequency)
    found = FoundModes(
        source="", frequency=frequency, frequency_std=frequency_std, damping=damping, damping_std=damping_std,
        shape=shape, scaled=np.zeros(n, bool), node=dofs.node, direction=dofs.direction, sensor=sensor,
    )  # fmt: skip
    made = modal_model_of(found, name=name, geometry=geometry, force=force)
    return replace(made, shape=shape[:, order], shape_std=std[:, order])


CLASS_STD = 0.1
"""Standard deviation of each modal coordinate of a shape that stands for a class: a mode of a class resembles the
model's, MAC 0.9 with some ten modes that it may be mixed with, and what it is mixed with is not known."""


class Classes:
    """Models of stacks that show what modes of a class look like: one for all that are nearly as high."""

    def __init__(self) -> None:
        self._known: dict[str, ReducedSystem] = {}

    def _of(self, stack: Stack) -> ReducedSystem:
        """Return the model of a stack, or of one that is nearly as high and otherwise the same."""
        step = round(np.log(stack.height / stack.width) / np.log1p(HEIGHTS_ALIKE))
        key = digest({"stack": replace(stack, name="", height=stack.width), "step": step})
        if key not in self._known:
            self._known[key] = reduce(stack, G_f_range=G_F_RANGE, n_snapshot=N_SNAPSHOT)
        return self._known[key]

    def modes(self, name: str, stack: Stack, wanted: tuple[str, ...], poles: Reals) -> ModalModel:
        """Return modes that are named by class: the model's shapes of these classes stand for theirs.

        Parameters
        ----------
        name : str
            The configuration.
        stack : Stack
            What was tested.
        wanted : tuple of str
            Class of each mode, such as "torsion 1".
        poles : (4, n_mode)
            Frequencies, their standard deviations, Hz, damping ratios and theirs.

        Raises
        ------
        FitError
            The model has no mode of a class.
        """
        station_step = 4  # One in so many stations along the length, enough to distinguish classes.
        grid = class_grid(stack)
        system = self._of(stack)
        modes, column = solve_by_class(system, observe(system, grid), wanted, G_f=stack.contact.G_f)
        if np.any(column < 0):
            absent = ", ".join(c for c, k in zip(wanted, column, strict=True) if k < 0)
            raise FitError(f"{name}: the model of {stack.name} has no mode of class {absent}")
        upwards = np.arange(CLASS_STATIONS * CLASS_ROWS).reshape(CLASS_STATIONS, CLASS_ROWS)[::station_step].ravel()
        node, n = grid.node[upwards], upwards.size
        shape = modes.shape[np.ix_(upwards, column)]
        shape = shape / np.abs(shape).max(axis=0)
        geometry = Geometry(node=node, coordinate=grid.location[upwards], line=np.empty((0, 2), dtype=int))
        return assembled(
            name,
            poles,
            (shape, CLASS_STD * np.linalg.norm(shape, axis=0) * np.ones_like(shape)),
            geometry=geometry,
            dofs=Dofs(node=node, direction=grid.direction[upwards]),
            sensor=np.zeros(n, dtype=np.int64),
            force=None,
        )
