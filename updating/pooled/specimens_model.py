"""The model of many specimens: a model for each group of stacks, and coordinates of rig, group, specimen and state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lamella_shared import Reals
from model import Observation, observe
from updating.diagnosis.evidence import LABELS, PRESSURE, STATED_PRESSURE, WINDOW
from updating.diagnosis.fit_settings import CONTACT, FitSettings
from updating.diagnosis.fit_settings import Scope as Where
from updating.diagnosis.stack_model import StackModel
from updating.diagnosis.stack_near import StackNear
from updating.inference.levels import MISSING
from updating.inference.protocol import FARTHEST, Coordinate, Modal, State, Term
from updating.pooled.specimen import Group, Level, Specimen, height_ratio

CONTACT_SPREAD = 0.5
"""Prior standard deviation of the logarithm of the ratio of such a parameter to that of the rest."""
SHARED_PART = 0.5
"""Share of the variance of a nuisance, such as Young's modulus, that all specimens have in common."""
SCATTER = {"G_f": 0.2, "d_f": 0.4}
"""Standard deviations of ln G_f and ln d_f from specimen to specimen before any was measured: table 6 of Pirnat, Cepon
and Boltezar (2013) has 0.2 and 0.5 over six stacks."""


@dataclass(frozen=True, kw_only=True)
class Scope:
    """Where a coordinate acts.

    Attributes
    ----------
    local : str
        What it is to the model of one stack.
    members : tuple of int
        Specimens that have it.
    """

    local: str
    members: tuple[int, ...]


Scoped = dict[str, tuple[Coordinate, Scope]]


def nuisances_of(
    local: Mapping[str, Coordinate], names: Sequence[str], states: Sequence[Sequence[str]], scatter: Mapping[str, float]
) -> Scoped:
    """Return the coordinates of the base model: what specimens share, and what belongs to each.

    Parameters
    ----------
    local : mapping of str to Coordinate
        Nuisances of the model of one stack.
    names : sequence of str
        The specimens.
    states : sequence of sequence of str
        The states of each.
    scatter : mapping of str to float
        Standard deviations of ln G_f and ln d_f from specimen to specimen.
    """
    all_specimens, scoped = tuple(range(len(names))), Scoped()
    for name, c in local.items():
        if "[" in name and not name.startswith("gain"):  # of one state: one coordinate for each specimen
            what, _, state = name.partition("[")
            for s in all_specimens:
                if state.rstrip("]") in states[s] and len(states[s]) > 1:
                    key = f"{what}[{names[s]} {state}"
                    scoped[key] = replace(c, name=key), Scope(local=name, members=(s,))
            continue
        alone = name.startswith("gain") or name == "window"  # of the rig's instruments
        both = 1.0 if alone or name in CONTACT else np.sqrt(SHARED_PART)
        scoped[name] = _scaled(c, name, both), Scope(local=name, members=all_specimens)
        if alone:
            continue
        for s in all_specimens:
            key = f"{name}[{names[s]}]"
            if name in CONTACT:
                std = scatter[name]
                coordinate = replace(
                    c, name=key, std=std, lower=-FARTHEST * max(std, 0.1), upper=FARTHEST * max(std, 0.1)
                )
            else:
                coordinate = _scaled(c, key, np.sqrt(1.0 - SHARED_PART))
            scoped[key] = coordinate, Scope(local=name, members=(s,))
    return scoped


def with_settings(scoped: Scoped, model: StackModel, names: Sequence[str], settings: FitSettings) -> Scoped:
    """Return the coordinates of the base model with the settings of parameters.

    Parameters
    ----------
    scoped : Scoped
        The coordinates, as they are without.
    model : StackModel
        Of one group of specimens.
    names : sequence of str
        The specimens.
    settings : FitSettings
        What is known.
    """
    several = {scope.members[0] for key, (_, scope) in scoped.items() if _level(key, names) == "configuration"}
    usual = {c.name: c for c in model.nuisances}
    made = Scoped()
    for key, (c, scope) in scoped.items():
        what = key.partition("[")[0]
        levels: list[Where] = ["all", "specimen"]
        if what in CONTACT and not several.isdisjoint(scope.members):
            levels.append("configuration")
        level = _level(key, names)
        made[key] = settings.part(c, what, level, levels, usual.get(what, c), model.stack), scope
    return made


