"""
Model a stator
==============

Any outline will do: here a stator with 12 teeth, pressed by four bolts through plates.
"""

# %%
# ``data/stator/stack.toml`` describes it. A stack shows itself as a table, and draws its plan and its side.
# It is cut to 40 sheets on a coarse mesh, so that this page is soon made.
from dataclasses import replace
from pathlib import Path

import model

DATA = Path(model.__file__).parents[1] / "data"
stack = replace(model.read_stack(DATA / "stator/stack.toml"), n_lamina=40, mesh=model.Mesh(n_x=6))
stack

# %%
plan = stack.plot()

# %%
# Every sheet and every interface is in the model. A reduced basis of displacements over the height makes it small, and
# the modes follow in a moment, the rigid-body ones first. Where shapes are wanted is said by an observation: here one
# point at the top.
import numpy as np

system = model.reduce(stack, n_mode=12, z_tolerance=1e-3)
top = model.Observation(node=[1], location=[[0.09, 0.0, stack.height / 2]], direction=np.eye(3)[2:])
contact = {"G_f": stack.contact.G_f, "d_f": stack.contact.d_f}
modes = model.solve_modes(system, **contact, n_mode=12, observation=top)
print("\n".join(f"{f:.1f} Hz" for f in modes.frequency[modes.n_rigid :]))

# %%
# A shape turns in a window or a notebook (``plotter.show()``); here it is a picture.
from matplotlib.figure import Figure

plotter = model.mode_plotter(system, modes, modes.n_rigid)
picture = Figure(figsize=(7.0, 4.6))
axes = picture.add_axes((0.0, 0.0, 1.0, 1.0))
axes.imshow(plotter.screenshot(return_img=True))
axes.set_axis_off()
plotter.close()
