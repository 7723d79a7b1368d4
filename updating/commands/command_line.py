"""The command line as a process: its commands, how it is stopped, and errors that say what would be right."""

from __future__ import annotations

import signal
import sys
from threading import current_thread, main_thread

from rich.text import Text

from updating.commands.terminal import ERR, literal, print_what_can_be
from updating.commands.usage import app
from updating.errors import LAMELLA_ERRORS

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


_INTERRUPTED = 130
"""Exit code of a command that Ctrl-C ended (128 and the number of its signal)."""


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
