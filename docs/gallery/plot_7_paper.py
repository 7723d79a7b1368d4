"""
The published campaign
======================

Two of the 18 stacks of M. Pirnat, G. Čepon and M. Boltežar (Mech. Mach. Theory 2013), from their tables.
"""

# %%
# The paper's tables hold frequencies and no shapes, so modes are paired by their class.
# (On a coarse mesh, so that this page is soon made.)
from dataclasses import replace
from pathlib import Path

import model
from updating.fitting.modal_table import fit_row, read_modal_table

DATA = Path(model.__file__).parents[1] / "data"
table = read_modal_table(DATA / "pirnat2013/table7.toml")
chosen = [row for row in table.rows if row.name in ("8", "11")]
coarse = [replace(row, stack=replace(row.stack, mesh=model.Mesh(n_x=8, n_y=2))) for row in chosen]
fits = [fit_row(row, table.shape_class) for row in coarse]

# %%
# G_f and the mean frequency error, ours beside the published ones:
for fit in fits:
    print(
        f"stack {fit.row.name}: G_f = {fit.G_f.value:.0f} (published {fit.row.published_G_f:.0f}), "
        f"error {100 * fit.error:.1f} % (published {100 * fit.published_error:.1f} %)"
    )

# %%
# Both models are off by about as much, and by the same modes: what is missing is missing in both.
import numpy as np
from matplotlib.figure import Figure

figure = Figure(figsize=(9.0, 3.0), layout="constrained")
for axes, fit in zip(figure.subplots(1, 2, sharey=True), fits, strict=True):
    at = np.arange(len(table.shape_class))
    for shift, frequency, label, color in (
        (-0.2, fit.row.published_frequency, "published model", "0.7"),
        (0.2, fit.frequency, "Lamella", "#1f5f8b"),
    ):
        error = 100.0 * (frequency / fit.row.frequency - 1.0)
        axes.bar(at + shift, error, 0.38, label=label, color=color)
    axes.set_xticks(at, table.shape_class, rotation=30, ha="right", fontsize=8)
    axes.set_title(f"stack {fit.row.name}", loc="left", fontsize="medium")
    axes.axhline(0.0, color="0.3", linewidth=0.8)
axes.legend(frameon=False)
figure.axes[0].set_ylabel("frequency error [%]")

# %%
# ``lamella published`` goes on: all 18 stacks, four calibrations, an effect that they share, each stack predicted from
# the others. :doc:`/published` says what came out.
