"""Measured functions to a modal model."""
