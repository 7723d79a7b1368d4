"""`lamella effects`: list the physical effects beyond the base model, or explain one."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from rich.console import Console
from rich.table import Table

from ema.plot.figures import as_png
from ema.types.threads import single_threaded
from model import Effect, Parameter, catalogue, find_effects, read_stack
from model.effects.conformance import effect_faults
from model.stack.effect import Family
from updating.commands.terminal import OUT, bar
from updating.diagnosis.signature import Signature, signature, signature_figure
from updating.results.store import write_bytes

_WIDTH = 98
_SAME_SHAPE = 0.95  # cross-orthogonality of a mode with itself


@single_threaded
def effects_command(
    name: str | None, stack: Path | None, output: Path | None, effect_file: Sequence[Path]
) -> bool:
    """List effects or explain one; return whether that has no fault."""
    if name is None:
        for table in effect_tables(catalogue(effect_file)):
            OUT.print(table)
        OUT.print("More about one: lamella effects NAME --stack STACK")
        return True
    explained = explain(name, stack, output, effect_file, OUT)
    OUT.print(effect_text(explained.effect), markup=False, highlight=False)
    OUT.print(parameter_table(explained.effect))
    for fault in explained.faults:
        OUT.print(f"Fault: {fault}", style="bold red", markup=False, highlight=False)
    if explained.signature is None:
        OUT.print("What it does to your stack: add --stack STACK")
    else:
        OUT.print(signature_table(explained.signature))
    return not explained.faults


@dataclass(frozen=True, eq=False, kw_only=True)
class Explained:
    """An effect as `explain` finds it.

    `signature` is None without a stack; `faults` are those of an effect that does not ship.
    """

    effect: Effect
    faults: tuple[str, ...]
    signature: Signature | None


def explain(
    name: str, stack_file: Path | None, output: Path | None, files: Iterable[Path], console: Console
) -> Explained:
    """Find an effect, check it if it is the user's own, and try it on the stack; with `output` draw that."""
    shipped = catalogue()
    (effect,) = find_effects([name], catalogue(files))
    with bar(console) as progress:
        task = progress.add_task("explain", total=2)
        faults = () if effect.name in shipped else effect_faults(effect)
        progress.advance(task)
        found = None
        if stack_file is not None and not faults:
            found = signature(read_stack(stack_file), effect)
            if output is not None:
                write_bytes(output / f"{effect.name}.png", as_png(signature_figure(found)))
        progress.advance(task)
    return Explained(effect=effect, faults=faults, signature=found)


def effect_tables(known: dict[str, Effect]) -> tuple[Table, ...]:
    """List effects, one table a family, with their parameters."""
    tables = []
    for family in get_args(Family):
        members = [effect for effect in known.values() if effect.family == family]
        table = Table(title=family, title_justify="left", width=_WIDTH)
        table.add_column("effect", width=28)
        table.add_column("what it is", ratio=1)
        table.add_column("parameter, range and unit", ratio=1)
        for effect in members:
            table.add_row(
                effect.printed, effect.summary, "\n".join(f"{p.name} {_range(p)}" for p in effect.parameters)
            )
        if members:
            tables.append(table)
    return tuple(tables)


def effect_text(effect: Effect) -> str:
    """Write what an effect is, its paragraphs filled to the width of the terminal's tables."""
    paragraphs: list[str] = []
    for line in effect.description.strip().splitlines():
        if line.startswith((" ", "\t")) or (paragraphs and line and paragraphs[-1] and line[0].islower()):
            paragraphs[-1] += f" {line.strip()}"
        else:
            paragraphs.append(line.strip())
    filled = (textwrap.fill(text, _WIDTH, subsequent_indent="    ") for text in paragraphs)
    return f"{effect.printed}, {effect.family}\n\n" + "\n".join(filled) + "\n"


def parameter_table(effect: Effect) -> Table:
    """List the parameters of an effect with unit, range and source."""
    table = Table(title="Parameters", title_justify="left", width=_WIDTH)
    for name in ("parameter", "range and unit", "nominal", "neutral"):
        table.add_column(name, no_wrap=True)
    table.add_column("source", ratio=1)
    for p in effect.parameters:
        table.add_row(p.name, _range(p), f"{p.nominal:g}", f"{p.neutral:g}", p.source)
    return table


def signature_table(found: Signature) -> Table:
    """List what an effect does to the first modes at each pressure."""
    values = ", ".join(f"{name} = {value:g}" for name, value in found.strength.items())
    turned = [
        name for name, like in zip(found.mode, found.likeness.T, strict=True) if like.min() < _SAME_SHAPE
    ]
    table = Table(
        title=f"What it does at {values}",
        title_justify="left",
        caption=f"The shape of {', '.join(turned)} changes: MAC in mass below {_SAME_SHAPE**2:.2g}."
        if turned
        else None,
        caption_justify="left",
    )
    table.add_column("pressure", justify="right")
    table.add_column("change of")
    for name, f in zip(found.mode, found.base_frequency.T, strict=True):
        table.add_column(f"{name}\n{f[0]:.0f} to {f[-1]:.0f} Hz", justify="right")
    rows = zip(found.pressure, 100.0 * found.frequency_change, 100.0 * found.damping_change, strict=True)
    for pressure, frequency, damping in rows:
        at = f"{pressure / 1e3:g} kPa"
        table.add_row(at, "frequency [%]", *(f"{x:+.2f}" for x in frequency))
        table.add_row("", "damping ratio [% points]", *(f"{x:+.3f}" for x in damping))
    return table


def _range(parameter: Parameter) -> str:
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    return f"{parameter.lower:g} to {parameter.upper:g}{unit}"
