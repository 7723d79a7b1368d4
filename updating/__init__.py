"""Measurement and model side by side: pairing, correlation, fitting, diagnosis, reports.

Names are imported when they are first used; `__init__.pyi` says from where.
"""

# ruff: noqa: E402  # the check comes before what it checks is imported
from updating.packages import require_own_packages

require_own_packages()

from ema.types.lazy import exports
from ema.types.shown import drawn_by

__all__, __getattr__, __dir__ = exports(__name__, __file__)
drawn_by("updating.report.files")
