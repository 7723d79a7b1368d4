from updating.correlation.correlation import (
    Correlation,
    FrfCorrelation,
    PointCorrelation,
    correlate,
    correlate_frf,
    correlate_points,
    fdac,
)
from updating.correlation.localization import ErrorMap, Regions, map_error, regions
from updating.correlation.pairing import Pairing, Track, cross_orthogonality, macxp, pair, poles, subspace_mac, track
from updating.correlation.registration import Expansion, Registration, expand, register
from updating.diagnosis.answer import Diagnosis
from updating.diagnosis.diagnosis import diagnose
from updating.diagnosis.evidence import DiagnosisScatter
from updating.diagnosis.explained_model import FittedParameter, JointFit, Updated
from updating.diagnosis.fit_settings import FitSettings
from updating.diagnosis.matrices_answer import MatricesFit, diagnose_matrices, fit_matrices
from updating.errors import LAMELLA_ERRORS, FitError, PairingError, StoreError, UpdatingError
from updating.fitting.fit import Estimate, Fit, fit, frequency_error, opt_d, opt_G
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
    "fdac",
    "fit",
    "fit_matrices",
    "frequency_error",
    "joint_fit",
    "macxp",
    "map_error",
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
