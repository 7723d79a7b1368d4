"""Coordinates of many specimens: what the rig, a group, a specimen or one state has, and which terms there are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from updating.diagnosis.evidence import LABELS, PRESSURE, STATED_PRESSURE, WINDOW
from updating.diagnosis.fit_settings import FitSettings
from updating.diagnosis.fit_settings import Scope as Where
from updating.diagnosis.stack_model import StackModel
from updating.inference.levels import MISSING
from updating.inference.protocol import Coordinate, Term
from updating.pooled.specimen import Level

CONTACT = {"G_f": "contact stiffness", "d_f": "contact damping"}
"""Contact parameters in which a group or a specimen may differ from the rest, with their labels."""
CONTACT_SPREAD = 0.5
"""Prior standard deviation of the logarithm of the ratio of such a parameter to that of the rest."""
SHARED_PART = 0.5
"""Share of the variance of a nuisance, such as Young's modulus, that all specimens have in common."""
SCATTER = {"G_f": 0.2, "d_f": 0.4}
"""Standard deviations of ln G_f and ln d_f from specimen to specimen before any was measured: table 6 of Pirnat, Cepon
and Boltezar (2013) has 0.2 and 0.5 over six stacks."""
_FARTHEST = 8.0  # prior standard deviations that a nuisance may move


@dataclass(frozen=True, kw_only=True)
class Scope:
    """Where a coordinate acts.

    Attributes
    ----------
    local : str
        What it is to the model of one stack.
    members : tuple of int
        Specimens that have it.
    """

    local: str
    members: tuple[int, ...]


Scoped = dict[str, tuple[Coordinate, Scope]]


def nuisances_of(
    local: Mapping[str, Coordinate], names: Sequence[str], states: Sequence[Sequence[str]], scatter: Mapping[str, float]
) -> Scoped:
    """Return the coordinates of the base model: what specimens share, and what belongs to each.

    Parameters
    ----------
    local : mapping of str to Coordinate
        Nuisances of the model of one stack.
    names : sequence of str
        The specimens.
    states : sequence of sequence of str
        The states of each.
    scatter : mapping of str to float
        Standard deviations of ln G_f and ln d_f from specimen to specimen.
    """
    all_specimens, scoped = tuple(range(len(names))), Scoped()
    for name, c in local.items():
        if "[" in name and not name.startswith("gain"):  # of one state: one coordinate for each specimen
            what, _, state = name.partition("[")
            for s in all_specimens:
                if state.rstrip("]") in states[s] and len(states[s]) > 1:
                    key = f"{what}[{names[s]} {state}"
                    scoped[key] = replace(c, name=key), Scope(local=name, members=(s,))
            continue
        alone = name.startswith("gain") or name == "window"  # of the rig's instruments
        both = 1.0 if alone or name in CONTACT else np.sqrt(SHARED_PART)
        scoped[name] = _scaled(c, name, both), Scope(local=name, members=all_specimens)
        if alone:
            continue
        for s in all_specimens:
            key = f"{name}[{names[s]}]"
            if name in CONTACT:
                std = scatter[name]
                coordinate = replace(
                    c, name=key, std=std, lower=-_FARTHEST * max(std, 0.1), upper=_FARTHEST * max(std, 0.1)
                )
            else:
                coordinate = _scaled(c, key, np.sqrt(1.0 - SHARED_PART))
            scoped[key] = coordinate, Scope(local=name, members=(s,))
    return scoped


def with_settings(scoped: Scoped, model: StackModel, names: Sequence[str], settings: FitSettings) -> Scoped:
    """Return the coordinates of the base model with the settings of parameters.

    Parameters
    ----------
    scoped : Scoped
        The coordinates, as they are without.
    model : StackModel
        Of one group of specimens.
    names : sequence of str
        The specimens.
    settings : FitSettings
        What is known.
    """
    several = {scope.members[0] for key, (_, scope) in scoped.items() if _level(key, names) == "configuration"}
    usual = {c.name: c for c in model.nuisances}
    made = Scoped()
    for key, (c, scope) in scoped.items():
        what = key.partition("[")[0]
        levels: list[Where] = ["all", "specimen"]
        if what in CONTACT and not several.isdisjoint(scope.members):
            levels.append("configuration")
        level = _level(key, names)
        made[key] = settings.part(c, what, level, levels, usual.get(what, c), model.stack), scope
    return made


