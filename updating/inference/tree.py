"""Errors of many states whose discrepancies are shared by levels of a tree, solved from its leaves to its root.

The discrepancy of a state is E = E_rig + E_specimen + E_state: each two random symmetric matrices, of stiffness and of
mass, in the coordinates of one reference state, and each linear in the errors. So the covariance of all errors is one
block for each state and, for every node of the tree, of the rank of such matrices. Integrating out E from the leaves to
the root (as in a Kalman filter on a tree; Chou, Willsky and Benveniste 1994) costs as many small factorisations as
there are nodes, where the covariance in full would have thousands of rows. See `discrepancy` for one stack.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from updating.inference.discrepancy import OF_MASS, Sizes, Weighed, shared_levels
from updating.inference.equation_error import Errors

Vector = NDArray[np.float64]
Path = tuple[str, ...]

_NUGGET = 1e-10  # of the noise of an equation error, as in `discrepancy.joined`
_DAMPING_NUGGET = 1e-6  # of the discrepancy of a damping ratio, likewise


@dataclass(frozen=True, kw_only=True)
class Tree:
    """Where states stand, and what shares of the discrepancy the levels have.

    Attributes
    ----------
    paths : tuple of tuple of str
        Place of each state, from the outside in.
    shares : tuple of float
        Of each level, from the outside in, that of single states last; they sum to 1.
    """

    paths: tuple[Path, ...]
    shares: tuple[float, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Leaf:
    """Errors of one state.

    Attributes
    ----------
    touched : (k,) int
        Coordinates of the fit on which they depend.
    noise, discrepancy : (n, n) float
        Covariance by noise, and by a discrepancy of size 1.
    columns : (n, 1 + k + p) float
        Errors, their derivatives, and how they follow the p numbers of a common discrepancy of size 1.
    mode : (n,) int
        The measured mode of each error.
    """

    touched: NDArray[np.intp]
    noise: Vector
    discrepancy: Vector
    columns: Vector
    mode: NDArray[np.intp]

    def information(self, size: float, kept: NDArray[np.bool_] | None = None) -> tuple[Vector, float]:
        """Return the products of the columns over noise and the state's part of the discrepancy, (1 + k + p,) squared.

        Parameters
        ----------
        size : float
            Of the state's part.
        kept : (n,) bool, optional
            Errors that count.

        Returns
        -------
        (1 + k + p, 1 + k + p) float, float
            The products, and the logarithm of the determinant of the covariance.
        """
        covariance, columns = self.noise + size**2 * self.discrepancy, self.columns
        if kept is not None:
            covariance, columns = covariance[np.ix_(kept, kept)], columns[kept]
        root = la.cholesky(covariance, lower=True, check_finite=False)
        white = la.solve_triangular(root, columns, lower=True, check_finite=False)
        return white.T @ white, 2.0 * float(np.sum(np.log(np.diag(root))))


@dataclass(frozen=True, eq=False)
class Message:
    """What a part of the tree says of coordinates and, where something above it is shared, of a discrepancy there.

    Attributes
    ----------
    touched : (k,) int
        Coordinates.
    product : (1 + k + p, 1 + k + p) float
        Products of errors and derivatives, p of the discrepancy or none.
    log_determinant : float
        Of the covariance.
    """

    touched: NDArray[np.intp]
    product: Vector
    log_determinant: float


def together(parts: Sequence[Message]) -> Message:
    """Return what several parts that share what is above them say."""
    touched = np.unique(np.concatenate([own.touched for own in parts]))
    rest = parts[0].product.shape[0] - 1 - parts[0].touched.size
    product, k = np.zeros((1 + touched.size + rest,) * 2), 1 + touched.size
    for own in parts:
        at, n = np.concatenate([[0], 1 + np.searchsorted(touched, own.touched)]), 1 + own.touched.size
        product[np.ix_(at, at)] += own.product[:n, :n]
        product[k:, k:] += own.product[n:, n:]
        product[at, k:] += own.product[:n, n:]
    product[k:, :k] = product[:k, k:].T
    return Message(touched, product, sum(own.log_determinant for own in parts))


def integrated(own: Message, variance: float, *, above: bool) -> Message:
    """Integrate out the discrepancy of a node.

    Parameters
    ----------
    own : Message
        What all below say of the discrepancy there.
    variance : float
        Of what the node adds to that above it.
    above : bool
        Whether any is above.
    """
    k = 1 + own.touched.size
    p = own.product.shape[0] - k
    inner = own.product[k:, k:]
    root = la.cholesky(np.eye(p) + variance * inner, lower=True, check_finite=False)
    towards = np.sqrt(variance) * la.solve_triangular(root, own.product[k:, :k], lower=True)
    log = own.log_determinant + 2.0 * float(np.sum(np.log(np.diag(root))))
    left = own.product[:k, :k] - towards.T @ towards
    if not above:
        return Message(own.touched, left, log)
    product = np.empty_like(own.product)
    product[:k, :k] = left
    across = la.cho_solve((root, True), own.product[k:], check_finite=False)  # (1 + variance M)^-1 M
    product[k:] = across
    product[:k, k:] = across[:, :k].T
    product[k:, k:] = 0.5 * (across[:, k:] + across[:, k:].T)
    return Message(own.touched, product, log)


@dataclass(frozen=True, eq=False, kw_only=True)
class TreeProblem:
    """All errors of a campaign of many states, with what their covariance is made of.

    Attributes
    ----------
    tree : Tree
        Where they stand.
    leaves : tuple of Leaf
        Equation errors, by state.
    n_coordinate : int
        Of the fit.
    damping, damping_jacobian, damping_noise, damping_discrepancy
        Logarithms of damping ratios that are compared, as `discrepancy.Problem` has them.
    damping_at : (N,) int
        The state of each.
    log_map, curvature
        As `discrepancy.Problem` has them.
    turned : tuple of (n, m) float
        Modal coordinates of the measured modes of each state, in those of the reference.
    errors : tuple of Errors
        By state, what was joined.
    """

    tree: Tree
    leaves: tuple[Leaf, ...]
    n_coordinate: int
    damping: Vector
    damping_jacobian: Vector
    damping_noise: Vector
    damping_discrepancy: Vector
    damping_at: NDArray[np.intp]
    log_map: float
    curvature: Vector
    turned: tuple[Vector, ...]
    errors: tuple[Errors, ...]

    def weighed(self, sizes: Sizes) -> Weighed:
        """Return misfit and derivatives over noise and a discrepancy of given sizes."""
        return self.of_stiffness(sizes.stiffness) + self.of_damping(sizes.damping)

    def beside(self, sizes: Sizes) -> Vector:
        """Return what the cost's gradient has beside that at a given covariance, by measured mode."""
        found = []
        pulled = pulls(self, sizes.stiffness)
        for leaf, errors, pull in zip(self.leaves, self.errors, pulled, strict=True):
            found.append(np.zeros((len(errors.value), self.n_coordinate)))
            found[-1][:, leaf.touched] = errors.beside(*pull)
        return np.vstack(found)

    def curvature_of(self, kept: NDArray[np.bool_]) -> Vector:
        """Return what of the curvature some measured modes make, `kept` being (n,) bool."""
        total, first = np.zeros_like(self.curvature), 0
        for leaf, own in zip(self.leaves, self.errors, strict=True):
            here = kept[first : first + len(own.value)]
            total[np.ix_(leaf.touched, leaf.touched)] += own.curvature[here].sum(axis=0)
            first += len(own.value)
        return total

    def of_stiffness(self, size: float) -> Weighed:
        """Return the same of equation errors alone."""
        return self.whole(Passing(self, size).root())

    def of_damping(self, size: float, kept: NDArray[np.bool_] | None = None) -> Weighed:
        """Return the same of damping ratios alone, of those that are kept."""
        some = np.ones(self.damping.size, dtype=bool) if kept is None else kept
        if not some.any():
            return Weighed.nothing(self.n_coordinate)
        at = np.ix_(some, some)
        return Weighed.of(
            self.damping[some],
            self.damping_jacobian[some],
            self.damping_noise[at] + size**2 * self.damping_discrepancy[at],
        )

    def whole(self, own: Message) -> Weighed:
        """Return what a message to the root says of all coordinates."""
        hessian, slope = np.zeros((self.n_coordinate,) * 2), np.zeros(self.n_coordinate)
        hessian[np.ix_(own.touched, own.touched)] = own.product[1:, 1:]
        slope[own.touched] = own.product[1:, 0]
        return Weighed(float(own.product[0, 0]), slope, hessian, 0.5 * own.log_determinant)


