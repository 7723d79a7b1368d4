"""Whether a measurement can be trusted: verdicts on channels, signs and exchanges, linearity."""
