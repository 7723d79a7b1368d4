"""Measurement and model side by side: pairing, fitting, diagnosis, reports."""

from updating.correlation import Correlation, correlate
from updating.diagnosis import Diagnosis, diagnose
from updating.errors import LAMELLA_ERRORS, FitError, PairingError, StoreError, UpdatingError
from updating.fit import Estimate, Fit, fit
from updating.objective import frequency_error, opt_d, opt_G
from updating.pairing import Pairing, pair
from updating.registration import Registration, register
from updating.report.page import write_report
from updating.store import read_result, write_result

__all__ = [
    "LAMELLA_ERRORS",
    "Correlation",
    "Diagnosis",
    "Estimate",
    "Fit",
    "FitError",
    "Pairing",
    "PairingError",
    "Registration",
    "StoreError",
    "UpdatingError",
    "correlate",
    "diagnose",
    "fit",
    "frequency_error",
    "opt_G",
    "opt_d",
    "pair",
    "read_result",
    "register",
    "write_report",
    "write_result",
]
