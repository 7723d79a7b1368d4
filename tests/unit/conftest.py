"""Files that tests of readers and of commands begin with."""

import pytest


@pytest.fixture
def stack_text():
    """A stack file of sheets and uniform contact; it ends in the table of the contact."""
    return """
name = "small"
length_mm = 300
width_mm = 80
height_mm = 65
n_lamina = 240
[material]
young_GPa = 200
poisson = 0.28
density_kg_m3 = 7650
[contact]
G_f = 825
d_f_s_per_Pa = 5e-11
pressure_kPa = 320
normal_modulus_GPa = 5
"""


@pytest.fixture
def campaign_text():
    """A campaign file of tables; it ends in its one configuration, whose files are to be named."""
    return """
[campaign]
name = "small"
[points]
file = "points.csv"
unit = "mm"
[measurement]
unit = "(m/s2)/N"
[measurement.table]
layout = "real-imaginary"
[[configuration]]
name = "M1"
"""
