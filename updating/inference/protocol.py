"""What the inference needs of a campaign and of a model: measured modes, coordinates, and modal matrices at a point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

FARTHEST = 8.0
"""Standard deviations of its prior that a nuisance may move: none does so by chance."""


@dataclass(frozen=True, eq=False, kw_only=True)
class State:
    """The measured modes of one state: one specimen, torque, force level and condition.

    Attributes
    ----------
    name : str
        The state.
    path : tuple of str
        Its place in the tree, from the outside in: rig, group, specimen, state. States share the discrepancy of
        every level whose names they have in common.
    frequency, frequency_std : (n,) float
        Natural frequencies, Hz, and their standard deviations.
    damping, damping_std : (n,) float
        Damping ratios and their standard deviations; NaN where damping is not compared.
    shape : (n_dof, n) float
        Real shapes of unit length.
    shape_std : (n,) float
        Standard deviation of one component of each.
    """

    name: str
    path: tuple[str, ...]
    frequency: Vector
    frequency_std: Vector
    damping: Vector
    damping_std: Vector
    shape: Vector
    shape_std: Vector


@dataclass(frozen=True, kw_only=True)
class Coordinate:
    """A number that a fit moves.

    Attributes
    ----------
    name : str
        What it is called.
    std : float
        Standard deviation of its normal prior about 0; infinite where nothing is known.
    lower, upper : float
        Bounds.
    starts : tuple of float
        Values that fits start from where nothing better is known.
    step : float
        A change of this size, or less, is small: what a local model must hold for.
    longest : float
        Longest step in one iteration.
    """

    name: str
    std: float
    lower: float = -np.inf
    upper: float = np.inf
    starts: tuple[float, ...] = (0.0,)
    step: float = 0.1
    longest: float = np.inf


@dataclass(frozen=True, kw_only=True)
class Term:
    """A candidate for what a model lacks.

    Attributes
    ----------
    name : str
        What it is called.
    coordinates : tuple of Coordinate
        Its own coordinates; none where it only frees nuisances.
    frees : mapping of str to float
        Nuisances whose prior it widens, with their standard deviation then.
    log_prior : float, optional
        Logarithm of its probability before anything was measured; by default all terms of a model are as probable.
    states : tuple of int, optional
        The states that it changes; all by default.
    """

    name: str
    coordinates: tuple[Coordinate, ...] = ()
    frees: Mapping[str, float] = field(default_factory=dict)
    log_prior: float | None = None
    states: tuple[int, ...] | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Modal:
    """A model in its own modal coordinates, in one state, with derivatives by the coordinates of a fit.

    Attributes
    ----------
    eigenvalue : (m,) float
        (rad/s)**2, ascending; 0 for the `n_rigid` first.
    n_rigid : int
        Number of rigid-body modes.
    shape : (n, m) float
        Mass-normalised modes in coordinates in which the mass is nearly the identity, the same for all states: they
        carry the discrepancy from one state to another.
    rows : (n_dof, m) float
        The modes at the sensors.
    moves : (q,) int
        Coordinates on which stiffness or mass depends.
    stiffness, mass : (q, m, m) float
        Derivatives of modal stiffness and mass by these.
    damping : (1 or n_measured, m, m) float
        Modal damping matrix; one for each measured mode where it depends on frequency.
    damps : (p,) int
        Coordinates on which it depends.
    damping_change : (p, 1 or n_measured, m, m) float
        Derivatives by these.
    looks : (k,) int
        Coordinates on which the rows depend, such as gains of sensors.
    row_change : (k, n_dof, m) float
        Derivatives of the rows by these.
    beyond : (k,) float
        Eigenvalues of further modes, whose equations are not looked at, and `beyond_rows` (n_dof, k) their rows: how
        shapes answer to a change as these take part.
    beyond_stiffness, beyond_mass : (q, k, m) float
        Derivatives by `moves` of the matrices between further modes and the others.
    of_mode : (n_measured, m, m) float, optional
        Stiffness that each measured mode feels beside that of the eigenvalues, where it depends on frequency or
        amplitude.
    of_mode_moves, of_mode_change : (s,) int and (s, n_measured, m, m) float
        Coordinates on which it depends, and its derivatives.
    touched : (n_own,) int, optional
        The coordinates of the fit that this state depends on, where these are a few of many: `moves`, `damps`, `looks`
        and `of_mode_moves` count among them.
    """

    eigenvalue: Vector
    n_rigid: int
    shape: Vector
    rows: Vector
    moves: NDArray[np.intp]
    stiffness: Vector
    mass: Vector
    damping: Vector
    damps: NDArray[np.intp]
    damping_change: Vector
    looks: NDArray[np.intp]
    row_change: Vector
    beyond: Vector
    beyond_rows: Vector
    beyond_stiffness: Vector
    beyond_mass: Vector
    of_mode: Vector | None = None
    of_mode_moves: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    of_mode_change: Vector = field(default_factory=lambda: np.zeros(0))
    touched: NDArray[np.intp] | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Change:
    """What a model changes between the modes at one point on the way to another, and its derivatives there.

    Attributes
    ----------
    moved : (k,) int
        Coordinates that differ between the two points.
    stiffness, mass : (1 or n_measured, M, m) and (k, 1 or n_measured, M, m) float
        Changes of the matrices between all modes, those beyond the equations last, and those in equations, for each
        measured mode where they depend on frequency; and their derivatives by `moved` at the second point.
    damping : (1 or n_measured, m, m) and (k, 1 or n_measured, m, m) float
        The same of damping, between the modes in equations.
    stiffness_beyond, mass_beyond : (1 or n_measured, M - m) and (k, 1 or n_measured, M - m) float
        Changes of the diagonal of the modes beyond, and their derivatives.
    """

    moved: NDArray[np.intp]
    stiffness: tuple[Vector, Vector]
    mass: tuple[Vector, Vector]
    damping: tuple[Vector, Vector]
    stiffness_beyond: tuple[Vector, Vector]
    mass_beyond: tuple[Vector, Vector]


class Screen(Protocol):
    """A state of a local model at one point, with what its terms change between the modes there."""

    @property
    def modal(self) -> Modal:
        """The model at the point."""

    def change(self, x: Vector) -> Change | None:
        """Return the change on the way to coordinates `x`; None where modal matrices do not say it."""


class LocalModel(Protocol):
    """A model that holds near the point about which it was made."""

    def of(self, coordinates: Sequence[Coordinate]) -> LocalModel:
        """Return the same for some of the coordinates, smaller where it can be; the others stay where neutral."""

    def modal(self, x: Vector, state: int) -> Modal:
        """Return the model of a state at coordinates `x`; raises numpy.linalg.LinAlgError where it has no modes."""

    def screen(self, x: Vector, state: int) -> Screen | None:
        """Return a state at coordinates `x` with what terms change there; None where the model itself is to be asked.

        Raises as `modal` does.
        """


class Model(Protocol):
    """A model of all states of a campaign."""

    @property
    def states(self) -> Sequence[State]:
        """The measured states."""

    @property
    def nuisances(self) -> Sequence[Coordinate]:
        """Coordinates of every explanation, those of the base model: they come first."""

    @property
    def terms(self) -> Mapping[str, Term]:
        """Candidates for what is missing, by name."""

    def about(self, coordinates: Sequence[Coordinate], points: Sequence[Vector]) -> LocalModel:
        """Return the model near some points of the coordinates."""
