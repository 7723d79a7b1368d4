"""The command line in this process, as its user meets it: what it prints on which stream, and its exit code."""

from __future__ import annotations

import io
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from subprocess import CompletedProcess
from unittest.mock import patch

from updating.commands.command_line import main

ROOT = Path(__file__).parents[1]


def lamella(*arguments: object, cwd: Path = ROOT) -> CompletedProcess[str]:
    """Run a command; starting a process of its own for each would take two seconds of imports."""
    words, code = ["lamella", *map(str, arguments)], 0
    stdout, stderr = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", newline="") for _ in range(2))
    with chdir(cwd), patch.object(sys, "argv", words), redirect_stdout(stdout), redirect_stderr(stderr):
        try:
            main()
        except SystemExit as stopped:
            code = stopped.code if isinstance(stopped.code, int) else int(stopped.code is not None)
        stdout.flush()
        stderr.flush()
    said, complained = (stream.buffer.getvalue().decode() for stream in (stdout, stderr))
    return CompletedProcess(words, code, said, complained)
