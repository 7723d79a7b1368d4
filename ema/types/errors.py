"""What can go wrong on the way from measured functions to a modal model.

EmaError
├── CampaignError        the campaign file: an unknown key, a missing file, an impossible value
├── MeasurementError     the measured data: unreadable, inconsistent or unfit for identification
└── IdentificationError  the identification: no mode in the band, a singular system
"""

from __future__ import annotations


class EmaError(Exception):
    """Base of every error that `ema` raises on purpose; its message is written for the user."""


class CampaignError(EmaError):
    """The campaign file asks for something that is not there or not possible."""


class MeasurementError(EmaError):
    """Measured data cannot be read or contradict themselves."""


class IdentificationError(EmaError):
    """The data are readable, but no modal model can be drawn from them as asked."""
