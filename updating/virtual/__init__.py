"""Vibration tests that are played on a model, with a truth that stays sealed."""
