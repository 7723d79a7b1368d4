"""The command line: every command as its user types it, how it is stopped, and errors that say what would be right.

What a command does is in the module of its name. `updating.commands` imports that when the command runs, so that no
help waits for numbers.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import os
import signal
import sys
from pathlib import Path
from threading import current_thread, main_thread
from typing import Annotated

import typer
from rich.text import Text

from updating import commands
from updating.commands.terminal import ERR, OUT, Run, literal, print_what_can_be
from updating.errors import LAMELLA_ERRORS, StoreError

Folder = Annotated[
    Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the results; made if it is not there.")
]

SharedEffects = Annotated[
    list[str] | None,
    typer.Option(
        "--effect", metavar="NAME", help="Physical effect to fit; may be given several times.", show_default=False
    ),
]

ResultsFolder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder with results.", show_default=False)]


def _there(path: Path) -> Path:
    """Refuse a file that is not there before what would read it is imported: that takes most of a second."""
    if not path.exists():
        raise StoreError(f"{path}: cannot be read: {os.strerror(errno.ENOENT)}")
    return path


def _campaign(path: Path) -> Path:
    """Return the campaign.toml of a folder that has one, and any other path as it is."""
    inside = _there(path) / "campaign.toml"
    return inside if inside.is_file() else path


CampaignFile = Annotated[
    Path,
    typer.Argument(
        metavar="CAMPAIGN",
        help="Campaign file (TOML), or the folder of a campaign.toml.",
        show_default=False,
        callback=_campaign,
    ),
]

EffectFiles = Annotated[
    list[Path] | None,
    typer.Option(
        "--effect-file",
        metavar="FILE",
        help="Python file that ends in EFFECT = Effect(...), whose code runs; may be given several times.",
    ),
]

ScatterFile = Annotated[
    Path | None,
    typer.Option(
        "--scatter",
        metavar="FILE",
        help="What separates a right model from a right measurement (TOML), where your laboratory knows better.",
        show_default=False,
    ),
]

Keep = Annotated[
    bool,
    typer.Option(
        "--keep",
        help="Use results that are there although they were changed or come from other files; the report says which.",
    ),
]

IdentifyAnew = Annotated[
    bool,
    typer.Option(
        "--identify-anew",
        help="Choose all poles automatically again; without it, poles chosen by hand are used by every command.",
    ),
]

Cluster = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Address of a Dask scheduler whose workers do the work, such as tcp://10.0.0.1:8786; "
        "all processors of this machine by default.",
        show_default=False,
    ),
]

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


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        OUT.print(f"lamella {version('lamella')}")
        raise typer.Exit


@app.callback()
def _options(
    _: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    pass


@app.command(epilog="Example: lamella new my_test")
def new(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder with measurements.", show_default=False)],
) -> None:
    """Look at the files in a folder and write a first campaign file there, campaign.toml.

    Format, columns, points, directions and units come from the files, their headers and their names; each subfolder
    with measurements is one configuration, and in a folder that holds modes alone each file of them. A comment stands
    wherever something is guessed, and "?" where it cannot be known: fill it in, and reading the campaign names what is
    left. A campaign file that is there is not overwritten. Where the folder has stiffness and mass matrices of another
    program, and no model yet, a first structure file is written, too.
    """
    commands.new_command(folder)


@app.command(epilog="Example: lamella ema data/demo_stack/campaign.toml -o out/demo")
def ema(
    campaign: CampaignFile,
    output: Folder,
    poles: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of results whose edited poles.txt files are used from now on."),
    ] = None,
    cluster: Cluster = None,
    keep: Keep = False,
    identify_anew: IdentifyAnew = False,
) -> None:
    """Identify frequencies, damping ratios and mode shapes of every configuration of a campaign.

    Poles come from the LSCF method and are chosen without any frequency guess. Writes for each configuration
    modal_model.json, modes.uff (points, modes, synthesised FRFs), modes.csv, shapes.csv and pictures, of several force
    levels amplitude.json and amplitude.png, of one that is to be compared with a reference change.json and change.csv,
    and a comparison of all configurations. To choose by hand, edit poles.txt there and run again with --poles DIR;
    every later command uses them until --identify-anew.
    """
    run = Run(campaign=campaign, output=output, cluster=cluster, keep=keep, identify_anew=identify_anew)
    commands.ema_command(run, poles)


@app.command(epilog="Example: lamella pick data/demo_stack/campaign.toml M1 -o out/demo")
def pick(
    campaign: CampaignFile,
    configuration: Annotated[
        str, typer.Argument(metavar="CONFIGURATION", help="Its name in the campaign file.", show_default=False)
    ],
    output: Folder,
) -> None:
    """Choose the poles of one configuration by clicks in its stabilisation chart.

    A left click adds the nearest pole, a right click takes one away; closing the window writes poles.txt, and every
    later command on these results identifies with them. Needs a display; without one, edit poles.txt with any editor
    and run **lamella ema ... --poles DIR**.
    """
    commands.pick_command(campaign, configuration, output)


@app.command(epilog="Example: lamella model data/demo_stack/stack.toml -o out/stack")
def model(
    stack: Annotated[
        Path,
        typer.Argument(
            metavar="STACK", help="Stack file, or structure file with [matrices] (TOML).", show_default=False
        ),
    ],
    output: Folder,
    modes: Annotated[int, typer.Option("--modes", "-n", min=1, max=200, help="Number of elastic modes.")] = 10,
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
    Physical effects beyond the base model are added with --effect; **lamella effects** lists them. A structure file
    with [matrices] is read, checked and reduced instead.
    """
    commands.model_command(stack, output, modes, tolerance, effect or (), effect_file or ())


