"""What a results folder holds, read back for a report, and the base and identified model of each configuration."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from ema.campaign.campaign import Campaign, Configuration
from ema.modal.change import Change
from ema.modal.mac import frac
from ema.plot.figures import within_band
from ema.types.frf import FRF, Dofs
from ema.types.modal_model import ModalModel
from lamella_shared import Complexes, Reals
from model import catalogue, find_effects
from updating.correlation.rig_check import RigCheck
from updating.diagnosis.answer import Diagnosis
from updating.diagnosis.explained_model import Updated, explained_model, explained_stack
from updating.errors import LAMELLA_ERRORS, PairingError, StoreError
from updating.fitting.fit import Fit, ModelFit, ParameterEstimate, fit
from updating.fitting.plots import fitted_frf
from updating.results.campaign import CHANGE, WHAT_CHANGED
from updating.results.identified import Quality, campaign_file
from updating.results.ledger import Entry, Ledger
from updating.results.pooled import PooledDiagnosis
from updating.results.store import file_digest, folder_name, is_intact, kept, read_document, read_frf, read_result
from updating.results.what_changed import WhatChanged
from updating.workers.workers import distribute

if TYPE_CHECKING:
    from updating.diagnosis.matrices_answer import MatricesFit

T = TypeVar("T")
_MADE = ("modal_model.json", "measurement.npz")
"""Files that results come from and that are results themselves: another run may have put others in their place."""


@dataclass(frozen=True, eq=False, kw_only=True)
class IdentifiedModel:
    """The model of one configuration with what was identified.

    Attributes
    ----------
    effects : tuple of str
        What was added to the base model.
    value : mapping of str to float
        Values of the effects' parameters.
    fit : ModelFit
        The model with them, and its modes.
    base_frac, frac : float
        FRAC of measured functions with those of the base model and of this one, in the mean over all; NaN where no
        functions were measured, or where nothing says where the force acted.
    """

    effects: tuple[str, ...]
    value: Mapping[str, float]
    fit: Fit | ModelFit  # of a stack, or of matrices: each is read back as what it was
    base_frac: float
    frac: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Tested:
    """One configuration that was identified, and fitted or not.

    Attributes
    ----------
    name : str
        The configuration.
    torque : float or None
        Bolt torque, N m.
    pressure : float or None
        Mean surface pressure, Pa.
    folder : Path
        Where its results are.
    measured : ModalModel
        Identified modes.
    quality : Quality
        What the checks found.
    fit : ModelFit or None
        The base model: that of a diagnosis, where `identified_model.with_models` added it, else `opt`.
    opt : Fit or None
        G_f by opt_G and d_f by opt_d of this configuration alone, eq. (1).
    change : Change or None
        What differs from its reference, where it has one.
    what_changed : WhatChanged or None
        What that was, and where, by a model.
    reference : Tested or None
        The first configuration of its reference, where that has results.
    identified : IdentifiedModel or None
        The model with what was identified, where `identified_model.with_models` added it.
    """

    name: str
    torque: float | None
    pressure: float | None
    folder: Path
    measured: ModalModel
    quality: Quality
    fit: ModelFit | None
    opt: Fit | None = None
    change: Change | None = None
    what_changed: WhatChanged | None = None
    reference: Tested | None = None
    identified: IdentifiedModel | None = None

    @property
    def stack_fit(self) -> Fit | None:
        """The base model, where it is that of a stack."""
        return self.fit if isinstance(self.fit, Fit) else None

    @property
    def matrices_fit(self) -> MatricesFit | None:
        """The fit, where it is that of matrices."""
        if self.fit is None or isinstance(self.fit, Fit):
            return None
        # With all of a diagnosis, which few results need.
        from updating.diagnosis.matrices_answer import MatricesFit

        return self.fit if isinstance(self.fit, MatricesFit) else None

    @property
    def has_parameters(self) -> bool:
        """Whether parameters of a model were fitted to this configuration alone."""
        return self.opt is not None or self.matrices_fit is not None

    @property
    def shown(self) -> ModelFit | None:
        """The fit with what was identified, else that of the base model, else none."""
        return self.fit if self.identified is None else self.identified.fit

    @property
    def has_functions(self) -> bool:
        """Whether modes were identified from functions here, not read from another program's file."""
        return not self.measured.read_from

    @property
    def no_functions(self) -> str:
        """Say why there are no functions, where there are none."""
        name = Path(self.measured.read_from).name
        return f"its modes were read from {name}, not identified here, so there are no functions to show"

    def frf(self) -> FRF:
        """Read the measured functions; they are not kept, so that a report of many configurations stays small.

        Raises
        ------
        StoreError
            There are none, as the modes were read, or they cannot be read.
        """
        if not self.has_functions:
            raise StoreError(f"{self.name}: {self.no_functions}")
        return read_frf(self.folder / "measurement.npz")


