from ema.campaign.campaign import Campaign, Configuration, read_campaign
from ema.campaign.campaign_file import Reassembly
from ema.campaign.estimate import Averaging, FRFEstimate, estimate_frf
from ema.campaign.measurement import Measurement, read_force_levels, read_measurement
from ema.identification.amplitude import (
    AmplitudeDependence,
    Level,
    Resonances,
    RingDown,
    amplitude_dependence,
    identify_force_levels,
    resonances,
    ring_down,
)
from ema.identification.exchange import (
    from_sdypy,
    read_poles,
    synthesized_frf,
    to_sdypy,
    write_modes_csv,
    write_modes_uff,
    write_poles,
    write_shapes_csv,
)
from ema.identification.identify import Failure, Identification, identify, identify_frf, try_identify
from ema.identification.stabilization import StabilizationDiagram, stabilization
from ema.io.found_modes import ModesStd
from ema.io.uff import write_uff
from ema.modal.change import Change, change, change_csv, change_sentence
from ema.modal.configurations import Comparison, Repeats, compare, contradicted, repeats
from ema.modal.mac import (
    Complexity,
    check_complexity,
    cmif,
    comac,
    complexity,
    frac,
    mac,
    mcf,
    modal_scale_factor,
    mpc,
    mpd,
    real_shape,
)
from ema.modal.read_modes import ReadModes, read_modes
from ema.plot.figures import pick_poles, turnable
from ema.quality.channels import check, usable
from ema.quality.explained import ExplainedPower
from ema.quality.linearity import check_force_levels, check_linearity
from ema.quality.structure import content_digests, shared_functions
from ema.quality.verdict import Verdict
from ema.types.errors import CampaignError, EmaError, IdentificationError, MeasurementError
from ema.types.frf import FRF, Dof, Dofs, Geometry
from ema.types.modal_model import ModalModel, synthesize

__all__ = [
    "FRF",
    "AmplitudeDependence",
    "Averaging",
    "Campaign",
    "CampaignError",
    "Change",
    "Comparison",
    "Complexity",
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
    "ModesStd",
    "ReadModes",
    "Reassembly",
    "Repeats",
    "Resonances",
    "RingDown",
    "StabilizationDiagram",
    "Verdict",
    "amplitude_dependence",
    "change",
    "change_csv",
    "change_sentence",
    "check",
    "check_complexity",
    "check_force_levels",
    "check_linearity",
    "cmif",
    "comac",
    "compare",
    "complexity",
    "content_digests",
    "contradicted",
    "estimate_frf",
    "frac",
    "from_sdypy",
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
    "read_modes",
    "read_poles",
    "real_shape",
    "repeats",
    "resonances",
    "ring_down",
    "shared_functions",
    "stabilization",
    "synthesize",
    "synthesized_frf",
    "to_sdypy",
    "try_identify",
    "turnable",
    "usable",
    "write_modes_csv",
    "write_modes_uff",
    "write_poles",
    "write_shapes_csv",
    "write_uff",
]
