"""How often the question what changed is answered rightly: structures of second models, FRFs through `ema`.

A laboratory has one structure, a stack or a held plate. It measures it twice, takes it apart and assembles it anew for
every further state, of which the first has not changed and others have one change each. Sensors are put back each time.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import model
from ema import FRF, Dofs, Geometry, ModalModel, change, identify_frf
from ema.types.arrays import single_threaded
from model.stack.parts import EdgeSupport
from tests.independent.bench import BenchModes, Planted
from tests.independent.campaign import SHAKER, STACK, Configuration, Plan
from tests.independent.changes import DRAWS, FEWEST_SCATTERS, States, drawn, workshop
from tests.independent.plate import Plate
from tests.independent.solid import Solid
from tests.studies.runner import BLIND, Share, share, study
from updating.changes.compare import what_changed
from updating.changes.reference import FittedReference, fit_reference
from updating.diagnosis.candidates import CandidateModel, candidate_model, instruments_of
from updating.results.what_changed import WhatChanged

RECORD = BLIND / "changes.jsonl"
"""Those of the published table that today's rules were asked."""
FIRST_SEED = 989_000
"""Of a study that is made anew; seeds below were looked at before."""
N_CHANGED = 2
"""Changed states that each laboratory measures."""
REFERENCES = ("R1", "R2")
PRESSURE = 320e3
STACK_BAND, STACK_STEP = (100.0, 1300.0), 1.0
PLATE_BAND, PLATE_STEP = (30.0, 600.0), 0.25
PLATE = Plate()
_HELD = ("support_compliance",)
_PLACE_SHARE = 0.1  # of the length, within which a location is right

PLATE_DRAWS: dict[str, tuple[str, dict[str, tuple[float, float]], str, tuple[str, ...]]] = {
    "added mass": ("mass", {"mass": (0.01, 0.1)}, "mass", ("added_mass",)),
    "absorber": (
        "absorber",
        {"mass": (0.01, 0.1), "frequency": (40.0, 500.0), "damping": (0.005, 0.05)},
        "mass",
        ("absorber",),
    ),
    "spring": ("spring", {"stiffness": (1e3, 1e4), "damping": (0.1, 2.0)}, "stiffness", ("spring_to_ground",)),
    "softer patch": ("patch", {"lost": (0.09, 0.9), "radius": (0.02, 0.06)}, "lost", ("softer_patch",)),
    "stiffer patch": ("patch", {"more": (0.3, 3.0), "radius": (0.02, 0.06)}, "more", ("stiffer_patch",)),
    "hole": ("hole", {"diameter": (0.02, 0.08)}, "diameter", ("hole",)),
    "crack": ("crack", {"length": (0.03, 0.12)}, "length", ("crack",)),
    "stiffener": (
        "stiffener",
        {"width": (0.005, 0.03), "height": (1e-3, 4e-3), "length": (0.1, 0.25)},
        "width",
        ("stiffener",),
    ),
    "softer edge": ("edge", {"lost": (0.3, 0.97), "length": (0.03, 0.12)}, "lost", ("softer_edge",)),
    "firmer edge": ("edge", {"more": (0.5, 5.0), "length": (0.03, 0.12)}, "more", ("firmer_edge",)),
    "softer mounting": ("mounting", {"lost": (0.3, 0.9)}, "lost", ("softer_mounting",)),
}
"""Changes of a plate: what is planted, its ranges, the one that is its size, and the kinds that are right."""


