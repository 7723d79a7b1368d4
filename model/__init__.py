"""Laminated stack to natural frequencies, damping, shapes and FRFs."""

from model.assemble import assemble
from model.errors import ModelError, SolveError, StackError
from model.material import Material
from model.modes import Modes, complex_modes, solve_modes
from model.observation import Observation, Observed, observe, sample_points
from model.reduction import ReducedSystem, reduce
from model.refinement import Refined, refine
from model.response import frf, frf_direct
from model.stack import Clamp, Contact, Mesh, Stack
from model.stack_file import read_stack
from model.surface import Surface, mode_surface
from model.system import Assembly, Kron, Monomial, ParameterFactor, Term

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
    "Observed",
    "ParameterFactor",
    "ReducedSystem",
    "Refined",
    "SolveError",
    "Stack",
    "StackError",
    "Surface",
    "Term",
    "assemble",
    "complex_modes",
    "frf",
    "frf_direct",
    "mode_surface",
    "observe",
    "read_stack",
    "reduce",
    "refine",
    "sample_points",
    "solve_modes",
]
