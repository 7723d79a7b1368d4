"""What can go wrong on the way from a stack description to its modes.

ModelError
├── StackError   the stack file or description: an unknown key, an impossible value
├── MatricesError  matrices of another program: unreadable, or not those of a vibrating structure
├── EffectError  a physical effect: unknown, contradictory, or not possible on this stack
└── SolveError   the numerical solution: a singular system, no convergence
"""

from __future__ import annotations


class ModelError(Exception):
    """Base of every error that `model` raises on purpose; its message is written for the user."""


class StackError(ModelError):
    """The description of the stack is incomplete or impossible."""


class MatricesError(ModelError):
    """The matrices of another program, or their structure file, cannot be read or cannot be right."""


class EffectError(ModelError):
    """A physical effect is unknown, badly written, contradicts another one, or needs what the stack lacks."""


class SolveError(ModelError):
    """The equations of the stack could not be solved to the asked accuracy."""
