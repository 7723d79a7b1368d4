"""What a stack's effects change between the modes at one point, for a screening of all of them without new modes."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from model.elements.equations import OMEGA, Target
from updating.inference.protocol import Change, Modal

Vector = NDArray[np.float64]
TARGETS: tuple[Target, ...] = ("K", "M", "C")


class Near(Protocol):
    """What a screen needs of the equations near a point, `StackNear`."""

    names: list[str]
    at: dict[str, int]
    moving: frozenset[str]
    of_target: dict[str, Any]
    stacked: dict[str, Any]
    size: int
    n_equation: int
    whole: Any

    def modal(
        self, x: Vector, state: int, solved: tuple[Vector, Vector, dict[str, Vector]] | None = None
    ) -> Modal:
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
        self.modal, every = near.modal(x, state, solved), solved[1]
        m = near.n_equation
        self._blocks, self._beyond = dict[str, Vector](), dict[str, Vector]()
        for t in "KMC":
            if near.of_target[t]:
                whole = near.stacked[t] @ (every if t != "C" else every[:, :m])
                self._blocks[t] = (every if t != "C" else every[:, :m]).T @ whole[:, :, :m]
                if t != "C":
                    self._beyond[t] = np.einsum("ib,pib->pb", every[:, m:], whole[:, :, m:])
        self._here = near.whole.theta(dict(zip(near.names, x.tolist(), strict=True)), state)[0]
        slip = near.whole.slip
        slips = slip is not None and near.whole.measured[state].strain is not None
        self._slips = (
            {near.at[p.name] for p in slip.parameters if p.name in near.at} if slip and slips else set()
        )

    def change(self, x: Vector) -> Change | None:
        """Return what the coordinates that differ at `x` change; None where that depends on amplitudes."""
        near = self.near
        moved = [i for i in np.flatnonzero(x != self.x).tolist() if near.names[i] in near.moving]
        if self._slips.intersection(moved):
            return None
        names = frozenset(near.names[i] for i in moved)
        theta, slope = near.whole.theta(dict(zip(near.names, x.tolist(), strict=True)), self.state)
        omega = 2.0 * np.pi * near.whole.measured[self.state].state.frequency

        def summed(target: Target, blocks: Vector) -> tuple[Vector, Vector]:
            """Return the sum over terms of what changes, and its derivatives, last axes as those of `blocks`."""
            total, by = np.zeros((1, *blocks.shape[1:])), np.zeros((len(moved), 1, *blocks.shape[1:]))
            for p, block in zip(near.of_target[target], blocks, strict=True):
                if not p.names & names:
                    continue
                each = [{OMEGA: w} for w in omega.tolist()] if OMEGA in p.names and target != "M" else [{}]
                factor = np.array([p.factor({**theta, **at}) - p.factor({**self._here, **at}) for at in each])
                total = total + np.multiply.outer(factor, block)
                for k, name in enumerate(near.names[i] for i in moved):
                    if name in p.names:
                        rate = [p.factor.derivative({**theta, **at}, name) * slope[name] for at in each]
                        if len(rate) > by.shape[1]:
                            by = np.repeat(by, len(rate), axis=1)
                        by[k] += np.multiply.outer(rate, block)
            return total, by

        none = np.zeros((0, near.size, near.n_equation))
        stiffness, mass, damping = (
            summed(t, self._blocks.get(t, none if t != "C" else none[:, : near.n_equation])) for t in TARGETS
        )
        far, heavy = (summed(t, self._beyond.get(t, none[:, near.n_equation :, 0])) for t in TARGETS[:2])
        return Change(
            moved=np.array(moved, dtype=np.intp),
            stiffness=stiffness,
            mass=mass,
            damping=damping,
            stiffness_beyond=far,
            mass_beyond=heavy,
        )
