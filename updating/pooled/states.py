"""Each specimen at each torque: its contact by that alone, all else as it was found for all, and its modes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from updating.diagnosis.discrepancy import KINDS
from updating.diagnosis.evidence import Evidence
from updating.diagnosis.explanation import TRUST, Z95
from updating.diagnosis.residual import Residual
from updating.fitting.estimate import ParameterEstimate
from updating.pooled.beside import Bench
from updating.pooled.fit import Fitted, Weighing
from updating.pooled.linear import Scales, strengths
from updating.results.pooled_answer import ContactState, ModeAnswer

Vector = NDArray[np.float64]

UNITS = {"G_f": "1", "d_f": "s/Pa"}
"""Contact parameters of a specimen, and their units."""
_VAGUE = 2.0
"""Standard deviation of the logarithm of a parameter at a torque about that of its specimen, beforehand: so wide that
data decide, and finite where there are none, such as no damping ratio."""
_TOLD = 0.5
"""Of that, from which on data tell nothing."""


def contact_states(bench: Bench, own: Fitted) -> tuple[tuple[ContactState, ...], ...]:
    """Estimate G_f and d_f of each specimen from the frequencies and damping ratios at one torque alone.

    One step of least squares from where the explanation stands; the discrepancy that specimens share is taken as found.

    Parameters
    ----------
    bench : Bench
        The specimens.
    own : Fitted
        The explanation.

    Returns
    -------
    (n_specimen,) tuple of (n_configuration,) ContactState
        With 95 % intervals. A law of pressure that the explanation has is taken out: where it is right, the parameters
        are the same at all torques.
    """
    weighing = Weighing(bench, own.linear, own.coordinates, own.at.coordinate)
    joint = weighing.joined(weighing.reduced(own.scales), own.scales)
    solution = joint.step(*weighing.bounds(), TRUST)
    n_mean = len(strengths(bench, 0, own.scales).mean)
    latent = solution[n_mean : solution.size - len(own.coordinates)]
    return tuple(
        tuple(_state(bench, own, latent, s, c) for c in range(len(beside.evidence.tested)))
        for s, beside in enumerate(bench.own)
    )


def _state(bench: Bench, own: Fitted, latent: Vector, s: int, c: int) -> ContactState:
    evidence, block = bench.own[s].evidence, own.linear.block[s]
    names = evidence.nuisances
    at = [names.index(name) for name in UNITS]
    rows = (evidence.rows.configuration == c) & (evidence.rows.kind != "shape")
    weight = _precision(block.kind[rows], block.growth[rows], own.scales)
    value, slope = (block.value - block.shared @ latent)[rows], block.own[rows][:, at]
    covariance = np.linalg.inv(slope.T @ (weight[:, None] * slope) + _VAGUE**-2.0 * np.eye(len(at)))
    step, std = -covariance @ slope.T @ (weight * value), np.sqrt(np.diag(covariance))
    logs = contact_logs(own, s, names)
    nominal = nominal_contact(bench, s)
    return ContactState(
        name=bench.own[s].specimen.tested[c][0],
        pressure=bench.own[s].specimen.tested[c][1],
        **{
            name: None
            if std[k] > _TOLD * _VAGUE
            else estimate(name, nominal[name], logs[name] + float(step[k]), float(std[k]))
            for k, name in enumerate(UNITS)
        },
    )


def _precision(kind: NDArray[np.str_], growth: Vector, scales: Scales) -> Vector:
    size = np.array([scales.own(name) for name in KINDS])
    return 1.0 / (1.0 + size[[KINDS.index(name) for name in kind]] ** 2 * growth)


def modes_told(evidence: Evidence, base: Residual, found: Residual) -> tuple[ModeAnswer, ...]:
    """Return the measured modes of a specimen beside those of two models, configuration by configuration.

    Parameters
    ----------
    evidence : Evidence
        The specimen's.
    base, found : Residual
        The base model, and what was found.
    """
    told: list[ModeAnswer] = []
    unknown = np.full(base.log_frequency.size, np.nan)
    damped = [own.log_damping if own.log_damping.size else unknown for own in (base, found)]
    for tested, used in zip(evidence.tested, evidence.used, strict=True):
        for r in used:
            i, modes = len(told), tested.modes
            measured = modes.damping_std[r] < modes.damping[r]
            told.append(
                ModeAnswer(
                    configuration=tested.name,
                    frequency=float(modes.frequency[r]),
                    damping=float(modes.damping[r]) if measured else float("nan"),
                    base_frequency=float(modes.frequency[r] * np.exp(-base.log_frequency[i])),
                    model_frequency=float(modes.frequency[r] * np.exp(-found.log_frequency[i])),
                    base_damping=float(modes.damping[r] * np.exp(-damped[0][i])),
                    model_damping=float(modes.damping[r] * np.exp(-damped[1][i])),
                )
            )
    return tuple(told)


def nominal_contact(bench: Bench, s: int) -> dict[str, float]:
    """Return what the contact parameters of a specimen are where its nuisances are 0."""
    evidence = bench.own[s].evidence
    start = np.zeros(len(evidence.nuisances))
    return {"G_f": evidence.stack.contact.G_f, "d_f": evidence.theta(start, 0)["d_f"]}


def contact_logs(own: Fitted, s: int, names: tuple[str, ...]) -> dict[str, float]:
    """Return the logarithms of a specimen's contact parameters over the nominal ones, shifts by terms included."""
    logs = {name: float(own.at.nuisance[s][names.index(name)]) for name in UNITS}
    for c, z in zip(own.coordinates, own.at.coordinate, strict=True):
        if c.name in logs and c.parameter is None and s in c.members:
            logs[c.name] += float(z)
    return logs


def estimate(name: str, nominal: float, log: float, std: float) -> ParameterEstimate:
    """Return a contact parameter with its 95 % interval."""
    value, lower, upper = (nominal * np.exp(log + Z95 * std * np.array([0.0, -1.0, 1.0]))).tolist()
    return ParameterEstimate(
        name=name, unit=UNITS[name], value=value, lower=lower, upper=upper, at_bound=False
    )
