"""Modes of all laminas: what the reduction leaves, measured by the full equations and removed.

A step of preconditioned subspace iteration on the full equations (LOBPCG: Knyazev 2001, SIAM J. Sci. Comput.
23, 517-541) lowers each frequency towards its value without any reduction. The drop is a lower bound of the
error, and close to it as long as the preconditioner is good; it has two levels, the equations in the
through-thickness basis, factorised, for what is smooth over the height, and for the rest planar problems that
eigenvectors over z of the interfaces leave.

Where the estimated error is too large, the basis is enriched or all laminas are solved.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as splinalg
from numpy.typing import NDArray

from lamella_shared import Reals, arrays
from model.elements.equations import Assembly, Kron
from model.elements.mesh import FIELDS, Field
from model.modes.modes import Modes, Observation, full_parameters, outside_ranges, reduced_eigenpairs, solve_modes
from model.reduction.reduction import ReducedSystem, reduce, shifted_factor
from model.reduction.through_thickness import SPARE, shear_shift
from model.solvers.eigen import lowest_modes, orthonormalize
from model.solvers.low_rank import Factor
from model.stack.stack import Stack

_MIN_STEPS = 6  # with through-thickness functions, for modes that the reduced system lacks to come up


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"n": "frequency error reduction_error"})
class Refined:
    """Frequencies of the full equations, with all laminas and no reduction.

    Attributes
    ----------
    frequency : (n_mode,) float
        Natural frequencies after the last step, Hz, ascending; 0 for rigid-body motion.
    error : (n_mode,) float
        Estimated relative error that is left in `frequency`.
    reduction_error : (n_mode,) float
        Estimated relative error of the reduced system's frequencies.
    outside : tuple of str
        Parameters outside the ranges that the reduction was made for; then further random vectors are
        iterated, because the reduction may lack modes.
    n_step : int
        Steps on the full equations.
    converged : bool
        Whether every `error` is within the tolerance.
    """

    frequency: Reals
    error: Reals
    reduction_error: Reals
    outside: tuple[str, ...]
    n_step: int
    converged: bool


def refine(
    system: ReducedSystem,
    *,
    G_f: float,
    d_f: float = 0.0,
    n_mode: int = 12,
    parameters: Mapping[str, float] | None = None,
    tolerance: float = 1e-6,
    max_steps: int = 30,
) -> Refined:
    """Verify the reduced system's frequencies on the full equations, and refine them.

    Parameters
    ----------
    system : ReducedSystem
        The reduced stack.
    G_f, d_f : float
        Contact parameters, Pa/Pa and s/Pa; frequencies do not depend on `d_f`.
    n_mode : int
        Number of modes, rigid-body modes included.
    parameters : mapping of str to float, optional
        Values of further parameters that differ from `system.theta`.
    tolerance : float
        Relative error of frequencies at which the iteration ends.
    max_steps : int
        Steps at most; 1 gives an estimate of the reduction's error at the least cost.

    Raises
    ------
    SolveError
        A parameter is unknown, or the reduced system has fewer modes.
    """
    theta = full_parameters(system, G_f, d_f, parameters)
    values, vectors, n_rigid = reduced_eigenpairs(system, theta, n_mode)
    smooth = shifted_factor(system.assembly, theta)
    correct = _without_motion(system, theta, _preconditioner(system, theta, smooth), vectors[:, :n_rigid])
    x = _from_phi(system, _over_plan(system, theta, smooth, vectors, n_rigid, n_mode))
    n = x.shape[1]
    start = np.sqrt(values[n_rigid:n_mode])
    fewest, outside = 0, outside_ranges(system, theta)
    if outside:  # the through-thickness basis may lack modes altogether
        full = system.laminas
        fresh = full.apply(full.krons("M", theta), np.random.default_rng(0).standard_normal((full.size, SPARE)))
        x, fewest = np.hstack([x, correct(fresh)]), _MIN_STEPS
    history, error = _iterated(system, theta, x, correct, (n, fewest, max_steps, tolerance))
    frequency = history[-1] / (2.0 * np.pi)
    drop = (start - history[-1]) / history[-1]
    return Refined(
        frequency=np.concatenate([np.zeros(n_rigid), frequency]),
        error=np.concatenate([np.zeros(n_rigid), error]),
        reduction_error=np.concatenate([np.zeros(n_rigid), drop + error]),
        outside=outside,
        n_step=len(history) - 1,
        converged=bool(np.all(error <= tolerance)),
    )


def _iterated(
    system: ReducedSystem,
    theta: Mapping[str, float],
    x: Reals,
    correct: Callable[[Reals], Reals],
    limits: tuple[int, int, int, float],
) -> tuple[list[Reals], Reals]:
    """Return the angular frequencies after each step of subspace iteration from x, and the error left in them.

    `limits` has the modes wanted, the fewest and the most steps, and the relative error at which it ends.
    """
    n, fewest, most, tolerance = limits
    full = system.laminas
    stiffness, mass = (full.krons(target, theta) for target in ("K", "M"))
    nothing = x[:, :0]
    step: tuple[Reals, Reals, Reals] = (nothing, nothing, nothing)
    found, x, kx, mx, _ = _rayleigh_ritz([(x, full.apply(stiffness, x), full.apply(mass, x)), step])
    history = [np.sqrt(found[:n])]
    error = np.full(n, np.inf)
    while len(history) <= min(most, fewest) or (len(history) <= most and not np.all(error <= tolerance)):
        t = correct(kx - mx * found)
        t -= x @ (mx.T @ t)
        t /= np.linalg.norm(t, axis=0)
        space = [(x, kx, mx), (t, full.apply(stiffness, t), full.apply(mass, t)), step]
        found, x, kx, mx, step = _rayleigh_ritz(space)
        history.append(np.sqrt(found[:n]))
        error = _left(history)
    return history, error


def _without_motion(
    system: ReducedSystem, theta: Mapping[str, float], correct: Callable[[Reals], Reals], rigid: Reals
) -> Callable[[Reals], Reals]:
    """Return a preconditioner whose results have no part in rigid-body motion, in reduced coordinates (n, n_rigid)."""
    if not rigid.shape[1]:  # a stack that is held has none
        return correct
    motion = _from_phi(system, system.basis @ rigid)
    mass_motion = system.laminas.apply(system.laminas.krons("M", theta), motion)

    def corrected(residual: Reals) -> Reals:
        t = correct(residual)
        t -= motion @ (mass_motion.T @ t)
        return t

    return corrected


def residual_error(system: ReducedSystem, *, G_f: float, n_mode: int = 12) -> Reals:
    """Estimate the error that the reduction leaves in frequencies, with little memory.

    One step along the preconditioned residual of the equations of all laminas, a few modes at a time. `refine` does the
    same with all modes together, and goes on.

    Parameters
    ----------
    system : ReducedSystem
        The reduced stack.
    G_f : float
        Contact stiffness parameter, Pa/Pa.
    n_mode : int
        Number of modes, rigid-body modes included.

    Returns
    -------
    (n_mode,) float
        Relative errors: twice what the step lowers each frequency; 0 for rigid-body motion.
    """
    at_once = 2  # modes of which the residual is taken
    theta = full_parameters(system, G_f, 0.0, None)
    values, vectors, n_rigid = reduced_eigenpairs(system, theta, n_mode)
    full = system.laminas
    stiffness, mass = (full.krons(target, theta) for target in ("K", "M"))
    correct = _preconditioner(system, theta, shifted_factor(system.assembly, theta))
    error = np.zeros(n_mode)
    for first in range(n_rigid, n_mode, at_once):
        part = slice(first, min(first + at_once, n_mode))
        x = _from_phi(system, system.basis @ vectors[:, part])
        kx, mx = full.apply(stiffness, x), full.apply(mass, x)
        t = correct(kx - mx * values[part])
        t /= np.linalg.norm(t, axis=0)
        found = _rayleigh_ritz([(x, kx, mx), (t, full.apply(stiffness, t), full.apply(mass, t))])[0]
        error[part] = 2.0 * (np.sqrt(values[part] / found) - 1.0)
    return error


def _over_plan(
    system: ReducedSystem, theta: Mapping[str, float], smooth: Factor, vectors: Reals, n_rigid: int, n_mode: int
) -> Reals:
    """Return the elastic modes with all of the plan and thickness basis, those too that the snapshots lack."""
    tolerance = 1e-5  # relative change of eigenvalues with through-thickness functions in the last step
    assembly = system.assembly
    mass = assembly.krons("M", theta)

    def product(x: Reals) -> Reals:
        return assembly.apply(mass, x)

    known = [orthonormalize(system.basis @ vectors[:, :n_rigid], product)] if n_rigid else []
    fresh = np.random.default_rng(0).standard_normal((assembly.size, SPARE))
    start = np.hstack([system.basis @ vectors[:, n_rigid:n_mode], fresh])
    shift, n = shear_shift(system.stack, theta), n_mode - n_rigid
    return lowest_modes(smooth.solve, product, shift, start, n, tolerance, known, _MIN_STEPS)[1][:, :n]


def _left(history: list[Reals]) -> Reals:
    """Estimate the relative error that is left from how fast the frequencies fell."""
    safety = 2.0  # the next drops together are taken as no more than this times their geometric sum
    drops = -np.diff(history, axis=0) / history[-1]
    last = np.maximum(drops[-1], np.finfo(float).eps)
    if len(drops) == 1:
        return last  # nothing is known of the rate yet: half the drop again and again
    rate = np.clip(last / np.maximum(drops[-2], np.finfo(float).eps), 0.05, 0.9)
    return safety * last * rate / (1.0 - rate)


def _rayleigh_ritz(
    space: list[tuple[Reals, Reals, Reals]],
) -> tuple[Reals, Reals, Reals, Reals, tuple[Reals, Reals, Reals]]:
    """Return the lowest Ritz pairs of the space spanned by all first members, and what was added to the first.

    Each entry holds vectors and their products with K and M; the last result does too.
    """
    k, m = (_gram([entry[0] for entry in space], [entry[i] for entry in space]) for i in (1, 2))
    n = space[0][0].shape[1]
    scale = 1.0 / np.sqrt(np.diag(m))
    k, m = k * np.outer(scale, scale), m * np.outer(scale, scale)
    size, turn = la.eigh(m)
    keep = size > 1e-12 * size[-1]
    turn = turn[:, keep] / np.sqrt(size[keep])
    values, vectors = la.eigh(turn.T @ k @ turn)
    weight = scale[:, None] * (turn @ vectors[:, :n])
    ends = np.cumsum([a[0].shape[1] for a in space])
    parts = np.split(weight, ends[:-1])
    added = tuple(sum(a[i] @ part for a, part in zip(space[1:], parts[1:], strict=True)) for i in range(3))
    x, kx, mx = (space[0][i] @ parts[0] + added[i] for i in range(3))
    return values[:n], x, kx, mx, added


def _gram(left: list[Reals], right: list[Reals]) -> Reals:
    """Return all products of left and right blocks, a symmetric matrix of which half is computed."""
    ends = np.cumsum([0, *(block.shape[1] for block in left)])
    gram = np.zeros((ends[-1], ends[-1]))
    for i, a in enumerate(left):
        for j, b in enumerate(right[: i + 1]):
            part = a.T @ b
            gram[ends[i] : ends[i + 1], ends[j] : ends[j + 1]] = part
            gram[ends[j] : ends[j + 1], ends[i] : ends[i + 1]] = part.T
    return (gram + gram.T) / 2.0


def _from_phi(system: ReducedSystem, x: Reals) -> Reals:
    """Return displacements in coordinates of the through-thickness functions on all laminas."""
    where, k = system.assembly.slices(), x.shape[1]
    return np.vstack([(system.phi[f] @ x[where[f]].reshape(system.phi[f].shape[1], -1)).reshape(-1, k) for f in FIELDS])


def _to_phi(system: ReducedSystem, x: Reals) -> Reals:
    where, k = system.laminas.slices(), x.shape[1]
    return np.vstack(
        [(system.phi[f].T @ x[where[f]].reshape(system.phi[f].shape[0], -1)).reshape(-1, k) for f in FIELDS]
    )


def _preconditioner(system: ReducedSystem, theta: Mapping[str, float], smooth: Factor) -> Callable[[Reals], Reals]:
    """Return an approximation of (K + shift M)^-1 on all laminas; `smooth` is that of the thickness basis."""
    rest = _rough_part(system, theta)
    return lambda r: _from_phi(system, smooth.solve(_to_phi(system, r))) + rest(r)


def _rough_part(system: ReducedSystem, theta: Mapping[str, float]) -> Callable[[Reals], Reals]:
    """Return an approximation of (K + shift M)^-1 for what is orthogonal to the through-thickness functions."""
    full, shift = system.laminas, shear_shift(system.stack, theta)
    inertia = (dataclasses.replace(k, z=shift * k.z) for k in full.krons("M", theta))
    shifted = (*full.krons("K", theta), *inertia)
    rough = {field: _Rough.of(full, field, shifted) for field in FIELDS}

    def apply(r: Reals) -> Reals:
        y = np.empty_like(r)
        for field, where in full.slices().items():
            phi = system.phi[field]
            value = r[where].reshape(phi.shape[0], -1)
            value = value - phi @ (phi.T @ value)
            solved = rough[field].solve(value.reshape(phi.shape[0], full.plan.size(field), -1))
            solved = solved.reshape(phi.shape[0], -1)
            y[where] = (solved - phi @ (phi.T @ solved)).reshape(-1, r.shape[1])
        return y

    return apply


@dataclass(frozen=True, eq=False, kw_only=True)
class _Rough:
    """Approximate inverse of one field's own block of a matrix, for displacements rough over z.

    Attributes
    ----------
    over_z : (n_lamina, n_lamina)
        Eigenvectors of the block's mean over the plan.
    members : tuple of (m,) int
        Eigenvectors that share a planar problem.
    solve_planar : tuple of callable
        Solution of each planar problem.
    """

    over_z: Reals
    members: tuple[NDArray[np.intp], ...]
    solve_planar: tuple[Callable[[Reals], Reals], ...]

    @classmethod
    def of(cls, assembly: Assembly, field: Field, krons: tuple[Kron, ...]) -> _Rough:
        ratio = 8.0  # of eigenvalues over z that share one planar factor
        parts = [(sp.csr_matrix(k.z), k.planar) for k in krons if k.row == k.column == field]
        size = assembly.plan.form(field, field).diagonal()
        mean = sum(float(np.mean(planar.diagonal() / size)) * z for z, planar in parts)
        values, vectors = la.eigh(mean.toarray())
        group = np.floor(np.log(np.maximum(values, values[-1] * 1e-12)) / np.log(ratio)).astype(int)
        members = tuple(np.flatnonzero(group == g) for g in np.unique(group))
        solvers = []
        for m in members:
            shares = [float(np.mean(np.einsum("ij,ij->j", vectors[:, m], z @ vectors[:, m]))) for z, _ in parts]
            planar = sum(share * p for share, (_, p) in zip(shares, parts, strict=True))
            solvers.append(splinalg.splu(planar.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0).solve)
        return cls(over_z=vectors, members=members, solve_planar=tuple(solvers))

    def solve(self, value: Reals) -> Reals:
        """Return the solution for (n_lamina, n_planar, k)."""
        n, n_planar, k = value.shape
        turned = (self.over_z.T @ value.reshape(n, -1)).reshape(n, n_planar, k)
        for m, solve in zip(self.members, self.solve_planar, strict=True):
            part = turned[m].transpose(1, 0, 2).reshape(n_planar, -1)
            turned[m] = solve(part).reshape(n_planar, m.size, k).transpose(1, 0, 2)
        return (self.over_z @ turned.reshape(n, -1)).reshape(n, n_planar, k)


Basis = Literal["first", "enriched", "all laminas"]


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"any": "error"})
class Verification:
    """How far the frequencies of a reduced stack are from those of all its laminas.

    Attributes
    ----------
    error : (n_mode,) float
        Estimated relative error of each frequency, from the residual of the equations of all laminas.
    tolerance : float
        The error that was allowed.
    basis : "first", "enriched" or "all laminas"
        What the frequencies are from: the first reduced basis, which kept the tolerance; one with more
        through-thickness functions, because the first did not; or an iteration on the equations of all laminas,
        because neither did.
    first_error : float
        Largest estimated error with the first basis.
    """

    error: Reals
    tolerance: float
    basis: Basis
    first_error: float

    @property
    def within_tolerance(self) -> bool:
        """Whether every error is within the tolerance."""
        return bool(np.all(self.error <= self.tolerance))


def solve_verified(
    stack: Stack, *, observation: Observation, n_mode: int = 16, tolerance: float = 1e-4
) -> tuple[ReducedSystem, Modes, Verification]:
    """Solve for the modes of a stack and check them on the equations of all laminas.

    When the estimated error exceeds the tolerance, the basis is enriched; when that does not suffice, the modes are
    iterated on the equations of all laminas. Damping ratios and shapes are those of the last reduced basis.

    Parameters
    ----------
    stack : Stack
        The stack.
    observation : Observation
        Where shapes are wanted.
    n_mode : int
        Number of modes, rigid-body modes included.
    tolerance : float
        Relative error of a frequency.

    Returns
    -------
    system : ReducedSystem
        The reduced stack, for pictures and responses.
    modes : Modes
        The modes, rigid-body ones first.
    verification : Verification
        Errors, and what the frequencies are from.

    Raises
    ------
    SolveError
        The modes do not converge.
    """
    of_basis = 0.1  # of the tolerance, that the through-thickness functions may take in the first basis
    spare = 2  # modes beyond those asked for, so that none is missing among close ones
    enriched = 0.003  # of the tolerance, that the through-thickness functions may take in the enriched basis
    contact = stack.contact

    def attempt(share: float) -> tuple[ReducedSystem, Modes, Reals]:
        system = reduce(stack, n_mode=n_mode + spare, n_snapshot=1, z_tolerance=share * tolerance)
        modes = solve_modes(system, G_f=contact.G_f, d_f=contact.d_f, n_mode=n_mode, observation=observation)
        return system, modes, residual_error(system, G_f=contact.G_f, n_mode=n_mode)

    system, modes, error = attempt(of_basis)
    first, basis = float(error.max()), "first"
    if first > tolerance:
        system, modes, error = attempt(enriched)
        basis = "enriched"
    if error.max() > tolerance:
        check = refine(system, G_f=contact.G_f, n_mode=n_mode, tolerance=of_basis * tolerance)
        # where factors depend on frequency, the correction is that at the reference frequency
        corrected = modes.frequency * (1.0 - check.reduction_error + check.error)
        modes, basis, error = dataclasses.replace(modes, frequency=corrected), "all laminas", check.error
    return system, modes, Verification(error=error, tolerance=tolerance, basis=basis, first_error=first)  # type: ignore[arg-type]