def _level(key: str, names: Sequence[str]) -> Where:
    """Return the level of a coordinate: all specimens, one specimen, or one of its configurations."""
    _, bracket, where = key.partition("[")
    return "all" if not bracket else "specimen" if where.rstrip("]") in names else "configuration"


def _scaled(c: Coordinate, name: str, share: float) -> Coordinate:
    """Return a coordinate of a share of the prior's standard deviation."""
    if not np.isfinite(c.std):
        return replace(c, name=name)
    return replace(c, name=name, std=c.std * share, lower=c.lower * share, upper=c.upper * share)


@dataclass(frozen=True, kw_only=True)
class Meant:
    """What a term is: an effect, a hypothesis about the measurement, or a contact parameter, at a level."""

    effect: str
    level: Level


def terms_of(
    model: StackModel, levels: Sequence[Level], nuisances: Scoped, states_of: Sequence[Sequence[int]]
) -> tuple[dict[str, Term], dict[str, Meant], Scoped]:
    """Return all that may be missing, what each term is, and where its coordinates act.

    Effects are tried at every level; contact parameters and what a file states wrongly where they are not all alike.
    Half of all models lack nothing; effects are as probable, and so are the rig, the groups together, and the specimens
    together.

    Parameters
    ----------
    model : StackModel
        Of one group of specimens.
    levels : sequence of Level
        The rig, groups, and specimens.
    nuisances : Scoped
        Coordinates of the base model.
    states_of : sequence of sequence of int
        States of each specimen.
    """
    terms, meant, scoped = dict[str, Term](), dict[str, Meant](), Scoped()
    hypotheses = {n: frees for n, frees in model.hypotheses.items() if n != WINDOW}
    contact = tuple(CONTACT) if model.touching else ()
    n_effect = len(model.effects) + len(hypotheses) + len(contact)
    kinds, of_stack = [level.kind for level in levels], model.terms
    for level in levels:
        prior = float(np.log(MISSING / n_effect / len(set(kinds)) / kinds.count(level.kind)))
        states = tuple(c for s in level.members for c in states_of[s])

        def add(effect: str, level: Level, coordinates: dict[str, tuple[Coordinate, str]], **frees: float) -> None:
            name = named(effect, level)
            terms[name] = Term(
                name=name,
                coordinates=tuple(c for c, _ in coordinates.values()),
                frees=frees,
                log_prior=prior,  # noqa: B023  # called within the turn
                states=states,  # noqa: B023
            )
            meant[name] = Meant(effect=effect, level=level)
            for key, (c, local) in coordinates.items():
                scoped[key] = c, Scope(local=local, members=level.members)

        for effect in model.effects:
            by_name = {named(c.name, level): c for c in of_stack[effect].coordinates}
            add(effect, level, {full_name: (replace(c, name=full_name), c.name) for full_name, c in by_name.items()})
        for effect, frees in hypotheses.items():
            if level.kind == "group":
                continue
            if effect == STATED_PRESSURE and level.kind == "rig":  # of a torque in all specimens
                of_torque = {f"{n}@rig": (_normal(f"{n}@rig", PRESSURE), n) for n in frees}
                add(effect, level, of_torque)
                continue
            freed = {
                key: std
                for key, (_, scope) in nuisances.items()
                for n, std in frees.items()
                if scope.local == n and scope.members == level.members
            }
            if freed:
                add(effect, level, {}, **freed)
        for what in contact if level.kind in ("group", "specimen") else ():
            key = f"{named(what, level)}"
            add(what, level, {key: (_normal(key, CONTACT_SPREAD), what)})
    return terms, meant, scoped


