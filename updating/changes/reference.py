"""A model that was fitted to a reference, about which changes are looked for: of a stack, or of matrices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ema.types.modal_model import ModalModel
from model import MatrixStructure
from model.modes.modes import observe
from updating.changes.fields import Fields
from updating.changes.kinds.clamps import under_clamps
from updating.changes.kinds.contact import whole_contact, whole_laminas
from updating.changes.kinds.edges import edges
from updating.changes.nodes import Nodes, motions
from updating.changes.structure import Part, Structure
from updating.correlation.pairing import require_points
from updating.correlation.registration import register
from updating.diagnosis.candidates import CandidateModel
from updating.diagnosis.diagnosis import SHARES, priors_of, start_of
from updating.diagnosis.evidence import Campaigned, DiagnosisScatter, Tested, assemble_evidence
from updating.diagnosis.matrices_model import MatricesModel
from updating.diagnosis.stack_model import StackModel
from updating.inference.explain import Explanation, explain
from updating.inference.protocol import Modal, State
from updating.inference.search import begin, extended

Vector = NDArray[np.float64]

MOUNTING = 0.1
"""Relative standard deviation, from one mounting to the next, of what holds an edge against moving and against turning:
10 % of it moves the modes of a held plate by some 0.4 %, as a plate did that was clamped anew."""


TEMPERATURE = 2e-3
"""The same of the stiffness of everything: 5 K."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Beside:
    """A reference and a changed state in one model, at what was fitted to the reference.

    Attributes
    ----------
    states, modals : tuple of State and of Modal
        What was measured, the reference and its repeats first, and the model of each.
    sensors : tuple of sparse (n_dof, n)
        What each state measures of vectors in the structure's equations of motion.
    structure : callable
        Takes the lowest and the highest frequency that are compared, Hz; returns the structure in the changed state.
    """

    states: tuple[State, ...]
    modals: tuple[Modal, ...]
    sensors: tuple[Any, ...]
    structure: Callable[[tuple[float, float]], Structure]


class FittedReference(Protocol):
    """A model that was fitted to a reference: about this point changes are looked for."""

    @property
    def tested(self) -> tuple[Campaigned, ...]:
        """Name, pressure in Pa and modes of the reference and of its repeats."""

    @property
    def fit(self) -> Explanation:
        """Its fit."""

    @property
    def gain(self) -> float:
        """Relative standard deviation of the gain of an accelerometer that roves."""

    @property
    def still(self) -> float:
        """Motion of a mode at the sensors, over the median of all modes, below which no change shows it."""

    def beside(self, changed: Sequence[Campaigned]) -> Beside:
        """Put a changed state beside it."""

    def scattered(self, structure: Any) -> list[tuple[Part, float]]:
        """Return what is a little different in each assembly, with its relative standard deviation."""


@dataclass(frozen=True, eq=False, kw_only=True)
class StackReference:
    """A stack's model that was fitted to a reference; see `FittedReference`.

    Attributes
    ----------
    candidates : CandidateModel
        The reduced model.
    tested : tuple of (str, float, ModalModel)
        Name, pressure in Pa and modes of the reference and of its repeats.
    model : StackModel
        The model beside the first of them.
    fit : Explanation
        Its fit.
    """

    candidates: CandidateModel
    tested: tuple[Campaigned, ...]
    model: StackModel
    fit: Explanation

    @property
    def gain(self) -> float:
        """Relative standard deviation of the gain of an accelerometer that roves."""
        return self.model.scatter.gain

    @property
    def still(self) -> float:
        """Motion below which no change shows a mode: only a single plate moves in its plane."""
        # Motion of a mode at the sensors, over the median of all modes, below which a single plate moves in its
        # plane, which no change couples to its bending
        still = 1e-3
        return still if self.candidates.stack.n_lamina == 1 else 0.0

    def beside(self, changed: Sequence[Campaigned]) -> Beside:
        """Put a changed state beside it."""
        every, before, stack = _tested((*self.tested, *changed)), self.model, self.candidates.stack
        known = [(self.tested[0][2], before.observation[0])]
        for _, _, new in (*self.tested[1:], *changed):
            same = (points for modes, points in known if _at_same_points(modes, new))
            known.append((new, next(same, None) or register(stack, new.geometry, new.node, new.direction).observation))
        observation = [points for _, points in known]
        model = before.of_tests(every, observation)
        x, first = self.fit.x, len(self.tested)
        local = model.about(self.fit.coordinates, [x])
        modals = tuple(local.modal(x, c) for c in range(len(every)))
        at = dict(zip((c.name for c in self.fit.coordinates), x.tolist(), strict=True))
        theta, system = model.theta(at, first)[0], self.candidates.system
        modes = local.basis @ modals[first].shape
        seen = {points: observe(system, points).rows for points in observation}
        return Beside(
            states=model.states,
            modals=modals,
            sensors=tuple(seen[points] for points in observation),
            structure=lambda band: Fields(system, modes, theta, band),
        )

    def scattered(self, structure: Fields) -> list[tuple[Part, float]]:
        """Return what is a little different in each assembly: temperature, held edges, contact, each bolt."""
        # Relative standard deviation of the contact under one clamp whose bolt is tightened to the same torque again;
        # between bolts friction makes it 17 to 23 % (VDI 2230), which the reference has as well
        tightening = 0.03
        found: list[tuple[Part, float]] = [(whole_laminas(structure), TEMPERATURE)]
        found += [(part, MOUNTING) for part in edges(structure)]
        if structure.stack.n_lamina > 1:
            found.append((whole_contact(structure), self.model.scatter.stiffness))
            found += [(part, tightening) for part in under_clamps(structure)]
        return found


