"""
Write an effect of your own
===========================

A wedge under one end holds the laminas there together. No catalogue has it, and thirty lines do.
"""

# %%
# An effect is a file; this one ships with Lamella.
from pathlib import Path

import model

DATA = Path(model.__file__).parents[1] / "data"
print((DATA / "effects_example/gap_spring.py").read_text(encoding="utf-8"))

# %%
# The stack with and without it: how far does each mode move?
# (On a coarse mesh of 40 sheets, so that this page is soon made.)
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from ema.plot import palette

effect = model.read_effect(DATA / "effects_example/gap_spring.py")
base = replace(model.read_stack(DATA / "demo_stack/stack.toml"), n_lamina=40, mesh=model.Mesh(n_x=8, n_y=2))
system = model.reduce(base.with_effects(effect, wedge_modulus=5e7))
place = model.Observation(node=[1], location=[[0.0, 0.0, 0.0]], direction=np.eye(3)[2:])
contact = {"G_f": base.contact.G_f, "d_f": base.contact.d_f}
without, wedged = (
    model.solve_modes(system, **contact, observation=place, parameters={"wedge_modulus": modulus}).elastic()
    for modulus in (0.0, 5e7)
)
shift = 100.0 * (wedged.frequency / without.frequency - 1.0)

# %%
# Every mode rises, and none by much: a wedge is a weak effect.
figure = Figure(figsize=(7.0, 3.0), layout="constrained")
axes = figure.subplots()
axes.bar(np.arange(shift.size), shift, color=palette.FOUND)
axes.set_xticks(np.arange(shift.size), [f"{f:.0f} Hz" for f in without.frequency])
axes.set_ylabel("change of frequency [%]")
axes.spines[["top", "right"]].set_visible(False)

# %%
# ``lamella effects gap_spring --effect-file data/effects_example/gap_spring.py`` checks it as the shipped ones are
# checked; with ``--effect-file`` every command takes it.