def _normal(name: str, std: float) -> Coordinate:
    return Coordinate(name=name, std=std, lower=-FARTHEST * std, upper=FARTHEST * std, step=0.1, longest=0.4)


def named(effect: str, level: Level) -> str:
    """Return the name of a term, or of a coordinate, at a level: that of the effect alone where it is the rig's."""
    return effect if level.kind == "rig" else f"{effect}@{level.of}"


def label_of(model: StackModel, effect: str) -> str:
    """Return the label of an effect, a hypothesis or a contact parameter."""
    return model.effects[effect].label if effect in model.effects else {**LABELS, **CONTACT}[effect]


HEIGHT = "height"


class SpecimensModel:
    """The model of many specimens in all their states.

    Parameters
    ----------
    specimens : sequence of Specimen
        What was measured.
    groups : sequence of Group
        The models, and which specimens share each.
    levels : sequence of Level
        At which terms are tried.
    scatter : mapping of str to float, optional
        Standard deviations of ln G_f and ln d_f from specimen to specimen.
    settings : FitSettings
        Priors, bounds and scopes of parameters.
    """

    def __init__(
        self,
        specimens: Sequence[Specimen],
        groups: Sequence[Group],
        levels: Sequence[Level],
        scatter: Mapping[str, float] = SCATTER,
        settings: FitSettings = FitSettings(),  # noqa: B008  # it is frozen
    ) -> None:
        self.settings = settings
        self.specimens, self.groups, self.levels = tuple(specimens), tuple(groups), tuple(levels)
        self.scatter = dict(scatter)
        names = [specimen.name for specimen in specimens]
        where = sorted((s, g, i) for g, group in enumerate(groups) for i, s in enumerate(group.members))
        self.indices: list[tuple[int, int, int]] = []  # of each state: specimen, group, state there
        for s, g, i in where:
            first, last = groups[g].first[i : i + 2]
            self.indices += [(s, g, c) for c in range(first, last)]
        self.states_of = [[c for c, (of, _, _) in enumerate(self.indices) if of == s] for s in range(len(names))]
        self.states: tuple[State, ...] = tuple(
            replace(groups[g].model.states[c], path=("rig", names[s], groups[g].model.tested[c].name))
            for s, g, c in self.indices
        )
        local = {c.name: c for group in reversed(groups) for c in group.model.nuisances}
        self.local = {c.name: c for c in self.first.nuisances} | local
        usual = nuisances_of(
            self.local, names, [[n for n, _, _ in specimen.tested] for specimen in specimens], self.scatter
        )
        self._scoped: Scoped = with_settings(usual, self.first, names, settings)
        self.nuisances: tuple[Coordinate, ...] = tuple(c for c, _ in self._scoped.values())
        self.terms: dict[str, Term]
        self.meant: dict[str, Meant]
        self.terms, self.meant, further = terms_of(self.first, levels, self._scoped, self.states_of)
        self._scoped |= further
        self.parameters = self.first.parameters
        terms = self.first.terms
        self.parameter_coordinates = {c.name: c for n in self.first.effects for c in terms[n].coordinates}
        self._has = [{c.name for c in group.model.nuisances} | set(self.parameter_coordinates) for group in groups]
        self.heights = [height_ratio(specimens[s], groups[g].model) for s, g, _ in where]
        self._rows: dict[int, Reals] = {}

    @property
    def first(self) -> StackModel:
        """The model of the first group: all have the same effects."""
        return self.groups[0].model

    def with_scatter(self, scatter: Mapping[str, float]) -> SpecimensModel:
        """Return the same where contact scatters otherwise from specimen to specimen."""
        return SpecimensModel(self.specimens, self.groups, self.levels, scatter, self.settings)

    def with_groups(self, groups: Sequence[Group]) -> SpecimensModel:
        """Return the same of other models of the groups, such as with other modes or effects."""
        return SpecimensModel(self.specimens, groups, self.levels, self.scatter, self.settings)

    def scope(self, name: str) -> Scope:
        """Return where a coordinate acts."""
        return self._scoped[name][1]

    def acts(self, name: str, state: int) -> bool:
        """Tell whether a state depends on a coordinate."""
        scope, (s, g, c) = self._scoped[name][1], self.indices[state]
        what, _, suffix = scope.local.partition("[")
        if s not in scope.members:
            return False
        return not suffix or what == "gain" or suffix == f"{self.groups[g].model.tested[c].assembled}]"

    def local_of(self, coordinates: Sequence[Coordinate]) -> list[Coordinate]:
        """Return the coordinates of the model of one stack that some coordinates act on, each once."""
        known = {**self.local, **self.parameter_coordinates}
        names = dict.fromkeys([*self.local, *(self.scope(c.name).local for c in coordinates)])
        return [known[name] for name in names]

    def in_group(self, g: int, local: Sequence[Coordinate]) -> list[Coordinate]:
        """Return the coordinates of one stack that the model of a group has."""
        return [c for c in local if c.name in self._has[g]]

    def values(self, at: Mapping[str, float], s: int, local: Sequence[Coordinate]) -> Reals:
        """Return the coordinates of the model of one stack for a specimen: what the scopes give it, summed.

        Parameters
        ----------
        at : mapping of str to float
            Coordinates of the fit.
        s : int
            The specimen.
        local : sequence of Coordinate
            Of which the values are wanted.
        """
        index = {c.name: i for i, c in enumerate(local)}
        values = np.zeros(len(local))
        for name, value in at.items():
            scope = self._scoped[name][1]
            if s in scope.members and scope.local in index:
                values[index[scope.local]] += value
        if HEIGHT in index:
            values[index[HEIGHT]] += self.heights[s]
        return values

    def about(self, coordinates: Sequence[Coordinate], points: Sequence[Reals]) -> SpecimensNear:
        """Return the model near some points of the coordinates."""
        wide = 0.3  # of ln G_f from specimen to specimen, from which a basis is made at the ends, too
        local, names = self.local_of(coordinates), [c.name for c in coordinates]
        nears = []
        for g, group in enumerate(self.groups):
            of_group, where = self.in_group(g, local), list[Reals]()
            for x in points:
                at = dict(zip(names, x.tolist(), strict=True))
                values = np.array([self.values(at, s, of_group) for s in group.members])
                middle = np.mean(values, axis=0)
                where.append(middle)
                if self.first.touching and np.ptp(values[:, 0]) > 2.0 * wide:
                    where += [values[np.argmin(values[:, 0])], values[np.argmax(values[:, 0])]]
            nears.append(group.model.about(of_group, where))
        return SpecimensNear(self, coordinates, [self.in_group(g, local) for g in range(len(nears))], nears)

    def rows_of(self, g: int) -> Reals:
        """Return displacements at the same points of each stack's box, (n, n_basis): where modes are compared."""
        grid = (9, 4, 5)  # points of a stack's box at which modes of different stacks are compared
        if g not in self._rows:
            stack = self.groups[g].model.stack
            sides = (stack.length, stack.width, stack.height)
            axes = [np.linspace(-0.5, 0.5, n) * side for n, side in zip(grid, sides, strict=True)]
            location = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
            n = len(location)
            points = Observation(
                node=np.tile(np.arange(n), 3),
                location=np.tile(location, (3, 1)),
                direction=np.repeat(np.eye(3), n, axis=0),
            )
            self._rows[g] = observe(self.groups[g].model.candidates.system, points).reduced_rows
        return self._rows[g]


