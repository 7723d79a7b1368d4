"""Structures whose model is matrices of another program: the same inference, the same answers."""
