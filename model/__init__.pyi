from model.contact.contact import SlipLaw
from model.effects.catalogue import catalogue, find_effects, printed_effects, read_effect
from model.elements.equations import Assembly, Formula, Kron, Monomial, ParameterFactor, Term
from model.matrices.reduced import ReducedMatrices, reduce_matrices
from model.matrices.structure import MatrixStructure, read_matrices
from model.modes.backbone import Backbone, ContactStrain, backbone, contact_strain
from model.modes.modes import (
    Modes,
    Observation,
    Observed,
    Surface,
    complex_modes,
    mode_surface,
    observe,
    sample_points,
    solve_modes,
)
from model.modes.refinement import Refined, refine
from model.modes.response import frf
from model.plot.plots import mode_plotter
from model.reduction.reduced_equations import ReducedEquations
from model.reduction.reduction import ReducedSystem, assemble, reduce, reduced_terms
from model.stack.effect import Effect, Parameter, shared_parameters
from model.stack.errors import EffectError, MatricesError, ModelError, SolveError, StackError
from model.stack.parts import Clamp, Contact, Instruments, Material, Mesh
from model.stack.stack import Stack
from model.stack.stack_file import read_stack

__all__ = [
    "Assembly",
    "Backbone",
    "Clamp",
    "Contact",
    "ContactStrain",
    "Effect",
    "EffectError",
    "Formula",
    "Instruments",
    "Kron",
    "Material",
    "MatricesError",
    "MatrixStructure",
    "Mesh",
    "ModelError",
    "Modes",
    "Monomial",
    "Observation",
    "Observed",
    "Parameter",
    "ParameterFactor",
    "ReducedEquations",
    "ReducedMatrices",
    "ReducedSystem",
    "Refined",
    "SlipLaw",
    "SolveError",
    "Stack",
    "StackError",
    "Surface",
    "Term",
    "assemble",
    "backbone",
    "catalogue",
    "complex_modes",
    "contact_strain",
    "find_effects",
    "frf",
    "mode_plotter",
    "mode_surface",
    "observe",
    "printed_effects",
    "read_effect",
    "read_matrices",
    "read_stack",
    "reduce",
    "reduce_matrices",
    "reduced_terms",
    "refine",
    "sample_points",
    "shared_parameters",
    "solve_modes",
]
