"""The model with what was found: its modes and functions, G_f and d_f fitted again with the effects at their values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.modal.mac import frac
from ema.types.frf import FRF
from ema.types.geometry import Dofs
from model import catalogue, find_effects
from updating.correlation.frf_plot import within_band
from updating.errors import LAMELLA_ERRORS, PairingError
from updating.fitting.estimate import ParameterEstimate
from updating.fitting.fit import Fit, fit
from updating.fitting.fitted_frf import fitted_frf
from updating.report.results import IdentifiedModel, Results, Tested
from updating.results.store import kept, read_document
from updating.workers.workers import distribute

FILE = "identified_model.json"
"""Beside the fit of a configuration."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """What is added to the base model.

    Attributes
    ----------
    effects : tuple of str
        Names of effects.
    value : mapping of str to float
        Values of their parameters.
    source : Path
        File of the results that says so.
    """

    effects: tuple[str, ...]
    value: Mapping[str, float]
    source: Path


def what_was_found(results: Results) -> Found | None:
    """Return the effects that the results name, with their values; None where they name none that the model can have.

    A diagnosis names them; without one, the last model of the ledger does. What is wrong with the measurement, or with
    what a file states, changes no model.
    """
    if results.diagnosis is not None:
        if not results.diagnosis.set:
            return None
        effects, parameters = (
            results.diagnosis.set[0],
            results.diagnosis.ranked(results.diagnosis.set[0]).parameter,
        )
        effects = tuple(e for e in effects if e not in results.diagnosis.measurement)
        return _found(effects, parameters, results.folder / "diagnosis.json")
    if results.ledger:
        last = results.ledger[-1]
        return _found(last.effects, last.shared, results.folder / "ledger.json")
    return None


def _found(effects: tuple[str, ...], parameters: tuple[ParameterEstimate, ...], source: Path) -> Found | None:
    known = catalogue()
    if (
        not effects or not set(effects) <= known.keys()
    ):  # an effect from a file is code, which a report does not run
        return None
    own = {p.name for e in effects for p in known[e].parameters}
    return Found(
        effects=tuple(effects), value={p.name: p.value for p in parameters if p.name in own}, source=source
    )


def with_identified_models(results: Results, executor: Executor | None = None) -> Results:
    """Add to each configuration that was fitted the model with what was found; results without a finding stay.

    Each is written beside the fit, and read back as long as nothing that it comes from changes. Where the model cannot
    be solved so, a remark says why.

    Parameters
    ----------
    results : Results
        Of a campaign.
    executor : Executor, optional
        Where the models are solved; by default here.
    """
    found = what_was_found(results)
    if found is None:
        return results
    fitted = [tested for tested in results.tested if tested.fit is not None]
    made = dict(
        zip((t.name for t in fitted), distribute(partial(_attempted, found), fitted, executor), strict=True)
    )
    remarks = tuple(f"{name}: {own}" for name, own in made.items() if isinstance(own, str))
    tested = tuple(
        replace(t, identified=own) if isinstance(own := made.get(t.name), IdentifiedModel) else t
        for t in results.tested
    )
    origin = {
        f"{t.folder.name}/{FILE}": read_document(t.folder / FILE)["provenance"]
        for t in tested
        if t.identified is not None
    }
    return replace(
        results, tested=tested, remarks=(*results.remarks, *remarks), origin={**results.origin, **origin}
    )


def _attempted(found: Found, tested: Tested) -> IdentifiedModel | str:
    """Return the model of a configuration, or why there is none."""
    inputs = [found.source, tested.folder / "fit.json", tested.folder / "modal_model.json"]
    if tested.has_functions:
        inputs.append(tested.folder / "measurement.npz")
    make: Callable[[], IdentifiedModel] = partial(identified_model, found, tested)
    try:
        return kept(tested.folder / FILE, IdentifiedModel, make, inputs=tuple(inputs), options={})
    except LAMELLA_ERRORS as error:
        return f"the model with what was found cannot be shown: {error}"


def identified_model(found: Found, tested: Tested) -> IdentifiedModel:
    """Fit G_f and d_f of one configuration again with effects at given values.

    Raises
    ------
    EffectError, FitError, PairingError, SolveError
        The stack cannot have the effects, or no mode pairs with them.
    """
    assert tested.fit is not None
    base = tested.fit
    stack = base.stack.with_effects(*find_effects(found.effects, catalogue()), **found.value)
    own = fit(stack, tested.measured, threshold=base.pairing.threshold)
    return IdentifiedModel(
        effects=found.effects,
        value=dict(found.value),
        fit=own,
        base_frac=mean_frac(tested, base),
        frac=mean_frac(tested, own),
    )


def mean_frac(tested: Tested, own: Fit) -> float:
    """Return the FRAC of measured and modelled functions in the band, in the mean; NaN where there is none."""
    if not tested.has_functions:
        return float("nan")
    lines = within_band(tested.frf(), tested.measured)
    value = modelled(tested, own, lines)
    return float("nan") if value is None else float(np.mean(fracs(lines, value)))


def fracs(lines: FRF, value: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the FRAC of every function at the first input with that of a model, (n_output,)."""
    return np.array([float(frac(a, b)) for a, b in zip(lines.value[:, 0], value, strict=True)])


def modelled(tested: Tested, own: Fit, lines: FRF) -> NDArray[np.complex128] | None:
    """Return a model's functions at the first input, (n_output, n_frequency) in the quantity of the lines.

    None where the points do not say where the force acted.
    """
    first = slice(0, 1)
    try:
        value = fitted_frf(
            own,
            tested.measured.geometry,
            output=lines.output,
            input=Dofs(node=lines.input.node[first], direction=lines.input.direction[first]),
            frequency=lines.frequency,
            quantity=lines.quantity,
        )
    except PairingError:
        return None
    return value[:, 0]
