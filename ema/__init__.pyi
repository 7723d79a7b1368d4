from ema.campaign.campaign import Campaign, Configuration, read_campaign
from ema.campaign.estimate import Averaging, FRFEstimate, estimate_frf
from ema.campaign.measurement import Measurement, read_force_levels, read_measurement
from ema.identification.amplitude import AmplitudeDependence, Level, amplitude_dependence
from ema.identification.force_levels import identify_force_levels
from ema.identification.identify import Failure, Identification, identify, identify_frf, try_identify
from ema.identification.poles_file import read_poles, write_poles
from ema.identification.resonance import Resonances, resonances
from ema.identification.ring_down import RingDown, ring_down
from ema.identification.stabilization import StabilizationDiagram, stabilization
from ema.io.uff import write_uff
from ema.modal.comparison import Comparison, compare
from ema.modal.export import synthesized_frf, write_modes_csv, write_modes_uff, write_shapes_csv
from ema.modal.mac import cmif, comac, frac, mac, mcf, modal_scale_factor, mpc, mpd, real_shape
from ema.modal.repeats import Repeats, repeats
from ema.modal.stated import contradicted
from ema.plot.modal_model import turnable
from ema.plot.picking import pick_poles
from ema.quality.channels import check, usable
from ema.quality.explained import ExplainedPower
from ema.quality.identical import content_digests, shared_functions
from ema.quality.linearity import check_force_levels, check_linearity
from ema.quality.verdict import Verdict
from ema.types.errors import CampaignError, EmaError, IdentificationError, MeasurementError
from ema.types.frf import FRF
from ema.types.geometry import Dof, Dofs, Geometry
from ema.types.modal_model import ModalModel, synthesize

__all__ = [
    "FRF",
    "AmplitudeDependence",
    "Averaging",
    "Campaign",
    "CampaignError",
    "Comparison",
    "Configuration",
    "Dof",
    "Dofs",
    "EmaError",
    "ExplainedPower",
    "FRFEstimate",
    "Failure",
    "Geometry",
    "Identification",
    "IdentificationError",
    "Level",
    "Measurement",
    "MeasurementError",
    "ModalModel",
    "Repeats",
    "Resonances",
    "RingDown",
    "StabilizationDiagram",
    "Verdict",
    "amplitude_dependence",
    "check",
    "check_force_levels",
    "check_linearity",
    "cmif",
    "comac",
    "compare",
    "content_digests",
    "contradicted",
    "estimate_frf",
    "frac",
    "identify",
    "identify_force_levels",
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
    "repeats",
    "resonances",
    "ring_down",
    "shared_functions",
    "stabilization",
    "synthesize",
    "synthesized_frf",
    "try_identify",
    "turnable",
    "usable",
    "write_modes_csv",
    "write_modes_uff",
    "write_poles",
    "write_shapes_csv",
    "write_uff",
]
