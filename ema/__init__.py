"""Measured functions to a modal model."""

from ema.campaign import Campaign, Configuration, read_campaign
from ema.errors import CampaignError, EmaError, IdentificationError, MeasurementError
from ema.frf import FRF
from ema.geometry import Dof, Dofs, Geometry
from ema.measurement import Measurement, read_measurement
from ema.uff import write_uff

__all__ = [
    "FRF",
    "Campaign",
    "CampaignError",
    "Configuration",
    "Dof",
    "Dofs",
    "EmaError",
    "Geometry",
    "IdentificationError",
    "Measurement",
    "MeasurementError",
    "read_campaign",
    "read_measurement",
    "write_uff",
]
