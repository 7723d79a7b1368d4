"""Mutate inputs of all readers until a time is over, and keep every input that finds a fault.

    python -m tests.recovery.fuzz --minutes 10 --corpus out/fuzz

A fault is any other exception than a reader's own, more than `SECONDS` of the processor, or more than `MEGABYTES` of
memory. Inputs that found one before are read first, and further ones are made from them, too.
"""

from __future__ import annotations

import argparse
import hashlib
import resource
import signal
import sys
import time
import traceback
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tests.conftest import TooSlowError, damaged
from tests.recovery.damaged_readers import READERS, write_files

SECONDS = 5.0
MEGABYTES = 1000
_REPORT = 1000  # inputs between two lines


def fault_of(reader: str, folder: Path, content: bytes) -> str:
    """Return what goes wrong where a reader of `READERS` gets this content, with its place; or nothing."""
    read, name, errors = READERS[reader]
    file = folder / name
    whole = file.read_bytes()
    file.write_bytes(content)
    try:
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            read(file)
    except errors as error:
        return "" if str(error) else f"{type(error).__name__} without a message"
    except (Exception, TooSlowError) as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__} at {Path(place.filename).name}:{place.lineno}: {error}"[:300]
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        file.write_bytes(whole)
    return ""


def fuzz(folder: Path, corpus: Path, seconds: float, seed: int) -> tuple[int, dict[str, Path]]:
    """Return how many inputs were read, and the faults with the files that they are kept in.

    Parameters
    ----------
    folder : Path
        What `write_files` writes, which the readers read.
    corpus : Path
        Folder of what was found; one folder for each reader.
    seconds : float
        When to stop.
    seed : int
        Of the mutations.
    """
    rng, end, count, found = np.random.default_rng(seed), time.monotonic() + seconds, 0, {}
    kept = {reader: sorted((corpus / _plain(reader)).glob("*")) for reader in READERS}
    waiting = [(reader, file.read_bytes()) for reader in READERS for file in kept[reader]]
    while waiting or time.monotonic() < end:
        if waiting:
            reader, content = waiting.pop()
        else:
            reader = str(rng.choice(list(READERS)))
            bases = [folder / READERS[reader][1], *kept[reader]]
            content = damaged(bases[int(rng.integers(len(bases)))].read_bytes(), rng)
        fault = fault_of(reader, folder, content)
        count += 1
        if fault and f"{reader}: {fault}" not in found:
            file = corpus / _plain(reader) / hashlib.sha256(content).hexdigest()[:16]
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
            kept[reader].append(file)
            found[f"{reader}: {fault}"] = file
        if count % _REPORT == 0:
            print(f"{count} inputs, {len(found)} faults", flush=True)
    return count, found


def _plain(reader: str) -> str:
    return reader.replace(" ", "_").replace("/", "_")


def main() -> int:
    """Fuzz as the arguments say; the exit code is 1 where a fault was found."""
    given = argparse.ArgumentParser(description="Mutate inputs of all readers.")
    given.add_argument("--minutes", type=float, default=10.0)
    given.add_argument("--corpus", type=Path, default=Path("out/fuzz"))
    given.add_argument("--seed", type=int, default=None)
    asked = given.parse_args()

    def stop(*_: object) -> None:
        raise TooSlowError

    signal.signal(signal.SIGPROF, stop)
    status = Path("/proc/self/status").read_text(encoding="utf-8").split("VmSize:")[1].split()[0]
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (1024 * int(status) + MEGABYTES * 2**20, hard))
    with TemporaryDirectory() as folder:
        copy = Path(folder)
        write_files(copy)
        seed = time.time_ns() if asked.seed is None else asked.seed
        count, found = fuzz(copy, asked.corpus, 60.0 * asked.minutes, seed)
    print(f"{count} inputs of {len(READERS)} readers, {len(found)} faults, seed {seed}")
    for fault, file in found.items():
        print(f"{file}: {fault}")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
