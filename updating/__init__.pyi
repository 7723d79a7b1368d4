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
from updating.diagnosis.matrices_answer import MatricesFit, diagnose_matrices, fit_matrices
from updating.errors import LAMELLA_ERRORS, FitError, PairingError, StoreError, UpdatingError
from updating.fitting.fit import Estimate, Fit, fit
from updating.fitting.joint_fit import FittedParameter, JointFit, joint_fit
from updating.fitting.joint_problem import FitSettings
from updating.fitting.ledger import Entry, ledger
from updating.fitting.objective import frequency_error, opt_d, opt_G
from updating.fitting.prepared import Prepared, prepare
from updating.fitting.sensitivity import Scatter
from updating.fitting.target import Target, target_of_modes, target_of_table
from updating.report.page import write_report
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
    "Prepared",
    "Regions",
    "Registration",
    "Scatter",
    "StoreError",
    "Target",
    "Track",
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
    "ledger",
    "macx",
    "macxp",
    "map_error",
    "modal_energy",
    "opt_G",
    "opt_d",
    "pair",
    "poles",
    "prepare",
    "read_result",
    "regions",
    "register",
    "subspace_mac",
    "target_of_modes",
    "target_of_table",
    "track",
    "write_report",
    "write_result",
]
