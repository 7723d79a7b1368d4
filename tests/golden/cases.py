"""Cases drawn from a seed and a kind: a stack as it is stated, the modes that its test gave, and what is true."""

from __future__ import annotations

import pickle
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import model
from ema import ModalModel
from model import Stack
from tests.golden.near_crossing import CLOSE, near_crossing
from tests.independent.campaign import Plan
from tests.independent.effects import TABLE
from tests.independent.layered import Layered
from tests.independent.setups import SETUPS
from tests.independent.solid import Solid
from tests.recovery.reference_models import simulated

Key = tuple[str, str, int, str]
"""World, kind, seed and stack: what a case is drawn from."""
WORLDS = ("layered", "solid")
KINDS = ("null", "single", "pair", "lacking", "crossing_null", "crossing_single")
"""Nothing planted, one effect, two, one that the catalogue lacks; nothing and one effect near a crossing."""
FIRST = {"layered": 420_000, "solid": 430_000}
"""Seeds; no rule was set on these."""
NUMBER, NUMBER_OF_CROSSINGS = 40, 30
"""Cases of each world."""
MIXTURE = ("null", "single", "pair", "lacking", "single")
"""Kinds of the cases away from crossings, in their turn."""
CROSSING_MIXTURE = ("crossing_null", "crossing_single")
STACKS = ("shipped", "long", "shipped", "wide")
"""Stacks of the near crossings, in their turn; cases away from crossings are of the shipped stack."""
FOLDER = Path(tempfile.gettempdir()) / "golden_cases"
"""Where drawn cases are kept, outside the repository."""
_TRIALS = 12  # seeds that are tried for a near crossing, each so far from the one before
_STRIDE = 100_000


@dataclass(frozen=True, kw_only=True)
class Case:
    """A test and what is true of it.

    Attributes
    ----------
    seed, world, kind : int, str, str
        What it is drawn from.
    setup : str
        Which of `SETUPS` it is of.
    planted : dict
        By the second model's key, with values in SI units.
    truth : tuple of str
        Effects of the catalogue that are meant; none where nothing is planted or the catalogue lacks it.
    distance : float
        Smallest distance of two measured modes of one torque, relative to their frequency.
    stack : Stack
        As stated.
    tested : list of (str, float, ModalModel)
        Name, stated pressure in Pa and measured modes of each torque.
    """

    seed: int
    world: str
    kind: str
    setup: str
    planted: dict[str, dict[str, float]]
    truth: tuple[str, ...]
    distance: float
    stack: Stack
    tested: list[tuple[str, float, ModalModel]]

    @property
    def meta(self) -> dict:
        """All but stack and modes, as plain values."""
        return {
            "seed": self.seed,
            "world": self.world,
            "kind": self.kind,
            "setup": self.setup,
            "planted": {key: dict(values) for key, values in self.planted.items()},
            "truth": list(self.truth),
            "distance": self.distance,
        }


@cache
def second_model(world: str) -> Solid | Layered:
    """Return the second model of a world."""
    return Solid() if world == "solid" else Layered()


@cache
def coarse(world: str) -> Solid | Layered:
    """Return the same with fewer functions, within 0.5 % of the frequencies."""
    return Solid(order=(16, 4)) if world == "solid" else Layered(n_element=(14, 3))


def planned(world: str) -> list[Key]:
    """Return what the cases of a world are drawn from, in an order of which any first part is a fair sample."""
    first = FIRST[world]
    plain = [(world, MIXTURE[i % len(MIXTURE)], first + i, "shipped") for i in range(NUMBER)]
    close = [
        (world, CROSSING_MIXTURE[i % 2], first + 2000 + i, STACKS[i // 2 % len(STACKS)])
        for i in range(NUMBER_OF_CROSSINGS)
    ]
    share = [((i + 0.5) / len(keys), key) for keys in (plain, close) for i, key in enumerate(keys)]
    return [key for _, key in sorted(share)]


def all_planned() -> list[Key]:
    """Return the same of all worlds, in turn."""
    return [key for keys in zip(*map(planned, WORLDS), strict=True) for key in keys]


def draw_case(world: str, kind: str, seed: int, setup: str = "shipped") -> Case:
    """Draw and simulate a case.

    Raises
    ------
    ValueError
        No near crossing was found with any of the seeds that are tried.
    """
    crossing, _, plain = kind.rpartition("_")
    if not crossing:
        return _case(SETUPS[setup].draw(seed, plain, world), seed, kind, setup)
    for trial in range(_TRIALS):
        plan = near_crossing(
            SETUPS[setup].draw(seed + trial * _STRIDE, plain, world), second_model(world), coarse(world)
        )
        case = None if plan is None else _case(plan, seed, kind, setup)
        if case is not None and case.distance < CLOSE:
            return case
    message = f"no near crossing of the stack {setup!r} from seed {seed} in {_TRIALS} trials"
    raise ValueError(message)


def _case(plan: Plan, seed: int, kind: str, setup: str) -> Case:
    _, tested = simulated(plan, second_model(plan.model_key))
    names = [TABLE[key].catalogue for key in plan.planted]
    return Case(
        seed=seed,
        world=plan.model_key,
        kind=kind,
        setup=setup,
        planted={key: dict(values) for key, values in plan.planted.items()},
        truth=tuple(name for name in names if name is not None),
        distance=min(distance(modes) for _, _, modes in tested),
        stack=model.read_stack(plan.stack),
        tested=tested,
    )


def distance(modes: ModalModel) -> float:
    """Return the smallest distance of two measured modes, relative to their frequency."""
    frequency = np.sort(modes.frequency)
    return float(np.min(np.diff(frequency) / frequency[1:], initial=1.0))


def kept(folder: Path, world: str, kind: str, seed: int, setup: str = "shipped") -> Case:
    """Return a case from a folder of drawn ones; draw it and put it there where it is not yet.

    The folder must be the reader's: pickles can run code.
    """
    file = folder / world / f"{kind}_{seed}.pkl"
    if file.exists():
        meta, stack, tested = pickle.loads(file.read_bytes())
        meta |= {"truth": tuple(meta["truth"])}
        return Case(**meta, stack=stack, tested=tested)
    case = draw_case(world, kind, seed, setup)
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(".part")
    part.write_bytes(pickle.dumps((case.meta, case.stack, case.tested)))
    part.replace(file)
    return case


def saved(folder: Path) -> Iterator[Case]:
    """Yield the cases of a folder."""
    for file in sorted(folder.glob("*/*.pkl")):
        kind, _, seed = file.stem.rpartition("_")
        yield kept(folder, file.parent.name, kind, int(seed))
