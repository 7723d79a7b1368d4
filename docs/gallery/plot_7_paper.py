"""
The published campaign
======================

Two of the 18 stacks of M. Pirnat, G. Čepon and M. Boltežar (Mech. Mach. Theory 2013), from their tables.
"""

# %%
# The paper's tables hold frequencies and no shapes, so modes are paired by their class. G_f is fitted by opt_G.
# (On a coarse mesh, so that this page is soon made.)
import csv
from dataclasses import replace
from pathlib import Path

import numpy as np

import model
from updating.correlation.shape_class import class_grid, shape_classes, solve_by_class
from updating.fitting.fit import G_F_BOUNDS, estimate_stiffness, frequency_error

DATA = Path(model.__file__).parents[1] / "data"
CLASSES = ("torsion 1", "bending 1", "bending 2", "torsion 2")
planform = replace(model.read_stack(DATA / "pirnat2013/stack_C1.toml"), mesh=model.Mesh(n_x=8, n_y=2))


def rows(name):
    """Return the rows of a table of the paper by stack."""
    with (DATA / "pirnat2013" / name).open(encoding="utf-8", newline="") as file:
        return {row["stack"]: row for row in csv.DictReader(file)}


def fitted(name):
    """Return measured, published and modelled frequencies of a stack, and its G_f."""
    row, height = rows("table7_frequencies_320kPa.csv")[name], rows("table1_stacks.csv")[name]["height_mm"]
    measured, published = (np.array([float(row[f"f{r}_{of}_Hz"]) for r in range(1, 5)]) for of in ("exp", "num"))
    stack = replace(planform.with_contact(pressure=320e3), height=1e-3 * float(height))
    system = model.reduce(stack, G_f_range=G_F_BOUNDS, n_snapshot=4)
    grid = model.observe(system, class_grid(stack))

    def predict(G_f):
        modes, column = solve_by_class(system, grid, CLASSES, G_f=G_f)
        return modes.frequency[column], modes.frequency_gradient[column, modes.parameter.index("G_f")]

    G_f = estimate_stiffness(predict, measured, np.zeros(4), bounds=G_F_BOUNDS)
    return measured, published, predict(G_f.value)[0], G_f.value


found = {name: fitted(name) for name in ("8", "11")}

# %%
# G_f and the mean frequency error, ours beside the published ones:
for name, (measured, published, ours, G_f) in found.items():
    print(
        f"stack {name}: G_f = {G_f:.0f} (published {rows('table6_contact_parameters.csv')[name]['Gf_M2']}), error "
        f"{frequency_error(measured, ours):.1%} (published {frequency_error(measured, published):.1%})"
    )

# %%
# Both models are off by about as much, and by the same modes: what is missing is missing in both.
from matplotlib.figure import Figure

from ema.plot import palette

figure = Figure(figsize=(9.0, 3.0), layout="constrained")
for axes, (name, (measured, published, ours, _)) in zip(figure.subplots(1, 2, sharey=True), found.items(), strict=True):
    at = np.arange(len(CLASSES))
    for shift, frequency, label, color in (
        (-0.2, published, "published model", palette.QUIET),
        (0.2, ours, "Lamella", palette.BASE),
    ):
        axes.bar(at + shift, 100.0 * (frequency / measured - 1.0), 0.38, label=label, color=color)
    axes.set_xticks(at, CLASSES, rotation=30, ha="right", fontsize=8)
    axes.set_title(f"stack {name}", loc="left", fontsize="medium")
    axes.axhline(0.0, color=palette.INK, linewidth=0.8)
axes.legend(frameon=False)
figure.axes[0].set_ylabel("frequency error [%]")

# %%
# Every calibration has a third bending mode, near 680 Hz under C1, between the modes that the paper reports. Neither
# damping nor a neighbour can hide it: it is far more than its bandwidth away from both neighbours.
stack = model.read_stack(DATA / "pirnat2013/stack_C1.toml").with_effects(*model.find_effects(["clamp_inertia"]))
roll = {"clamp_roll_inertia": 0.0025, "clamp_station": 0.89}  # as the 18 stacks say together
system = model.reduce(stack, ranges={"clamp_roll_inertia": (0.0, 0.005)})
given = {"G_f": 1.3 * stack.contact.G_f, "d_f": stack.contact.d_f, "parameters": roll}
modes = model.solve_modes(system, n_mode=14, observation=class_grid(stack), **given)
name = shape_classes(modes)
for r in (name.index(one) for one in ("bending 2", "bending 3", "torsion 2")):
    print(f"{name[r]}: {modes.frequency[r]:.0f} Hz, bandwidth {2 * modes.damping[r] * modes.frequency[r]:.0f} Hz")

# %%
# The place of the shaker can. The paper shows it in a photograph alone, so it is tried: the mean of the functions at
# 44 points of the upper face, driven at its corner and near a node of that mode.
x, y = np.meshgrid(np.linspace(-0.5, 0.5, 11) * stack.length, np.linspace(-0.5, 0.5, 4) * stack.width, indexing="ij")


def above(x: list[float], y: list[float]) -> model.Observation:
    """Return places on the upper face, moving across the sheets."""
    place = np.column_stack([x, y, np.full(len(x), 0.5 * stack.height)])
    return model.Observation(node=np.arange(len(x)), location=place, direction=np.tile([0.0, 0.0, 1.0], (len(x), 1)))


points, lines = above(x.ravel(), y.ravel()), np.arange(200.0, 1000.0, 2.0)
figure = Figure(figsize=(9.0, 3.2), layout="constrained")
axes = figure.subplots()
for at, label, color in (
    ((0.5, 0.5), "a corner", palette.SERIES[0]),
    ((0.12, 0.25), "x = 0.12 L, y = 0.25 W", palette.SERIES[1]),
):
    drive = above([at[0] * stack.length], [at[1] * stack.width])
    found = model.frf(system, frequency=lines, output=points, input=drive, **given)
    mean = np.sqrt(np.mean(np.abs(found[:, 0]) ** 2, axis=0))
    axes.semilogy(lines, mean, label=f"shaker at {label}", color=color)
axes.axvline(modes.frequency[name.index("bending 3")], color=palette.INK, linewidth=0.8, linestyle=":")
axes.set_xlabel("frequency [Hz]")
axes.set_ylabel("mean accelerance [m/s² per N]")
axes.legend(frameon=False)

# %%
# ``make published`` goes on: all 18 stacks, four calibrations, an effect that they share, each stack predicted from
# the others. :doc:`/published` says what came out.
