"""Finite elements of the sheets, and the equations of motion as sums of products over height and plan."""
