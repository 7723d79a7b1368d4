from updating.correlation.correlation import Correlation, correlate
from updating.correlation.energy import Regions, modal_energy, regions
from updating.correlation.expansion import Expansion, expand, expanded_modes
from updating.correlation.frf_correlation import FrfCorrelation, correlate_frf, fdac
from updating.correlation.localization import ErrorMap, map_error
from updating.correlation.macxp import macx, macxp, poles
from updating.correlation.orthogonality import cross_orthogonality
from updating.correlation.pairing import Pairing, pair
from updating.correlation.point_correlation import PointCorrelation, correlate_points
from updating.correlation.registration import Registration, register
from updating.correlation.subspace import subspace_mac
from updating.correlation.tracking import Track, track
from updating.diagnosis.answer import Diagnosis
from updating.diagnosis.diagnosis import diagnose
from updating.diagnosis.evidence import DiagnosisScatter
from updating.diagnosis.fit_settings import FitSettings
from updating.diagnosis.joint_answer import FittedParameter, JointFit, Updated
from updating.diagnosis.matrices_answer import MatricesFit, diagnose_matrices, fit_matrices
from updating.errors import LAMELLA_ERRORS, FitError, PairingError, StoreError, UpdatingError
from updating.fitting.fit import Estimate, Fit, fit
from updating.fitting.objective import frequency_error, opt_d, opt_G
from updating.pooled.joint_fit import joint_fit
from updating.pooled.specimen import Specimen
from updating.report.page import write_report
from updating.results.ledger import Entry
from updating.results.store import read_result, write_result

__all__ = [
    "LAMELLA_ERRORS",
    "Correlation",
    "Diagnosis",
    "DiagnosisScatter",
    "Entry",
    "ErrorMap",
    "Estimate",
    "Expansion",
    "Fit",
    "FitError",
    "FitSettings",
    "FittedParameter",
    "FrfCorrelation",
    "JointFit",
    "MatricesFit",
    "Pairing",
    "PairingError",
    "PointCorrelation",
    "Regions",
    "Registration",
    "Specimen",
    "StoreError",
    "Track",
    "Updated",
    "UpdatingError",
    "correlate",
    "correlate_frf",
    "correlate_points",
    "cross_orthogonality",
    "diagnose",
    "diagnose_matrices",
    "expand",
    "expanded_modes",
    "fdac",
    "fit",
    "fit_matrices",
    "frequency_error",
    "joint_fit",
    "macx",
    "macxp",
    "map_error",
    "modal_energy",
    "opt_G",
    "opt_d",
    "pair",
    "poles",
    "read_result",
    "regions",
    "register",
    "subspace_mac",
    "track",
    "write_report",
    "write_result",
]