class SpecimensNear:
    """The model of many specimens near some points: that of each group, with the coordinates of each state.

    Parameters
    ----------
    whole : SpecimensModel
        The model.
    coordinates : sequence of Coordinate
        Of the fit.
    local : sequence of sequence of Coordinate
        Of the model of each group.
    nears : sequence of StackNear
        These.
    """

    def __init__(
        self,
        whole: SpecimensModel,
        coordinates: Sequence[Coordinate],
        local: Sequence[Sequence[Coordinate]],
        nears: Sequence[StackNear],
    ) -> None:
        self.whole, self.names = whole, [c.name for c in coordinates]
        self.local, self.nears = local, nears
        self._touched: dict[int, tuple[NDArray[np.intp], list[list[int]]]] = {}
        self._last: tuple[bytes, int] = b"", 0  # coordinates that were asked last, and their number of equations
        self._common = [whole.rows_of(g) @ near.basis if len(nears) > 1 else None for g, near in enumerate(nears)]

    def of(self, coordinates: Sequence[Coordinate]) -> SpecimensNear:
        """Return the same for some of the coordinates; the others stay where they are neutral."""
        local = self.whole.local_of(coordinates)
        by_group = [self.whole.in_group(g, local) for g in range(len(self.nears))]
        nears = [near.of(present) for near, present in zip(self.nears, by_group, strict=True)]
        return SpecimensNear(self.whole, coordinates, by_group, nears)

    def touched(self, state: int) -> tuple[NDArray[np.intp], list[list[int]]]:
        """Return the coordinates of a state, and where among them each coordinate of its stack's model stands."""
        if state not in self._touched:
            _, g, _ = self.whole.indices[state]
            touched = [i for i, name in enumerate(self.names) if self.whole.acts(name, state)]
            index = {c.name: i for i, c in enumerate(self.local[g])}
            of: list[list[int]] = [[] for _ in index]
            for k, i in enumerate(touched):
                of[index[self.whole.scope(self.names[i]).local]].append(k)
            self._touched[state] = np.array(touched, dtype=np.intp), of
        return self._touched[state]

    def screen(self, x: Reals, state: int) -> None:  # noqa: ARG002  # as the protocol has it
        """Return nothing: `updating.pooled.screening` looks at all states and levels together."""
        return

    def _n_equation(self, x: Reals) -> int:
        """Return how many equations are looked at in all states: a clamp that rides in one stack adds to all."""
        if self._last[0] != x.tobytes():
            at = dict(zip(self.names, x.tolist(), strict=True))
            each = (
                self.nears[g].n_equation_at(self.whole.values(at, s, self.local[g]), c)
                for s, g, c in self.whole.indices
            )
            self._last = x.tobytes(), max(each)
        return self._last[1]

    def modal(self, x: Reals, state: int) -> Modal:
        """Return the model of a state at coordinates."""
        s, g, c = self.whole.indices[state]
        touched, of = self.touched(state)
        at = {self.names[i]: float(x[i]) for i in touched}
        modal = self.nears[g].modal(self.whole.values(at, s, self.local[g]), c, n_equation=self._n_equation(x))

        def spread(columns: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
            pairs = [(k, i) for i, column in enumerate(columns.tolist()) for k in of[column]]
            where, taken = zip(*pairs, strict=True) if pairs else ((), ())
            return np.array(where, dtype=np.intp), np.array(taken, dtype=np.intp)

        moves, q = spread(modal.moves)
        damps, p = spread(modal.damps)
        looks, k = spread(modal.looks)
        of_mode_moves, r = spread(modal.of_mode_moves)
        common = self._common[g]
        return replace(
            modal,
            shape=modal.shape if common is None else common @ modal.shape,
            moves=moves,
            stiffness=modal.stiffness[q],
            mass=modal.mass[q],
            beyond_stiffness=modal.beyond_stiffness[q],
            beyond_mass=modal.beyond_mass[q],
            damps=damps,
            damping_change=modal.damping_change[p],
            looks=looks,
            row_change=modal.row_change[k],
            of_mode_moves=of_mode_moves,
            of_mode_change=modal.of_mode_change[r] if r.size else modal.of_mode_change,
            touched=touched,
        )
