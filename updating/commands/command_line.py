"""The command line: one command for each job, and errors that say what would be right."""

from __future__ import annotations

import sys
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from ema.types.threads import single_threaded
from model import catalogue, find_effects
from updating.blind import jobs as blind_jobs
from updating.commands import jobs, ledger_jobs, tables, update_job
from updating.commands.options import (
    CampaignFile,
    Cluster,
    EffectFiles,
    Folder,
    ResultsFolder,
    ScatterFile,
    SharedEffects,
)
from updating.commands.view import view as view_results
from updating.errors import LAMELLA_ERRORS
from updating.fitting.modal_table import is_modal_table
from updating.published import jobs as published_jobs
from updating.published.campaign import CALIBRATIONS, read_published
from updating.published.tables import screening_table, summary_table
from updating.published.verdict import published_verdict
from updating.report.pdf import print_pdf
from updating.results.identified import Identified

app = typer.Typer(
    name="lamella",
    help=(
        "From the measured FRFs of a laminated steel stack to a validated model.\n\n"
        "A campaign file (TOML) says where the FRFs are, at which points they were measured and at which bolt torques; "
        "a stack file says what the stack is made of. Start with **lamella demo**, or read the campaign file "
        "in data/demo_stack line by line."
    ),
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
)
_OUT = Console() if sys.stdout.isatty() else Console(width=100)  # a file or pipe has no width of its own
_ERR = Console(stderr=True)

_INTERRUPTED = 130
"""Exit code of a command that Ctrl-C ended (128 and the number of its signal)."""


@app.command(epilog="Example: lamella ema data/demo_stack/campaign.toml -o out/demo")
def ema(
    campaign: CampaignFile,
    output: Folder,
    poles: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of earlier results whose edited poles.txt files are used."),
    ] = None,
    cluster: Cluster = None,
) -> None:
    """Identify frequencies, damping ratios and mode shapes of every configuration of a campaign.

    Poles come from the LSCF method and are chosen without any frequency guess. Writes for each configuration
    modal_model.json, modes.uff (points, modes, synthesised FRFs), modes.csv, shapes.csv and pictures, and a
    comparison of all configurations. To choose by hand, edit poles.txt there and run again with --poles DIR.
    """
    identified, comparison = jobs.identify(campaign, output, poles, _OUT, cluster)
    for found in identified:
        _OUT.print(tables.modes_table(found.modal_model))
        _print_findings(found)
    if len(identified) > 1:
        _OUT.print(tables.comparison_table(comparison))
    _OUT.print(f"Results in [bold]{output}[/bold]; make a page of them with: lamella report {output}")


@app.command(epilog="Example: lamella pick data/demo_stack/campaign.toml M1 -o out/demo")
def pick(
    campaign: CampaignFile,
    configuration: Annotated[
        str,
        typer.Argument(metavar="CONFIGURATION", help="Its name in the campaign file.", show_default=False),
    ],
    output: Folder,
) -> None:
    """Choose the poles of one configuration by clicks in its stabilisation chart.

    A left click adds the nearest pole, a right click takes one away; closing the window writes poles.txt, which
    **lamella ema ... --poles DIR** uses. Needs a display; without one, edit poles.txt with any editor.
    """
    _OUT.print(f"Poles: [bold]{jobs.pick(campaign, configuration, output)}[/bold]")


@app.command(epilog="Example: lamella model data/demo_stack/stack.toml -o out/stack")
def model(
    stack: Annotated[Path, typer.Argument(metavar="STACK", help="Stack file (TOML).", show_default=False)],
    output: Folder,
    modes: Annotated[
        int, typer.Option("--modes", "-n", min=1, max=200, help="Number of elastic modes.")
    ] = 10,
    tolerance: Annotated[
        float, typer.Option(min=1e-7, max=1e-2, help="Relative error that a frequency may have.")
    ] = 1e-4,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME[:parameter=value,...]",
            help="Physical effect, at its nominal strength but for the values given; may be given several times.",
        ),
    ] = None,
    effect_file: EffectFiles = None,
) -> None:
    """Solve the model of a stack: natural frequencies, damping ratios, shapes, and the pressure between laminas.

    Each frequency has an error estimated from the equations of all laminas; where it exceeds the tolerance, the basis
    is enriched or all laminas are solved, and the table says so. Where the stack file has a table [pressing], the
    static stage comes first. Writes modes.json, verification.json, pressure.json and pictures.
    Physical effects beyond the base model are added with --effect; **lamella effects** lists them.
    """
    added = jobs.AddedEffects(option=tuple(effect or ()), file=tuple(effect_file or ()))
    solved = jobs.solve(stack, output, modes, tolerance, _OUT, added)
    if solved.pressure is not None:
        _OUT.print(tables.pressure_table(solved.pressure))
    _OUT.print(tables.model_table(solved.stack, solved.modes, solved.shape_class, solved.verification))
    _OUT.print(f"Results in [bold]{output}[/bold]")


