"""Measurement and model side by side: pairing, correlation, fitting, diagnosis, reports."""

from updating.correlation import Correlation, correlate
from updating.diagnosis import Diagnosis, diagnose
from updating.energy import Regions, modal_energy, regions
from updating.errors import LAMELLA_ERRORS, FitError, PairingError, StoreError, UpdatingError
from updating.expansion import Expansion, expand, expanded_modes
from updating.fit import Estimate, Fit, fit
from updating.frf_correlation import FrfCorrelation, correlate_frf, fdac
from updating.joint_fit import FittedParameter, JointFit, joint_fit
from updating.ledger import Entry, ledger
from updating.localization import ErrorMap, map_error
from updating.macxp import macx, macxp, poles
from updating.objective import frequency_error, opt_d, opt_G
from updating.orthogonality import cross_orthogonality
from updating.pairing import Pairing, pair
from updating.point_correlation import PointCorrelation, correlate_points
from updating.prepared import Prepared, prepare
from updating.registration import Registration, register
from updating.report.page import write_report
from updating.sensitivity import Scatter
from updating.store import read_result, write_result
from updating.subspace import subspace_mac
from updating.target import Target, target_of_modes, target_of_table
from updating.tracking import Track, track

__all__ = [
    "LAMELLA_ERRORS",
    "Correlation",
    "Diagnosis",
    "Entry",
    "ErrorMap",
    "Estimate",
    "Expansion",
    "Fit",
    "FitError",
    "FittedParameter",
    "FrfCorrelation",
    "JointFit",
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
    "expand",
    "expanded_modes",
    "fdac",
    "fit",
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
