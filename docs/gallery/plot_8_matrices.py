"""
Bring a model of another program
================================

CalculiX wrote the stiffness and mass of a cantilever plate. A test of a plate that is not quite that one was simulated:
its springs are softer, and it has a mass that the model lacks. Where is it, and how heavy?
"""

# %%
# The structure file says what the matrices are, what may vary in them, and where something may sit.
from pathlib import Path

import ema
import model
import updating

DATA = Path(ema.__file__).parents[1] / "data"
structure = model.read_matrices(DATA / "matrices_example/structure.toml")
print("\n".join(structure.notes))

# %%
# What a reduction to some eighty coordinates costs is estimated: relative errors of frequencies, at the nominal factors
# and with each of them one prior deviation away.
reduced = model.reduce_matrices(structure)
print(reduced.size, {name: f"{error:.1e}" for name, error in reduced.left.items()})

# %%
# The terms of the file alone cannot make up for what is missing.
(identified,) = ema.identify(ema.read_campaign(DATA / "matrices_example/campaign.toml"))
fit = updating.fit_matrices(structure, identified.modal_model, threshold=0.7)
for moved in fit.moved:
    pulled = moved.deviations or 0.0
    print(
        f"{moved.label}: {moved.value:.3g}, stated {moved.stated:.3g}, pulled by {pulled:+.1f} deviations of its prior"
    )
print("\n".join(fit.findings))

# %%
# So masses and springs are tried at every place, and whatever the file or the measurement may state wrongly.
found = updating.diagnose_matrices(structure, [("plate", identified.modal_model)])
found

# %%
# The error as what was identified is added, and mode by mode.
waterfall = found.plot()

# %%
# The whole answer in words; what was planted stands in ``data/matrices_example/truth.json``.
print("\n".join(found.sentences))
