"""
Fit the contact
===============

Two numbers say how sheets hold together: the contact stiffness G_f, and the contact damping d_f.
"""

# %%
# The first torque of a test, identified as in :doc:`plot_1_identify`.
from pathlib import Path

import ema
import model
import updating

DATA = Path(ema.__file__).parents[1] / "data"
campaign = ema.read_campaign(DATA / "demo_diagnosis/campaign.toml")
found = next(iter(ema.identify(campaign)))
pressure = campaign.configurations[0].pressure

# %%
# G_f is fitted to the measured frequencies, then d_f to the damping ratios. The modes are paired by MAC.
stack = model.read_stack(campaign.stack).with_contact(pressure=pressure)
fit = updating.fit(stack, found.modal_model)
fit

# %%
# The objectives over what was tried, and the MAC of measured and modelled modes.
objectives = fit.plot()

# %%
# A mean error of several per cent, with shapes that agree: something is missing in the model, and it is not the
# contact's stiffness. :doc:`plot_4_hidden_effect` asks what, of another test.
print(f"mean frequency error {100 * fit.error:.1f} %")
