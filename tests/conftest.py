"""Damaged files and the watch over whoever reads them."""

import os
import re
import signal
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest

SECONDS = 5.0  # of the processor for one input; most take a few ms
MEGABYTES = 500  # beyond what the process had before

# What a hand or a program may put in the place of a number or word, and what a disk or transfer leaves of it.
VALUES = [b"0", b"-1", b"1.5", b"1e999", b"nan", b"-inf", b"inf", b"1e-320", b"1e9", b"1000000", b"2147483648",
          b"9" * 25, b"true", b"null", b'"text"', b"[]", b"{}", b"[0, 0]", b"1+2j", b'"../.."', b'"**/*"',
          b'"\\u0000"']  # fmt: skip
RUBBISH = [b"", b"'", b'"', b"[[", b"\0", b"\xff", b"\n", b"\r\n", b"\xef\xbb\xbf", b",", b";", b"\t", b"#",
           b" " * 80, b"9" * 5000, b"[" * 3000, b"x = 1\n"]  # fmt: skip


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Return a file with one to three faults: of its values, of its lines, or of its bytes."""
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        if len(data) < 10:
            break
        start = int(rng.integers(len(data)))
        stop = start + int(rng.integers(1, 40))
        kind = rng.choice(["value", "rubbish", "lines", "byte", "loss", "double", "end"], p=[0.5, *6 * [0.5 / 6]])
        if kind in ("value", "rubbish"):
            odd = VALUES if kind == "value" else RUBBISH
            word = re.compile(rb"[-+]?\d[\d.eE+-]*|\"[^\"\n]*\"|\w+").search(data, start)
            if word is not None:
                data = data[: word.start()] + odd[rng.integers(len(odd))] + data[word.end() :]
        elif kind == "lines":  # lost, doubled or moved
            lines = data.splitlines(keepends=True)
            first, second = (int(i) for i in rng.integers(len(lines), size=2))
            if rng.random() < 0.5:
                lines.insert(first, lines[second])
            if rng.random() < 0.7:
                del lines[second]
            data = b"".join(lines)
        elif kind == "byte":
            data = data[:start] + bytes([rng.integers(256)]) + data[start + 1 :]
        elif kind == "loss":
            data = data[:start] + data[stop:]
        elif kind == "double":
            data = data[:stop] + data[start:]
        elif rng.random() < 0.3:
            data = data[:start]
    return data


class TooSlowError(BaseException):
    """A reader took too long; no `except Exception` holds it up."""


def _status(key: str) -> float:
    """What the system says of this process, in MB."""
    return int(re.search(rf"{key}:\s+(\d+)", Path("/proc/self/status").read_text())[1]) / 1024


@pytest.fixture(scope="session", autouse=True)
def share_of_processors():
    """Let each process of the tests use its share of the processors: pools of each beside the others only wait."""
    from updating.workers import workers

    share = workers.n_processor() // int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workers, "n_processor", lambda: max(share, 1))
        yield


@pytest.fixture
def two_processes(monkeypatch):
    """Have pools of two processes, whatever the share of this one."""
    monkeypatch.setattr("updating.workers.workers.n_processor", lambda: 2)


def _leave_pictures_white(patch: pytest.MonkeyPatch) -> None:
    from matplotlib.figure import Figure

    patch.setattr(Figure, "draw", lambda *_: None)
    for name in ("amplitude", "comparison", "overlay", "shape", "stabilization"):
        patch.setattr(f"updating.commands.ema.{name}_figure", lambda *_, **__: Figure(figsize=(1, 1)))
    patch.setattr("updating.commands.ema.stabilization", lambda *_, **__: None)  # that of the picture alone


@pytest.fixture
def undrawn(monkeypatch):
    """Leave pictures white where a test asks for words and numbers alone: drawing takes longer than all else."""
    _leave_pictures_white(monkeypatch)


@pytest.fixture(scope="module")
def all_undrawn():
    """Leave pictures white in all tests of a module, and in what they share."""
    with pytest.MonkeyPatch.context() as patch:
        _leave_pictures_white(patch)
        yield


@pytest.fixture
def limits():
    """Hold each block to `SECONDS` and all to `MEGABYTES`, by the system's own means."""
    resource = pytest.importorskip("resource")

    def stop(*_):
        raise TooSlowError

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    before = signal.signal(signal.SIGPROF, stop)
    resource.setrlimit(resource.RLIMIT_AS, (int(_status("VmSize") + MEGABYTES) * 2**20, hard))
    yield
    resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
    signal.signal(signal.SIGPROF, before)


@pytest.fixture
def damage():
    """Damaged versions of a file, so many and seeded."""

    def make(file: Path, count: int) -> Iterator[bytes]:
        whole = file.read_bytes()
        return (damaged(whole, np.random.default_rng(seed)) for seed in range(count))

    return make


@pytest.fixture
def copied():
    """Put the file itself in place of a link to it."""

    def copied(link: Path) -> Path:
        content = link.read_bytes()
        link.unlink()
        link.write_bytes(content)
        return link

    return copied


@pytest.fixture
def survives(limits, request):
    """Read a file with each of the contents; fail at other errors than the given ones, and at hang and greed."""

    def run(read: Callable[[Path], object], file: Path, errors: tuple, contents: Iterable[bytes]) -> None:
        peak = _status("VmHWM")
        slowest, count, refused, faults = (0.0, 0), 0, 0, {}
        for number, content in enumerate(contents):
            count += 1
            file.write_bytes(content)
            start = time.process_time()
            try:
                signal.setitimer(signal.ITIMER_PROF, SECONDS)
                read(file)
            except errors as error:
                refused += 1
                if not str(error):
                    faults[f"input {number}: {type(error).__name__} without a message"] = ""
            except BaseException as error:
                if isinstance(error, KeyboardInterrupt):
                    raise
                place = traceback.extract_tb(error.__traceback__)[-1]
                faults.setdefault(
                    f"{type(error).__name__} at {place.filename}:{place.lineno}",
                    f"input {number}: {error}\n" + "".join(traceback.format_tb(error.__traceback__)[-4:]),
                )
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0.0)
            slowest = max(slowest, (time.process_time() - start, number))
        print(
            f"\n{request.node.name}: {count} inputs, {refused} refused, slowest {1e3 * slowest[0]:.0f} ms "
            f"(input {slowest[1]}), {_status('VmHWM') - peak:.0f} MB more memory"
        )
        assert not faults, "\n\n".join(f"{what}\n{where}" for what, where in faults.items())

    return run