@dataclass(frozen=True, kw_only=True)
class Pair:
    """A state beside its reference, and what was said of it.

    Attributes
    ----------
    seed : int
        Of the laboratory; `state` numbers its states, 0 has not changed.
    structure : str
        "stack" or "plate".
    planted : str
        What was changed; empty of nothing. `values` are its parameters.
    moved : float
        Shift of the mode that is moved most, over the scatter between two assemblies.
    place : tuple of float
        Where, m; empty where it is not at one place.
    size : float
        True size as the kind that is right has it; NaN where kinds define another.
    seen : bool
        Whether the comparison without a model calls the state changed.
    verdict, left : str, tuple of str
        The answer.
    kind_place, kind_size : tuple of float
        Location of the leading kind; median, lower and upper end of the size of the right one, empty where it is none.
    part : str
        Clamp or edge of the leading kind.
    right : tuple of str
        Kinds that are right.
    sentences : tuple of str
        The answer in words.
    """

    seed: int
    state: int
    structure: str
    planted: str
    values: dict[str, float]
    moved: float
    scatter: float
    place: tuple[float, ...]
    size: float
    seen: bool
    verdict: str
    left: tuple[str, ...]
    kind_place: tuple[float, ...]
    kind_size: tuple[float, ...]
    part: str
    right: tuple[str, ...]
    sentences: tuple[str, ...]

    @property
    def changed(self) -> bool:
        """Whether it is called changed, with a model or without."""
        return self.seen or self.verdict != "unchanged"

    @property
    def in_set(self) -> bool:
        """Whether a right kind is among those that are named."""
        return bool(set(self.left) & set(self.right))

    @property
    def placed(self) -> bool:
        """Whether the leading kind is within a tenth of the length of where the change is."""
        length = 0.465 if self.structure == "stack" else PLATE.length
        away = np.subtract(self.kind_place[:2], self.place[:2])
        return bool(np.hypot(*away) < _PLACE_SHARE * length)


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What a laboratory measured, and what is true of each state after the references."""

    seed: int
    structure: str
    tests: tuple[ModalModel, ...]
    planted: tuple[dict[str, object], ...]


def kinds_of(seed: int, structure: str) -> list[str]:
    """Return which changes a laboratory's states have: all kinds in turn."""
    every = list(DRAWS if structure == "stack" else PLATE_DRAWS)
    turn = seed // 3 if structure == "plate" else seed - seed // 3
    return [every[(N_CHANGED * turn + k) % len(every)] for k in range(N_CHANGED)]


def structure_of(seed: int) -> str:
    """Return what a laboratory has: every third one a plate."""
    return "plate" if seed % 3 == 2 else "stack"


@single_threaded
def measured(seed: int) -> Measured:
    """Simulate and identify all states of a laboratory."""
    structure = structure_of(seed)
    bench: StackBench | PlateBench = StackBench(seed) if structure == "stack" else PlateBench(seed)
    modes = [bench.modes(i) for i in range(len(REFERENCES) + 1)]
    scatter = bench.scatter(modes)
    truth = [_truth("", {}, 0.0, scatter, (), np.nan)]
    for k, name in enumerate(kinds_of(seed, structure)):
        number = len(modes)
        before, more, planted = bench.modes(number), 1.0, bench.drawn(k, name, 1.0)
        while True:  # larger until it shows, or can be no larger
            after, more = bench.modes(number, planted), 1.6 * more
            moved, larger = bench.moved(before, after) / scatter, bench.drawn(k, name, more)
            if moved > FEWEST_SCATTERS or larger == planted:
                break
            planted = larger
        modes.append(after)
        truth.append(bench.truth(name, planted, moved, scatter))
    tests = tuple(bench.test(i, one) for i, one in enumerate(modes))
    return Measured(seed=seed, structure=structure, tests=tests, planted=tuple(truth))


