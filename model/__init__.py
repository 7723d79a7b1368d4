"""Laminated stack to natural frequencies, damping, shapes and FRFs."""

from model.assemble import assemble
from model.errors import ModelError, SolveError, StackError
from model.material import Material
from model.modes import Modes, complex_modes, solve_modes
from model.observation import Observation, sample_points
from model.reduction import ReducedSystem, reduce
from model.response import frf, frf_direct
from model.stack import Clamp, Contact, Mesh, Stack
from model.stack_file import read_stack
from model.system import Assembly, Kron, Monomial, Term

__all__ = [
    "Assembly",
    "Clamp",
    "Contact",
    "Kron",
    "Material",
    "Mesh",
    "ModelError",
    "Modes",
    "Monomial",
    "Observation",
    "ReducedSystem",
    "SolveError",
    "Stack",
    "StackError",
    "Term",
    "assemble",
    "complex_modes",
    "frf",
    "frf_direct",
    "read_stack",
    "reduce",
    "sample_points",
    "solve_modes",
]
