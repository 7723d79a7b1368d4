"""Physical effects beyond the base model, one a file; each file ends in ``EFFECT = Effect(...)``."""
