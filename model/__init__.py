"""Laminated stack to natural frequencies, damping, shapes and FRFs."""
