"""Golden results: one set of simulated tests, drawn from seeds, that every inference engine is put to."""
