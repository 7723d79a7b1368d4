"""Measured functions to a modal model."""

from ema.campaign import Campaign, Configuration, read_campaign
from ema.comparison import Comparison, compare
from ema.errors import CampaignError, EmaError, IdentificationError, MeasurementError
from ema.estimate import Averaging, FRFEstimate, estimate_frf
from ema.export import synthesized_frf, write_modes_csv, write_modes_uff, write_shapes_csv
from ema.frf import FRF
from ema.geometry import Dof, Dofs, Geometry
from ema.identify import Identification, identify, identify_frf
from ema.linearity import check_force_levels, check_linearity
from ema.mac import cmif, comac, frac, mac, mcf, modal_scale_factor, mpc, mpd, real_shape
from ema.measurement import Measurement, read_force_levels, read_measurement
from ema.modes import ModalModel, synthesize
from ema.picking import pick_poles, read_poles, write_poles
from ema.quality import check, usable
from ema.stabilization import StabilizationDiagram, stabilization
from ema.uff import write_uff
from ema.verdict import Verdict

__all__ = [
    "FRF",
    "Averaging",
    "Campaign",
    "CampaignError",
    "Comparison",
    "Configuration",
    "Dof",
    "Dofs",
    "EmaError",
    "FRFEstimate",
    "Geometry",
    "Identification",
    "IdentificationError",
    "Measurement",
    "MeasurementError",
    "ModalModel",
    "StabilizationDiagram",
    "Verdict",
    "check",
    "check_force_levels",
    "check_linearity",
    "cmif",
    "comac",
    "compare",
    "estimate_frf",
    "frac",
    "identify",
    "identify_frf",
    "mac",
    "mcf",
    "modal_scale_factor",
    "mpc",
    "mpd",
    "pick_poles",
    "read_campaign",
    "read_force_levels",
    "read_measurement",
    "read_poles",
    "real_shape",
    "stabilization",
    "synthesize",
    "synthesized_frf",
    "usable",
    "write_modes_csv",
    "write_modes_uff",
    "write_poles",
    "write_shapes_csv",
    "write_uff",
]
