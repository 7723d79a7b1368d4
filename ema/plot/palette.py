"""Colours by meaning: one colour says one thing in every figure, chart and page.

What is drawn beside each other differs for persons with any colour vision, and every colour is seen on white and on
dark ground.
"""

from __future__ import annotations

MEASURED = "#62656d"
"""What was measured."""
MODES = "#335ff0"
"""What the identified modes say."""
BASE = "#d28303"
"""What the base model says: the model without effects, or before a change."""
FOUND = "#38a76f"
"""What the model says with what was found, or with what is being tried."""
LEFT = "#a847b2"
"""What is left between two: a difference."""
ACCENT = "#b93627"
"""What was chosen or stands out."""
BY_MEANING = (MEASURED, MODES, BASE, FOUND, LEFT, ACCENT)

USED, LEFT_OUT, ELSEWHERE = "#5b67a8", "#98a2d3", "#c9cfe9"
"""What an error is of, dark to light: data that were fitted, modes that were left out, configurations likewise."""

QUIET, PALE = "#9aa1ab", "#dde1e7"
"""What only helps the eye: values tried, guide lines, edges; and a structure at rest."""
INK = "#33414f"
"""Lines and letters in print."""

SERIES = (MODES, ACCENT, FOUND, LEFT, BASE, MEASURED, "#5fb4d9", "#8c6a3f")
"""Several of one kind, such as channels, specimens or effects, which have no meaning but their name."""

LIKENESS, PLACE, MOTION, CHANGE, SIGNED = "Blues", "Oranges", "viridis", "Reds", "RdBu_r"
"""Scales: of MAC; of where a model fails; of displacements and fields; of what changed; from -1 to 1."""
