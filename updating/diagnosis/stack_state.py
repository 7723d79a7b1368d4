"""What equations near a point need: a state of a stack with its measurement, and the model of the whole stack."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from model import Effect, Parameter, ReducedEquations
from model.reduction.reduced_equations import ReducedTerm
from updating.diagnosis.candidates import CandidateModel
from updating.inference.protocol import State

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class StackState:
    """One state of a stack: what it knows of itself, and the measurement.

    Attributes
    ----------
    state : State
        The measured modes.
    parameter : mapping of str to float
        Values that the state sets, pressure among them.
    assembled : str
        What was put together once: all its force levels share this name.
    rows : (n_dof, n_basis) float
        Measured points.
    slope : (n_dof, n_basis) float
        How these change as all points move along x, 1/m.
    sensor : (n_dof,) int
        The accelerometer that measured each shape component, from 0.
    strain : (n_mode, n_share) float, optional
        Strains of equal parts of the contact's energy in resonance of each mode, where amplitudes are known.
    """

    state: State
    parameter: Mapping[str, float]
    assembled: str
    rows: Vector
    slope: Vector
    sensor: NDArray[np.int64]
    strain: Vector | None = None


class Whole(Protocol):
    """What the equations near a point need of the model of a stack, `StackModel`."""

    equations: ReducedEquations
    candidates: CandidateModel
    measured: tuple[StackState, ...]
    clamp_locations: tuple[str, ...]
    dimensions: tuple[str, ...]
    n_gain: int
    n_equation: int
    rigid: float
    slip: Effect | None

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """Parameters of all effects by name."""

    def theta(self, at: Mapping[str, float], state: int) -> tuple[dict[str, float], dict[str, float]]:
        """Return the model's parameters in a state at coordinates by name, and their derivatives by coordinates."""

    def n_riding(self, names: Collection[str]) -> int:
        """Return how many modes what rides on the structure has, where coordinates let it."""

    def n_riding_within(self, theta: Mapping[str, float]) -> int:
        """Return how many of these lie where equations are looked at, at parameters of the model."""

    def finer_mesh(self, theta: Mapping[str, float]) -> tuple[Vector | None, Vector]:
        """Return what a finer mesh adds to the stiffness between the modes of the plain stack, and M times these."""

    def dimension(self, name: str, theta: Mapping[str, float]) -> dict[str, Vector]:
        """Return the derivatives of K and M by the logarithm of a dimension."""

    def acting(
        self, thetas: Sequence[Mapping[str, float]], moving: frozenset[str]
    ) -> list[tuple[ReducedTerm, frozenset[str]]]:
        """Return the terms that do not vanish while some parameters move, with what of these each depends on."""