class StackBench:
    """A stack in the hands of one laboratory."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 1])
        plan = Plan(
            seed=seed,
            model_key="solid",
            kind="null",
            configurations=(Configuration(name="R1", torque=3.0, pressure=PRESSURE),),
            band=STACK_BAND,
            step=STACK_STEP,
            force_noise=float(np.exp(rng.uniform(np.log(2e-4), np.log(2e-3)))),
            response_noise=float(np.exp(rng.uniform(np.log(3e-4), np.log(3e-3)))),
        )
        self.seed, self.states = seed, States(plan=plan, model=Solid(order=(18, 4)), shop=workshop(rng))
        self.scatter, self.moved = self.states.scatter, self.states.moved

    def drawn(self, k: int, name: str, more: float) -> Planted:
        """Return the change of a number, its size being so many times the first one."""
        return drawn(np.random.default_rng([self.seed, 2, k]), name, len(self.states.stack[0].clamps), more)

    def modes(self, number: int, planted: Planted | None = None) -> BenchModes:
        """Return the modes of the state of a number."""
        return self.states.modes(self.states.assembled(number, planted))

    def truth(self, name: str, planted: Planted, moved: float, scatter: float) -> dict[str, object]:
        """Return what is true of a change."""
        bench = self.states.stack[0]
        values = {key: v for one in planted.values() for key, v in one.items()}
        half = np.array([bench.length, bench.width]) / 2.0
        place: tuple[float, ...] = ()
        if name in ("loose bolt", "tight bolt", "removed mass"):
            clamp = int(values["clamp"] * len(bench.clamps)) if "clamp" in values else int(next(iter(values)))
            place = bench.clamps[clamp].x, bench.clamps[clamp].y
            values = values | {"number": float(clamp + 1)}
        elif "x" in values:
            place = values["x"] * half[0], values.get("y", 0.9 if name == "glue on a side" else 0.0) * half[1]
        return _truth(name, values, moved, scatter, place, _stack_size(name, values))

    def test(self, number: int, modes: BenchModes) -> ModalModel:
        """Return what `ema` makes of the functions of a state."""
        _, _, nominal = self.states.stack
        dofs = Dofs(node=np.arange(1, SHAKER), direction=np.tile([0.0, 0.0, 1.0], (SHAKER - 1, 1)))
        geometry = Geometry(node=np.arange(1, SHAKER + 1), coordinate=nominal, line=np.empty((0, 2), dtype=int))
        frf, _ = self.states.measured(number, modes)
        value, run = frf.reshape(SHAKER - 1, 1, -1), np.repeat(np.arange(len(frf)), frf.shape[1])
        return _identified(_name(number), self.states.frequency, value, dofs, SHAKER, run, geometry)


def _stack_size(name: str, values: dict[str, float]) -> float:
    """Return the true size as a kind of change states it; NaN where patches are of another form."""
    if name in ("added mass", "absorber"):
        return values["mass"]
    if name == "removed mass":
        return -next(iter(values.values()))
    if name == "spring":
        return values["stiffness"]
    return 1.0 - values["ratio"] if name == "less pressure" else float("nan")


def _truth(
    name: str, values: dict[str, float], moved: float, scatter: float, place: Sequence[float], size: float
) -> dict[str, object]:
    return {
        "planted": name,
        "values": {key: float(v) for key, v in values.items()},
        "moved": float(moved),
        "scatter": scatter,
        "place": tuple(float(v) for v in place),
        "size": float(size),
    }


def _name(number: int) -> str:
    return REFERENCES[number] if number < len(REFERENCES) else f"S{number - len(REFERENCES)}"


def _identified(
    name: str, frequency: np.ndarray, value: np.ndarray, output: Dofs, force: int, run: np.ndarray, geometry: Geometry
) -> ModalModel:
    frf = FRF(
        frequency=frequency,
        value=value,
        quantity="accelerance",
        output=output,
        input=Dofs(node=[force], direction=[[0.0, 0.0, 1.0]]),
        run=run,
        source=(name,) * len(value),
    )
    return identify_frf(frf, geometry, name=name)


class PlateBench:
    """A held plate in the hands of one laboratory."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 1])
        self.seed, self._hold = seed, rng.uniform(0.03, 0.12)
        self._errors = rng.uniform(1e-3, 1e-2), 10.0 ** rng.uniform(-4.0, -2.7)
        self._true = dataclasses.replace(
            PLATE,
            thickness=PLATE.thickness * (1.0 + 0.01 * rng.standard_normal()),
            translation=PLATE.translation * np.exp(0.3 * rng.standard_normal()),
            rotation=PLATE.rotation * np.exp(0.5 * rng.standard_normal()),
        )
        self._nominal = _plate_points()
        self._point = self._nominal + 1e-3 * rng.standard_normal(self._nominal.shape)
        self._half = np.array([PLATE.length, PLATE.width]) / 2.0
        self.moved = _moved

    def drawn(self, k: int, name: str, more: float) -> Planted:
        """Return the change of a number, its size being so many times the first one."""
        return _plate_drawn(np.random.default_rng([self.seed, 2, k]), name, more, self._half)

    def modes(self, number: int, planted: Planted | None = None) -> tuple[np.ndarray, ...]:
        """Return the modes of the state of a number."""
        one, true = np.random.default_rng([self.seed, 3, number]), self._true
        held, young = np.exp(self._hold * one.standard_normal(2)), np.exp(5e-4 * one.standard_normal())
        plate = dataclasses.replace(
            true, translation=true.translation * held[0], rotation=true.rotation * held[1], young=true.young * young
        )
        return plate.modes(22, self._point, dict(planted or {}))

    def scatter(self, modes: Sequence[tuple[np.ndarray, ...]]) -> float:
        """Return the relative scatter of a frequency between two assemblies, from the true modes of some."""
        logs = np.log([one[0][modes[0][0] < PLATE_BAND[1]] for one in modes])
        return float(np.sqrt(2.0 * np.mean(np.var(logs, axis=0, ddof=1))))

    def truth(self, name: str, planted: Planted, moved: float, scatter: float) -> dict[str, object]:
        """Return what is true of a change."""
        values = dict(next(iter(planted.values())))
        at = (values["x"], values["y"]) if "x" in values else (-self._half[0], values.get("y", np.nan))
        return _truth(name, values, moved, scatter, () if name == "softer mounting" else at, _plate_size(name, values))

    def test(self, number: int, modes: tuple[np.ndarray, ...]) -> ModalModel:
        """Return what `ema` makes of the functions of a state."""
        return _plate_test(self.seed, number, modes, self._nominal, self._errors)