@app.command(epilog="Example: lamella effects clamp_inertia --stack data/demo_stack/stack.toml -o out/effects")
def effects(
    name: Annotated[str | None, typer.Argument(metavar="EFFECT", help="Effect to explain.", show_default=False)] = None,
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
    if name is None and (stack is not None or output is not None):
        raise typer.BadParameter(
            "which effect? give its name with --stack and -o, such as lamella effects clamp_inertia"
        )
    if stack is None and output is not None:
        raise typer.BadParameter("-o needs a stack for the picture; give it with --stack")
    if not commands.effects_command(name, stack, output, effect_file or ()):
        raise typer.Exit(1)


@app.command(epilog="Example: lamella fit data/hidden_effect/d/campaign.toml -o out/d")
def fit(
    campaign: CampaignFile,
    output: Folder,
    threshold: Annotated[float, typer.Option(min=0.0, max=1.0, help="Smallest MAC that makes a pair of modes.")] = 0.8,
    effect: SharedEffects = None,
    effect_file: EffectFiles = None,
    scatter: ScatterFile = None,
    cluster: Cluster = None,
    keep: Keep = False,
    identify_anew: IdentifyAnew = False,
) -> None:
    """Identify a campaign, fit contact stiffness G_f and contact damping d_f, and write the report.

    G_f minimises opt_G and d_f minimises opt_d; modes are paired by MAC.

    With --effect, effects whose parameters all configurations share are added, each alone and all together, with one
    contact law for all torques of a stack, and the ledger says what each does to the error on data fitted and on data
    held out. One stack is fitted as lamella diagnose does it, with --scatter as there, and with the same numbers.

    Of a campaign that lists specimens all are fitted together: effects are the rig's, contact each specimen's own.
    """
    run = Run(
        campaign=campaign, output=output, effect_files=tuple(effect_file or ()), scatter_file=scatter, cluster=cluster,
        keep=keep, identify_anew=identify_anew,
    )  # fmt: skip
    commands.fit_command(run, threshold, effect or ())


@app.command(epilog="Example: lamella update data/demo_stack/update.toml -o out/update")
def update(
    specification: Annotated[
        Path, typer.Argument(metavar="SPEC", help="Updating file (TOML).", show_default=False, callback=_there)
    ],
    output: Folder,
    effect_file: EffectFiles = None,
    cluster: Cluster = None,
    identify_anew: IdentifyAnew = False,
) -> None:
    """Fit several configurations at once as a file says: parameters free, shared or fixed, priors, modes held out.

    One stack is fitted as lamella diagnose does it, several as a campaign of specimens, with the same numbers;
    data/demo_stack/update.toml shows the keys. Writes update.json with covariance and course of the fit, ledger.json
    with the error without effects, with each and with all, and both as tables and pictures.
    """
    files = tuple(effect_file or ())
    commands.update_command(
        Run(campaign=specification, output=output, effect_files=files, cluster=cluster, identify_anew=identify_anew)
    )


@app.command(epilog="Example: lamella diagnose data/hidden_effect/a/campaign.toml -o out/a")
def diagnose(
    campaign: CampaignFile,
    output: Folder,
    effect_file: EffectFiles = None,
    scatter: ScatterFile = None,
    cluster: Cluster = None,
    keep: Keep = False,
    identify_anew: IdentifyAnew = False,
    reference: Annotated[
        bool,
        typer.Option(
            "--reference",
            help="Where configurations have a reference: diagnose the model beside the references, not what changed.",
        ),
    ] = False,
) -> None:
    """Say which physical effect the model lacks, how sure that is, what cannot be told apart, and what cannot be seen.

    All configurations of the campaign count together. Writes diagnosis.json; one that an earlier run left is read back.
    Where configurations have a reference (compare_to), says instead whether each changed, what, and where, and writes
    what_changed.json beside its modes; --reference asks what the model of the others lacks.
    A campaign that lists specimens is diagnosed as a whole: which effect is the rig's, which specimens are odd, and
    what a treatment changes. Writes pooled_diagnosis.json.
    """
    run = Run(
        campaign=campaign, output=output, effect_files=tuple(effect_file or ()), scatter_file=scatter, cluster=cluster,
        keep=keep, identify_anew=identify_anew,
    )  # fmt: skip
    commands.diagnose_command(run, reference=reference)


@app.command("next-test", epilog="Example: lamella next-test data/hidden_effect/open/campaign.toml -o out/open")
def next_test(
    campaign: CampaignFile,
    output: Folder,
    effect_file: EffectFiles = None,
    scatter: ScatterFile = None,
    identify_anew: IdentifyAnew = False,
) -> None:
    """Rank further tests by how well they would resolve the explanations that a diagnosis leaves open.

    The diagnosis is made where the folder has none of this campaign.
    """
    files = tuple(effect_file or ())
    commands.next_test_command(
        Run(campaign=campaign, output=output, effect_files=files, scatter_file=scatter, identify_anew=identify_anew)
    )


@app.command(epilog="Example: lamella report out/demo --pdf")
def report(
    folder: ResultsFolder,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Print report.pdf too, by an installed Chromium, Chrome or Edge.")
    ] = False,
    pptx: Annotated[bool, typer.Option("--pptx", help="Write the main pages as slides, report.pptx, too.")] = False,
    gif: Annotated[bool, typer.Option("--gif", help="Write every mode shape as a GIF that moves, too.")] = False,
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only",
            metavar="TITLE",
            help="Only the sections whose titles begin so, such as Answer; may be given several times.",
            show_default=False,
        ),
    ] = None,
    keep: Keep = False,
) -> None:
    """Make one self-contained HTML page from the results in a folder.

    Every figure is also written to the folder figures there, with its numbers as CSV.
    """
    commands.report_command(folder, pdf=pdf, pptx=pptx, gif=gif, only=only or (), keep=keep)


