"""What may be wrong with a measurement or with what a file states of it, tried beside the physical effects.

Each hypothesis lets nuisances leave what is known of them. It explains nothing physical, and is named as what it is.
"""

from __future__ import annotations

MEASUREMENT = "measurement"
"""Family of these hypotheses."""
STATED_PRESSURE, STATED_SIZE, STATED_PLACE = "stated_pressure", "stated_size", "stated_place"
SENSOR_GAIN, STATED_POINTS, WINDOW = "sensor_gain", "stated_points", "exponential_window"
LABELS = {
    STATED_PRESSURE: "a pressure or torque stated wrongly",
    STATED_SIZE: "dimensions of the stack stated wrongly",
    STATED_PLACE: "clamps that sit elsewhere than stated",
    SENSOR_GAIN: "the calibration of a roving accelerometer",
    STATED_POINTS: "measured points that all sit farther along the stack than stated",
    WINDOW: "the damping of an exponential window",
}
"""What each is called."""
PRESSURE, SIZE, GAIN = 0.07, 0.01, 0.3
"""Standard deviations of logarithms where something was stated wrongly."""
PLACE = 8e-3
"""The same of a place, m."""
FALL = 3.0
"""The same of a decay, 1/s: of a window that falls to a hundredth in 1.5 s."""