def _level(key: str, names: Sequence[str]) -> Where:
    """Return the level of a coordinate: all specimens, one specimen, or one of its configurations."""
    _, bracket, where = key.partition("[")
    return "all" if not bracket else "specimen" if where.rstrip("]") in names else "configuration"


def _scaled(c: Coordinate, name: str, share: float) -> Coordinate:
    """Return a coordinate of a share of the prior's standard deviation."""
    if not np.isfinite(c.std):
        return replace(c, name=name)
    return replace(c, name=name, std=c.std * share, lower=c.lower * share, upper=c.upper * share)


@dataclass(frozen=True, kw_only=True)
class Meant:
    """What a term is: an effect, a hypothesis about the measurement, or a contact parameter, at a level."""

    effect: str
    level: Level


def terms_of(
    model: StackModel, levels: Sequence[Level], nuisances: Scoped, states_of: Sequence[Sequence[int]]
) -> tuple[dict[str, Term], dict[str, Meant], Scoped]:
    """Return all that may be missing, what each term is, and where its coordinates act.

    Effects are tried at every level; contact parameters and what a file states wrongly where they are not all alike.
    Half of all models lack nothing; effects are as probable, and so are the rig, the groups together, and the specimens
    together.

    Parameters
    ----------
    model : StackModel
        Of one group of specimens.
    levels : sequence of Level
        The rig, groups, and specimens.
    nuisances : Scoped
        Coordinates of the base model.
    states_of : sequence of sequence of int
        States of each specimen.
    """
    terms, meant, scoped = dict[str, Term](), dict[str, Meant](), Scoped()
    hypotheses = {n: frees for n, frees in model.hypotheses.items() if n != WINDOW}
    contact = tuple(CONTACT) if model.touching else ()
    n_effect = len(model.effects) + len(hypotheses) + len(contact)
    kinds, of_stack = [level.kind for level in levels], model.terms
    for level in levels:
        prior = float(np.log(MISSING / n_effect / len(set(kinds)) / kinds.count(level.kind)))
        states = tuple(c for s in level.members for c in states_of[s])

        def add(effect: str, level: Level, coordinates: dict[str, tuple[Coordinate, str]], **frees: float) -> None:
            name = named(effect, level)
            terms[name] = Term(
                name=name,
                coordinates=tuple(c for c, _ in coordinates.values()),
                frees=frees,
                log_prior=prior,  # noqa: B023  # called within the turn
                states=states,  # noqa: B023
            )
            meant[name] = Meant(effect=effect, level=level)
            for key, (c, local) in coordinates.items():
                scoped[key] = c, Scope(local=local, members=level.members)

        for effect in model.effects:
            by_name = {named(c.name, level): c for c in of_stack[effect].coordinates}
            add(effect, level, {full_name: (replace(c, name=full_name), c.name) for full_name, c in by_name.items()})
        for effect, frees in hypotheses.items():
            if level.kind == "group":
                continue
            if effect == STATED_PRESSURE and level.kind == "rig":  # of a torque in all specimens
                of_torque = {f"{n}@rig": (_normal(f"{n}@rig", PRESSURE), n) for n in frees}
                add(effect, level, of_torque)
                continue
            freed = {
                key: std
                for key, (_, scope) in nuisances.items()
                for n, std in frees.items()
                if scope.local == n and scope.members == level.members
            }
            if freed:
                add(effect, level, {}, **freed)
        for what in contact if level.kind in ("group", "specimen") else ():
            key = f"{named(what, level)}"
            add(what, level, {key: (_normal(key, CONTACT_SPREAD), what)})
    return terms, meant, scoped


def _normal(name: str, std: float) -> Coordinate:
    return Coordinate(name=name, std=std, lower=-_FARTHEST * std, upper=_FARTHEST * std, step=0.1, longest=0.4)


def named(effect: str, level: Level) -> str:
    """Return the name of a term, or of a coordinate, at a level: that of the effect alone where it is the rig's."""
    return effect if level.kind == "rig" else f"{effect}@{level.of}"


def label_of(model: StackModel, effect: str) -> str:
    """Return the label of an effect, a hypothesis or a contact parameter."""
    return model.effects[effect].label if effect in model.effects else {**LABELS, **CONTACT}[effect]
