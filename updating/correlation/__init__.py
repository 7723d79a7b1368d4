"""Measured and modelled modes and FRFs side by side: pairing, correlation, expansion, and where they disagree."""
