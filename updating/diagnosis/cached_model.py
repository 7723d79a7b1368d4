"""The reduced model of a stack, cached for its next diagnosis: no measurement enters it, and it takes long."""

from __future__ import annotations

import inspect
import platform
import sys
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from types import FunctionType
from typing import Any

import platformdirs

from model import (
    Assembly,
    Effect,
    Instruments,
    Kron,
    Mesh,
    Monomial,
    ReducedEquations,
    ReducedSystem,
    Stack,
    Term,
)
from model.contact.pressure import InterfaceLaw, PressureField
from model.effects import parts
from model.effects.catalogue import shipped
from model.elements.equations import Formula, Product, Riding
from model.elements.mesh import Plan, plan_on
from model.reduction.reduced_equations import InRange, ReducedTerm
from model.reduction.riding import RidingPart
from model.stack.inputs import CompressionCurve
from model.stack.outline import Outline, Triangulation
from model.stack.parts import Clamp, Contact, EdgeSupport, Interlayer, Material, PatchSupport, Pressing
from updating.diagnosis.candidates import CandidateModel, candidate_model, clamp_places
from updating.errors import StoreError
from updating.results.array_file import Special, flattened, read_arrays, restored, write_arrays
from updating.results.store import digest, versions

N_CACHED = 3
"""Models that are cached, those that were used last; each takes some 260 MB."""
_TYPES = (
    Assembly, CandidateModel, Clamp, CompressionCurve, Contact, EdgeSupport, InRange, Instruments, InterfaceLaw,
    Interlayer, Kron, Material, Mesh, Monomial, Outline, PatchSupport, Pressing, PressureField, Product,
    ReducedEquations, ReducedSystem, ReducedTerm, Riding, RidingPart, Stack, Term, Triangulation,
)  # fmt: skip


def cached_model(
    stack: Stack,
    instruments: Instruments,
    effects: Mapping[str, Effect],
    aids: Sequence[Effect] = (),
    executor: Executor | None = None,
) -> CandidateModel:
    """Return `candidate_model`, or read it from the user's cache folder where an earlier call left the same.

    A model with effects that do not ship is not cached, for their code may change. A folder that cannot be written, or
    a damaged file there, costs the time alone.

    Parameters
    ----------
    stack, instruments, effects, aids, executor
        As in `candidate_model`.
    """
    file = _file(stack, instruments, effects, aids)
    if file is None:
        return candidate_model(stack, instruments, effects, aids, executor)
    candidates = _read(*file)
    if candidates is not None:
        return candidates
    candidates = candidate_model(stack, instruments, effects, aids, executor)
    path, made, special = file
    with suppress(StoreError, OSError, TypeError):  # what cannot be written is made anew
        write_arrays(path, flattened(candidates, _TYPES, special), made)
        _forget(path.parent)
    return candidates


def kept_model(
    stack: Stack, instruments: Instruments, effects: Mapping[str, Effect], aids: Sequence[Effect] = ()
) -> CandidateModel | None:
    """Return what `cached_model` left, and None where it is not there."""
    file = _file(stack, instruments, effects, aids)
    return None if file is None else _read(*file)


def _file(
    stack: Stack, instruments: Instruments, effects: Mapping[str, Effect], aids: Sequence[Effect]
) -> tuple[Path, Mapping[str, Any], tuple[Special, ...]] | None:
    """Return where a model is cached, what it is made by, and how it is written; None of one that is not cached."""
    shipped_effects = [vars(effect) for effect in shipped()]  # by what they are: other processes have copies
    if any(vars(effect) not in shipped_effects for effect in (*stack.effects, *effects.values())):
        return None
    made_by = {**versions(), "scikit-fem": version("scikit-fem"), "python": platform.python_version()}
    base = replace(stack, instruments=instruments)
    what = digest({"stack": base, "effects": [*effects, *(aid.name for aid in aids)]})
    special = _special((*stack.effects, *effects.values(), *aids, *clamp_places(base)))
    return (
        folder() / f"model_{what}.arrays",
        {"versions": made_by, "stack": stack.name, "digest": what},
        special,
    )


def folder() -> Path:
    """Return where models are cached."""
    return platformdirs.user_cache_path("lamella", appauthor=False)


def _read(path: Path, made: Mapping[str, Any], special: Sequence[Special]) -> CandidateModel | None:
    try:
        graph = read_arrays(path, made)
        if graph is None:
            return None
        candidates = restored(graph, _TYPES, special)
        path.touch()  # for it was used now
    except Exception:  # no file, or what one makes of its reading that somebody wrote by hand
        return None
    return candidates if isinstance(candidates, CandidateModel) else None


def _forget(where: Path) -> None:
    """Remove all models but those that were used last."""
    files = sorted(where.glob("model_*"), key=lambda file: file.stat().st_mtime, reverse=True)
    for file in files[N_CACHED:]:
        file.unlink(missing_ok=True)


def _special(effects: Iterable[Effect]) -> tuple[Special, ...]:
    """Return how what is no data is written: effects and their factors by name, and a mesh's spaces by the mesh."""
    known = {effect.name: effect for effect in effects}
    return (
        Special(kind=Effect, down=lambda effect: effect.name, up=known.__getitem__),
        Special(kind=Formula, down=lambda formula: formula.function, up=Formula),
        *(Special(kind=kind, down=_written, up=_formula) for kind in (FunctionType, partial)),
        Special(
            kind=Plan,
            down=lambda plan: (plan.membrane.mesh.p, plan.membrane.mesh.t),
            up=lambda mesh: plan_on(*mesh),
        ),
    )


def _written(function: Any) -> dict[str, Any]:
    """Return the name of a function in its module and, of a partial one, what it is given.

    Raises
    ------
    TypeError
        It cannot be found by a name.
    """
    given = dict[str, Any]()
    if isinstance(function, partial) and not function.args:
        function, given = function.func, function.keywords
    written = {"module": function.__module__, "name": function.__qualname__, "given": given}
    if _function(written) is not function:
        raise TypeError(f"{function} is not found by its name")
    return written


def _formula(written: Mapping[str, Any]) -> Any:
    """Return the function that is meant, with what it is given."""
    function = _function(written)
    return partial(function, **written["given"]) if written["given"] else function


@cache
def _modules() -> frozenset[str]:
    """Return the modules that factors of the effects that ship are in."""
    return frozenset((parts.__name__, *(effect.terms.__module__ for effect in shipped())))


def _function(written: Mapping[str, Any]) -> Any:
    """Return a function by its name: one of the parameters alone, in the modules of the effects that ship.

    Raises
    ------
    TypeError
        There is none: a file must not choose what code runs.
    """
    module, name = written["module"], written["name"]
    if module in _modules():
        factor = getattr(sys.modules[module], name, None)
        if inspect.isfunction(factor) and factor.__module__ == module:
            (first, *_) = inspect.get_annotations(factor).values()
            if first == "Theta":
                return factor
    raise TypeError(f"{module}.{name} is no factor of an effect")
