"""The command line: the commands under one name, and errors that say what would be right."""

from __future__ import annotations

import signal
import sys
from importlib import import_module
from threading import current_thread, main_thread
from typing import Annotated, Any

import typer
from rich.text import Text
from typer.core import TyperGroup

from updating.commands.terminal import ERR, OUT, literal, print_what_can_be
from updating.errors import LAMELLA_ERRORS

COMMANDS = {
    "new": "Look at the files in a folder and write a first campaign file there, campaign.toml.",
    "ema": "Identify frequencies, damping ratios and mode shapes of every configuration of a campaign.",
    "pick": "Choose the poles of one configuration by clicks in its stabilisation chart.",
    "model": (
        "Solve the model of a stack: natural frequencies, damping ratios, shapes, and the pressure between laminas."
    ),
    "effects": "List the physical effects that a stack can have beyond the base model, or explain one.",
    "fit": ("Identify a campaign, fit contact stiffness G_f and contact damping d_f, and write the report."),
    "update": (
        "Fit several configurations at once as a file says: parameters free, shared or fixed, priors, modes held out."
    ),
    "published": (
        "Reproduce the published campaign of 18 stacks from its tables, then add effects that all stacks share."
    ),
    "diagnose": (
        "Say which physical effect the model lacks, how sure that is, what cannot be told apart, and what cannot be "
        "seen."
    ),
    "next-test": (
        "Rank further tests by how well they would resolve the explanations that a diagnosis leaves open."
    ),
    "report": "Make one self-contained HTML page from the results in a folder.",
    "open": (
        "Open a workbench in the browser: points and functions, both shapes of any MAC, sliders for every parameter."
    ),
    "view": "Show mode shapes and stabilisation chart of one configuration.",
    "simulate": "Simulate a vibration test on a model and write its FRFs as a test system would.",
    "demo": (
        "Identify the shipped campaign, fit the model, say what it lacks, add it and see the error fall."
    ),
}
"""Every command with what it does: the first sentence of its function, whose module is imported when it is run."""

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


class _Commands(TyperGroup):
    """The commands by name and sentence; the module of one is imported when it is run or asked for its help."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return the command that the words name, with all of its options."""
        name, command, rest = super().resolve_command(ctx, args)
        if name is None:
            return name, command, rest
        return name, load(name), rest


def load(name: str) -> Any:
    """Import the module of a command and return it with its options, as `typer` runs it."""
    from ema.types.threads import single_threaded

    function = "open_" if name == "open" else name.replace("-", "_")
    module = import_module(f"updating.commands.{function}")
    one = typer.Typer(add_completion=False, rich_markup_mode="markdown", pretty_exceptions_enable=False)
    # only now: threads are limited in what is imported
    one.command(name, epilog=f"Example: {module.EXAMPLE}")(single_threaded(getattr(module, function)))
    return typer.main.get_command(one)


def _listed() -> None:
    """Stand for a command in the list of all."""


app = typer.Typer(
    name="lamella",
    cls=_Commands,
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
for _name, _sentence in COMMANDS.items():
    app.command(_name, help=_sentence)(_listed)

_INTERRUPTED = 130
"""Exit code of a command that Ctrl-C ended (128 and the number of its signal)."""


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


def _say(message: str) -> None:
    """Print an error as it stands; lines are left for the terminal to break."""
    ERR.print(Text.assemble(("Error:", "bold red"), " ", literal(message)), soft_wrap=True)


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


def main() -> None:
    """Run the command line; a foreseen error becomes one message on stderr and exit code 1.

    What asks the process to end (SIGTERM), such as a batch system or the workbench, ends it as Ctrl-C does: its workers
    with it, and nothing of theirs is left behind.
    """
    print_what_can_be()
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
        if stopped.code == _INTERRUPTED:
            ERR.print("Interrupted; what was done is kept, and the same command goes on from there.")
        raise
