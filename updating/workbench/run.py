"""A command run beside the workbench: what it says, and a stop that works."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress

_SHOWN = 400  # lines of what it says that are kept
_LAST_WORDS = 2.0  # s
_PATIENCE = 15.0  # s that a command has to end
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
        self._process = await asyncio.create_subprocess_exec(
            sys.executable, "-c", _CODE, *words,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            env={**os.environ, "COLUMNS": "100"},
            start_new_session=True,  # a group of its own, so that its workers are ended with it
        )  # fmt: skip
        reading = asyncio.create_task(self._read(self._process.stdout))
        try:
            code = await self._process.wait()
            with suppress(TimeoutError):  # a worker may hold its output a moment longer
                await asyncio.wait_for(reading, _LAST_WORDS)
        finally:
            self._process = None
        await done(code)

    async def _read(self, output: asyncio.StreamReader | None) -> None:
        lines: list[str] = []
        if output is not None:
            async for line in output:
                lines = [*lines, line.decode(errors="replace").rstrip()][-_SHOWN:]
                self._said(lines)

    def stop(self) -> None:
        """End the command as Ctrl-C does; what is written is whole, and it goes on from there when it is run again.

        It ends its workers itself. Where it does not within some seconds, it and they are killed.
        """
        if self._process is None:
            return
        process = self._process
        with suppress(ProcessLookupError):
            process.terminate()
        with suppress(RuntimeError):  # no loop runs where the workbench itself ends
            asyncio.get_running_loop().call_later(_PATIENCE, self._kill, process)

    def _kill(self, process: asyncio.subprocess.Process) -> None:
        if process.returncode is None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL) if hasattr(os, "killpg") else process.kill()
