"""Laminated stack to natural frequencies, damping, shapes and FRFs."""

from model.assemble import assemble
from model.catalogue import catalogue, find_effects, read_effect
from model.effect import Effect, Parameter, shared_parameters
from model.enrichment import enriched, with_attachment_modes
from model.errors import EffectError, ModelError, SolveError, StackError
from model.material import Material
from model.modes import Modes, complex_modes, solve_modes
from model.observation import Observation, Observed, observe, sample_points
from model.reduced_equations import ReducedEquations
from model.reduction import ReducedSystem, reduce, reduced_terms
from model.refinement import Refined, refine
from model.response import frf, frf_direct
from model.stack import Clamp, Contact, Instruments, Mesh, Stack
from model.stack_file import read_stack
from model.surface import Surface, mode_surface
from model.system import Assembly, Formula, Kron, Monomial, ParameterFactor, Term
from model.truncation import truncated

__all__ = [
    "Assembly",
    "Clamp",
    "Contact",
    "Effect",
    "EffectError",
    "Formula",
    "Instruments",
    "Kron",
    "Material",
    "Mesh",
    "ModelError",
    "Modes",
    "Monomial",
    "Observation",
    "Observed",
    "Parameter",
    "ParameterFactor",
    "ReducedEquations",
    "ReducedSystem",
    "Refined",
    "SolveError",
    "Stack",
    "StackError",
    "Surface",
    "Term",
    "assemble",
    "catalogue",
    "complex_modes",
    "enriched",
    "find_effects",
    "frf",
    "frf_direct",
    "mode_surface",
    "observe",
    "read_effect",
    "read_stack",
    "reduce",
    "reduced_terms",
    "refine",
    "sample_points",
    "shared_parameters",
    "solve_modes",
    "truncated",
    "with_attachment_modes",
]
