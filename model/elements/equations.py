"""The stack's equations of motion as named sums of (matrix over z) x (matrix over the plan).

Every lamina carries the same planar fields u, v and w, so each part of the mass, stiffness and damping
matrix is a sum of Kronecker products Z x P, times a scalar that depends on the parameters. Reduction over z
replaces Z by Phi' Z Phi and leaves everything else as it is.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from lamella_shared import Reals
from model.elements.mesh import FIELDS, Field, Plan
from model.stack.errors import SolveError
from model.stack.stack import Stack

Target = Literal["M", "C", "K"]
Matrix = Any  # scipy sparse or numpy dense; scipy has no common type for the two

Theta = Mapping[str, Any]
"""Parameters by name: real, or complex in a complex step."""

OMEGA = "omega"
"""The parameter, rad/s, of factors that depend on frequency: modes are solved at their own, responses line by line."""


class ParameterFactor(Protocol):
    """The scalar by which a term is multiplied, as a function of the parameters `theta`."""

    def __call__(self, theta: Mapping[str, float]) -> float:
        """Return the value at the parameters `theta`."""

    def derivative(self, theta: Mapping[str, float], name: str) -> float:
        """Return the derivative by the parameter `name` at `theta`."""

    def names(self, theta: Mapping[str, float]) -> frozenset[str]:
        """Return the parameters on which it depends at `theta`."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Monomial:
    """The factor of a term: the product of parameters raised to powers.

    Attributes
    ----------
    exponent : mapping of str to int
        Power of each parameter; empty for a term that is always there.
    """

    exponent: Mapping[str, int]

    def __call__(self, theta: Mapping[str, float]) -> float:
        """Return the value at the parameters `theta`."""
        return float(math.prod(theta[name] ** n for name, n in self.exponent.items()))

    def derivative(self, theta: Mapping[str, float], name: str) -> float:
        """Return the derivative by the parameter `name` at `theta`."""
        n = self.exponent.get(name, 0)
        if n == 0:
            return 0.0
        rest = {other: power for other, power in self.exponent.items() if other != name}
        return n * theta[name] ** (n - 1) * Monomial(exponent=rest)(theta)

    def names(self, theta: Mapping[str, float]) -> frozenset[str]:  # noqa: ARG002
        """Return the parameters on which it depends."""
        return frozenset(name for name, power in self.exponent.items() if power)


