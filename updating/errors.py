"""What can go wrong when measurement and model are put side by side.

UpdatingError
├── PairingError   measured points or modes find no partner in the model
├── FitError       an objective cannot be evaluated or minimised
├── StoreError     results cannot be written or read back
└── WorkerError    the processes that do the work cannot be had, or one was killed
"""

from __future__ import annotations

from ema.types.errors import EmaError
from model.stack.errors import ModelError


class UpdatingError(Exception):
    """Base of every error that `updating` raises on purpose; its message is written for the user."""


class PairingError(UpdatingError):
    """Measured points or modes find no partner in the model."""


class FitError(UpdatingError):
    """An objective cannot be evaluated or minimised."""


class StoreError(UpdatingError):
    """Results cannot be written, or a written result cannot be read back."""


class WorkerError(UpdatingError):
    """The processes that do the work cannot be had, or one of them was killed."""


LAMELLA_ERRORS = (EmaError, ModelError, UpdatingError)
"""Every error with a message for the user, for one `except` clause."""
