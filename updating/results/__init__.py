"""Results on disk: written with what made them, and read back."""