@app.command("open", epilog="Example: lamella open out/demo")
def open_(
    path: Annotated[
        Path, typer.Argument(metavar="PATH", help="Folder of results, campaign file, or folder with a campaign.toml.")
    ] = Path(),
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Folder for the results of a campaign; out/ and the name of its folder by default.",
            show_default=False,
        ),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Where to listen; 0 for any that is free.")] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the browser, or print the address alone.")
    ] = True,
    identify_anew: IdentifyAnew = False,
) -> None:
    """Open a workbench in the browser: points and functions, both shapes of any MAC, sliders for every parameter.

    It listens on this machine alone, at an address with a token that changes every time, and needs no network. A
    campaign without results is identified and fitted first. Ctrl-C ends it.
    """
    commands.open_command(path, output, port, browser=browser, identify_anew=identify_anew)


@app.command(epilog="Example: lamella view out/demo")
def view(
    folder: ResultsFolder,
    configuration: Annotated[
        str | None, typer.Argument(metavar="CONFIGURATION", help="Its name; the first by default.", show_default=False)
    ] = None,
) -> None:
    """Show mode shapes and stabilisation chart of one configuration.

    In a window where there is a display: drag to turn, choose the mode with the slider. Otherwise a page, view.html,
    is written and opened in the browser.
    """
    commands.view_command(folder, configuration)