@dataclass(eq=False)
class Passing:
    """Messages from the leaves of a tree to its root at one size; those that are asked for again are kept.

    Attributes
    ----------
    problem : TreeProblem
        The errors.
    size : float
        Of the discrepancy.
    """

    problem: TreeProblem
    size: float
    _kept: dict[Path, Message | None] = field(default_factory=dict)

    def of(self, node: Path) -> Message:
        """Return what a node of the tree and all below it say to what is above."""
        found = self._of(node, {})
        assert found is not None
        return found

    def root(self, without: Mapping[int, NDArray[np.bool_] | None] | None = None) -> Message:
        """Return the message to the root.

        Parameters
        ----------
        without : mapping of int to (n,) bool or None, optional
            States of which not all errors count: those that do, or None where none does.
        """
        found = self._of((), without or {})
        if found is None:
            message = "nothing is left to say anything"
            raise ValueError(message)
        return found

    def _of(self, node: Path, without: Mapping[int, NDArray[np.bool_] | None]) -> Message | None:
        tree = self.problem.tree
        below = [c for c, path in enumerate(tree.paths) if path[: len(node)] == node]
        whole = not any(c in without for c in below)
        if whole and node in self._kept:
            return self._kept[node]
        depth = len(node)
        if depth == len(tree.shares):
            found = self._leaf(below[0], without)
        else:
            children = dict.fromkeys(tree.paths[c][: depth + 1] for c in below)
            parts = [own for own in (self._of(child, without) for child in children) if own is not None]
            found = together(parts) if parts else None
            share = tree.shares[depth - 1] if depth else 0.0
            if found is not None and share > 0.0:
                above = any(s > 0.0 for s in tree.shares[: depth - 1])
                found = integrated(found, self.size**2 * share, above=above)
        if whole:
            self._kept[node] = found
        return found

    def _leaf(self, c: int, without: Mapping[int, NDArray[np.bool_] | None]) -> Message | None:
        kept = without.get(c)
        if c in without and (kept is None or not kept.any()):
            return None
        own, shares = self.problem.leaves[c], self.problem.tree.shares
        product, log = own.information(self.size * float(np.sqrt(shares[-1])), kept)
        if not any(s > 0.0 for s in shares[:-1]):
            product = product[: 1 + own.touched.size, : 1 + own.touched.size]
        return Message(own.touched, product, log)


