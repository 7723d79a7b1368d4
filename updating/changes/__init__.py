"""What changed between a state and its reference, and where: kinds of change at a location that nobody knows."""
