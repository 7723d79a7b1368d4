"""
What changed, and where
=======================

A stack before and after a transport, and before and after a repair. What happened to it?
"""

# %%
# Four states of each were measured, each assembled anew: a reference and its repeat, a control, and the state in
# question. Here are their modes.
from dataclasses import replace
from pathlib import Path

import ema
import model

DATA = Path(model.__file__).parents[1] / "data"
campaigns = {name: ema.read_campaign(DATA / f"hidden_effect/{name}/campaign.toml") for name in ("change_a", "change_b")}
modes = {
    name: {one.modal_model.name: one.modal_model for one in ema.identify(campaign)}
    for name, campaign in campaigns.items()
}
[(name, [float(f.round(1)) for f in one["before"].frequency]) for name, one in modes.items()]

# %%
# Has it changed? That needs no model: every frequency, damping ratio and shape is tested against what assemblies
# scatter by. What the repair did is too little to be seen so.
reference = ("before", "before_again")
for states in modes.values():
    for state in ("control", "after"):
        print(ema.change_sentence(ema.change([states[state]], [states[before] for before in reference])))

# %%
# What changed, and where, takes a model that is fitted to the reference. Of thousands of locations, sizes and
# directions of each kind of change it says which are likely. ``lamella diagnose`` does this on the full mesh.
from updating.changes.compare import what_changed
from updating.changes.reference import fit_reference
from updating.diagnosis.candidates import candidate_model, instruments_of

stack = replace(model.read_stack(DATA / "hidden_effect/stack.toml"), mesh=model.Mesh(n_x=12, n_y=3))
candidates = candidate_model(stack, instruments_of(modes["change_a"]["before"]), {})
answers = {}
for name, states in modes.items():
    pressure = campaigns[name].configuration("before").pressure
    fitted = fit_reference(candidates, [(before, pressure, states[before]) for before in reference])
    answers[name] = what_changed(fitted, [("after", pressure, states["after"])], seen=True)
    print("\n".join(answers[name].sentences))

# %%
# The map of the probability of the location after the transport: one of the clamps.
from updating.report.change_part import map_chart
from updating.report.part import printed

transport = printed(map_chart(answers["change_a"]), (5.0, 3.8))

# %%
# And after the repair.
repair = printed(map_chart(answers["change_b"]), (5.0, 3.8))
