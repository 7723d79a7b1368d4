"""`lamella demo`: the whole story on a shipped campaign, from FRFs to what the model lacks."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from ema.types.threads import single_threaded
from updating.commands.diagnose import diagnose_campaign
from updating.commands.fit import Asked, campaign_ledger, fit_campaign
from updating.commands.report import make_report
from updating.commands.shipped import shipped_data
from updating.commands.terminal import OUT
from updating.diagnosis.answer import Diagnosis
from updating.errors import FitError
from updating.results.identified import Failed
from updating.results.text import percent

_LEAST_MAC = 0.8


@single_threaded
def demo_command(output: Path) -> None:
    """Tell the whole story on the shipped campaign."""
    campaign = shipped_data("demo_diagnosis") / "campaign.toml"
    _say(
        "A vibration test of a bolted stack of 240 sheets at two torques: a shaker, two accelerometers that rove over "
        "44 points. It was simulated with noise and tolerances by a model that shares nothing with this one."
    )
    done = [one for one in fit_campaign(campaign, output, _LEAST_MAC, OUT) if not isinstance(one, Failed)]
    modes = " and ".join(f"{own.modal_model.frequency.size} at {own.modal_model.name}" for own, _ in done)
    errors = " and ".join(f"{percent(fitted.error)} at {fitted.name}" for _, fitted in done)
    _say(f"1. Identify: {modes} are the modes that the functions show.")
    _say(f"2. Fit G_f and d_f: the model's frequencies are then off by {errors} in the mean.")
    answer = diagnose_campaign(campaign, output, (), OUT)
    _say(f"3. Diagnose: {answer.sentences[0]}")
    if not answer.set:
        message = f"{campaign}: nothing was named, where lost contact was planted"
        raise FitError(message)
    entries = campaign_ledger(done, Asked(effects=answer.set[0]), campaign, output)
    before, after = entries[0], entries[-1]
    _say(
        f"4. Add it: of modes that were fitted the error falls from {percent(before.error)} to {percent(after.error)}, "
        f"of modes that were not from {percent(before.mode_error)} to {percent(after.mode_error)}."
    )
    OUT.print(_mode_by_mode(answer))
    _say(f"Report: {make_report(output)}")
    _say(
        f"Step by step: lamella fit {campaign} -o {output}, then lamella diagnose with the same words; it ends with "
        "the command that adds what it found."
    )


def _say(sentence: str) -> None:
    OUT.print(sentence, markup=False, highlight=False)


def _mode_by_mode(answer: Diagnosis) -> Table:
    """Return the errors of all modes before and after."""
    table = Table(title="Frequency errors of the model", title_justify="left")
    for heading in ("mode", "measured [Hz]", "without [%]", "with [%]"):
        table.add_column(heading, justify="right")
    for own in answer.errors:
        table.add_row(
            f"{own.configuration}, {own.mode}",
            f"{own.frequency:.2f}",
            f"{100 * own.base:+.2f}",
            f"{100 * own.explained:+.2f}",
        )
    return table
