"""Measured functions to a modal model.

Names are imported when they are first used; `__init__.pyi` says from where.
"""

from lamella_shared import drawn_by, exports

__all__, __getattr__, __dir__ = exports(__name__, __file__)
drawn_by("ema.plot.figures")
