"""`lamella model`: press a stack and solve its modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from ema.plot.figures import as_png
from ema.types.threads import single_threaded
from model import EffectError, Modes, Stack, catalogue, read_stack
from model.contact.pressing import press
from model.contact.pressure import PressureSummary
from model.matrices.structure_file import is_structure_file
from model.modes.verified import Verification, solve_verified
from model.plot.pressure import pressure_figure
from model.plot.shapes import mode_png
from model.reduction.through_thickness import n_rigid
from model.stack.parts import Pressing
from model.stack.stack_file import stack_inputs
from updating.commands.effect_option import with_named_effects
from updating.commands.matrices import solve_matrices
from updating.commands.terminal import OUT, bar
from updating.correlation.shape_class import class_grid, shape_classes
from updating.results.store import write_bytes, write_result


@single_threaded
def model_command(
    stack: Path,
    output: Path,
    modes: int,
    tolerance: float,
    effect: Sequence[str],
    effect_file: Sequence[Path],
) -> None:
    """Solve the model of a stack or of matrices, and print its modes."""
    if is_structure_file(stack):
        if effect or effect_file:
            message = (
                f"{stack}: effects are added to stacks; of a structure of matrices terms and places may vary"
            )
            raise EffectError(message)
        OUT.print(solve_matrices(stack, output, modes, OUT))
        return
    added = AddedEffects(option=tuple(effect), file=tuple(effect_file))
    solved = solve(stack, output, modes, tolerance, OUT, added)
    if solved.pressure is not None:
        OUT.print(pressure_table(solved.pressure))
    OUT.print(model_table(solved.stack, solved.modes, solved.shape_class, solved.verification))
    OUT.print(f"Results in {output}")


@dataclass(frozen=True, eq=False, kw_only=True)
class Solved:
    """A stack with its elastic modes: what `solve` writes and the command line prints.

    `pressure` is None where the stack file gives one pressure for all places.
    """

    stack: Stack
    modes: Modes
    shape_class: tuple[str, ...]
    verification: Verification
    pressure: PressureSummary | None


@dataclass(frozen=True, eq=False, kw_only=True)
class AddedEffects:
    """Effects that the user adds to a stack: as in `with_named_effects`, and files of the user's own."""

    option: tuple[str, ...] = ()
    file: tuple[Path, ...] = ()


def solve(
    stack_file: Path, output: Path, n_mode: int, tolerance: float, console: Console, effects: AddedEffects
) -> Solved:
    """Press the stack of a file where it says how, solve its elastic modes, write both and their pictures."""
    stack = read_stack(stack_file)
    if effects.option or effects.file:
        stack = with_named_effects(stack, effects.option, catalogue(effects.file))
    options = {"n_mode": n_mode, "tolerance": tolerance, "effects": dict(stack.effect_values)}
    inputs = (*stack_inputs(stack_file), *effects.file)
    pressure = None
    with bar(console) as progress:
        task = progress.add_task("press and solve", total=2 + n_mode)
        if isinstance(stack.pressing, Pressing):
            field = press(stack)
            stack, pressure = replace(stack, pressing=field), field.summary()
            write_result(output / "pressure.json", pressure, inputs=inputs, options={})
            write_bytes(output / "pressure.png", as_png(pressure_figure(field)))
        progress.advance(task)
        system, every, verification = solve_verified(
            stack, n_mode=n_rigid(stack) + n_mode, observation=class_grid(stack), tolerance=tolerance
        )
        modes = every.elastic()
        verification = replace(verification, error=verification.error[every.n_rigid :])
        write_result(output / "modes.json", modes, inputs=inputs, options=options)
        write_result(output / "verification.json", verification, inputs=inputs, options=options)
        progress.advance(task)
        for r in range(modes.frequency.size):
            write_bytes(output / f"mode_{r + 1:02d}.png", mode_png(system, modes, r))
            progress.advance(task)
    names = shape_classes(modes) if stack.outline is None else ("",) * modes.frequency.size
    return Solved(stack=stack, modes=modes, shape_class=names, verification=verification, pressure=pressure)


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
    table = Table(
        title=f"{stack.name}: {modes.frequency.size} elastic modes",
        title_justify="left",
        caption=f"Errors of f are estimated from the residual of the equations of {laminas}. {origin}",
        caption_justify="left",
    )
    for name in ("mode", "f [Hz]", "error of f [%]", "damping [%]"):
        table.add_column(name, justify="right")
    table.add_column("shape")
    columns = (modes.frequency, verification.error, modes.damping, names)
    for r, (f, error, xi, name) in enumerate(zip(*columns, strict=True), start=1):
        table.add_row(str(r), f"{f:.2f}", f"{100 * max(error, 0.0):.5f}", f"{100 * xi:.3g}", name)
    return table


def pressure_table(pressure: PressureSummary) -> Table:
    """List mean, range and lost contact of the pressure at the bottom, middle and top interface and over all."""
    table = Table(
        title="Pressure between the laminas",
        title_justify="left",
        caption=f"Clamping force {pressure.force:.4g} N, mean pressure {pressure.mean / 1e3:.4g} kPa; "
        f"equilibrium to {pressure.residual:.1g}.",
        caption_justify="left",
    )
    table.add_column("interface")
    for name in ("mean [kPa]", "lowest [kPa]", "highest [kPa]", "lost contact [%]"):
        table.add_column(name, justify="right")
    n = pressure.lowest.size
    kilo = [x / 1e3 for x in (pressure.interface_mean, pressure.lowest, pressure.highest)]
    for name, k in {"bottom": 0, "middle": n // 2, "top": n - 1}.items():
        table.add_row(name, *(f"{x[k]:.4g}" for x in kilo), f"{100 * pressure.lost_contact[k]:.3g}")
    mean, lowest, highest = kilo
    table.add_row(
        "all", f"{mean.mean():.4g}", f"{lowest.min():.4g}", f"{highest.max():.4g}",
        f"{100 * pressure.lost_contact.mean():.3g}",
    )  # fmt: skip
    return table
