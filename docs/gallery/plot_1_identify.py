"""
Identify modes
==============

From the FRFs of a test to frequencies, damping ratios and shapes.
"""

# %%
# A campaign file says which files hold the functions, where the points are, and which torques were tested. The first
# torque is identified here. A modal model shows itself as a table.
from pathlib import Path

import ema

DATA = Path(ema.__file__).parents[1] / "data"
campaign = ema.read_campaign(DATA / "hidden_effect/b/campaign.toml")
found = next(iter(ema.identify(campaign)))
found.modal_model

# %%
# Poles of all model orders were computed at once. Those that stay where they are while the order grows are candidates.
# The identification chooses among them, refines all modes together by maximum likelihood, and says how far each number
# can be trusted.
from ema.plot.figures import overlay_figure, stabilization_figure

chart = stabilization_figure(ema.stabilization(found.measurement.frf))

# %%
# What it makes of the measured functions:
over_each_other = overlay_figure(found.measurement.frf, found.modal_model)

# %%
# And its shapes. In a notebook, ``ema.turnable(found.modal_model, 1).show()`` gives one that turns.
shapes = found.modal_model.plot()
