"""
Find a hidden effect
====================

A test at two torques was simulated with an effect that the model does not have. Which one is it?
"""

# %%
# Both torques count together. Nothing but the functions, the points and the stack file is read.
from pathlib import Path

import ema
import model
import updating
from updating.diagnosis.cached_model import cached_model

DATA = Path(ema.__file__).parents[1] / "data"
campaign = ema.read_campaign(DATA / "hidden_effect/b/campaign.toml")
tested = [
    (one.name, one.pressure, found.modal_model)
    for one, found in zip(campaign.configurations, ema.identify(campaign), strict=True)
]

# %%
# Every effect of the catalogue is tried. ``cached_model`` keeps the reduced model for the next time.
found = updating.diagnose(model.read_stack(campaign.stack), tested, model.catalogue(), reduced=cached_model)
found

# %%
# The error as what was identified is added, of modes that were fitted and of those left out; and mode by mode.
waterfall = found.plot()

# %%
# The whole answer in words:
print("\n".join(found.sentences))

# %%
# What was planted stands in ``data/hidden_effect/sealed/b.toml``.
