"""Measurement and model side by side: pairing, fitting, diagnosis, reports."""
