"""Vibration tests that are simulated on a model, with a truth that stays sealed."""
