"""`lamella demo`: every step on the campaign that travels with the program."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

from ema.types.arrays import single_threaded
from updating.commands.diagnose import diagnose_campaign
from updating.commands.fit import campaign_ledger, fit_campaign
from updating.commands.report import make_report
from updating.commands.terminal import OUT, Run
from updating.diagnosis.answer import Diagnosis
from updating.errors import FitError, StoreError
from updating.results.identified import Failed
from updating.results.text import Table, percent

_FOLDER = "share/lamella"

_CHECKOUT = Path(__file__).parents[2] / "data"


def shipped_data(name: str) -> Path:
    """Return a folder of data that travels with the program, as seen from the working directory where it is below.

    Parameters
    ----------
    name : str
        Such as "demo_diagnosis".

    Raises
    ------
    StoreError
        This installation lacks it.
    """
    folder = _CHECKOUT / name
    if not folder.is_dir():
        folder = _installed(name)
    here = Path.cwd()
    return folder.relative_to(here) if folder.is_relative_to(here) else folder


def _installed(name: str) -> Path:
    try:
        listed = files("lamella") or []
    except PackageNotFoundError:
        listed = []
    places = {Path(str(file.locate())).resolve().parent for file in listed if f"{_FOLDER}/{name}/" in file.as_posix()}
    top = min(places, key=lambda place: len(place.parts), default=None)
    if top is None or not top.is_dir():
        raise StoreError(
            f"this installation of Lamella lacks the data {name!r}: install it as built, or run in a checkout, "
            f"where it is data/{name}"
        )
    return top


@single_threaded
def demo_command(output: Path) -> None:
    """Take every step on the shipped campaign, and print what each shows."""
    campaign = shipped_data("demo_diagnosis") / "campaign.toml"
    run = Run(campaign=campaign, output=output)
    OUT.print(
        "A vibration test of a bolted stack of 240 sheets at two torques: a shaker, two accelerometers that rove over "
        "44 points. It was simulated with noise and tolerances by a model that shares nothing with this one."
    )
    done = [outcome for outcome in fit_campaign(run) if not isinstance(outcome, Failed)]
    modes = " and ".join(f"{result.modal_model.frequency.size} at {result.modal_model.name}" for result, _ in done)
    errors = " and ".join(f"{percent(fitted.error)} at {fitted.name}" for _, fitted in done)
    OUT.print(f"1. Identify: {modes} are the modes that the functions show.")
    OUT.print(f"2. Fit G_f and d_f: the model's frequencies are then off by {errors} in the mean.")
    answer = diagnose_campaign(run)
    OUT.print(f"3. Diagnose: {answer.sentences[0]}")
    if not answer.set:
        raise FitError(f"{campaign}: nothing was named, where lost contact was planted")
    entries = campaign_ledger(run, done, answer.set[0])
    before, after = entries[0], entries[-1]
    OUT.print(
        f"4. Add it: of modes that were fitted the error falls from {percent(before.error)} to {percent(after.error)}, "
        f"of modes that were not from {percent(before.mode_error)} to {percent(after.mode_error)}."
    )
    OUT.print(_mode_by_mode(answer))
    OUT.print(f"Report: {make_report(output)}")
    OUT.print(
        f"Step by step: lamella fit {campaign} -o {output}, then lamella diagnose with the same arguments; it ends "
        "with the command that adds what was identified."
    )


def _mode_by_mode(answer: Diagnosis) -> Table:
    """Return the errors of all modes before and after."""
    rows = [
        (f"{m.configuration}, {m.mode}", f"{m.frequency:.2f}", f"{100 * m.base:+.2f}", f"{100 * m.explained:+.2f}")
        for m in answer.errors
    ]
    return Table("Frequency errors of the model", ("mode", "measured [Hz]", "without [%]", "with [%]"), rows)