def pulls(problem: TreeProblem, size: float) -> list[tuple[Vector, Vector]]:
    """Return the errors of each state over their covariance, (n, m), and the inverse's blocks by mode, (n, m, m).

    What is known of each shared discrepancy comes down from the root (Rauch, Tung and Striebel 1965).
    """
    tree, depths = problem.tree, range(1, len(problem.tree.shares))
    state_size = size * float(np.sqrt(tree.shares[-1]))
    white, said = [], dict[Path, tuple[Vector, Vector]]()
    for path, leaf in zip(tree.paths, problem.leaves, strict=True):
        inverse = la.inv(leaf.noise + state_size**2 * leaf.discrepancy, check_finite=False)
        follows = leaf.columns[:, 1 + leaf.touched.size :]
        heard = inverse @ follows
        white.append((inverse, heard, inverse @ leaf.columns[:, 0]))
        _hear(said, path[:-1], follows.T @ heard, heard.T @ leaf.columns[:, 0])
    inner = dict[Path, Vector]()
    for depth in reversed(depths):
        for node in dict.fromkeys(path[:depth] for path in tree.paths):
            precision, pull = said[node]
            inner[node] = la.inv(np.eye(pull.size) + size**2 * tree.shares[depth - 1] * precision)
            _hear(said, node[:-1], precision @ inner[node], inner[node] @ pull)
    p = said[()][1].size
    known: dict[Path, tuple[Vector, Vector]] = {(): (np.zeros(p), np.zeros((p, p)))}
    for depth in depths:
        variance = size**2 * tree.shares[depth - 1]
        for node in dict.fromkeys(path[:depth] for path in tree.paths):
            mean, covariance = known[node[:-1]]
            known[node] = (
                inner[node] @ (mean + variance * said[node][1]),
                variance * inner[node] + inner[node] @ covariance @ inner[node],
            )
    found = []
    for (inverse, heard, pull), path, own in zip(white, tree.paths, problem.errors, strict=True):
        mean, covariance = known[path[:-1]]
        n, m = own.value.shape
        mode = np.arange(n)
        by_mode = heard.reshape(n, m, p)
        blocks = inverse.reshape(n, m, n, m)[mode, :, mode] - by_mode @ covariance @ by_mode.transpose(
            0, 2, 1
        )
        found.append(((pull - heard @ mean).reshape(n, m), blocks))
    return found


