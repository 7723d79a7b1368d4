"""The smallest change that is named: against a reference, and by the diagnosis of the changed state alone.

One change each of a few kinds is made larger in steps, everything else of the laboratory staying as it is. Both
questions are asked of the same modes. The diagnosis alone is taken at its best: whatever it names that it does not name
of the state before counts as the change.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ema import ModalModel, change
from ema.types.arrays import single_threaded
from model import catalogue
from tests.studies.changes import (
    DRAWS,
    PLATE_DRAWS,
    PRESSURE,
    REFERENCES,
    Measured,
    PlateBench,
    StackBench,
    fitted,
    stated,
)
from tests.studies.runner import study
from updating.changes.compare import what_changed
from updating.diagnosis.cached_model import cached_model
from updating.diagnosis.diagnosis import diagnose

CASES = (
    (989_900, "stack", "added mass"),
    (989_901, "stack", "lost contact"),
    (989_902, "stack", "loose bolt"),
    (989_903, "plate", "added mass"),
    (989_904, "plate", "crack"),
    (989_905, "plate", "softer edge"),
)
STEP, N_SIZE = 3.0**0.5, 9
"""Sizes are so many times each other, and so many; the one in the middle is drawn."""


@dataclass(frozen=True, kw_only=True)
class Smallest:
    """What the smallest change is that is named.

    Attributes
    ----------
    seed : int
        Of the laboratory.
    structure, planted : str
        What has changed, and how.
    scatter : float
        Relative standard deviation of a frequency between two assemblies.
    moved : tuple of float
        Over that scatter, by how much each size moves the mode that it moves most.
    beside, alone : int
        Number of the smallest size that is named with a reference and without; `N_SIZE` where none is.
    """

    seed: int
    structure: str
    planted: str
    scatter: float
    moved: tuple[float, ...]
    beside: int
    alone: int

    @property
    def row(self) -> str:
        """The line of the published table."""
        last = self.moved[min(self.alone, N_SIZE - 1)]
        ratio = "none" if self.beside == N_SIZE else f"{last / self.moved[self.beside]:.1f}"
        ratio = f"more than {ratio}" if self.alone == N_SIZE > self.beside else ratio
        sizes = [f"{self.moved[k]:.1f}" if k < N_SIZE else "none" for k in (self.beside, self.alone)]
        return f"| {self.structure}: {self.planted} | {sizes[0]} | {sizes[1]} | {ratio} |"


@single_threaded
def solved(seed: int, structure: str, planted: str) -> Smallest:
    """Find the smallest sizes of one change."""
    bench: StackBench | PlateBench = StackBench(seed) if structure == "stack" else PlateBench(seed)
    number, n = len(REFERENCES), len(REFERENCES)
    before = [bench.modes(i) for i in range(number + 1)]
    scatter = bench.scatter(before)
    tests = tuple(bench.test(i, one) for i, one in enumerate(before[:n]))
    reference = fitted(Measured(seed=seed, structure=structure, tests=tests, planted=()))
    right = DRAWS[planted].right if structure == "stack" else PLATE_DRAWS[planted][3]
    after = [bench.modes(number, bench.drawn(0, planted, STEP ** (k - N_SIZE // 2))) for k in range(N_SIZE)]

    def beside(k: int) -> bool:
        test = bench.test(number, after[k])
        seen = change([test], list(tests)).changed
        return bool({*right} & {*what_changed(reference, [(test.name, PRESSURE, test)], seen=seen).left})

    usual = _named(bench.test(number, before[n]), structure)
    return Smallest(
        seed=seed,
        structure=structure,
        planted=planted,
        scatter=scatter,
        moved=tuple(bench.moved(before[n], one) / scatter for one in after),
        beside=_first(beside),
        alone=_first(lambda k: not _named(bench.test(number, after[k]), structure) <= usual),
    )


def _named(test: ModalModel, structure: str) -> set[str]:
    """Return all that the diagnosis of one state names."""
    found = diagnose(stated(structure), [(test.name, PRESSURE, test)], catalogue(), reduced=cached_model)
    return {name for effects in found.set for name in effects} | ({"at a point"} if found.point_change else set())


def _first(found: Callable[[int], bool]) -> int:
    """Return the smallest size from which something is found, by bisection."""
    low, high = 0, N_SIZE
    while low < high:
        middle = (low + high) // 2
        if found(middle):
            high = middle
        else:
            low = middle + 1
    return high


def study_of(number: int, record: Path) -> list[Smallest]:
    """Return the first cases; those that a record holds are read back."""
    return study(CASES[:number], solved, record, Smallest, lambda case: (case.seed, case.structure, case.planted))
