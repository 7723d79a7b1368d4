"""MAC and its family, the comparison of configurations, and the export of modes."""
