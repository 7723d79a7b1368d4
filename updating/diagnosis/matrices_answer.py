"""Fits and diagnoses of a structure of matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from ema.types.arrays import single_threaded
from ema.types.modal_model import ModalModel
from model import MatrixStructure, Modes, ReducedMatrices
from updating.correlation.pairing import pair, require_points
from updating.diagnosis.answer import Diagnosis, Moved
from updating.diagnosis.diagnosis import SHARES, priors_of
from updating.diagnosis.evidence import DiagnosisScatter, Tested
from updating.diagnosis.matrices_model import MatricesModel
from updating.diagnosis.points import search_corrected
from updating.diagnosis.ranking import answer_of
from updating.diagnosis.text import sentences
from updating.errors import FitError
from updating.fitting.fit import ModelFit, frequency_error
from updating.inference.decide import decide
from updating.inference.discrepancy import whitened
from updating.inference.explain import Explanation
from updating.inference.protocol import LocalModel
from updating.inference.search import begin

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class MatricesFit(ModelFit):
    """The stated terms of a structure of matrices fitted to one configuration.

    Attributes
    ----------
    moved : tuple of Moved
        Every quantity that was fitted: as stated, as fitted, and what was known of it.
    at_bound : tuple of str
        Those of them that lie at an end of what the structure file allows.
    together : tuple of str
        What these data tell of terms that they cannot tell apart, in words.
    initial_error : float
        Mean relative frequency error before the fit.
    initial_mac : (n_pair,) float
        MAC of the pairs before the fit.
    stated_error : float
        Mean relative deviation that the measurement states of these frequencies.
    """

    moved: tuple[Moved, ...]
    at_bound: tuple[str, ...]
    together: tuple[str, ...]
    initial_error: float
    initial_mac: Vector
    stated_error: float

    @property
    def findings(self) -> tuple[str, ...]:
        """What a user should read before using the parameters."""
        found = list(self.together)
        if self.at_bound:
            found.insert(
                0,
                f"{self.name}: {', '.join(self.at_bound)} ended at the end of what the structure file allows: a sign "
                "that something is missing there that these terms make up for; lamella diagnose asks what",
            )
        if self.error > max(0.5 * self.initial_error, 3.0 * self.stated_error):
            found.insert(
                0,
                f"{self.name}: the terms take away less than half of the frequency error: {self.error:.2%} of "
                f"{self.initial_error:.2%} stays, where the measurement states {self.stated_error:.2%}: shapes and "
                "priors allow no values that meet the frequencies, so something is missing that no term describes, "
                "which lamella diagnose asks for; or the priors are too narrow, or shapes are trusted too far "
                "(shape_std in [modes])",
            )
        return tuple(found)


@single_threaded
def fit_matrices(
    structure: MatrixStructure, measured: ModalModel, *, threshold: float = 0.8, scatter: DiagnosisScatter | None = None
) -> MatricesFit:
    """Fit the stated terms of a structure to the modes of one configuration.

    Frequencies and shapes are weighed by their noise and by the discrepancy that every model has, whose size is
    estimated; terms have the priors of the structure file.

    Parameters
    ----------
    structure : MatrixStructure
        The structure.
    measured : ModalModel
        The identified modes.
    threshold : float
        Smallest MAC that makes a pair.
    scatter : DiagnosisScatter, optional
        What is known of what no term has.

    Raises
    ------
    PairingError
        Measured points do not lie on the structure, or are fewer than the modes.
    FitError
        No measured mode resembles one of the model.
    """
    require_points(measured)
    scatter = scatter or DiagnosisScatter()
    model = MatricesModel(structure, [Tested(name=measured.name, pressure=np.nan, modes=measured)], scatter)
    zero = np.zeros(len(model.nuisances))
    before = _modes(model.about(model.nuisances, [zero]), zero, measured)
    _, explanation = begin(model, shares=SHARES, starts=[zero], priors=priors_of(scatter))
    shown = _shown(model, explanation, 0, threshold)
    pairing, modes = shown.pairing, shown.modes
    if not pairing.measured.size:
        raise FitError(
            f"{measured.name}: none of {measured.frequency.size} measured modes pairs with the model by a MAC of "
            f"{threshold:g}; the largest is {pairing.mac.max():.2f}. Check point numbers, places, directions and signs"
        )
    first = pair(measured, before, threshold=0.0)
    paired = {int(r): int(s) for r, s in zip(first.measured, first.model, strict=True)}
    column = [paired[int(r)] for r in pairing.measured]
    return MatricesFit(
        name=measured.name,
        modes=modes,
        pairing=pairing,
        distance=shown.distance,
        error=shown.error,
        moved=model.moved(explanation),
        at_bound=_at_bound(explanation),
        together=_together(model, explanation),
        initial_error=frequency_error(measured.frequency[pairing.measured], before.frequency[column]),
        initial_mac=first.mac[pairing.measured, column],
        stated_error=float(np.mean((measured.frequency_std / measured.frequency)[pairing.measured])),
    )


def _shown(model: MatricesModel, explanation: Explanation, state: int, threshold: float) -> ModelFit:
    """Put the model with an explanation beside the modes of a configuration."""
    tested = model.tested[state]
    measured = cast("ModalModel", tested.modes)
    modes = _modes(model.about(explanation.coordinates, [explanation.x]), explanation.x, measured, state)
    pairing = pair(measured, modes, threshold=threshold)
    frequency = measured.frequency[pairing.measured]
    return ModelFit(
        name=tested.name,
        modes=modes,
        pairing=pairing,
        distance=model.observed[state].distance,
        error=frequency_error(frequency, modes.frequency[pairing.model]) if frequency.size else float("nan"),
    )


def _at_bound(explanation: Explanation) -> tuple[str, ...]:
    return tuple(c.name for c, ends in zip(explanation.coordinates, explanation.at_bound, strict=True) if ends)


def _modes(local: LocalModel, x: Vector, measured: ModalModel, state: int = 0) -> Modes:
    """Return the elastic modes at the measured points at some coordinates."""
    modal = local.modal(x, state)
    value, shape = modal.eigenvalue[modal.n_rigid :], modal.rows[:, modal.n_rigid :]
    frequency = np.sqrt(np.maximum(value, 0.0)) / (2.0 * np.pi)
    loss = np.einsum("ii->i", modal.damping[0])[modal.n_rigid :]
    damping = loss / (4.0 * np.pi * frequency) if np.any(loss) else np.full(loss.size, np.nan)
    return modes_at(frequency, damping, shape, measured.node, measured.direction)


def modes_at(frequency: Vector, damping: Vector, shape: Vector, node: NDArray[np.int64], direction: Vector) -> Modes:
    """Return modes, (n,) Hz and (n,), with their shapes at some components, (n_dof, n)."""
    n = frequency.size
    return Modes(
        frequency=frequency,
        damping=damping,
        pole_frequency=frequency,
        shape=shape,
        node=node,
        direction=direction,
        n_rigid=0,
        parameter=(),
        frequency_gradient=np.zeros((n, 0)),
        damping_gradient=np.zeros((n, 0)),
        shape_gradient=np.zeros((len(node), n, 0)),
        coordinate=np.zeros((0, n)),
    )


def _together(
    model: MatricesModel, explanation: Explanation, *, narrowed: float = 0.5, shows: float = 0.9
) -> tuple[str, ...]:
    """Say which combinations of stated terms the data determine, where not each of them.

    A term is determined whose deviation fell below `narrowed` of that of its prior. Combinations are the principal
    directions of what the data leave in units of the priors; those are listed whose deviation fell below `shows`.
    """
    combined = 4  # terms of a combination that are named, and combinations
    names = [c.name for c in explanation.coordinates]
    stated = [i for i, n in enumerate(names) if n in {one.name for one in model.structure.factors}]
    vague = [names[i] for i in stated if explanation.std[i] > narrowed * explanation.coordinates[i].std]
    if len(vague) < 2:
        return ()
    _, jacobian, _ = whitened(explanation.problem, explanation.evidence.sizes)
    std = np.array([explanation.coordinates[i].std for i in stated])
    size, turn = la.eigh(std[:, None] * (jacobian[:, stated].T @ jacobian[:, stated]) * std)
    left = 1.0 / np.sqrt(1.0 + np.maximum(size, 0.0))
    parts = []
    for k in np.flatnonzero(left < shows)[::-1][:combined]:
        share = turn[:, k] * np.sign(turn[np.argmax(np.abs(turn[:, k])), k])
        large = [j for j in np.argsort(-np.abs(share))[:combined] if abs(share[j]) > 0.1]
        words = " ".join(f"{'+' if share[j] > 0 else '-'} {abs(share[j]):.2f} {names[stated[j]]}" for j in large)
        parts.append(f"{words.removeprefix('+ ')} (now known to {left[k]:.2g} of before)")
    number = f"{len(model.states[0].frequency)} modes"
    tell = f"; what they tell is mostly {'; '.join(parts)}" if parts else ", nor any combination of them"
    return (f"{model.tested[0].name}: {number} cannot tell these terms apart: {', '.join(vague)}{tell}",)


@single_threaded
def diagnose_matrices(
    structure: MatrixStructure,
    tested: Sequence[tuple[str, ModalModel]],
    *,
    scatter: DiagnosisScatter | None = None,
    asked: Sequence[Sequence[str]] = (),
) -> Diagnosis:
    """Say what the model of a structure lacks.

    Parameters
    ----------
    structure : MatrixStructure
        The structure.
    tested : sequence of (str, ModalModel)
        Name and identified modes of each configuration.
    scatter : DiagnosisScatter, optional
        What a laboratory knows of what separates a right model from a right measurement.
    asked : sequence of sequence of str
        Effects, or effects together, that are fitted and ranked in any case.

    Raises
    ------
    PairingError
        Measured points do not lie on the structure, or are fewer than the modes.
    """
    least_mac = 0.8  # that makes a pair in what is shown of a diagnosis
    for _, modes in tested:
        require_points(modes)
    scatter = scatter or DiagnosisScatter()
    reduced: list[ReducedMatrices] = []

    def make(tests: Sequence[Tested]) -> tuple[MatricesModel, list[Vector]]:
        model = MatricesModel(structure, tests, scatter, reduced=reduced)
        return model, [np.zeros(len(model.nuisances))]

    given = [Tested(name=name, pressure=np.nan, modes=modes) for name, modes in tested]
    node = [modes.node for _, modes in tested]
    model, found, mixed_up = search_corrected(make, given, node, shares=SHARES, priors=priors_of(scatter), asked=asked)
    decision = decide(found)
    shown = (found.base, *decision.left[:1])
    models = {one.name: tuple(_shown(model, x, c, least_mac) for x in shown) for c, one in enumerate(model.tested)}
    answer = replace(answer_of(model, found, decision, asked), mixed_up=mixed_up, models=models)
    return replace(answer, sentences=sentences(answer))
