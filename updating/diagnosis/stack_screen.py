"""What a stack's effects change between the modes at one point, for a screening of all of them without new modes."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from model.elements.equations import OMEGA, Target
from updating.inference.protocol import Change, Modal

Vector = NDArray[np.float64]
ENERGIES: tuple[Target, ...] = ("K", "M")
TARGETS: tuple[Target, ...] = (*ENERGIES, "C")


class Near(Protocol):
    """What a screen needs of the equations near a point, `StackNear`."""

    names: list[str]
    at: dict[str, int]
    moving: frozenset[str]
    of_target: dict[str, Any]
    stacked: dict[str, Any]
    size: int
    whole: Any

    def modal(self, x: Vector, state: int, solved: tuple[Vector, Vector, dict[str, Vector]] | None = None) -> Modal:
        """Return the model of a state at coordinates; `solved` is what that returns there, where it is known."""

    def solved(self, x: Vector, state: int) -> tuple[Vector, Vector, dict[str, Vector]]:
        """Return all eigenvalues and modes of the local equations at coordinates, and K, M and C."""


class StackScreen:
    """A state of a local model at one point, with every term between the modes there.

    Parameters
    ----------
    near : Near
        The local model, with the coordinates of all terms.
    x : (n_coordinate,) float
        The point.
    state : int
        Which state.

    Raises
    ------
    numpy.linalg.LinAlgError
        The model has no modes there.
    """

    def __init__(self, near: Near, x: Vector, state: int) -> None:
        self.near, self.x, self.state = near, x, state
        solved = near.solved(x, state)
        self.modal, vectors = near.modal(x, state, solved), solved[1]
        m = self._n = self.modal.eigenvalue.size
        self._blocks, self._beyond = dict[str, Vector](), dict[str, Vector]()
        for t in "KMC":
            if near.of_target[t]:
                whole = near.stacked[t] @ (vectors if t != "C" else vectors[:, :m])
                self._blocks[t] = (vectors if t != "C" else vectors[:, :m]).T @ whole[:, :, :m]
                if t != "C":
                    self._beyond[t] = np.einsum("ib,pib->pb", vectors[:, m:], whole[:, :, m:])
        self._here = near.whole.theta(dict(zip(near.names, x.tolist(), strict=True)), state)[0]
        self._factors: dict[int, Vector] = {}
        self._by_name: dict[tuple[str, Target], list[int]] = {}
        for t in TARGETS:
            for i, p in enumerate(near.of_target[t]):
                for name in p.names:
                    self._by_name.setdefault((name, t), []).append(i)
        slip = near.whole.slip
        slips = slip is not None and near.whole.measured[state].strain is not None
        self._slips = {near.at[p.name] for p in slip.parameters if p.name in near.at} if slip and slips else set()

    def _factor(self, part: Any, slow: bool) -> Vector:
        """Return the factor of a part at the point; at the frequency of each measured mode where it depends on that."""
        if id(part) not in self._factors:
            omega = 2.0 * np.pi * self.near.whole.measured[self.state].state.frequency
            points = [{**self._here, OMEGA: w} for w in omega.tolist()] if slow else [self._here]
            self._factors[id(part)] = np.array([part.factor(at) for at in points])
        return self._factors[id(part)]

    def change(self, x: Vector) -> Change | None:
        """Return what the coordinates that differ at `x` change; None where that depends on amplitudes."""
        near = self.near
        moved = [i for i in np.flatnonzero(x != self.x).tolist() if near.names[i] in near.moving]
        if self._slips.intersection(moved):
            return None
        names = frozenset(near.names[i] for i in moved)
        nothing = frozenset(near.names[i] for i in np.flatnonzero((x == 0.0) & (self.x == 0.0)).tolist())
        theta, slope = near.whole.theta(dict(zip(near.names, x.tolist(), strict=True)), self.state)
        omega = 2.0 * np.pi * near.whole.measured[self.state].state.frequency

        at_modes = [{**theta, OMEGA: w} for w in omega.tolist()]

        def summed(target: Target, *blocks: Vector) -> list[tuple[Vector, Vector]]:
            """Return the sums over terms of what changes, and derivatives, last axes as those of each of `blocks`."""
            of_target = near.of_target[target]
            acting = sorted({i for name in names for i in self._by_name.get((name, target), ())})
            acting = [i for i in acting if not of_target[i].needs & nothing]
            parts = [of_target[i] for i in acting]
            slow = [OMEGA in p.names for p in parts]
            n = len(at_modes) if any(slow) else 1
            weight = np.zeros((1 + len(moved), n, len(parts)))  # of each part, and its derivatives
            for i, (p, depends_on_omega) in enumerate(zip(parts, slow, strict=True)):
                points, here = at_modes if depends_on_omega else [theta], self._factor(p, depends_on_omega)
                weight[0, :, i] = [p.factor(at) for at in points] - here
                for k, name in enumerate(near.names[j] for j in moved):
                    if name in p.names:
                        weight[1 + k, :, i] = [p.factor.derivative(at, name) * slope[name] for at in points]
            sums = [np.tensordot(weight, block[acting], 1) for block in blocks]
            return [(block[0], block[1:]) for block in sums]

        none = np.zeros((0, near.size, self._n))
        (stiffness, far), (mass, heavy) = (
            summed(t, self._blocks.get(t, none), self._beyond.get(t, none[:, self._n :, 0])) for t in ENERGIES
        )
        (damping,) = summed("C", self._blocks.get("C", none[:, : self._n]))
        return Change(
            moved=np.array(moved, dtype=np.intp),
            stiffness=stiffness,
            mass=mass,
            damping=damping,
            stiffness_beyond=far,
            mass_beyond=heavy,
        )