@app.command(
    epilog="Example: lamella effects clamp_inertia --stack data/demo_stack/stack.toml -o out/effects"
)
def effects(
    name: Annotated[
        str | None, typer.Argument(metavar="EFFECT", help="Effect to explain.", show_default=False)
    ] = None,
    stack: Annotated[
        Path | None, typer.Option(metavar="STACK", help="Stack file (TOML) on which the effect is tried.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="DIR", help="Folder for the picture.")
    ] = None,
    effect_file: EffectFiles = None,
) -> None:
    """List the physical effects that a stack can have beyond the base model, or explain one.

    With the name of an effect: what it is, where it enters, its parameters, and what it is mistaken for. With a stack
    file too: what it does to the first modes of that stack at 160 and 320 kPa (M1 and M2 of the paper), computed at its
    nominal strength; with -o a picture of it. An effect of your own file is checked as well.
    """
    if name is None:
        if stack is not None or output is not None:
            message = "which effect? give its name with --stack and -o, such as lamella effects clamp_inertia"
            raise typer.BadParameter(message)
        for table in tables.effect_tables(catalogue(effect_file or ())):
            _OUT.print(table)
        _OUT.print("More about one: lamella effects NAME --stack STACK")
        return
    if stack is None and output is not None:
        message = "-o needs a stack for the picture; give it with --stack"
        raise typer.BadParameter(message)
    explained = jobs.explain(name, stack, output, effect_file or (), _OUT)
    _OUT.print(tables.effect_text(explained.effect), markup=False, highlight=False)
    _OUT.print(tables.parameter_table(explained.effect))
    for fault in explained.faults:
        _OUT.print(f"Fault: {fault}", style="bold red", markup=False, highlight=False)
    if explained.signature is None:
        _OUT.print("What it does to your stack: add --stack STACK")
    else:
        _OUT.print(tables.signature_table(explained.signature))
    if explained.faults:
        raise typer.Exit(1)


@app.command(epilog="Example: lamella fit data/pirnat2013/campaign.toml -o out/pirnat2013")
def fit(
    campaign: CampaignFile,
    output: Folder,
    threshold: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Smallest MAC that makes a pair of modes.")
    ] = 0.8,
    effect: SharedEffects = None,
    cluster: Cluster = None,
) -> None:
    """Identify a campaign, fit contact stiffness G_f and contact damping d_f, and write the report.

    G_f minimises opt_G and d_f minimises opt_d; modes are paired by MAC. A campaign whose modes are
    given as a table is fitted row by row, with modes paired by shape class.

    With --effect, effects whose parameters all configurations share are added, each alone and all together, with one
    contact law for all torques of a stack, and the ledger says what each does to the error on data fitted and on data
    held out.
    """
    find_effects(effect or [], catalogue())  # before hours of work
    if is_modal_table(campaign):
        rows = jobs.fit_modal_table(campaign, output, _OUT, cluster)
        _OUT.print(tables.modal_table(rows))
        if effect:
            _OUT.print(
                ledger_jobs.ledger_table(ledger_jobs.table_ledger(rows, effect, campaign, output, cluster))
            )
        _OUT.print(f"Report: [bold]{jobs.report(output)}[/bold]")
        return
    fits = []
    for found, fitted in jobs.fit(campaign, output, threshold, _OUT, cluster):
        _OUT.print(tables.fit_table(found.modal_model, fitted))
        _print_findings(found)
        if effect:  # without, a campaign of any length takes the same memory
            fits.append((found, fitted))
    if effect:
        _OUT.print(
            ledger_jobs.ledger_table(ledger_jobs.campaign_ledger(fits, effect, campaign, output, cluster))
        )
    _OUT.print(f"Report: [bold]{jobs.report(output)}[/bold]")


