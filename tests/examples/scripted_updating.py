"""Scripted updating of the demo stack: from FRF files to where the model fails, and to what it lacks.

Run it in the folder of the source checkout: python tests/examples/scripted_updating.py
"""

import numpy as np

import ema
import model
import updating

campaign = ema.read_campaign("data/demo_stack/campaign.toml")
assert campaign.stack is not None  # a campaign file may leave it out; this one names it
stack = model.read_stack(campaign.stack)
tested = {found.modal_model.name: found for found in ema.identify(campaign)}

# One configuration: modes paired and compared, mode by mode, point by point, and without modes on the FRFs.
measured = tested["M1"].modal_model
fit = updating.fit(stack.with_contact(pressure=160e3), measured)
compared = updating.correlate(measured, fit.modes, fit.pairing)
points = updating.correlate_points(measured, fit.modes, fit.pairing)
print(f"M1: frequency errors {np.round(100 * compared.frequency_error, 2)} %, MAC {np.round(compared.mac, 4)}")
print(f"least COMAC {points.comac.min():.4f} at point {points.node[np.argmin(points.comac)]}")

r, s = fit.pairing.measured, fit.pairing.model
likeness = updating.macxp(
    measured.shape[:, r],
    measured.pole[r],
    fit.modes.shape[:, s],
    updating.poles(fit.modes.frequency[s], fit.modes.damping[s]),
)
print(f"MACXP of the pairs {np.round(np.diag(likeness), 3)}")

# Measured shapes on the whole stack, and where the model's stiffness is off.
registration = updating.register(fit.stack, measured.geometry, measured.node, measured.direction, tolerance=0.01)
expanded = updating.expand(measured.shape, measured.shape_std, fit.modes)
system = model.reduce(fit.stack, n_snapshot=4)
fault = updating.map_error(
    system,
    measured,
    registration.observation,
    updating.regions(fit.stack),
    G_f=fit.G_f.value,
    modes=fit.pairing.measured,
)
print(f"expansion matches the shapes with a MAC of {expanded.matched.min():.4f} or more")
print(f"error in constitutive relation: {100 * np.sqrt(fault.total.max()):.2f} % of the stiffness at most")

# Both torques at once: what the model lacks, and what an effect that is asked for does to the error; the numbers are
# those of lamella diagnose and lamella fit --effect.
pressure = {c.name: c.pressure for c in campaign.configurations if c.pressure is not None}
found = updating.diagnose(
    stack,
    [(name, pressure[name], one.modal_model) for name, one in tested.items()],
    model.catalogue(),
    asked=[["pressure_exponent"]],
)
print(found.sentences[0])
for effects in ((), ("pressure_exponent",)):
    ranked = found.ranked(effects)
    print(
        f"{' + '.join(('base', *effects))}: error {100 * ranked.frequency_error:.2f} %, "
        f"left out {100 * ranked.left_out_error:.2f} %"
    )
for p in ranked.parameter:
    print(f"  {p.name} = {p.value:.4g} {p.unit}, {p.lower:.4g} to {p.upper:.4g}")
