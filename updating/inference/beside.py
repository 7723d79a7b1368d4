"""A model near an explanation, with a change of its stiffness or mass in one direction beside it, fitted as any other.

The explanation's own modes and derivatives hold for all that a fit moves; with the change, the small eigenproblem is
solved anew, so that the evidence is that of modes with the change, not of errors that are linear in it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from updating.inference.discrepancy import rotation
from updating.inference.explain import Explanation, Setting, converged
from updating.inference.protocol import Coordinate, LocalModel, Modal, Screen, State, Term

Vector = NDArray[np.float64]
_RIGID = 0.01  # of the lowest elastic eigenvalue, up to which a mode with the change is still rigid-body motion


@dataclass(frozen=True, eq=False)
class Beside:
    """The model of an explanation with a change in one direction: its last coordinates are those of the direction.

    Attributes
    ----------
    explanation : Explanation
        About which it holds.
    states : sequence of State
        What was measured.
    of_mass, sign : bool and float
        Whether the mass changes, or the stiffness, relative to that of each mode; 1 where that raises frequencies.
    changed : collection of int, optional
        States that have the change; all by default.
    """

    explanation: Explanation
    states: Sequence[State]
    of_mass: bool
    sign: float
    changed: Collection[int] | None = None
    terms: Mapping[str, Term] = field(default_factory=dict)

    @property
    def nuisances(self) -> Sequence[Coordinate]:
        """All coordinates of the explanation."""
        return self.explanation.coordinates

    def about(self, coordinates: Sequence[Coordinate], points: Sequence[Vector]) -> LocalModel:  # noqa: ARG002
        """Return the model itself: it holds near the explanation."""
        return self

    def of(self, coordinates: Sequence[Coordinate]) -> LocalModel:  # noqa: ARG002
        """Return the model itself."""
        return self

    def screen(self, x: Vector, state: int) -> Screen | None:  # noqa: ARG002
        """Return nothing: the model itself is to be asked."""
        return None

    def modal(self, x: Vector, state: int) -> Modal:
        """Return the model of a state; raises numpy.linalg.LinAlgError where its mass is not positive."""
        errors, first = self.explanation.errors, self.explanation.errors[0]
        at, n, m = errors[state].latent.modal, self.explanation.x.size, errors[state].value.shape[1]
        away = x[:n] - self.explanation.x
        turn = np.eye(m) if state == 0 else rotation(first, errors[state])
        has = self.sign if self.changed is None or state in self.changed else 0.0
        elastic = np.sqrt(at.eigenvalue[at.n_rigid :])
        size = np.concatenate([np.full(at.n_rigid, elastic[0]), elastic])
        size = -np.ones(m) if self.of_mass else size  # what raises frequencies takes mass away
        here = size * (x[n:] @ turn)
        change = has * np.sign(size[0]) * np.outer(here, here)
        by = has * np.sign(size[0]) * (turn * size)[:, :, None] * here
        by = by + by.transpose(0, 2, 1)

        stiffness = np.diag(at.eigenvalue) + np.tensordot(away[at.moves], at.stiffness, 1)
        mass = np.eye(m) + np.tensordot(away[at.moves], at.mass, 1)
        changed, kept = (mass, stiffness) if self.of_mass else (stiffness, mass)
        changed = changed + change
        value, vector = la.eigh(*((kept, changed) if self.of_mass else (changed, kept)))
        n_rigid = int(np.count_nonzero(value < _RIGID * elastic[0] ** 2))
        value[:n_rigid] = 0.0

        rows = at.rows + np.tensordot(away[at.looks], at.row_change, 1)
        beyond = np.tensordot(away[at.moves], at.beyond_stiffness, 1)
        beyond -= np.tensordot(away[at.moves], at.beyond_mass, 1) * at.eigenvalue
        rows = rows + at.beyond_rows @ (beyond / (at.eigenvalue - at.beyond[:, None]))

        def turned(matrices: Vector) -> Vector:
            return np.asarray(vector.T @ matrices @ vector)

        none = np.zeros_like(by)
        further = np.zeros((m, at.beyond.size, m))
        return replace(
            at,
            eigenvalue=value,
            n_rigid=n_rigid,
            shape=at.shape @ vector,
            rows=rows @ vector,
            moves=np.concatenate([at.moves, np.arange(n, n + m)]),
            stiffness=turned(np.concatenate([at.stiffness, none if self.of_mass else by])),
            mass=turned(np.concatenate([at.mass, by if self.of_mass else none])),
            damping=turned(at.damping + np.tensordot(away[at.damps], at.damping_change, 1)),
            damping_change=turned(at.damping_change),
            row_change=at.row_change @ vector,
            beyond_stiffness=np.concatenate([at.beyond_stiffness, further]) @ vector,
            beyond_mass=np.concatenate([at.beyond_mass, further]) @ vector,
            of_mode=None if at.of_mode is None else turned(at.of_mode),
            of_mode_change=turned(at.of_mode_change) if at.of_mode_moves.size else at.of_mode_change,
        )

    def fitted(self, setting: Setting, direction: Vector, strength: float, *, steps: int = 20) -> float:
        """Return by how much the evidence rises from the explanation's where the change is fitted from a direction.

        Parameters
        ----------
        setting : Setting
            What all fits share.
        direction : (m,) float
            Where the fit starts, in the modes of the first state.
        strength : float
            Prior standard deviation of its components.
        steps : int
            Most steps.

        Raises
        ------
        numpy.linalg.LinAlgError
            The model has no modes there.
        """
        unknown = tuple(
            Coordinate(name=f"direction {i}", std=strength, step=np.inf, longest=3.0 * strength)
            for i in range(direction.size)
        )
        fit = converged(
            self,
            [Term(name="unlisted", coordinates=unknown)],
            replace(setting, apart=self.explanation.apart),
            np.concatenate([self.explanation.x, direction]),
            local=self,
            sizes=self.explanation.evidence.sizes,
            rounds=3,
            steps=steps,
        )
        # a direction and its opposite are one change
        return float(fit.log_evidence - self.explanation.log_evidence + np.log(2.0))