@app.command(epilog="Example: lamella update data/demo_stack/update.toml -o out/update")
def update(
    specification: Annotated[
        Path, typer.Argument(metavar="SPEC", help="Updating file (TOML).", show_default=False)
    ],
    output: Folder,
    effect_file: EffectFiles = None,
    cluster: Cluster = None,
) -> None:
    """Fit several configurations at once as a file says: parameters free, shared or fixed, priors, modes held out.

    data/demo_stack/update.toml has every key. Writes update.json with covariance and convergence record, ledger.json
    with the error without effects, with each and with all, and both as tables and pictures.
    """
    updated = update_job.update(specification, output, _OUT, effect_file or (), cluster)
    _OUT.print(update_job.parameter_table(updated.fit))
    _OUT.print(ledger_jobs.ledger_table(updated.ledger))
    _OUT.print(f"Results in [bold]{output}[/bold]")


@app.command(epilog="Example: lamella published --calibration C1 -o out/published")
def published(
    output: Folder,
    calibration: Annotated[
        list[str] | None,
        typer.Option(help="C0, C1, C2 or C3; may be given several times. All four by default."),
    ] = None,
    effect: SharedEffects = None,
    screen: Annotated[
        float | None,
        typer.Option(
            metavar="MINUTES",
            min=0.0,
            help="Try all effects and the best pairs too, under each calibration until so much processor time is used.",
            show_default=False,
        ),
    ] = None,
    data: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the published tables.")] = Path(
        "data/pirnat2013"
    ),
    cluster: Cluster = None,
) -> None:
    """Reproduce the published campaign of 18 stacks from its tables, then add effects that all stacks share.

    Writes for each calibration of planform and clamps what is fitted, with Tables 6 and 7 and figures 12 to 16 beside
    ours, the error with the effects, by default clamp_inertia, also with each stack left out in turn, and how contact
    stiffness grows with pressure. A calibration takes some minutes; trying all effects takes half an hour.
    """
    find_effects(effect or [], catalogue())
    calibrations = calibration or list(CALIBRATIONS)
    _OUT.print(
        summary_table(
            published_jobs.published(data, calibrations, effect or ["clamp_inertia"], output, _OUT, cluster)
        )
    )
    if screen is not None:
        found = published_jobs.screen_published(data, calibrations, screen, output, _OUT, cluster)
        _OUT.print(screening_table(found))
        _OUT.print(published_verdict(found, read_published(data).table), highlight=False)
    _OUT.print(f"Results in [bold]{output}[/bold]")


@app.command(epilog="Example: lamella diagnose data/hidden_effect/a/campaign.toml -o out/a")
def diagnose(
    campaign: CampaignFile,
    output: Folder,
    effect_file: EffectFiles = None,
    scatter: ScatterFile = None,
) -> None:
    """Say which physical effect the model lacks, how sure that is, what cannot be told apart, and what cannot be seen.

    All configurations of the campaign count together. Writes diagnosis.json; one that an earlier run left is read back.
    """
    found = jobs.diagnose(campaign, output, effect_file or [], _OUT, scatter)
    for sentence in found.sentences:
        _OUT.print(sentence, highlight=False)
    _OUT.print(tables.diagnosis_table(found))
    _OUT.print(f"Results in [bold]{output}[/bold]; make a page of them with: lamella report {output}")


@app.command(
    name="next-test", epilog="Example: lamella next-test data/hidden_effect/a/campaign.toml -o out/a"
)
def next_test(
    campaign: CampaignFile,
    output: Folder,
    effect_file: EffectFiles = None,
    scatter: ScatterFile = None,
) -> None:
    """Rank further tests by how well they would tell apart the explanations that a diagnosis leaves open.

    The diagnosis is made where the folder has none of this campaign.
    """
    found = jobs.diagnose(campaign, output, effect_file or [], _OUT, scatter)
    if not found.next_tests:
        _OUT.print(f"Nothing to separate: the verdict is {found.verdict!r}.", highlight=False)
        return
    _OUT.print(tables.next_test_table(found))


