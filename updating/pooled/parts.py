"""What is reported of the terms of an explanation: whose each is, and its parameters."""

from __future__ import annotations

import numpy as np

from updating.diagnosis.coordinates import scaled
from updating.diagnosis.evidence import DECAY, POINTS_SHIFT
from updating.fitting.fit import ParameterEstimate
from updating.inference.explain import Explanation
from updating.pooled.specimens_model import SpecimensModel
from updating.results.pooled import Part
from updating.results.text import Z95


def part_of(model: SpecimensModel, fit: Explanation, name: str, label: str, log_odds: float) -> Part:
    """Return a term of an explanation with its 95 % intervals.

    Parameters
    ----------
    model : SpecimensModel
        The model.
    fit : Explanation
        The explanation.
    name : str
        The term.
    label : str
        Its label.
    log_odds : float
        Its gain in log odds beside the other terms.
    """
    term, meant = model.terms[name], model.meant[name]
    shown = [c.name for c in term.coordinates] or list(term.frees)
    return Part(
        effect=meant.effect,
        label=label,
        level=meant.level.kind,
        of=meant.level.of,
        specimens=tuple(model.specimens[s].name for s in meant.level.members),
        parameter=tuple(estimate_of(model, fit, n) for n in shown),
        log_odds=log_odds,
    )


def estimate_of(model: SpecimensModel, fit: Explanation, name: str) -> ParameterEstimate:
    """Return a coordinate as the parameter that it is of; of a stated value the ratio, of a location the shift."""
    i = [c.name for c in fit.coordinates].index(name)
    c, local = fit.coordinates[i], model.scope(name).local
    ends = np.clip(fit.x[i] + Z95 * fit.std[i] * np.array([0.0, -1.0, 1.0]), c.lower, c.upper)
    unit = "1"
    if local in model.parameters:
        p = model.parameters[local]
        values, unit = [scaled(p, float(z))[0] for z in ends], p.unit
    elif local in (*model.first.places, POINTS_SHIFT):
        values, unit = ends.tolist(), "m"
    elif local == DECAY:
        values, unit = ends.tolist(), "1/s"
    else:
        values = np.exp(ends).tolist()
    return ParameterEstimate(
        name=local,
        unit=unit,
        value=float(values[0]),
        lower=float(min(values[1:])),
        upper=float(max(values[1:])),
        at_bound=bool(fit.at_bound[i]),
    )