def _plate_points() -> np.ndarray:
    x = np.linspace(-0.5, 0.5, 8)[1:] * PLATE.length
    y = np.linspace(-0.5, 0.5, 5) * PLATE.width
    return np.array([(a, b) for a in x for b in y])


def _plate_drawn(rng: np.random.Generator, name: str, more: float, half: np.ndarray) -> dict[str, dict[str, float]]:
    key, ranges, size, _ = PLATE_DRAWS[name]
    values = {one: float(np.exp(rng.uniform(np.log(low), np.log(high)))) for one, (low, high) in ranges.items()}
    values[size] = min(more * values[size], ranges[size][1])
    x, y = rng.uniform(-0.85, 0.85, 2) * half
    if key == "edge":
        values["y"] = float(y)
    elif key != "mounting":
        values |= {"x": float(x), "y": float(y)}
    if key == "stiffener":
        values["angle"] = float(rng.uniform(0.0, np.pi))
        values |= {"x": 0.4 * values["x"], "y": 0.3 * values["y"]}  # within the plate, whatever its direction
    if key == "crack":  # through, along one side, its tips within the plate
        values |= {"x": 0.6 * values["x"], "y": 0.5 * values["y"], "along": float(rng.integers(2))}
    if "lost" in values:
        values["ratio"] = 1.0 - values["lost"]
    if "more" in values:
        values["ratio"] = 1.0 + values["more"]
    return {key: values}


def _plate_size(name: str, values: dict[str, float]) -> float:
    sizes = {"added mass": "mass", "absorber": "mass", "spring": "stiffness", "hole": "diameter", "crack": "length"}
    return values[sizes[name]] if name in sizes else float("nan")


def _moved(before: tuple[np.ndarray, ...], after: tuple[np.ndarray, ...]) -> float:
    a, b = (one[2] / np.linalg.norm(one[2], axis=0) for one in (before, after))
    alike = np.abs(a.T @ b)
    seen = (before[0] < PLATE_BAND[1]) & (before[0] > PLATE_BAND[0]) & (alike.max(axis=1) > 0.8)
    shift = np.abs(np.log(after[0][alike.argmax(axis=1)] / before[0]))
    return float(shift[seen].max(initial=0.0))


def _plate_test(
    seed: int, number: int, modes: tuple[np.ndarray, ...], nominal: np.ndarray, errors: tuple[float, float]
) -> ModalModel:
    """Return what `ema` makes of the functions of a plate; gains of sensors and noise are as given."""
    rng = np.random.default_rng([seed, 4, number])
    frequency = np.arange(PLATE_BAND[0], PLATE_BAND[1] + PLATE_STEP / 2.0, PLATE_STEP)
    f, ratio, shape = modes
    omega, one = 2.0 * np.pi * frequency, 2.0 * np.pi * f
    force = shape[-1]
    lines = (force / (one**2 - omega[:, None] ** 2 + 2j * ratio * one * omega[:, None])).T
    value = -(omega**2) * (shape @ lines) * (1.0 + errors[0] * rng.standard_normal((len(shape), 1)))
    level = errors[1] * np.sqrt(np.mean(np.abs(value) ** 2, axis=1, keepdims=True))
    value = value + level * (rng.standard_normal(value.shape) + 1j * rng.standard_normal(value.shape))
    n = len(nominal)
    geometry = Geometry(
        node=np.arange(1, n + 1), coordinate=np.column_stack([nominal, np.zeros(n)]), line=np.empty((0, 2), int)
    )
    dofs = Dofs(node=np.arange(1, n + 1), direction=np.tile([0.0, 0.0, 1.0], (n, 1)))
    return _identified(_name(number), frequency, value[:, None], dofs, n, np.zeros(n), geometry)


_reduced: dict[str, CandidateModel] = {}
"""Models of all stacks and of all plates: what they are said to be is the same in all laboratories."""


def reduced(found: Measured) -> CandidateModel:
    """Return the model of a structure as it is stated."""
    if found.structure not in _reduced:
        known = model.catalogue()
        effects = {name: known[name] for name in (_HELD if found.structure == "plate" else ())}
        _reduced[found.structure] = candidate_model(stated(found.structure), instruments_of(found.tests[0]), effects)
    return _reduced[found.structure]


