"""What each physical effect does to the error, on data used and on data held out: as data and files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lamella_shared import csv_text
from updating.fitting.fit import ParameterEstimate
from updating.results.store import write_bytes, write_result


@dataclass(frozen=True, eq=False, kw_only=True)
class Entry:
    """One line of the ledger.

    Attributes
    ----------
    effects : tuple of str
        Effects that were added; none is the base model.
    error : float
        Mean relative frequency error, eq. (2), after the fit.
    mode_error : float
        The same of each mode of each configuration, predicted by a fit to all others.
    configuration_error : float
        The same of each configuration predicted by a fit without it. What it shares with no other, such as the contact
        parameters of a stack that was measured once, is fitted to it. NaN where there is one configuration only.
    damping_error, mode_damping_error, configuration_damping_error : float
        The same of damping ratios; NaN where they did not take part.
    chi_square : float
        Of the fit to all data; NaN of a table, whose modes have no stated uncertainty.
    n_residual : int
        Number of weighted differences in it.
    shared : tuple of ParameterEstimate
        The effects' parameters.
    pulled : tuple of str
        In words, what is known of the stack or of the measurement and would have to be far off: so the model could meet
        these data without more effects.
    """

    effects: tuple[str, ...]
    error: float
    mode_error: float
    configuration_error: float
    damping_error: float
    mode_damping_error: float
    configuration_damping_error: float
    chi_square: float
    n_residual: int
    shared: tuple[ParameterEstimate, ...]
    pulled: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Ledger:
    """The ledger as it is written."""

    entry: tuple[Entry, ...]


def write_ledger(
    entries: tuple[Entry, ...], options: Mapping[str, object], inputs: tuple[Path, ...], output: Path
) -> None:
    """Write ledger.json and ledger.csv."""
    write_result(output / "ledger.json", Ledger(entry=entries), inputs=inputs, options=options)
    columns = [
        "error", "mode_error", "configuration_error", "damping_error", "mode_damping_error",
        "configuration_damping_error", "chi_square", "n_residual",
    ]  # fmt: skip
    rows = ([" + ".join(("base", *e.effects)), *(getattr(e, c) for c in columns)] for e in entries)
    write_bytes(output / "ledger.csv", csv_text(["model", *columns], rows).encode())
