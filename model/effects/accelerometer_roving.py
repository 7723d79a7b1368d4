"""Accelerometer mass, roving: the two sensors load another place in each run.

In the mean over all runs each measured point carries its share of the sensors' mass, and that is what a global
frequency sees to first order. The shift from run to run is `ema`'s to find.

Enters: mass matrix at all measured points, 2 m / n_point each, spread over the height, all directions; affine.
Range: 0 to 0.05 kg a sensor.
Does: lowers torsion (0.3 %) more than bending (0.1 %), for the points lie on the edges. The same between
    torques; scatter from run to run. (Demo stack, nominal strength.)
Mistaken for: density, fill factor, clamp_mass.
"""

from __future__ import annotations

from model.effects.parts import known_or_usual_instruments, point_mass
from model.elements.equations import Assembly, Term
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return the mean over the runs of two masses of 1 kg."""
    sensors = 2
    sensor = known_or_usual_instruments(assembly.stack).sensor
    share = sensors / len(sensor)
    return point_mass(assembly, "accelerometer_roving", "roving_sensor_mass", sensor[:, :2], share)


EFFECT = Effect(
    name="accelerometer_roving",
    label="mass of the roving accelerometers",
    family="inertia",
    summary="Mass of the accelerometers that rove over the points",
    description=__doc__,
    parameters=(
        Parameter(
            name="roving_sensor_mass",
            unit="kg",
            nominal=0.02,
            lower=0.0,
            upper=0.05,
            source="data sheets of general-purpose accelerometers with mounting",
        ),
    ),
    terms=terms,
)
