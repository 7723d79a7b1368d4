"""Effects as the command line names them: ``NAME`` or ``NAME:parameter=value,parameter=value``."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from model import Effect, EffectError, Stack, find_effects


def with_named_effects(stack: Stack, options: Iterable[str], known: dict[str, Effect]) -> Stack:
    """Return the stack with effects that have the values given, and nominal ones where none is.

    Raises
    ------
    EffectError
        An effect or a parameter is unknown, or a value is no number in the parameter's range.
    """
    for option in options:
        name, _, given = option.partition(":")
        effect = find_effects([name.strip()], known)[0]
        values = {p.name: p.nominal for p in effect.parameters}
        values.update(_value(effect, part) for part in given.split(",") if part.strip())
        stack = stack.with_effects(effect, **values)
    return stack


def _value(effect: Effect, text: str) -> tuple[str, float]:
    name, equals, number = (part.strip() for part in text.partition("="))
    parameters = {p.name: p for p in effect.parameters}
    if not equals:
        message = f"effect {effect.name}: {text!r} must be parameter=value; it has {', '.join(parameters)}"
        raise EffectError(message)
    if name not in parameters:
        close = difflib.get_close_matches(name, parameters, n=1)
        hint = f"did you mean {close[0]}?" if close else f"it has {', '.join(parameters)}"
        message = f"effect {effect.name}: no parameter {name!r}; {hint}"
        raise EffectError(message)
    parameter = parameters[name]
    try:
        value = float(number)
    except ValueError as error:
        message = f"effect {effect.name}: {name} must be a number in {parameter.unit}, got {number!r}"
        raise EffectError(message) from error
    if not parameter.lower <= value <= parameter.upper:
        message = (
            f"effect {effect.name}: {name} = {value:g} {parameter.unit} lies outside its range, "
            f"{parameter.lower:g} to {parameter.upper:g} {parameter.unit}"
        )
        raise EffectError(message)
    return name, value