@dataclass(frozen=True, eq=False, kw_only=True)
class Results:
    """Results of a campaign.

    Attributes
    ----------
    name : str
        The campaign.
    tested : tuple of Tested
        Its configurations.
    missing : tuple of str
        Configurations that are not done yet.
    ledger : tuple of Entry
        What each effect does to the error; empty where no effect was fitted.
    diagnosis : Diagnosis or None
        Which effect is missing, where that was asked.
    updated : Updated or None
        What an updating file made of all configurations together.
    folder : Path
        Where all this is.
    campaign : Path or None
        The campaign file, as it was named; None of specimens.
    pooled : PooledDiagnosis or None
        What many specimens tell together, where the campaign lists them.
    origin : mapping of str to dict
        Provenance of every result file, by its path within the folder.
    remarks : tuple of str
        Which results were changed, or come from other files than those beside them.
    about : tuple of (str, str)
        Title block, by name: project, author and date as far as the campaign states them.
    """

    name: str
    folder: Path
    origin: dict[str, dict[str, Any]]
    tested: tuple[Tested, ...] = ()
    missing: tuple[str, ...] = ()
    ledger: tuple[Entry, ...] = ()
    diagnosis: Diagnosis | None = None
    updated: Updated | None = None
    campaign: Path | None = None
    pooled: PooledDiagnosis | None = None
    remarks: tuple[str, ...] = ()
    about: tuple[tuple[str, str], ...] = ()


def read_results(folder: Path, *, keep: bool = False) -> Results:
    """Read everything in a results folder that a report shows.

    A fit, a ledger, a diagnosis or an updating that was changed after it was written, or that comes from other modes
    than those beside it, is left out, and the remarks say so.

    Parameters
    ----------
    folder : Path
        Folder of the results.
    keep : bool
        Whether such results are read, too; the remarks then say which they are.

    Raises
    ------
    StoreError
        The folder holds no result, one that cannot be read, or measured modes that were changed.
    """
    reader = _Reader(folder, keep=keep)
    for name in ("pooled_diagnosis.json", "pooled_fit.json"):  # a diagnosis says more
        if (folder / name).exists():
            pooled, remarks = reader.needed(folder / name, PooledDiagnosis), tuple(reader.remarks)
            return Results(name=pooled.name, folder=folder, origin=reader.origin, pooled=pooled, remarks=remarks)
    if not (folder / "campaign.json").exists():
        raise StoreError(
            f"{folder}: no campaign.json to report on; make results with: lamella fit CAMPAIGN -o {folder}"
        )
    results = _read_campaign(folder, reader)
    if not results.tested:
        raise StoreError(f"{folder}: none of its configurations is done; go on with: lamella fit CAMPAIGN -o {folder}")
    return results


