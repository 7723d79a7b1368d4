"""A diagnosis as its user runs it: made once, read back while nothing that it came from has changed."""

import io
import itertools

import pytest
from rich.console import Console

import model
from ema import read_campaign
from updating.commands import diagnose as command
from updating.commands import fit as fit_command
from updating.commands.terminal import Run
from updating.diagnosis import cached_model
from updating.diagnosis.answer import Diagnosis, Sizes
from updating.diagnosis.diagnosis import diagnose
from updating.errors import FitError
from updating.report.results import read_results, with_models
from updating.results.ledger import Ledger
from updating.results.store import read_result
from updating.results.text import interval_text, percent
from updating.workbench import what_if
from updating.workbench.what_if import kept_reduction, outcome, tried_model, values_of
from updating.workbench.what_if_panel import fitted_sentence

CONSIDERED = ("clamp_mass", "pressure_exponent")


@pytest.mark.slow
def test_what_was_diagnosed_is_read_back_until_an_input_changes(write_small_campaign, tmp_path, monkeypatch):
    whole, made = model.catalogue(), []
    campaign, shown = write_small_campaign(tmp_path, 2), io.StringIO()
    console = Console(file=shown, force_terminal=True, width=100)

    def counted(*given, **options):
        made.append(diagnose(*given, **options))
        return made[-1]

    monkeypatch.setattr(command, "catalogue", lambda _: {name: whole[name] for name in CONSIDERED})
    monkeypatch.setattr(command, "diagnose_stack", counted)
    monkeypatch.setattr(cached_model, "folder", lambda: tmp_path / "cache")
    first, second = (
        command.diagnose_campaign(Run(campaign=campaign, output=tmp_path / "out", console=console)) for _ in range(2)
    )
    assert len(made) == 1
    for stage in ("reduce the model with 2 effects", "fit 2 effects, each alone"):
        assert f"diagnose: {stage}" in shown.getvalue()
    assert second.sentences == first.sentences == made[0].sentences
    assert repr(second.ranking) == repr(first.ranking)  # what is not a number is not equal to itself

    def here(*given, scatter, reduced, **_):
        made.append(diagnose(*given, scatter=scatter, reduced=reduced))
        return made[-1]

    monkeypatch.setattr(command, "diagnose_stack", here)
    campaign.write_text(campaign.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    command.diagnose_campaign(Run(campaign=campaign, output=tmp_path / "out", console=console))
    assert len(made) == 2
    assert repr(made[1].ranking) == repr(made[0].ranking)  # wherever it was made, and with a model that was read back
    scatter = tmp_path / "scatter.toml"
    scatter.write_text("frequency = 0.2\ndamping = 0.9\n", encoding="utf-8")
    doubtful = command.diagnose_campaign(
        Run(campaign=campaign, output=tmp_path / "out", scatter_file=scatter, console=console)
    )
    assert doubtful.ranking[0].log_odds < made[1].ranking[0].log_odds - 5.0
    assert doubtful.discrepancy == Sizes(frequency=0.2, damping=0.9)
    assert doubtful.too_large == ()
    scatter.write_text("frequenzy = 0.02\nyoung = 2.0\n", encoding="utf-8")
    with pytest.raises(FitError, match=r"(?s)scatter.toml: young.*scatter.toml: .*frequenzy.*frequency"):
        command.diagnose_campaign(
            Run(campaign=campaign, output=tmp_path / "out", scatter_file=scatter, console=console)
        )


@pytest.mark.slow
def test_a_fit_with_an_effect_prints_the_numbers_of_the_diagnosis(write_small_campaign, tmp_path, monkeypatch):
    whole, made, campaign = model.catalogue(), [], write_small_campaign(tmp_path, 2)
    scatter = tmp_path / "scatter.toml"
    scatter.write_text("frequency = 0.05\n", encoding="utf-8")

    def counted(*given, **options):
        made.append(diagnose(*given, **options))
        return made[-1]

    monkeypatch.setattr(command, "catalogue", lambda _: {name: whole[name] for name in CONSIDERED})
    monkeypatch.setattr(command, "diagnose_stack", counted)
    monkeypatch.setattr(what_if, "catalogue", lambda: {name: whole[name] for name in CONSIDERED})
    monkeypatch.setattr(cached_model, "folder", lambda: tmp_path / "cache")
    shown, out = io.StringIO(), tmp_path / "out"
    monkeypatch.setattr(fit_command, "OUT", Console(file=shown, width=250))
    command.diagnose_campaign(Run(campaign=campaign, output=out, scatter_file=scatter, console=Console(quiet=True)))
    fit_command.fit_command(Run(campaign=campaign, output=out, scatter_file=scatter), 0.8, ["clamp_mass"])
    assert len(made) == (1 if made[0].has(("clamp_mass",)) else 2)  # where it can, it is the one that was there
    found = read_result(out / "diagnosis.json", Diagnosis)
    base, added = read_result(out / "ledger.json", Ledger).entry
    for entry, effects in ((base, ()), (added, ("clamp_mass",))):
        one = found.ranked(effects)
        numbers = (entry.error, entry.mode_error, entry.configuration_error, entry.damping_error, entry.chi_square)
        assert numbers == pytest.approx(
            (
                one.frequency_error, one.left_out_error, one.left_out_configuration_error, one.damping_error,
                one.misfit,
            ),
            rel=0.0, abs=0.0, nan_ok=True,
        )  # fmt: skip
        assert entry.shared == one.parameter
        assert f"{100 * entry.frequency_error:.2f} | {100 * entry.damping_error:.2f}" in shown.getvalue()
    assert interval_text(found.ranked(("clamp_mass",)).parameter[0]) in shown.getvalue()
    assert_shown_alike(campaign, out, found)


def assert_shown_alike(campaign_file, out, found):
    """Report and workbench have the numbers of a diagnosis: of the base model, of the answer and of what was asked."""
    results = with_models(read_results(out))
    assert results.remarks == ()
    error = {names: found.ranked(names).frequency_error for names in ((), ("clamp_mass",))}
    answer = tuple(e for e in (found.set[0] if found.set else ()) if e not in found.measurement)
    assert mean_error(t.fit for t in results.tested) == pytest.approx(error[()], rel=1e-9)
    assert all((t.identified is not None) == bool(answer) for t in results.tested)
    if answer:
        named = found.ranked(found.set[0]).frequency_error
        assert mean_error(t.identified.fit for t in results.tested) == pytest.approx(named, rel=1e-9)
    assert f"{percent(error[()])} before and {percent(error['clamp_mass',])} after" in fitted_sentence(
        results, ["clamp_mass"]
    )
    campaign = read_campaign(campaign_file)
    kept = kept_reduction(results)
    assert kept is not None
    # With `clamp_mass`, which is wrong here, two modes lie within 0.5 % and pair with either.
    near = {effects: 1e-3 if effects in ((), answer) else 0.1 for effects in error}
    for effects, reduced in itertools.product(near, (None, kept)):
        shown = []
        for tested in results.tested:
            state = campaign.configuration(tested.name)
            tried = tried_model(results, tested, state, campaign.stack, effects, reduced)
            shown.append(outcome(tried, values_of(results, tested.name, effects)))
        n = sum(one.measured.size for one in shown)
        assert sum(one.error * one.measured.size for one in shown) / n == pytest.approx(
            error[effects], rel=near[effects]
        )


def mean_error(fits):
    """Return the mean frequency error of all pairs."""
    fits = list(fits)
    sizes = [fit.pairing.measured.size for fit in fits]
    return sum(fit.error * n for fit, n in zip(fits, sizes, strict=True)) / sum(sizes)