class _Recorded(dict[str, Any]):
    """Parameters that note which of them were asked for."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        super().__init__(values)
        self.asked: set[str] = set()

    def __getitem__(self, name: str) -> Any:
        self.asked.add(name)
        return super().__getitem__(name)

    def get(self, name: str, default: Any = None) -> Any:
        if name in self:
            self.asked.add(name)
        return super().get(name, default)


class Analytic:
    """A factor that is an analytic function of the parameters, with derivatives by a complex step.

    Attributes
    ----------
    function : callable
        From values of the parameters by name, real or complex, to the factor: a field, or a method. No `abs`, `min` or
        comparison of complex values is inside, which are not analytic (Squire and Trapp 1998).
    """

    function: Callable[[Theta], Any]

    def __call__(self, theta: Mapping[str, float]) -> float:
        """Return the value at the parameters `theta`."""
        return float(np.real(self.function(theta)))

    def derivative(self, theta: Mapping[str, float], name: str) -> float:
        """Return the derivative by the parameter `name` at `theta`."""
        step = 1e-30  # of the complex step, which loses nothing to rounding however small it is
        return float(np.imag(self.function({**theta, name: theta[name] + 1j * step})) / step)

    def names(self, theta: Mapping[str, float]) -> frozenset[str]:
        """Return the parameters that the function asks for at `theta`."""
        recorded = _Recorded(theta)
        self.function(recorded)
        return frozenset(recorded.asked)


@dataclass(frozen=True, eq=False)
class Formula(Analytic):
    """The factor of a term as an analytic function of the parameters.

    Attributes
    ----------
    function : callable
        From a mapping of parameter names to values, real or complex, to the factor, as `Analytic` asks for it.
    """

    function: Callable[[Theta], Any]


@dataclass(frozen=True, eq=False, kw_only=True)
class Product:
    """The factor of a term as the product of two others.

    Attributes
    ----------
    first, second : ParameterFactor
        The two.
    """

    first: ParameterFactor
    second: ParameterFactor

    def __call__(self, theta: Mapping[str, float]) -> float:
        """Return the value at the parameters `theta`."""
        return self.first(theta) * self.second(theta)

    def derivative(self, theta: Mapping[str, float], name: str) -> float:
        """Return the derivative by the parameter `name` at `theta`."""
        return self.first.derivative(theta, name) * self.second(theta) + self.first(theta) * self.second.derivative(
            theta, name
        )

    def names(self, theta: Mapping[str, float]) -> frozenset[str]:
        """Return the parameters on which either depends at `theta`."""
        return self.first.names(theta) | self.second.names(theta)


@dataclass(frozen=True, eq=False, kw_only=True)
class Riding(Analytic):
    """The factor of a unit mass that rides on a spring: what its apparent mass m / (1 - omega^2 m c) is above m.

    Line by line it is this factor (Den Hartog, Mechanical Vibrations, 3.2). In reduced matrices the mass has
    coordinates of its motion on the spring instead (`model.reduction.riding`), and modes are those of constant ones.

    Attributes
    ----------
    mass : float
        The mass m, kg.
    compliance : callable
        From the parameters to the compliance c of its seat, m/N; analytic as the function of a `Formula`.
    share : callable
        From the parameters to the share of the mass that rides, from 0 to 1; its root is analytic as well.
    loss : float
        Loss factor of the seat, which bounds the apparent mass: that of bolted joints that slip (Ibrahim and Pettit,
        J. Sound Vib. 279, 2005).
    """

    mass: float
    compliance: Callable[[Theta], Any]
    share: Callable[[Theta], Any]
    loss: float = 0.1

    def function(self, theta: Theta, /) -> Any:
        """Return what the mass is above its own at an angular frequency, kg, real or complex."""
        x = theta[OMEGA] ** 2 * self.mass * self.compliance(theta)
        return self.share(theta) * self.mass * x * (1.0 - x) / ((1.0 - x) ** 2 + self.loss**2)


@dataclass(frozen=True, eq=False, kw_only=True)
class Kron:
    """One Kronecker product; where `row` and `column` differ, its transpose is meant as well.

    Attributes
    ----------
    row, column : "u", "v" or "w"
        Fields that it couples.
    z : (n_z_row, n_z_column) matrix
        Over the laminas, or over the through-thickness functions that stand for them.
    planar : (n_row, n_column) sparse matrix
        Over the plan.
    """

    row: Field
    column: Field
    z: Matrix
    planar: sp.csr_matrix


def collected(krons: Iterable[Kron]) -> tuple[Kron, ...]:
    """Sum products of which the matrices over z are multiples of each other."""
    found: list[Kron] = []
    for kron in krons:
        for i, other in enumerate(found):
            share = ratio(kron.z, other.z) if (kron.row, kron.column) == (other.row, other.column) else 0.0
            if share:
                found[i] = dataclasses.replace(other, planar=other.planar + share * kron.planar)
                break
        else:
            found.append(kron)
    return tuple(found)


def ratio(a: Matrix, b: Matrix) -> float:
    """Return the number by which b must be multiplied to give a, 0 if there is none."""
    same = 1e-13  # relative difference between matrices over z that count as multiples of each other
    if a.shape != b.shape or sp.issparse(a) != sp.issparse(b):
        return 0.0
    if sp.issparse(a):
        a, b = sp.csr_array(a), sp.csr_array(b)
        if not (np.array_equal(a.indptr, b.indptr) and np.array_equal(a.indices, b.indices)):
            return 0.0
        a, b = a.data, b.data
    largest = np.unravel_index(np.argmax(np.abs(b)), b.shape) if b.size else ()
    if not b.size or b[largest] == 0.0:
        return 0.0
    found = float(a[largest] / b[largest])
    return found if np.abs(a - found * b).max() <= same * np.abs(a).max() else 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Term:
    """One named part of the mass (M), damping (C) or stiffness (K) matrix."""

    name: str
    target: Target
    factor: ParameterFactor
    krons: tuple[Kron, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Assembly:
    """The equations of motion, M a + C v + K x = f, as a sum of terms.

    A displacement is one vector: the fields u, v, w one after the other, each with the index over z outside
    and the planar index inside.

    Attributes
    ----------
    stack : Stack
        What is described.
    plan : Plan
        The lamina's mesh and spaces.
    n_z : mapping of field to int
        Number of laminas, or of through-thickness functions, of each field.
    terms : tuple of Term
        The parts.
    theta : mapping of str to float
        The parameters and their nominal values.
    """

    stack: Stack
    plan: Plan
    n_z: Mapping[Field, int]
    terms: tuple[Term, ...]
    theta: Mapping[str, float]

    @property
    def size(self) -> int:
        """Number of degrees of freedom."""
        return sum(self.n_z[field] * self.plan.size(field) for field in FIELDS)

    def slices(self) -> dict[Field, slice]:
        """Return where each field sits in a displacement vector."""
        found, start = {}, 0
        for field in FIELDS:
            stop = start + self.n_z[field] * self.plan.size(field)
            found[field] = slice(start, stop)
            start = stop
        return found

    def term(self, name: str) -> Term:
        """Return the term of a name.

        Raises
        ------
        SolveError
            There is none.
        """
        for term in self.terms:
            if term.name == name:
                return term
        raise SolveError(f"no term {name!r}; there are {', '.join(term.name for term in self.terms)}")

    def with_terms(self, terms: tuple[Term, ...], theta: Mapping[str, float]) -> Assembly:
        """Return the assembly with further terms and the nominal values of their parameters."""
        return dataclasses.replace(self, terms=self.terms + terms, theta={**self.theta, **theta})

    def acting(self, samples: Sequence[Mapping[str, float]]) -> Assembly:
        """Return the assembly without the terms that vanish at all samples, such as those of neutral effects."""
        terms = tuple(t for t in self.terms if any(t.factor(theta) != 0.0 for theta in samples))
        return dataclasses.replace(self, terms=terms)

    def krons(self, target: Target, theta: Mapping[str, float]) -> tuple[Kron, ...]:
        """Return the Kronecker products of a matrix, factors multiplied in.

        Those with factor 0 are left out, and those that share their matrix over z are summed over the plan.
        """
        factors = [(term, term.factor(theta)) for term in self.terms if term.target == target]
        return collected(
            dataclasses.replace(kron, z=factor * kron.z)
            for term, factor in factors
            if factor != 0.0
            for kron in term.krons
        )

    def matrix(self, target: Target, theta: Mapping[str, float]) -> sp.csr_matrix:
        """Return M, C or K at the parameters `theta` as one sparse matrix."""
        return self.sparse_sum(self.krons(target, theta))

    def sparse_sum(self, krons: tuple[Kron, ...]) -> sp.csr_matrix:
        """Return a sum of Kronecker products as one sparse matrix, (size, size)."""
        sizes = {field: self.n_z[field] * self.plan.size(field) for field in FIELDS}
        blocks: dict[tuple[Field, Field], Any] = {}
        for kron in krons:
            block = sp.kron(sp.csr_matrix(kron.z), kron.planar, format="csr")
            key = (kron.row, kron.column)
            blocks[key] = blocks[key] + block if key in blocks else block
        for row, column in list(blocks):
            if row != column:
                blocks[column, row] = blocks[row, column].T.tocsr()
        rows = [[blocks.get((r, c), sp.csr_matrix((sizes[r], sizes[c]))) for c in FIELDS] for r in FIELDS]
        return sp.vstack([sp.hstack(row, format="csr") for row in rows], format="csr")

    def apply(self, krons: tuple[Kron, ...], x: NDArray[Any]) -> NDArray[Any]:
        """Multiply a sum of Kronecker products by vectors, (size, k), without forming the matrix."""
        y = np.zeros_like(x)
        where, k = self.slices(), x.shape[1]
        planar_first = {
            field: x[part].reshape(self.n_z[field], -1, k).transpose(1, 0, 2).reshape(-1, self.n_z[field] * k)
            for field, part in where.items()
        }

        def add(row: Field, column: Field, z: Matrix, planar: Matrix) -> None:
            flat = (planar @ planar_first[column]).reshape(-1, self.n_z[column], k).transpose(1, 0, 2)
            y[where[row]] += (z @ flat.reshape(self.n_z[column], -1)).reshape(-1, k)

        for kron in krons:
            add(kron.row, kron.column, kron.z, kron.planar)
            if kron.row != kron.column:
                add(kron.column, kron.row, kron.z.T, kron.planar.T)
        return y

    def project_z(self, phi: Mapping[Field, Reals]) -> Assembly:
        """Return the Galerkin projection on x = sum over j of phi[field][:, j] x_j, for each field.

        Terms that share their products still do.
        """
        projected: dict[int, tuple[Kron, ...]] = {}
        for term in self.terms:
            if id(term.krons) not in projected:
                projected[id(term.krons)] = tuple(
                    dataclasses.replace(kron, z=phi[kron.row].T @ (kron.z @ phi[kron.column])) for kron in term.krons
                )
        terms = tuple(dataclasses.replace(term, krons=projected[id(term.krons)]) for term in self.terms)
        n_z = {field: phi[field].shape[1] for field in FIELDS}
        return dataclasses.replace(self, n_z=n_z, terms=terms)