class _Reader:
    """Reads results of a folder, and notes which of them are not what they were or belong to something else."""

    def __init__(self, folder: Path, *, keep: bool) -> None:
        self._folder, self._keep = folder, keep
        self._digests: dict[str, dict[Path, str]] = {}
        self.remarks: list[str] = []
        self.origin: dict[str, dict[str, Any]] = {}

    def needed(self, path: Path, kind: type[T]) -> T:
        """Return a result without which there is nothing to show; a fault is an error, or a remark if kept."""
        fault = self._fault(path)
        if fault and not self._keep:
            raise StoreError(f"{path}: {fault}; make it anew with the command that made it, or use it with --keep")
        return self._read(path, kind, fault)

    def optional(self, path: Path, kind: type[T]) -> T | None:
        """Return a result; None where there is none or it has a fault and is not kept."""
        if not path.exists():
            return None
        fault = self._fault(path)
        if fault and not self._keep:
            self._remark(path, f"{fault}, and is left out; make it anew with the command that made it, or use --keep")
            return None
        return self._read(path, kind, fault)

    def _read(self, path: Path, kind: type[T], fault: str) -> T:
        result = read_result(path, kind, edited=True)
        if fault:
            self._remark(path, f"{fault}, and is used all the same (--keep)")
        self.origin[path.relative_to(self._folder).as_posix()] = read_document(path)["provenance"]
        return result

    def _remark(self, path: Path, text: str) -> None:
        self.remarks.append(f"{path.relative_to(self._folder).as_posix()} {text}.")

    def _fault(self, path: Path) -> str:
        """Return what is wrong with the origin of a result; empty where all is well."""
        document = read_document(path)
        if not is_intact(document):
            return "was changed after it was written"
        for name, digest in document["provenance"]["inputs"].items():
            last = PurePosixPath(name).name
            digests = self._beside(path, name) if last in _MADE else ()
            if digests and digest not in digests:
                return f"comes from another {name} than is here"
        return ""

    def _beside(self, path: Path, name: str) -> Collection[str]:
        """Return the digests of the files that a result can come from.

        That is the one in the folder that its name says, else the one beside the result, else any of that name below.
        """
        stated, name = self._folder / name, PurePosixPath(name).name
        if name not in self._digests:
            self._digests[name] = {file: file_digest(file) for file in self._folder.rglob(name)}
        digests = self._digests[name]
        named = stated if stated in digests else path.parent / name
        return (digests[named],) if named in digests else digests.values()


def _read_campaign(folder: Path, reader: _Reader) -> Results:
    campaign = reader.needed(folder / "campaign.json", Campaign)
    folders = {c.name: folder / folder_name(c.name) for c in campaign.configurations}
    identified = [c for c in campaign.configurations if (folders[c.name] / "modal_model.json").exists()]
    del reader.origin["campaign.json"]
    named = {c.name: _read_tested(folders[c.name], c, reader) for c in identified}
    ledger = reader.optional(folder / "ledger.json", Ledger)
    diagnosis, updated = (
        reader.optional(folder / "diagnosis.json", Diagnosis),
        reader.optional(folder / "update.json", Updated),
    )
    about = (("Project", campaign.project), ("Author", campaign.author), ("Date of the test", campaign.date))
    return Results(
        name=campaign.name,
        folder=folder,
        origin=reader.origin,
        tested=tuple(
            tested if tested.change is None else replace(tested, reference=named.get(tested.change.reference[0]))
            for tested in named.values()
        ),
        missing=tuple(name for name in folders if name not in named),
        ledger=() if ledger is None else ledger.entry,
        diagnosis=diagnosis,
        updated=updated,
        campaign=_campaign_file(folder),
        remarks=tuple(reader.remarks),
        about=tuple((name, text) for name, text in about if text),
    )


def _campaign_file(folder: Path) -> Path:
    """Return the campaign file; as it was named where it is not there, for results can be read without it."""
    try:
        return campaign_file(folder)
    except StoreError:
        return read_result(folder / "campaign.json", Campaign, edited=True).path


def _read_tested(folder: Path, configuration: Configuration, reader: _Reader) -> Tested:
    fit = reader.optional(folder / "fit.json", _kind_of_fit(folder / "fit.json"))
    return Tested(
        name=configuration.name,
        torque=configuration.torque,
        pressure=configuration.pressure,
        folder=folder,
        measured=reader.needed(folder / "modal_model.json", ModalModel),
        quality=reader.needed(folder / "quality.json", Quality),
        fit=fit,
        opt=fit if isinstance(fit, Fit) else None,
        change=reader.optional(folder / CHANGE, Change) if configuration.compare_to else None,
        what_changed=reader.optional(folder / WHAT_CHANGED, WhatChanged) if configuration.compare_to else None,
    )


def _kind_of_fit(path: Path) -> type[ModelFit]:
    """Return what a fit is of: matrices, or a stack."""
    if not path.exists() or read_document(path)["kind"] == Fit.__name__:
        return Fit
    # With all of a diagnosis, which few results need.
    from updating.diagnosis.matrices_answer import MatricesFit

    return MatricesFit


FILE, BASE_FILE = "identified_model.json", "base_model.json"
"""Beside the modes of a configuration."""


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


def fracs(lines: FRF, value: Complexes) -> Reals:
    """Return the FRAC of every function at the first input with that of a model, (n_output,)."""
    return np.array([float(frac(a, b)) for a, b in zip(lines.value[:, 0], value, strict=True)])


def modelled(tested: Tested, model: Fit, lines: FRF) -> Complexes | None:
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
