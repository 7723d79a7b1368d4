"""A command run beside the workbench: what it says, and a stop that works."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress

_SHOWN = 400  # lines of what it says that are kept
_CODE = "from updating.commands.command_line import main; main()"


class Command:
    """One command of `lamella` at a time, as a process of its own: a page stays quick beside it, and it can be stopped.

    Parameters
    ----------
    said : callable
        Takes the lines said so far each time that there is a new one.
    """

    def __init__(self, said: Callable[[list[str]], None]) -> None:
        self._said = said
        self._process: asyncio.subprocess.Process | None = None

    @property
    def running(self) -> bool:
        """Whether a command runs now."""
        return self._process is not None

    async def run(self, words: Sequence[str], done: Callable[[int], Awaitable[None]]) -> None:
        """Run `lamella` with some words and hand its exit code on."""
        if self.running:
            return
        lines: list[str] = []
        self._process = await asyncio.create_subprocess_exec(
            sys.executable, "-c", _CODE, *words,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            env={**os.environ, "COLUMNS": "100"},
        )  # fmt: skip
        try:
            if self._process.stdout is not None:
                async for line in self._process.stdout:
                    lines = [*lines, line.decode(errors="replace").rstrip()][-_SHOWN:]
                    self._said(lines)
            code = await self._process.wait()
        finally:
            self._process = None
        await done(code)

    def stop(self) -> None:
        """End the command; what it has written is whole, and it goes on from there when it is run again."""
        if self._process is not None:
            with suppress(ProcessLookupError):
                self._process.terminate()