@app.command(epilog="Example: lamella simulate data/demo_stack/virtual_test.toml -o data/demo_stack")
def simulate(
    specification: Annotated[
        Path, typer.Argument(metavar="SPEC", help="Virtual test (TOML).", show_default=False, callback=_there)
    ],
    output: Folder,
    effect_file: EffectFiles = None,
) -> None:
    """Simulate a vibration test on a model and write its FRFs as a test system would.

    The truth goes to truth.json, which no other command reads. The same file and seed give the same bytes.
    """
    commands.simulate_command(specification, output, effect_file or ())


@app.command(epilog="Example: lamella demo")
def demo(output: Folder = Path("out/demo")) -> None:
    """Identify the shipped campaign, fit the model, say what it lacks, add it and see the error fall.

    The campaign travels with the program; nothing is fetched.
    """
    commands.demo_command(output)


EXTRAS = {
    "jinja2": "report",
    "plotly": "report",
    "pyvista": "report",
    "vtkmodules": "report",
    "pptx": "report",
    "trame": "workbench",
    "aiohttp": "workbench",
    "nptdms": "tdms",
}
"""Packages that some commands need, with the extra of `pyproject.toml` that brings them."""


def _say(message: str) -> None:
    """Print an error as it stands; lines are left for the terminal to break."""
    ERR.print(Text.assemble(("Error:", "bold red"), " ", literal(message)), soft_wrap=True)


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


def _hand_back_large_arrays(*, large: int = 4 << 20) -> None:
    """Let glibc give large arrays back to the system once they are freed; elsewhere nothing happens.

    By default it keeps freed ones of up to 32 MB for later ones, which seldom fit: a fifth of the memory of an
    identification of a large file was such holes.

    `large`: bytes.
    """
    threshold = -3  # M_MMAP_THRESHOLD in malloc.h
    with contextlib.suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).mallopt(threshold, large)


def main() -> None:
    """Run the command line; a foreseen error becomes one message on stderr and exit code 1.

    What asks the process to end (SIGTERM), such as a batch system or the workbench, ends it as Ctrl-C does: its workers
    with it, and nothing of theirs is left behind.
    """
    interrupted = 130  # Exit code of a command that Ctrl-C ended (128 and the number of its signal).
    print_what_can_be()
    _hand_back_large_arrays()
    if current_thread() is main_thread():
        signal.signal(signal.SIGTERM, _interrupt)
    try:
        app()
    except LAMELLA_ERRORS as error:
        _say(str(error))
        sys.exit(1)
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in EXTRAS:
            raise
        _say(
            f"this takes {package}, which is not installed. What was done is kept; the same command goes on after "
            f'pip install "lamella[{EXTRAS[package]}]", or "lamella[all]" for all there is'
        )
        sys.exit(1)
    except OSError as error:  # foreseen errors say more; this is a file that was there a moment ago
        _say(f"{error.filename or 'a file'}: {error.strerror or error}")
        sys.exit(1)
    except SystemExit as stopped:
        if stopped.code == interrupted:
            ERR.print("Interrupted; what was done is kept, and the same command goes on from there.")
        raise
