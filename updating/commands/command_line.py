"""The command line: the commands under one name, and errors that say what would be right."""

from __future__ import annotations

import sys
from importlib.metadata import version
from typing import Annotated

import typer
from rich.text import Text

from ema.types.threads import single_threaded
from updating.commands import (
    blind,
    demo,
    diagnose,
    effects,
    ema,
    fit,
    model,
    new,
    next_test,
    open_,
    pick,
    published,
    report,
    simulate,
    update,
    view,
)
from updating.commands.terminal import ERR, OUT, literal, print_what_can_be
from updating.errors import LAMELLA_ERRORS

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
for _module in (
    new, ema, pick, model, effects, fit, update, published, diagnose, next_test, report, open_, view, simulate, blind,
    demo,
):  # fmt: skip
    _name = _module.__name__.rpartition(".")[2]
    app.command(_name.rstrip("_").replace("_", "-"), epilog=f"Example: {_module.EXAMPLE}")(
        getattr(_module, _name)
    )

_INTERRUPTED = 130
"""Exit code of a command that Ctrl-C ended (128 and the number of its signal)."""


def _version(wanted: bool) -> None:
    if wanted:
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


def main() -> None:
    """Run the command line; a foreseen error becomes one message on stderr and exit code 1."""
    print_what_can_be()
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
            ERR.print("Interrupted; what was done is kept, and the same command goes on from there.")
        raise
