"""The model of many specimens as the inference asks for it: a model for each group of stacks, coordinates by scope."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from model import Observation, observe
from updating.diagnosis.fit_settings import FitSettings
from updating.diagnosis.stack_model import StackModel
from updating.diagnosis.stack_near import StackNear
from updating.inference.protocol import Coordinate, Modal, State, Term
from updating.pooled.groups import Group, height_ratio
from updating.pooled.scoped import SCATTER, Meant, Scope, Scoped, nuisances_of, terms_of, with_settings
from updating.pooled.specimen import Level, Specimen

Vector = NDArray[np.float64]

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
        self.place: list[tuple[int, int, int]] = []  # of each state: specimen, group, state there
        for s, g, i in where:
            first, last = groups[g].first[i : i + 2]
            self.place += [(s, g, c) for c in range(first, last)]
        self.states_of = [[c for c, place in enumerate(self.place) if place[0] == s] for s in range(len(names))]
        self.states: tuple[State, ...] = tuple(
            replace(groups[g].model.states[c], path=("rig", names[s], groups[g].model.tested[c].name))
            for s, g, c in self.place
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
        self._rows: dict[int, Vector] = {}

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
        scope, (s, g, c) = self._scoped[name][1], self.place[state]
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

    def values(self, at: Mapping[str, float], s: int, local: Sequence[Coordinate]) -> Vector:
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

    def about(self, coordinates: Sequence[Coordinate], points: Sequence[Vector]) -> SpecimensNear:
        """Return the model near some points of the coordinates."""
        wide = 0.3  # of ln G_f from specimen to specimen, from which a basis is made at the ends, too
        local, names = self.local_of(coordinates), [c.name for c in coordinates]
        nears = []
        for g, group in enumerate(self.groups):
            of_group, where = self.in_group(g, local), list[Vector]()
            for x in points:
                at = dict(zip(names, x.tolist(), strict=True))
                values = np.array([self.values(at, s, of_group) for s in group.members])
                middle = np.mean(values, axis=0)
                where.append(middle)
                if self.first.touching and np.ptp(values[:, 0]) > 2.0 * wide:
                    where += [values[np.argmin(values[:, 0])], values[np.argmax(values[:, 0])]]
            nears.append(group.model.about(of_group, where))
        return SpecimensNear(self, coordinates, [self.in_group(g, local) for g in range(len(nears))], nears)

    def rows_of(self, g: int) -> Vector:
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
            _, g, _ = self.whole.place[state]
            touched = [i for i, name in enumerate(self.names) if self.whole.acts(name, state)]
            index = {c.name: i for i, c in enumerate(self.local[g])}
            of: list[list[int]] = [[] for _ in index]
            for k, i in enumerate(touched):
                of[index[self.whole.scope(self.names[i]).local]].append(k)
            self._touched[state] = np.array(touched, dtype=np.intp), of
        return self._touched[state]

    def screen(self, x: Vector, state: int) -> None:  # noqa: ARG002  # as the protocol has it
        """Return nothing: `updating.pooled.screening` looks at all states and levels together."""
        return

    def _n_equation(self, x: Vector) -> int:
        """Return how many equations are looked at in all states: a clamp that rides in one stack adds to all."""
        if self._last[0] != x.tobytes():
            at = dict(zip(self.names, x.tolist(), strict=True))
            each = (
                self.nears[g].n_equation_at(self.whole.values(at, s, self.local[g]), c) for s, g, c in self.whole.place
            )
            self._last = x.tobytes(), max(each)
        return self._last[1]

    def modal(self, x: Vector, state: int) -> Modal:
        """Return the model of a state at coordinates."""
        s, g, c = self.whole.place[state]
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
