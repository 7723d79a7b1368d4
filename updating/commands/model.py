"""The commands on models alone: solve a stack or matrices, explain an effect, simulate a test."""

from __future__ import annotations

import difflib
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import numpy as np
from rich.table import Table as Printed

from ema.plot.figures import as_png
from ema.types.arrays import single_threaded
from model import (
    Effect,
    EffectError,
    MatricesError,
    Modes,
    Parameter,
    Stack,
    catalogue,
    find_effects,
    read_matrices,
    read_stack,
    reduce_matrices,
)
from model.contact.pressing import PressureSummary, press
from model.effects.conformance import effect_faults
from model.matrices.structure_file import is_structure_file, matrices_inputs
from model.modes.refinement import Verification, solve_verified
from model.plot.plots import mode_png, pressure_figure
from model.reduction.through_thickness import n_rigid
from model.stack.effect import Family
from model.stack.parts import Pressing
from model.stack.stack_file import stack_inputs
from updating.commands.terminal import OUT, bar, print_lines
from updating.correlation.shape_class import class_grid, shape_classes
from updating.results.store import write_bytes, write_result
from updating.results.text import Table

if TYPE_CHECKING:
    from updating.diagnosis.signature import Signature

_WIDTH = 98


@single_threaded
def effects_command(name: str | None, stack: Path | None, output: Path | None, effect_file: Sequence[Path]) -> bool:
    """List effects or explain one; return whether that has no fault."""
    if name is None:
        OUT.print(*effect_tables(catalogue(effect_file)))
        OUT.print("More about one: lamella effects NAME --stack STACK")
        return True
    (effect,) = find_effects([name], catalogue(effect_file))
    OUT.print(effect_text(effect))
    OUT.print(parameter_table(effect))
    with OUT.status("check the effect, and try it on the stack"):
        faults = () if effect.name in catalogue() else effect_faults(effect)  # those that ship have none
        shown = None
        if stack is not None and not faults:
            from updating.diagnosis.signature import signature, signature_figure

            shown = signature(read_stack(stack), effect)
            if output is not None:
                write_bytes(output / f"{effect.name}.png", as_png(signature_figure(shown)))
    for fault in faults:
        OUT.print(f"Fault: {fault}", style="bold red")
    OUT.print("What it does to your stack: add --stack STACK" if shown is None else signature_table(shown))
    return not faults


def effect_tables(known: dict[str, Effect]) -> tuple[Printed, ...]:
    """List effects, one table a family, with their parameters."""
    tables = []
    for family in get_args(Family):
        members = [effect for effect in known.values() if effect.family == family]
        table = Printed(title=family, title_justify="left", width=_WIDTH)
        table.add_column("effect", width=28)
        table.add_column("what it is", ratio=1)
        table.add_column("parameter, range and unit", ratio=1)
        for effect in members:
            table.add_row(effect.printed, effect.summary, "\n".join(f"{p.name} {_range(p)}" for p in effect.parameters))
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


def parameter_table(effect: Effect) -> Printed:
    """List the parameters of an effect with unit, range and source."""
    table = Printed(title="Parameters", title_justify="left", width=_WIDTH)
    for name in ("parameter", "range and unit", "nominal", "neutral"):
        table.add_column(name, no_wrap=True)
    table.add_column("source", ratio=1)
    for p in effect.parameters:
        table.add_row(p.name, _range(p), f"{p.nominal:g}", f"{p.neutral:g}", p.source)
    return table


def signature_table(signature: Signature) -> Table:
    """List what an effect does to the first modes at each pressure."""
    same_shape = 0.95  # cross-orthogonality of a mode with itself
    values = ", ".join(f"{name} = {value:g}" for name, value in signature.strength.items())
    turned = [name for name, like in zip(signature.mode, signature.likeness.T, strict=True) if like.min() < same_shape]
    modes = zip(signature.mode, signature.base_frequency.T, strict=True)
    changes = (100.0 * signature.frequency_change, 100.0 * signature.damping_change)
    rows: list[list[str]] = []
    for pressure, frequency, damping in zip(signature.pressure, *changes, strict=True):
        rows.append([f"{pressure / 1e3:g} kPa", "frequency [%]", *(f"{x:+.2f}" for x in frequency)])
        rows.append(["", "damping ratio [% points]", *(f"{x:+.3f}" for x in damping)])
    return Table(
        f"What it does at {values}",
        ("pressure", "change of", *(f"{name}\n{f[0]:.0f} to {f[-1]:.0f} Hz" for name, f in modes)),
        rows,
        f"The shape of {', '.join(turned)} changes: MAC in mass below {same_shape**2:.2g}." if turned else "",
    )