@app.command(epilog="Example: lamella report out/demo --pdf")
def report(
    folder: ResultsFolder,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Print report.pdf too, by an installed Chromium, Chrome or Edge.")
    ] = False,
) -> None:
    """Make one self-contained HTML page from the results in a folder.

    Every figure is also written to the folder figures there, with its numbers as CSV.
    """
    with _OUT.status("drawing"):
        page = jobs.report(folder)
    _OUT.print(f"Report: [bold]{page}[/bold]")
    if pdf:
        _OUT.print(f"PDF: [bold]{print_pdf(page)}[/bold]")


@app.command(epilog="Example: lamella view out/demo")
def view(
    folder: ResultsFolder,
    configuration: Annotated[
        str | None,
        typer.Argument(metavar="CONFIGURATION", help="Its name; the first by default.", show_default=False),
    ] = None,
) -> None:
    """Show mode shapes and stabilisation chart of one configuration.

    In a window where there is a display: drag to turn, choose the mode with the slider. Otherwise a page, view.html,
    is written and opened in the browser.
    """
    page = view_results(folder, configuration)
    if page is not None:
        _OUT.print(f"No display for a window; page: [bold]{page}[/bold]")


@app.command(epilog="Example: lamella simulate data/demo_stack/virtual_test.toml -o data/demo_stack")
def simulate(
    specification: Annotated[
        Path, typer.Argument(metavar="SPEC", help="Virtual test (TOML).", show_default=False)
    ],
    output: Folder,
    effect_file: EffectFiles = None,
) -> None:
    """Play a vibration test on a model and write its FRFs as a test system would.

    The truth goes to truth.json, which no other command reads. The same file and seed give the same bytes.
    """
    jobs.simulate(specification, output, effect_file or ())
    _OUT.print(f"Campaign: [bold]{output / 'campaign.toml'}[/bold]")


@app.command(epilog="Example: lamella blind data/demo_stack/virtual_test.toml -o out/blind")
def blind(
    specification: Annotated[
        Path, typer.Argument(metavar="SPEC", help="Virtual test (TOML).", show_default=False)
    ],
    output: Folder,
    full: Annotated[bool, typer.Option("--full", help="1300 cases instead of 134.")] = False,
    cluster: Cluster = None,
) -> None:
    """Diagnose virtual tests with sealed effects and print how often the answer was right.

    Each case is recorded in cases.jsonl as soon as it is done and is not run again; delete the file to begin anew.
    Kinds of cases are mixed, and a run that is interrupted prints the figures of those that it has.
    """
    try:
        cases = blind_jobs.run_blind(specification, output, _OUT, full=full, cluster=cluster)
    except KeyboardInterrupt:
        _OUT.print(blind_jobs.figures_table(blind_jobs.recorded(output)))
        raise
    _OUT.print(blind_jobs.figures_table(cases))


@app.command(epilog="Example: lamella demo")
def demo(output: Folder = Path("out/demo")) -> None:
    """Run the whole path on the shipped campaign data/demo_stack: identify, fit, report.

    Run it in the folder of the source checkout, where data/ is.
    """
    fit(Path("data/demo_stack/campaign.toml"), output)


def _print_findings(found: Identified) -> None:
    for line in found.quality.findings:
        _OUT.print(f"  {line}", markup=False, highlight=False)


def _version(wanted: bool) -> None:
    if wanted:
        _OUT.print(f"lamella {version('lamella')}")
        raise typer.Exit


@app.callback()
def _options(
    _: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    pass


def _say(message: str) -> None:
    """Print an error as it stands: what is in brackets is no markup, and lines are left for the terminal to break."""
    _ERR.print(Text.assemble(("Error:", "bold red"), " ", message), soft_wrap=True)


def main() -> None:
    """Run the command line; a foreseen error becomes one message on stderr and exit code 1."""
    try:
        single_threaded(app)()
    except LAMELLA_ERRORS as error:
        _say(str(error))
        sys.exit(1)
    except OSError as error:  # foreseen errors say more; this is a file that was there a moment ago
        _say(f"{error.filename or 'a file'}: {error.strerror or error}")
        sys.exit(1)
    except SystemExit as stopped:
        if stopped.code == _INTERRUPTED:
            _ERR.print("Interrupted; what was done is kept, and the same command goes on from there.")
        raise