def stated(structure: str) -> model.Stack:
    """Return what a structure is said to be."""
    if structure == "stack":
        return model.read_stack(STACK).with_contact(pressure=PRESSURE)
    return model.Stack(
        name="plate",
        length=PLATE.length,
        width=PLATE.width,
        height=PLATE.thickness,
        n_lamina=1,
        material=model.Material(young=PLATE.young, poisson=PLATE.poisson, density=PLATE.density),
        mesh=model.Mesh(n_x=12, n_y=8),
        supports=(EdgeSupport(edge="left", along=np.inf, across=np.inf, rotation=np.inf),),
    )


@single_threaded
def fitted(found: Measured) -> FittedReference:
    """Fit the reference of a laboratory."""
    n = len(REFERENCES)
    return fit_reference(reduced(found), [(t.name, PRESSURE, t) for t in found.tests[:n]])


@single_threaded
def judged(found: Measured) -> list[Pair]:
    """Ask what changed in each state of a laboratory."""
    reference, n = fitted(found), len(REFERENCES)
    pairs = []
    for k, test in enumerate(found.tests[n:]):
        seen = change([test], list(found.tests[:n])).changed
        answer = what_changed(reference, [(test.name, PRESSURE, test)], seen=seen)
        pairs.append(_pair(found, k, answer, seen=seen))
    return pairs


def _pair(found: Measured, k: int, answer: WhatChanged, *, seen: bool) -> Pair:
    truth = found.planted[k]
    name = str(truth["planted"])
    right: tuple[str, ...] = ()
    if name:
        right = DRAWS[name].right if found.structure == "stack" else PLATE_DRAWS[name][3]
    lead = answer.kind(answer.left[0]) if answer.left else None
    sized = next((answer.kind(one) for one in answer.left if one in right), None)
    return Pair(
        seed=found.seed,
        state=k,
        structure=found.structure,
        **truth,  # type: ignore[arg-type]  # as `_truth` made it
        seen=seen,
        verdict=answer.verdict,
        left=answer.left,
        kind_place=() if lead is None or not lead.local else lead.place,
        kind_size=() if sized is None else (sized.size, sized.lower, sized.upper),
        part="" if lead is None else lead.part,
        right=right,
        sentences=answer.sentences,
    )


def figures(pairs: Sequence[Pair]) -> Iterator[Share]:
    """Yield what the pairs say."""
    none = [one for one in pairs if not one.planted]
    changed = [one for one in pairs if one.planted and one.moved >= FEWEST_SCATTERS]
    named = [one for one in changed if one.left]
    placed = [one for one in named if one.place and one.kind_place]
    sized = [one for one in changed if np.isfinite(one.size) and one.kind_size]
    bolts = [one for one in changed if one.planted == "loose bolt"]

    yield share("no change: changed or named", "at most 5 %", [one.changed for one in none])
    yield share("no change: named", "at most 5 %", [bool(one.left) for one in none])
    yield share("one change: changed", "97 %", [one.changed for one in changed])
    yield share("one change: kind right or in the set", "80 %", [one.in_set for one in changed])
    yield share("one change: named, and not one of the names is right", "at most 5 %",
                [bool(one.left) and not one.in_set for one in changed])  # fmt: skip
    yield share("one change: a wrong name first", "at most 5 %",
                [bool(one.left) and one.left[0] not in one.right for one in changed])  # fmt: skip
    yield share("location within a tenth of the length, of those named", "80 %", [one.placed for one in placed])
    yield share("intervals of 90 % hold the size", "80 to 97 %",
                [one.kind_size[1] <= one.size <= one.kind_size[2] for one in sized])  # fmt: skip
    yield share("loose bolts: the right clamp is in the answer", "80 %",
                [one.in_set and one.part == f"clamp {one.values['number']:.0f}" for one in bolts])  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Laboratory:
    """What was said of all states of one laboratory."""

    seed: int
    pairs: tuple[Pair, ...]


def solved(seed: int) -> Laboratory:
    """Simulate a laboratory and ask what changed in each of its states."""
    return Laboratory(seed=seed, pairs=tuple(judged(measured(seed))))


def study_of(number: int, record: Path, first: int = FIRST_SEED) -> list[Pair]:
    """Return the pairs of so many laboratories; those that a record holds are read back, others are added to it."""
    asked = [(seed,) for seed in range(first, first + number)]
    found = study(asked, solved, record, Laboratory, lambda case: (case.seed,))
    return [pair for one in found for pair in one.pairs]