def _hear(said: dict[Path, tuple[Vector, Vector]], node: Path, precision: Vector, pull: Vector) -> None:
    """Add what one more says of the discrepancy of a node."""
    known = said.get(node)
    said[node] = (precision, pull) if known is None else (known[0] + precision, known[1] + pull)


def tree_problem(errors: Sequence[Errors], tree: Tree, n_coordinate: int) -> TreeProblem:
    """Join the errors of all states.

    Parameters
    ----------
    errors : sequence of Errors
        By state.
    tree : Tree
        Where they stand.
    n_coordinate : int
        Number of coordinates of the fit.
    """
    leaves, turned = [], []
    everything = np.arange(n_coordinate)
    curvature = np.zeros((n_coordinate, n_coordinate))
    damping_jacobian = []
    for own in errors:
        touched = everything if own.touched is None else own.touched
        turn = np.eye(own.value.shape[1])
        if own is not errors[0]:
            u, _, v = la.svd(errors[0].shape.T @ own.shape)
            turn = u @ v
        turned.append(own.weight @ turn.T)
        leaves.append(_leaf_of(own, turn, turned[-1], touched))
        curvature[np.ix_(touched, touched)] += own.curvature.sum(axis=0)
        jacobian = np.zeros((len(own.damping), n_coordinate))
        jacobian[:, touched] = own.damping_jacobian
        damping_jacobian.append(jacobian)
    ratio = np.concatenate([own.damping for own in errors])
    seen, at = (
        np.isfinite(ratio),
        np.concatenate([np.full(len(e.damping), c) for c, e in enumerate(errors)]),
    )
    common = shared_levels(tree.paths, tree.shares)
    every = np.vstack(turned)
    of_damping = common[np.ix_(at, at)] * (every @ every.T) ** 2 + _DAMPING_NUGGET * np.eye(at.size)
    return TreeProblem(
        tree=tree,
        leaves=tuple(leaves),
        n_coordinate=n_coordinate,
        damping=ratio[seen],
        damping_jacobian=np.vstack(damping_jacobian)[seen],
        damping_noise=np.diag(np.concatenate([own.damping_std for own in errors])[seen] ** 2),
        damping_discrepancy=of_damping[np.ix_(seen, seen)],
        damping_at=at[seen].astype(np.intp),
        log_map=sum(own.log_map for own in errors),
        curvature=curvature,
        turned=tuple(turned),
        errors=tuple(errors),
    )


def _leaf_of(own: Errors, turn: Vector, turned: Vector, touched: NDArray[np.intp]) -> Leaf:
    """Return the errors of a state; `turn` (m, m) leads to the reference, where its modal coordinates are `turned`."""
    n, m = own.value.shape
    low, high = np.tril_indices(m)
    # e_sr = sum_ij turn_is E_ij turned_rj: of each number of E once, on the diagonal with twice the variance
    follows = turn[low][:, :, None] * turned.T[high][:, None, :]  # (p, m, n)
    follows = follows + turn[high][:, :, None] * turned.T[low][:, None, :]
    follows *= np.where(low == high, np.sqrt(0.5), 1.0)[:, None, None]
    of_stiffness = follows.transpose(2, 1, 0).reshape(n * m, low.size)
    of_mass = own.inertia.reshape(-1, 1) * of_stiffness
    latent = np.hstack([np.sqrt(1.0 - OF_MASS) * of_stiffness, np.sqrt(OF_MASS) * of_mass])
    return Leaf(
        touched=touched,
        noise=la.block_diag(*own.noise) + _NUGGET * np.eye(n * m),
        discrepancy=latent @ latent.T,
        columns=np.column_stack([own.value.ravel(), own.jacobian.reshape(n * m, -1), latent]),
        mode=np.repeat(np.arange(n), m),
    )
