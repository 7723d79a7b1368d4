"""Measured points with their degrees of freedom (DOFs), and frequency-response functions between these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, Protocol

import numpy as np

from lamella_shared import Booleans, Complexes, Integers, Reals, arrays, frozen, readonly

Quantity = Literal["receptance", "mobility", "accelerance"]
"""Response over force: displacement (m/N), velocity (m/(N s)) or acceleration (m/(N s2))."""

DERIVATIVE: dict[Quantity, int] = {"receptance": 0, "mobility": 1, "accelerance": 2}
"""How often displacement is differentiated in time."""


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"any": "frequency", "output.node input.node frequency": "value coherence", "output.node": "run"})
class FRF:
    """A block of frequency-response functions on a common, uniform frequency axis, in SI units.

    Attributes
    ----------
    frequency : (n_frequency,) float
        Frequency lines, Hz, ascending.
    value : (n_output, n_input, n_frequency) complex
        Response of each output over force at each input.
    quantity : {"receptance", "mobility", "accelerance"}
        What the response is.
    output, input : Dofs
        Response and force DOFs, `n_output` and `n_input` of them.
    run : (n_output,) int
        Roving run in which each output was measured, counted from 0 in reading order.
    source : tuple of str
        Where each output comes from (file and data set), for messages; `n_output` entries.
    coherence : (n_output, n_input, n_frequency) float or None
        Ordinary coherence of each function, or None when the test system did not store it.
    decay_rate : float
        What an exponential window on the responses adds to the decay rate of every mode, 1/s.
    reciprocal : bool
        Whether responses and forces have changed places, as for a roving hammer: outputs are then where it struck.
    """

    frequency: Reals
    value: Complexes
    quantity: Quantity
    output: Dofs
    input: Dofs
    run: Integers
    source: tuple[str, ...]
    coherence: Reals | None = None
    decay_rate: float = 0.0
    reciprocal: bool = False

    def __post_init__(self) -> None:
        if len(self.source) != self.output.node.size:
            raise ValueError(f"FRF.source: expected {self.output.node.size} entries, got {len(self.source)}")

    def band(self, lower: float, upper: float) -> FRF:
        """Return the lines with ``lower <= frequency <= upper`` (Hz)."""
        return self._lines((self.frequency >= lower) & (self.frequency <= upper))

    def outputs(self, keep: Booleans) -> FRF:
        """Return the outputs for which `keep` (n_output,) is true."""
        if np.all(keep):
            return self
        return replace(
            self,
            value=frozen(self.value[keep]),
            output=Dofs(node=self.output.node[keep], direction=self.output.direction[keep]),
            run=self.run[keep],
            source=tuple(s for s, k in zip(self.source, keep, strict=True) if k),
            coherence=None if self.coherence is None else self.coherence[keep],
        )

    def by_reciprocity(self) -> FRF:
        """Exchange response and force where there are more inputs than outputs."""
        n_output, n_input, _ = self.value.shape
        if n_input <= n_output:
            return self
        return FRF(
            frequency=self.frequency,
            value=self.value.swapaxes(0, 1),
            quantity=self.quantity,
            output=self.input,
            input=self.output,
            run=np.zeros(n_input, dtype=int),
            source=(", ".join(dict.fromkeys(self.source)),) * n_input,
            coherence=None if self.coherence is None else self.coherence.swapaxes(0, 1),
            decay_rate=self.decay_rate,
            reciprocal=True,
        )

    @property
    def sensor(self) -> Integers:
        """Number of each output among those of its run, from 0: the accelerometer where some rove."""
        return place_in_run(self.run)

    def convert(self, quantity: Quantity) -> FRF:
        """Return the same functions as another quantity.

        Differentiation in time is multiplication by ``i omega``. Integration divides by it, so the line
        at 0 Hz, where the result does not exist, is then left out.
        """
        power = DERIVATIVE[quantity] - DERIVATIVE[self.quantity]
        if power == 0:
            return self
        lines = self._lines(self.frequency > 0) if power < 0 else self
        factor = (2j * np.pi * lines.frequency) ** power
        return replace(lines, value=frozen(lines.value * factor), quantity=quantity)

    def _lines(self, keep: Booleans) -> FRF:
        (at,) = np.nonzero(keep)
        chosen: slice | Booleans = keep
        if at.size and at[-1] - at[0] + 1 == at.size:
            chosen = slice(int(at[0]), int(at[-1]) + 1)  # the same memory
        return replace(
            self,
            frequency=self.frequency[chosen],
            value=frozen(self.value[..., chosen]),
            coherence=None if self.coherence is None else self.coherence[..., chosen],
        )


def place_in_run(run: Integers) -> Integers:
    """Return the number of each output, (n_output,), among those of its run, from 0."""
    return np.array([np.count_nonzero(run[:i] == number) for i, number in enumerate(run)], dtype=np.int64)


@dataclass(frozen=True, eq=False, kw_only=True)
class Geometry:
    """Points of a test structure in the global coordinate system.

    Attributes
    ----------
    node : (n_node,) int
        Point numbers, unique.
    coordinate : (n_node, 3) float
        Position of each point, m.
    line : (n_line, 2) int
        Point numbers joined by trace lines for drawing; may be empty.
    axes : (n_node, 3, 3) float
        Rows: the local x, y and z axis of each point in global coordinates, in which its directions
        were measured. Given empty, every point has the global axes.
    """

    node: Integers
    coordinate: Reals
    line: Integers
    axes: Reals = field(default_factory=lambda: np.empty((0, 3, 3)))

    def __post_init__(self) -> None:
        node = readonly("Geometry", "node", self.node, (None,), np.int64)
        object.__setattr__(self, "node", node)
        object.__setattr__(self, "coordinate", readonly("Geometry", "coordinate", self.coordinate, (node.size, 3)))
        object.__setattr__(self, "line", readonly("Geometry", "line", self.line, (None, 2), np.int64))
        axes = self.axes if np.size(self.axes) else np.broadcast_to(np.eye(3), (node.size, 3, 3))
        object.__setattr__(self, "axes", readonly("Geometry", "axes", axes, (node.size, 3, 3)))
        if np.unique(node).size != node.size:
            repeated = sorted({int(n) for n in node if np.count_nonzero(node == n) > 1})
            raise ValueError(f"Geometry.node: point numbers must be unique, repeated: {repeated}")

    def direction(self, node: int, code: int) -> tuple[float, float, float]:
        """Return the global unit vector of a signed local direction: 1, 2, 3 for +x, +y, +z, negative for -.

        A point that the geometry does not hold (a reference often is not there) has the global axes.
        """
        known = np.flatnonzero(self.node == node)
        axes = self.axes[known[0]] if known.size else np.eye(3)
        x, y, z = np.sign(code) * axes[abs(code) - 1]
        return float(x), float(y), float(z)

    def line_rows(self, node: Integers) -> Integers:
        """Return the trace lines between some points as pairs of their positions in `node`, (n_line, 2)."""
        row = {int(n): i for i, n in enumerate(node)}
        rows = [(row[int(a)], row[int(b)]) for a, b in self.line if int(a) in row and int(b) in row]
        return np.array(rows, dtype=np.int64).reshape(-1, 2)

    def displacement(self, dofs: DofSet, value: Reals | Complexes) -> Complexes:
        """Return the displacement (n_node, 3) of all points of which some degrees of freedom move by `value` (n_dof,).

        A point measured in skew directions moves so as to meet them in the least-squares sense.
        """
        displacement = np.zeros(self.coordinate.shape, dtype=complex)
        for k, node in enumerate(self.node):
            at = dofs.node == node
            if at.any():
                displacement[k] = np.linalg.pinv(dofs.direction[at]) @ value[at]
        return displacement


class Dof(NamedTuple):
    """One degree of freedom: a point number and a unit vector in global coordinates, sign included."""

    node: int
    direction: tuple[float, float, float]


class DofSet(Protocol):
    """Anything that has degrees of freedom: `Dofs`, or modes measured at them."""

    @property
    def node(self) -> Integers:
        """Point number of each DOF (n_dof,)."""

    @property
    def direction(self) -> Reals:
        """Direction of each DOF (n_dof, 3)."""


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"any": "node", "node 3": "direction"})
class Dofs:
    """Degrees of freedom: a point number and a signed direction each.

    Attributes
    ----------
    node : (n_dof,) int
        Point number of each DOF; it may be absent from the geometry (a reference often is).
    direction : (n_dof, 3) float
        Unit vector of the measured direction in global coordinates, sign included.
    """

    node: Integers
    direction: Reals

    def name(self, index: int) -> str:
        """Return a DOF as a campaign file writes it, ``12+z``, or its point and direction off the axes."""
        direction = self.direction[index]
        axis = int(np.argmax(np.abs(direction)))
        if abs(direction[axis]) < 0.999:
            return f"{self.node[index]} along {np.round(direction, 3).tolist()}"
        return f"{self.node[index]}{'+' if direction[axis] > 0 else '-'}{'xyz'[axis]}"


def dof_keys(dofs: DofSet) -> list[tuple[float, ...]]:
    """Return each DOF as a key: its point and its direction to four digits."""
    return [(int(n), *(np.round(d, 4) + 0.0).tolist()) for n, d in zip(dofs.node, dofs.direction, strict=True)]


def shared_dofs(sets: Sequence[DofSet]) -> tuple[Integers, ...]:
    """Return for each set the positions of the DOFs that all of them have, in the order of the first."""
    places = [{key: k for k, key in enumerate(dof_keys(dofs))} for dofs in sets]
    common = [key for key in places[0] if all(key in other for other in places)]
    return tuple(np.array([place[key] for key in common], dtype=np.int64) for place in places)


def driving_points(output: Dofs, inputs: Dofs) -> list[tuple[int, int, float]]:
    """Find outputs and inputs at one point along one line, with the product of their directions' signs."""
    pairs: list[tuple[int, int, float]] = []
    for i, (node, direction) in enumerate(zip(inputs.node, inputs.direction, strict=True)):
        for o in np.flatnonzero(output.node == node):
            cosine = float(output.direction[o] @ direction)
            if abs(cosine) > 0.999:
                pairs.append((int(o), i, float(np.sign(cosine))))
    return pairs
