"""Finite-element models of other programs: their matrices, what may vary in them, and their reduction."""