def _range(parameter: Parameter) -> str:
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    return f"{parameter.lower:g} to {parameter.upper:g}{unit}"


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
        raise EffectError(f"effect {effect.name}: {text!r} must be parameter=value; it has {', '.join(parameters)}")
    if name not in parameters:
        close = difflib.get_close_matches(name, parameters, n=1)
        hint = f"did you mean {close[0]}?" if close else f"it has {', '.join(parameters)}"
        raise EffectError(f"effect {effect.name}: no parameter {name!r}; {hint}")
    parameter = parameters[name]
    try:
        value = float(number)
    except ValueError as error:
        raise EffectError(
            f"effect {effect.name}: {name} must be a number in {parameter.unit}, got {number!r}"
        ) from error
    if not parameter.lower <= value <= parameter.upper:
        raise EffectError(
            f"effect {effect.name}: {name} = {value:g} {parameter.unit} lies outside its range, "
            f"{parameter.lower:g} to {parameter.upper:g} {parameter.unit}"
        )
    return name, value


def solve_matrices(file: Path, output: Path, n_mode: int) -> Table:
    """Solve the modes of a structure, write them, say what the file and the reduction leave out, and list them.

    Raises
    ------
    MatricesError
        It has fewer modes than are asked for.
    """
    with bar(OUT) as progress:
        task = progress.add_task("read, reduce and solve", total=2)
        structure = read_matrices(file)
        progress.advance(task)
        reduced = reduce_matrices(structure)
        progress.advance(task)
    print_lines(OUT, structure.notes, soft_wrap=True)
    frequency = reduced.solve()[0]
    elastic = frequency[frequency > 1e-3 * structure.band_Hz]
    inside = elastic[elastic <= structure.band_Hz][:n_mode]
    if not inside.size:
        raise MatricesError(f"{file}: no mode below reduction.band_Hz = {structure.band_Hz:g}; raise it")
    none = np.zeros((0, inside.size))
    from updating.diagnosis.matrices_answer import modes_at

    modes = modes_at(inside, np.zeros(inside.size), none, np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    write_result(output / "modes.json", modes, inputs=matrices_inputs(file), options={"n_mode": n_mode})
    return Table(
        f"{structure.name}: {inside.size} elastic modes up to {structure.band_Hz:g} Hz",
        ("mode", "f [Hz]"),
        [(str(r), f"{f:.4f}") for r, f in enumerate(inside, start=1)],
        f"{frequency.size - elastic.size} modes of a rigid body. {structure.node.size} degrees of freedom were "
        f"reduced to {reduced.size}; that leaves at most {100 * reduced.left['nominal']:.2g} % of a "
        f"frequency, and {100 * max(reduced.left.values()):.2g} % one prior deviation of a term away.",
    )


@single_threaded
def model_command(
    stack: Path, output: Path, modes: int, tolerance: float, effect: Sequence[str], effect_file: Sequence[Path]
) -> None:
    """Solve the model of a stack or of matrices, and print its modes."""
    if is_structure_file(stack):
        if effect or effect_file:
            raise EffectError(
                f"{stack}: effects are added to stacks; of a structure of matrices terms and places may vary"
            )
        OUT.print(solve_matrices(stack, output, modes))
        return
    with_effects = read_stack(stack)
    if effect or effect_file:
        with_effects = with_named_effects(with_effects, effect, catalogue(effect_file))
    solve(with_effects, (*stack_inputs(stack), *effect_file), output, modes, tolerance)
    OUT.print(f"Results in {output}")


def solve(
    stack: Stack, inputs: tuple[Path, ...], output: Path, n_mode: int, tolerance: float
) -> tuple[Modes, Verification]:
    """Press a stack where its file says how, solve its elastic modes, and write and print both with their pictures."""
    options = {"n_mode": n_mode, "tolerance": tolerance, "effects": dict(stack.effect_values)}
    pressure = None
    with bar(OUT) as progress:
        task = progress.add_task("press and solve", total=2 + n_mode)
        if isinstance(stack.pressing, Pressing):
            field = press(stack)
            stack, pressure = replace(stack, pressing=field), field.summary()
            write_result(output / "pressure.json", pressure, inputs=inputs, options={})
            write_bytes(output / "pressure.png", as_png(pressure_figure(field)))
        progress.advance(task)
        system, all_modes, verification = solve_verified(
            stack, n_mode=n_rigid(stack) + n_mode, observation=class_grid(stack), tolerance=tolerance
        )
        modes = all_modes.elastic()
        verification = replace(verification, error=verification.error[all_modes.n_rigid :])
        write_result(output / "modes.json", modes, inputs=inputs, options=options)
        write_result(output / "verification.json", verification, inputs=inputs, options=options)
        progress.advance(task)
        for r in range(modes.frequency.size):
            write_bytes(output / f"mode_{r + 1:02d}.png", mode_png(system, modes, r))
            progress.advance(task)
    names = shape_classes(modes) if stack.outline is None else ("",) * modes.frequency.size
    if pressure is not None:
        OUT.print(pressure_table(pressure))
    OUT.print(model_table(stack, modes, names, verification))
    return modes, verification


def model_table(stack: Stack, modes: Modes, names: tuple[str, ...], verification: Verification) -> Table:
    """List natural frequencies with their estimated errors, damping ratios and shape classes of the model."""
    worst = f"{100 * verification.first_error:.2g} %"
    origin = {
        "first": "They are within the tolerance.",
        "enriched": f"The first basis was off by {worst}, so it was enriched.",
        "all laminas": f"The first basis was off by {worst} and enriching did not do, so the frequencies were iterated "
        "on the equations of all laminas.",
    }[verification.basis]
    if not verification.within_tolerance:
        origin = f"The tolerance of {100 * verification.tolerance:.2g} % is not met. {origin}"
    laminas = "the lamina" if stack.n_lamina == 1 else f"all {stack.n_lamina} laminas"
    columns = (modes.frequency, verification.error, modes.damping, names)
    return Table(
        f"{stack.name}: {modes.frequency.size} elastic modes",
        ("mode", "f [Hz]", "error of f [%]", "damping [%]", "shape"),
        [
            (str(r), f"{f:.2f}", f"{100 * max(error, 0.0):.5f}", f"{100 * xi:.3g}", name)
            for r, (f, error, xi, name) in enumerate(zip(*columns, strict=True), start=1)
        ],
        f"Errors of f are estimated from the residual of the equations of {laminas}. {origin}",
    )


def pressure_table(pressure: PressureSummary) -> Table:
    """List mean, range and lost contact of the pressure at the bottom, middle and top interface and over all."""
    n = pressure.lowest.size
    mean, lowest, highest = (x / 1e3 for x in (pressure.interface_mean, pressure.lowest, pressure.highest))
    values = [
        (name, mean[k], lowest[k], highest[k], pressure.lost_contact[k])
        for name, k in {"bottom": 0, "middle": n // 2, "top": n - 1}.items()
    ]
    values.append(("all", mean.mean(), lowest.min(), highest.max(), pressure.lost_contact.mean()))
    return Table(
        "Pressure between the laminas",
        ("interface", "mean [kPa]", "lowest [kPa]", "highest [kPa]", "lost contact [%]"),
        [(name, *(f"{x:.4g}" for x in kilo), f"{100 * lost:.3g}") for name, *kilo, lost in values],
        f"Clamping force {pressure.force:.4g} N, mean pressure {pressure.mean / 1e3:.4g} kPa; "
        f"equilibrium to {pressure.residual:.1g}.",
    )


@single_threaded
def simulate_command(specification: Path, output: Path, effect_file: Sequence[Path]) -> None:
    """Simulate a vibration test, and say where its campaign file is."""
    from updating.virtual.campaign import write_virtual_test
    from updating.virtual.vibration_test import read_virtual_test

    write_virtual_test(read_virtual_test(specification, effect_file), output)
    OUT.print(f"Campaign: {output / 'campaign.toml'}")
