"""Pictures of functions, stabilisation charts and shapes."""