@dataclass(frozen=True, eq=False, kw_only=True)
class MatricesReference:
    """A structure of matrices that was fitted to a reference; see `FittedReference`.

    Attributes
    ----------
    matrices : MatrixStructure
        The structure.
    tested : tuple of (str, float, ModalModel)
        Name, nothing, and modes of the reference and of its repeats.
    model : MatricesModel
        The model beside the first of them.
    fit : Explanation
        Its fit.
    """

    matrices: MatrixStructure
    tested: tuple[Campaigned, ...]
    model: MatricesModel
    fit: Explanation
    still: float = 0.0

    @property
    def gain(self) -> float:
        """Relative standard deviation of the gain of an accelerometer that roves."""
        return self.model.scatter.gain

    def beside(self, changed: Sequence[Campaigned]) -> Beside:
        """Put a changed state beside it."""
        every, before = _tested((*self.tested, *changed)), self.model
        model = MatricesModel(self.matrices, every, before.scatter, reduced=before.bases)
        local = model.about(self.fit.coordinates, [self.fit.x])
        modals = tuple(local.modal(self.fit.x, c) for c in range(len(every)))
        shape = modals[len(self.tested)].shape
        return Beside(
            states=model.states,
            modals=modals,
            sensors=tuple(motions(self.matrices, observed) for observed in model.observed),
            structure=lambda band: Nodes(local, self.fit.x, shape, band),
        )

    def scattered(self, structure: Nodes) -> list[tuple[Part, float]]:
        """Return what is a little different in each assembly: temperature, and terms that hold it to the ground."""
        held = [(part, MOUNTING) for part in structure.grounded]
        return [(structure.whole_stiffness, TEMPERATURE), *held]


def _at_same_points(one: ModalModel, other: ModalModel) -> bool:
    """Tell whether two tests measured the same components, so that rows of the model need not be made twice."""
    return (
        np.array_equal(one.node, other.node)
        and np.array_equal(one.direction, other.direction)
        and np.array_equal(one.geometry.node, other.geometry.node)
        and np.array_equal(one.geometry.coordinate, other.geometry.coordinate)
    )


def _tested(given: Sequence[Campaigned]) -> list[Tested]:
    return [Tested(name=name, pressure=pressure, modes=modes) for name, pressure, modes in given]


def fit_reference(
    candidates: CandidateModel, tested: Sequence[Campaigned], *, scatter: DiagnosisScatter | None = None
) -> StackReference:
    """Fit the base model to a reference; held edges may give way, for no edge is rigid.

    Parameters
    ----------
    candidates : CandidateModel
        The reduced model, with the effects that are fitted where they raise the evidence.
    tested : sequence of (str, float, ModalModel)
        The reference and its repeats; the first is fitted, for what it shares with the others cancels.
    scatter : DiagnosisScatter, optional
        Priors of what is known of the structure.

    Raises
    ------
    FitError
        No measured mode resembles one of the model.
    PairingError
        Measured points do not lie on the stack.
    """
    evidence = assemble_evidence(candidates, tested[:1], scatter=scatter)
    model = StackModel(
        candidates,
        evidence.tested,
        evidence.observation,
        evidence.scatter,
        evidence.effects,
        start=evidence.start["G_f"],
    )
    common, fit = begin(model, shares=SHARES, starts=[start_of(model, evidence)], priors=priors_of(evidence.scatter))
    for one in extended(model, common, fit)[:1] if model.effects else ():
        further = explain(model, [model.terms[name] for name in one.terms], common, one.x)
        fit = further if further.log_evidence > fit.log_evidence else fit
    return StackReference(candidates=candidates, tested=tuple(tested), model=model, fit=fit)


def fit_matrices_reference(
    matrices: MatrixStructure, tested: Sequence[Campaigned], *, scatter: DiagnosisScatter | None = None
) -> MatricesReference:
    """Fit the stated terms of a structure of matrices to a reference.

    Parameters
    ----------
    matrices : MatrixStructure
        The structure.
    tested : sequence of (str, float, ModalModel)
        The reference and its repeats; the first is fitted, for what it shares with the others cancels.
    scatter : DiagnosisScatter, optional
        Priors of what no term has.

    Raises
    ------
    PairingError
        Measured points do not lie on the structure, or are fewer than the modes.
    """
    for _, _, modes in tested:
        require_points(modes)
    scatter = scatter or DiagnosisScatter()
    model = MatricesModel(matrices, _tested(tested[:1]), scatter)
    start = np.zeros(len(model.nuisances))
    _, fit = begin(model, shares=SHARES, starts=[start], priors=priors_of(scatter))
    return MatricesReference(matrices=matrices, tested=tuple(tested), model=model, fit=fit)
