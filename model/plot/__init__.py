"""Pictures of shapes and of pressure."""
