"""Measured configurations put beside the reduced model with all effects: what fits of them start from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.modal.mac import mac
from ema.types.modal_model import ModalModel
from model import Effect, Modes, Observation, Observed, ReducedEquations, Stack, contact_strain, observe, solve_modes
from updating.correlation.registration import register
from updating.diagnosis.candidates import G_F_RANGE, N_MODEL, CandidateModel
from updating.diagnosis.evidence import D_F_START, DiagnosisScatter, Tested, pair
from updating.diagnosis.slipping import AtLevel, silent_effects, strain_shares
from updating.errors import FitError

Vector = NDArray[np.float64]
Campaigned = tuple[str, float, ModalModel]  # name, pressure in Pa, identified modes

_TRIALS = 17


@dataclass(frozen=True, eq=False, kw_only=True)
class Assembled:
    """Configurations beside a model.

    Attributes
    ----------
    stack : Stack
        Without effects.
    tested : tuple of Tested
        The configurations.
    observation : tuple of Observation
        The measured points of each.
    effects : mapping of str to Effect
        Those that these data can show.
    impossible : mapping of str to str
        Why effects of the catalogue that are not among these cannot be.
    scatter : DiagnosisScatter
        What separates a right model from a right measurement.
    start : mapping of str to float
        ln G_f and ln d_f over the stack file's, near which the base model comes nearest; 0 without contact.
    """

    stack: Stack
    tested: tuple[Tested, ...]
    observation: tuple[Observation, ...]
    effects: Mapping[str, Effect]
    impossible: Mapping[str, str]
    scatter: DiagnosisScatter
    start: Mapping[str, float]


def assemble_evidence(
    candidates: CandidateModel,
    tested: Sequence[Campaigned],
    *,
    scatter: DiagnosisScatter | None = None,
    levels: Mapping[str, AtLevel] | None = None,
) -> Assembled:
    """Put measured configurations beside a model and look where its contact comes nearest to them.

    Parameters
    ----------
    candidates : CandidateModel
        The model.
    tested : sequence of (str, float, ModalModel)
        Name, pressure in Pa and identified modes of each configuration.
    scatter : DiagnosisScatter, optional
        What separates a right model from a right measurement.
    levels : mapping of str to AtLevel, optional
        Which force level each configuration is, by its name, where some are levels of one state.

    Raises
    ------
    FitError
        No configuration is given, or no measured mode of one resembles one of the model.
    PairingError
        Measured points do not lie on the stack.
    """
    if not tested:
        raise FitError("nothing to compare: no configuration was identified")
    base, silent = candidates.stack, silent_effects(candidates.effects, several_levels=bool(levels))
    observation = tuple(
        register(base, modes.geometry, modes.node, modes.direction).observation for _, _, modes in tested
    )
    configurations = _as_tested(tested, levels or {})
    observed = tuple(observe(candidates.system, o) for o in observation)
    touching = base.n_lamina > 1
    G_f = _nearest(candidates.system.equations, configurations, observed)
    if levels and touching:
        configurations = _with_contact_strain(candidates, configurations, observed, G_f, levels)
    d_f = np.log(D_F_START / base.contact.d_f) if base.contact.d_f > 0.0 else 0.0
    return Assembled(
        stack=base,
        tested=configurations,
        observation=observation,
        effects={name: effect for name, effect in candidates.effects.items() if name not in silent},
        impossible={**candidates.impossible, **silent},
        scatter=scatter or DiagnosisScatter(),
        start={
            "G_f": float(np.log(G_f / base.contact.G_f)) if touching else 0.0,
            "d_f": float(d_f) if touching else 0.0,
        },
    )


def _as_tested(given: Sequence[Campaigned], levels: Mapping[str, AtLevel]) -> tuple[Tested, ...]:
    states = {name: level.state for name, level in levels.items()}
    return tuple(Tested(name=name, pressure=p, modes=modes, state=states.get(name, "")) for name, p, modes in given)


def _with_contact_strain(
    candidates: CandidateModel,
    tested: Sequence[Tested],
    observed: Sequence[Observed],
    G_f: float,
    levels: Mapping[str, AtLevel],
) -> tuple[Tested, ...]:
    """Return the configurations with the strains that the contact has, by the base model's shapes, at their levels."""
    contact, with_strains = contact_strain(candidates.system), []
    for configuration, points in zip(tested, observed, strict=True):
        if configuration.name not in levels:
            with_strains.append(configuration)
            continue
        base = _solved(candidates.system.equations, configuration, points, G_f)
        column = np.argmax(mac(configuration.modes.shape, base.shape), axis=1)
        amplitude = levels[configuration.name].rms_motion / np.sqrt(np.mean(base.shape[:, column] ** 2, axis=0))
        coordinate = np.zeros((candidates.system.size, column.size))
        coordinate[: len(base.coordinate)] = base.coordinate[:, column]
        shares = [strain_shares(contact, x) for x in coordinate.T]
        strain = amplitude[:, None] * np.array(shares)
        with_strains.append(replace(configuration, strain=strain, motion=levels[configuration.name].motion))
    return tuple(with_strains)


def _solved(equations: ReducedEquations, configuration: Tested, observed: Observed, G_f: float) -> Modes:
    """Return the elastic modes of a configuration without effects."""
    known = {"pressure": configuration.pressure, **configuration.known}
    base = equations.base(("G_f", "d_f", *known))
    return solve_modes(
        base,
        G_f=G_f,
        d_f=D_F_START,
        n_mode=min(N_MODEL, base.size),  # one lamina without effects has few
        observation=replace(observed, reduced_rows=observed.reduced_rows[:, : base.size]),
        parameters=known,
        by=(),
    ).elastic()


def _nearest(equations: ReducedEquations, tested: Sequence[Tested], observed: Sequence[Observed]) -> float:
    """Return the G_f with which the base model has most of the measured modes, of those tried over its range.

    Raises
    ------
    FitError
        It has none of a configuration there.
    """
    G_f = min(np.geomspace(*G_F_RANGE, _TRIALS).tolist(), key=lambda trial: _far(equations, tested, observed, trial)[0])
    n_used = _far(equations, tested, observed, G_f)[1]
    unlike = [configuration.name for configuration, n in zip(tested, n_used, strict=True) if not n]
    if unlike:
        raise FitError(
            f"no measured mode of {' or '.join(unlike)} resembles one of the model, so nothing of it would be used; "
            "check points, directions and signs there, and that its files are of this stack"
        )
    return float(G_f)


def _far(
    equations: ReducedEquations, tested: Sequence[Tested], observed: Sequence[Observed], G_f: float
) -> tuple[float, list[int]]:
    """Return how far the measured modes are from the base model's in all, and how many of each it has."""
    mac_used = 0.6  # from which a measured mode counts as one that the model has
    cost, used = 0.0, []
    for configuration, points in zip(tested, observed, strict=True):
        modes = _solved(equations, configuration, points, G_f)
        row, column = pair(configuration.modes.shape, configuration.modes.frequency, modes.shape, modes.frequency)
        alike = mac(configuration.modes.shape, modes.shape)[row, column]
        far = np.log(configuration.modes.frequency[row] / modes.frequency[column])
        cost += float(np.sum(np.minimum((far / 0.2) ** 2, 1.0) + 1.0 - alike))
        used.append(int(np.count_nonzero(alike >= mac_used)))
    return cost, used
