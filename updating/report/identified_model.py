"""The models that a configuration is shown with: the base model, and the identified model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ema.modal.mac import frac
from ema.types.frf import FRF
from ema.types.geometry import Dofs
from model import catalogue, find_effects
from updating.correlation.plots import within_band
from updating.correlation.rig_check import RigCheck
from updating.diagnosis.answer import Diagnosis
from updating.diagnosis.explained_model import explained_model, explained_stack
from updating.errors import LAMELLA_ERRORS, PairingError
from updating.fitting.fit import Fit, ParameterEstimate, fit
from updating.fitting.plots import fitted_frf
from updating.report.results import IdentifiedModel, Results, Tested
from updating.results.store import kept, read_document
from updating.workers.workers import distribute

FILE, BASE_FILE = "identified_model.json", "base_model.json"
"""Beside the modes of a configuration."""

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Addition:
    """The effects that are added to the base model.

    Attributes
    ----------
    effects : tuple of str
        Names of effects.
    value : mapping of str to float
        Values of their parameters.
    source : Path
        File of the results that names them.
    """

    effects: tuple[str, ...]
    value: Mapping[str, float]
    source: Path


def identified_effects(results: Results) -> Addition | None:
    """Return the effects that the results name, with their values; None where the model can have none of them.

    A diagnosis names them; without one, the last model of the ledger does. Faults of the measurement, or of what a file
    states, change no model.
    """
    if results.diagnosis is not None:
        if not results.diagnosis.set:
            return None
        effects, parameters = (results.diagnosis.set[0], results.diagnosis.ranked(results.diagnosis.set[0]).parameter)
        effects = tuple(e for e in effects if e not in results.diagnosis.measurement)
        return _addition(effects, parameters, results.folder / "diagnosis.json")
    if results.ledger:
        last = results.ledger[-1]
        return _addition(last.effects, last.shared, results.folder / "ledger.json")
    return None


def _addition(effects: tuple[str, ...], parameters: tuple[ParameterEstimate, ...], source: Path) -> Addition | None:
    known = catalogue()
    if not effects or not set(effects) <= known.keys():  # an effect from a file is code, which a report does not run
        return None
    names = {p.name for e in effects for p in known[e].parameters}
    return Addition(
        effects=tuple(effects), value={p.name: p.value for p in parameters if p.name in names}, source=source
    )


def with_models(results: Results, executor: Executor | None = None) -> Results:
    """Add the base model and the identified model to each configuration.

    A diagnosis gives the numbers of both. Without one, but with effects in the ledger, G_f and d_f are fitted again
    with these effects. Models are written beside the configuration, and read back until one of their inputs changes.
    Where a model cannot be solved, a remark says why.

    Parameters
    ----------
    results : Results
        Of a campaign.
    executor : Executor, optional
        Where the models are solved; by default here.
    """
    if results.diagnosis is not None and results.diagnosis.stack is None:
        return replace(results, tested=tuple(_with_made(results.diagnosis, t) for t in results.tested))
    addition = identified_effects(results)
    if results.diagnosis is None and addition is None:
        return results
    with_base = [t for t in results.tested if results.diagnosis is not None or t.fit is not None]
    attempt = partial(_attempted, results.diagnosis, addition, results.folder)
    by_name = {t.name: (t, remark) for t, remark in distribute(attempt, with_base, executor)}
    tested = tuple(by_name[t.name][0] if t.name in by_name else t for t in results.tested)
    files = [t.folder / name for t in tested for name in (BASE_FILE, FILE) if t.name in by_name]
    origin = {f"{file.parent.name}/{file.name}": read_document(file)["provenance"] for file in files if file.exists()}
    return replace(
        results,
        tested=tested,
        remarks=(*results.remarks, *(remark for _, remark in by_name.values() if remark)),
        origin={**results.origin, **origin},
    )


def _with_made(diagnosis: Diagnosis, tested: Tested) -> Tested:
    """Return a configuration with the models of matrices that a diagnosis holds."""
    base, *others = diagnosis.models.get(tested.name, (tested.fit,))
    if not others:
        return replace(tested, fit=base)
    nan, answer = float("nan"), diagnosis.ranked(diagnosis.set[0])
    value = {p.name: p.value for p in answer.parameter}
    identified = IdentifiedModel(effects=answer.effects, value=value, fit=others[0], base_frac=nan, frac=nan)
    return replace(tested, fit=base, identified=identified)


def _attempted(
    diagnosis: Diagnosis | None, addition: Addition | None, folder: Path, tested: Tested
) -> tuple[Tested, str]:
    """Return a configuration with its models and no remark, or as it is with a remark that says why."""
    source = folder / "diagnosis.json" if addition is None else addition.source
    inputs = [source, tested.folder / "modal_model.json"]
    if tested.has_functions:
        inputs.append(tested.folder / "measurement.npz")

    def read(name: str, kind: type[T], make: Callable[[], T]) -> T:
        return kept(tested.folder / name, kind, make, inputs=tuple(inputs), options={})

    try:
        if diagnosis is not None:
            base = read(BASE_FILE, Fit, partial(_modelled, diagnosis, tested, (), ()))
            tested = replace(tested, fit=base)
        else:
            inputs.append(tested.folder / "fit.json")
        if addition is not None:
            identified = read(FILE, IdentifiedModel, partial(identified_model, diagnosis, addition, tested))
            tested = replace(tested, identified=identified)
    except LAMELLA_ERRORS as error:
        return tested, f"{tested.name}: the model of the answer cannot be shown: {error}."
    return tested, ""


def _modelled(diagnosis: Diagnosis, tested: Tested, explanation: Sequence[str], effects: Sequence[str]) -> Fit:
    """Return the model of a configuration with the numbers of an explanation, and its effects that change the stack."""
    assert diagnosis.stack is not None
    answer = diagnosis.ranked(explanation)
    known = find_effects(effects, catalogue())
    stack = explained_stack(diagnosis.stack, answer, known, state=tested.name, pressure=tested.pressure)
    plain = RigCheck(name=tested.name, sensor=0, reads=1.0, force=None)
    rig = next((check for check in diagnosis.rig if check.name == tested.name), plain)
    return explained_model(stack, tested.measured, answer.modelled.get(tested.name, ()), rig)


def identified_model(diagnosis: Diagnosis | None, addition: Addition, tested: Tested) -> IdentifiedModel:
    """Return the identified model of a configuration that has its base model.

    Its numbers are those of the diagnosis; without one, effects have their values, and G_f and d_f are fitted again.

    Raises
    ------
    EffectError, FitError, PairingError, SolveError
        The stack cannot have the effects, or no measured mode pairs with a mode of the model.
    """
    base = tested.stack_fit
    assert base is not None
    if diagnosis is not None:
        changed = _modelled(diagnosis, tested, diagnosis.set[0], addition.effects)
    else:
        stack = base.stack.with_effects(*find_effects(addition.effects, catalogue()), **addition.value)
        changed = fit(stack, tested.measured, threshold=base.pairing.threshold)
    return IdentifiedModel(
        effects=addition.effects,
        value=dict(addition.value),
        fit=changed,
        base_frac=mean_frac(tested, base),
        frac=mean_frac(tested, changed),
    )


def mean_frac(tested: Tested, model: Fit) -> float:
    """Return the mean FRAC of measured and modelled functions in the band; NaN where there are no functions."""
    if not tested.has_functions:
        return float("nan")
    lines = within_band(tested.frf(), tested.measured)
    value = modelled(tested, model, lines)
    return float("nan") if value is None else float(np.mean(fracs(lines, value)))


def fracs(lines: FRF, value: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the FRAC of every function at the first input with that of a model, (n_output,)."""
    return np.array([float(frac(a, b)) for a, b in zip(lines.value[:, 0], value, strict=True)])


def modelled(tested: Tested, model: Fit, lines: FRF) -> NDArray[np.complex128] | None:
    """Return a model's functions at the first input, (n_output, n_frequency) in the quantity of the lines.

    None where the points do not say where the force acted.
    """
    first = slice(0, 1)
    try:
        value = fitted_frf(
            model,
            tested.measured.geometry,
            output=lines.output,
            input=Dofs(node=lines.input.node[first], direction=lines.input.direction[first]),
            frequency=lines.frequency,
            quantity=lines.quantity,
        )
    except PairingError:
        return None
    return value[:, 0]
