"""One inference for every question: fit, compare and choose explanations without pairing modes."""
