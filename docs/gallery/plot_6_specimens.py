"""
Many specimens on one rig
=========================

Six stacks in the same clamps, three of them lacquered. What has the treatment changed?
"""

# %%
# The modes were identified before: a campaign lists their tables.
from dataclasses import replace
from pathlib import Path

import model
from updating.pooled.campaign_file import read_specimens, specimens_of
from updating.pooled.diagnosis import diagnose_specimens

DATA = Path(model.__file__).parents[1] / "data"
campaign = read_specimens(DATA / "hidden_effect/pooled_b/campaign.toml")
specimens = specimens_of(campaign, {}.__getitem__)  # none has to be identified first
[(one.name, dict(one.notes)) for one in specimens]

# %%
# Each effect is tried as the rig's, as a group's, as one specimen's and as each specimen's own. ``lamella diagnose``
# tries the whole catalogue on the full mesh; two effects on a coarse one will do to see how it goes.
coarse = [replace(one, stack=replace(one.stack, mesh=model.Mesh(n_x=10, n_y=3))) for one in specimens]
tried = {name: model.catalogue()[name] for name in ("pressure_exponent", "clamp_mass")}
found = diagnose_specimens(campaign.name, coarse, tried)
print("\n".join(found.sentences))

# %%
# G_f of each specimen and torque takes up what is missing, so that fitted errors hardly fall. A torque that is
# predicted from all else shows it:
import numpy as np
from matplotlib.figure import Figure

from ema.plot import palette

base = next(one for one in found.ranking if not one.parts)
figure = Figure(figsize=(7.0, 3.0), layout="constrained")
axes = figure.subplots()
for shift, answer, label, color in (
    (-0.2, base, "base model", palette.BASE),
    (0.2, found.best, "with what was found", palette.FOUND),
):
    errors = (answer.frequency_error, answer.left_out_error, answer.left_out_torque_error)
    axes.bar(np.arange(3) + shift, 100.0 * np.array(errors), 0.38, label=label, color=color)
axes.set_xticks(range(3), ["fitted", "a specimen left out", "a torque left out"])
axes.set_ylabel("mean frequency error [%]")
axes.legend(frameon=False)
axes.spines[["top", "right"]].set_visible(False)
