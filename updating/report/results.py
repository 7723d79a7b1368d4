"""What a results folder holds, read back for a report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from ema.campaign.campaign import Campaign, Configuration
from ema.types.frf import FRF
from ema.types.modal_model import ModalModel
from updating.diagnosis.answer import Diagnosis
from updating.errors import StoreError
from updating.fitting.fit import Fit
from updating.fitting.ledger import Entry, Ledger
from updating.fitting.modal_table import ModalTable, TableFit
from updating.results.pooled_answer import PooledDiagnosis
from updating.results.quality import Quality
from updating.results.store import folder_name, read_document, read_frf, read_result
from updating.results.updated import Updated

T = TypeVar("T")


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
    fit : Fit or None
        The fitted model.
    """

    name: str
    torque: float | None
    pressure: float | None
    folder: Path
    measured: ModalModel
    quality: Quality
    fit: Fit | None

    def frf(self) -> FRF:
        """Read the measured functions; they are not kept, so that a report of many configurations stays small."""
        return read_frf(self.folder / "measurement.npz")


@dataclass(frozen=True, eq=False, kw_only=True)
class Results:
    """Results of a campaign.

    Attributes
    ----------
    name : str
        The campaign.
    tested : tuple of Tested
        Its configurations, or
    table : tuple of TableFit
        its rows, where it was given as a table of modes; the other of the two is empty.
    shape_class : tuple of str
        Class of each mode of the table.
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
        The campaign file, as it was named; None for a table of modes.
    pooled : PooledDiagnosis or None
        What many specimens tell together, where the campaign lists them.
    origin : mapping of str to dict
        Provenance of every result file, by its path within the folder.
    """

    name: str
    tested: tuple[Tested, ...]
    table: tuple[TableFit, ...]
    shape_class: tuple[str, ...]
    missing: tuple[str, ...]
    ledger: tuple[Entry, ...]
    diagnosis: Diagnosis | None
    updated: Updated | None
    folder: Path
    campaign: Path | None
    pooled: PooledDiagnosis | None
    origin: dict[str, dict[str, Any]]


def read_results(folder: Path) -> Results:
    """Read everything in a results folder that a report shows.

    Raises
    ------
    StoreError
        The folder holds no result, or one that cannot be read.
    """
    if (folder / "pooled_diagnosis.json").exists():
        return _read_pooled(folder)
    if (folder / "modal_table.json").exists():
        found = _read_table(folder)
    elif (folder / "campaign.json").exists():
        found = _read_campaign(folder)
    else:
        message = (
            f"{folder}: no campaign.json to report on; make results with: lamella fit CAMPAIGN -o {folder}"
        )
        raise StoreError(message)
    if not found.tested and not found.table:
        message = (
            f"{folder}: none of its configurations is done; go on with: lamella fit CAMPAIGN -o {folder}"
        )
        raise StoreError(message)
    return found


def _read_campaign(folder: Path) -> Results:
    campaign = read_result(folder / "campaign.json", Campaign)
    own = {c.name: folder / folder_name(c.name) for c in campaign.configurations}
    done = [c for c in campaign.configurations if (own[c.name] / "modal_model.json").exists()]
    return Results(
        name=campaign.name,
        tested=tuple(_read_tested(own[c.name], c) for c in done),
        table=(),
        shape_class=(),
        missing=tuple(name for name in own if name not in {c.name for c in done}),
        ledger=_read_ledger(folder),
        diagnosis=_read_if_there(folder / "diagnosis.json", Diagnosis),
        updated=_read_if_there(folder / "update.json", Updated),
        folder=folder,
        campaign=campaign.path,
        pooled=None,
        origin=_origin(folder, [own[c.name] for c in done], ("modal_model.json", "fit.json")),
    )


def _read_tested(folder: Path, configuration: Configuration) -> Tested:
    return Tested(
        name=configuration.name,
        torque=configuration.torque,
        pressure=configuration.pressure,
        folder=folder,
        measured=read_result(folder / "modal_model.json", ModalModel),
        quality=read_result(folder / "quality.json", Quality),
        fit=_read_if_there(folder / "fit.json", Fit),
    )


def _read_table(folder: Path) -> Results:
    table = read_result(folder / "modal_table.json", ModalTable)
    own = {row.name: folder / f"stack_{folder_name(row.name)}" for row in table.rows}
    done = {name: path for name, path in own.items() if (path / "fit.json").exists()}
    return Results(
        name=table.name,
        tested=(),
        table=tuple(read_result(path / "fit.json", TableFit) for path in done.values()),
        shape_class=table.shape_class,
        missing=tuple(name for name in own if name not in done),
        ledger=_read_ledger(folder),
        diagnosis=_read_if_there(folder / "diagnosis.json", Diagnosis),
        updated=_read_if_there(folder / "update.json", Updated),
        folder=folder,
        campaign=None,
        pooled=None,
        origin=_origin(folder, list(done.values()), ("fit.json",)),
    )


def _read_pooled(folder: Path) -> Results:
    path = folder / "pooled_diagnosis.json"
    pooled = read_result(path, PooledDiagnosis)
    return Results(
        name=pooled.name,
        tested=(),
        table=(),
        shape_class=(),
        missing=(),
        ledger=(),
        diagnosis=None,
        updated=None,
        pooled=pooled,
        folder=folder,
        campaign=None,
        origin={path.name: read_document(path)["provenance"]},
    )


def _read_ledger(folder: Path) -> tuple[Entry, ...]:
    found = _read_if_there(folder / "ledger.json", Ledger)
    return () if found is None else found.entry


def _read_if_there(path: Path, kind: type[T]) -> T | None:
    return read_result(path, kind) if path.exists() else None


def _origin(folder: Path, done: list[Path], names: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    files = [path / name for path in done for name in names]
    files += [folder / name for name in ("ledger.json", "diagnosis.json", "update.json")]
    return {f.relative_to(folder).as_posix(): read_document(f)["provenance"] for f in files if f.exists()}
