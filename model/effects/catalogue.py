"""The catalogue of physical effects: those of `model/effects`, of installed packages and of the user's own files."""

from __future__ import annotations

import difflib
import importlib
import importlib.metadata
import importlib.util
import pkgutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import ModuleType

import model.effects
from model.stack.effect import Effect
from model.stack.errors import EffectError

ENTRY_POINTS = "lamella.effects"
"""Group of entry points under which an installed package offers effects."""
_NOT_EFFECTS = ("catalogue", "conformance", "parts")  # what stands beside the effects


def catalogue(files: Iterable[Path] = ()) -> dict[str, Effect]:
    """Return all effects by name: those that ship, those of installed packages, and those of the given files.

    Parameters
    ----------
    files : iterable of Path
        Python files that end in ``EFFECT = Effect(...)``. Their code runs.

    Raises
    ------
    EffectError
        A file cannot be read or has no effect, or two effects have one name.
    """
    installed = [
        _checked(point.load(), f"entry point {point.name} = {point.value}")
        for point in importlib.metadata.entry_points(group=ENTRY_POINTS)
    ]
    found: dict[str, Effect] = {}
    for effect in (*shipped(), *installed, *map(read_effect, files)):
        if effect.name in found:
            raise EffectError(f"two effects have the name {effect.name!r}; rename one of them")
        found[effect.name] = effect
    return found


def shipped() -> tuple[Effect, ...]:
    """Return the effects of `model/effects`."""
    modules = (
        importlib.import_module(f"model.effects.{found.name}")
        for found in pkgutil.iter_modules(model.effects.__path__)
        if found.name not in _NOT_EFFECTS
    )
    return tuple(_effect_of(module, module.__name__) for module in modules)


def read_effect(path: Path) -> Effect:
    """Run a Python file and return the effect in which it ends.

    Raises
    ------
    EffectError
        The file cannot be read or run, or does not end in ``EFFECT = Effect(...)``.
    """
    path = Path(path)
    spec = importlib.util.spec_from_file_location(f"lamella_effect_{path.stem}", path)
    if not path.is_file() or spec is None or spec.loader is None:
        raise EffectError(f"{path}: not a Python file that can be read; give one that ends in EFFECT = Effect(...)")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except EffectError as error:
        raise EffectError(f"{path}: {error}") from error
    except Exception as error:  # whatever the user's own code raises
        raise EffectError(f"{path}: {type(error).__name__}: {error}") from error
    return _effect_of(module, str(path))


def find_effects(names: Iterable[str], known: dict[str, Effect] | None = None) -> tuple[Effect, ...]:
    """Return effects by name, of the catalogue unless others are known.

    Raises
    ------
    EffectError
        There is none of a name; the message has the closest ones.
    """
    names, known = list(names), catalogue() if known is None else known
    for name in names:
        if name not in known:
            close = difflib.get_close_matches(name, known, n=3)
            hint = f"did you mean {' or '.join(close)}?" if close else f"there are {', '.join(sorted(known))}"
            raise EffectError(f"no effect {name!r}; {hint}")
    return tuple(known[name] for name in names)


def printed_effects(names: Iterable[str], known: Mapping[str, Effect] | None = None) -> tuple[str, ...]:
    """Return effects as a person reads them, "label (key)"; the key alone of those that are not known.

    Parameters
    ----------
    names : iterable of str
        Keys, such as a result has that was made with effects of the user's own files.
    known : mapping of str to Effect, optional
        Effects by name; the catalogue by default.
    """
    known = catalogue() if known is None else known
    return tuple(known[name].printed if name in known else name for name in names)


def _effect_of(module: ModuleType, where: str) -> Effect:
    if not hasattr(module, "EFFECT"):
        raise EffectError(f"{where}: has no EFFECT; an effect file ends in EFFECT = Effect(...)")
    return _checked(module.EFFECT, where)


def _checked(effect: object, where: str) -> Effect:
    if not isinstance(effect, Effect):
        raise EffectError(f"{where}: EFFECT is a {type(effect).__name__}; it must be a model.Effect")
    return effect
