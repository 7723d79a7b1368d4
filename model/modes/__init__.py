"""Natural modes, their derivatives and verification, points of observation, responses."""
