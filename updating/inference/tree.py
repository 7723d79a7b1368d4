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

from updating.inference.discrepancy import OF_MASS, Sizes, Weighed, rotation, shared_levels
from updating.inference.equation_error import Errors

Vector = NDArray[np.float64]
Path = tuple[str, ...]

_NUGGET = 1e-10  # of the noise of an equation error, as in `discrepancy.joined`
_DAMPING_NUGGET = 1e-6  # of the discrepancy of a damping ratio, likewise


@dataclass(frozen=True, kw_only=True)
class Tree:
    """Places of the states, and shares of the discrepancy of the levels.

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
        Errors, their derivatives, and their change by each of the p entries of a common discrepancy of size 1.
    mode : (n,) int
        The measured mode of each error.
    """

    touched: NDArray[np.intp]
    noise: Vector
    discrepancy: Vector
    columns: Vector
    mode: NDArray[np.intp]

    def information(self, size: float, kept: NDArray[np.bool_] | None = None) -> tuple[Vector, float]:
        """Return the products of the columns, whitened by noise and the state's part of the discrepancy.

        Parameters
        ----------
        size : float
            Of the state's part.
        kept : (n,) bool, optional
            Errors that are used.

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
    """What a part of the tree says of coordinates and, where a level above it is shared, of the discrepancy there.

    Attributes
    ----------
    touched : (k,) int
        Coordinates.
    product : (1 + k + p, 1 + k + p) float
        Products of errors and derivatives, the last p by the discrepancy; p may be 0.
    log_determinant : float
        Of the covariance.
    """

    touched: NDArray[np.intp]
    product: Vector
    log_determinant: float


def together(parts: Sequence[Message]) -> Message:
    """Join the messages of several parts that share the discrepancy above them."""
    touched = np.unique(np.concatenate([message.touched for message in parts]))
    rest = parts[0].product.shape[0] - 1 - parts[0].touched.size
    product, k = np.zeros((1 + touched.size + rest,) * 2), 1 + touched.size
    for message in parts:
        at, n = np.concatenate([[0], 1 + np.searchsorted(touched, message.touched)]), 1 + message.touched.size
        product[np.ix_(at, at)] += message.product[:n, :n]
        product[k:, k:] += message.product[n:, n:]
        product[at, k:] += message.product[:n, n:]
    product[k:, :k] = product[:k, k:].T
    return Message(touched, product, sum(message.log_determinant for message in parts))


def integrated(message: Message, variance: float, *, above: bool) -> Message:
    """Integrate out the discrepancy of a node.

    Parameters
    ----------
    message : Message
        Of all parts below the node.
    variance : float
        Of the discrepancy that the node adds to that above it.
    above : bool
        Whether any discrepancy is above.
    """
    k = 1 + message.touched.size
    p = message.product.shape[0] - k
    inner = message.product[k:, k:]
    root = la.cholesky(np.eye(p) + variance * inner, lower=True, check_finite=False)
    towards = np.sqrt(variance) * la.solve_triangular(root, message.product[k:, :k], lower=True)
    log = message.log_determinant + 2.0 * float(np.sum(np.log(np.diag(root))))
    left = message.product[:k, :k] - towards.T @ towards
    if not above:
        return Message(message.touched, left, log)
    product = np.empty_like(message.product)
    product[:k, :k] = left
    across = la.cho_solve((root, True), message.product[k:], check_finite=False)  # (1 + variance M)^-1 M
    product[k:] = across
    product[:k, k:] = across[:, :k].T
    product[k:, k:] = 0.5 * (across[:, k:] + across[:, k:].T)
    return Message(message.touched, product, log)


@dataclass(frozen=True, eq=False, kw_only=True)
class TreeProblem:
    """All errors of a campaign of many states, with the parts of their covariance.

    Attributes
    ----------
    tree : Tree
        Places of the states.
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
        """Return the gradient of the cost less that at a fixed covariance, by measured mode."""
        by_state = []
        pulled = pulls(self, sizes.stiffness)
        for leaf, errors, pull in zip(self.leaves, self.errors, pulled, strict=True):
            by_state.append(np.zeros((len(errors.value), self.n_coordinate)))
            by_state[-1][:, leaf.touched] = errors.beside(*pull)
        return np.vstack(by_state)

    def curvature_of(self, kept: NDArray[np.bool_]) -> Vector:
        """Return the part of the curvature of some measured modes; `kept` is (n,) bool."""
        total, first = np.zeros_like(self.curvature), 0
        for leaf, errors in zip(self.leaves, self.errors, strict=True):
            here = kept[first : first + len(errors.value)]
            total[np.ix_(leaf.touched, leaf.touched)] += errors.curvature[here].sum(axis=0)
            first += len(errors.value)
        return total

    def of_stiffness(self, size: float) -> Weighed:
        """Return the same of equation errors alone."""
        return self.whole(Passing(self, size).root())

    def of_damping(self, size: float, kept: NDArray[np.bool_] | None = None) -> Weighed:
        """Return the same of the damping ratios alone that are kept."""
        some = np.ones(self.damping.size, dtype=bool) if kept is None else kept
        if not some.any():
            return Weighed.nothing(self.n_coordinate)
        at = np.ix_(some, some)
        return Weighed.of(
            self.damping[some],
            self.damping_jacobian[some],
            self.damping_noise[at] + size**2 * self.damping_discrepancy[at],
        )

    def whole(self, message: Message) -> Weighed:
        """Return a message to the root as errors weighed, for all coordinates."""
        hessian, slope = np.zeros((self.n_coordinate,) * 2), np.zeros(self.n_coordinate)
        hessian[np.ix_(message.touched, message.touched)] = message.product[1:, 1:]
        slope[message.touched] = message.product[1:, 0]
        return Weighed(float(message.product[0, 0]), slope, hessian, 0.5 * message.log_determinant)


@dataclass(eq=False)
class Passing:
    """Messages from the leaves of a tree to its root at one size; complete ones are kept.

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
        """Return the message from a node of the tree, and all below it, to the node above."""
        message = self._of(node, {})
        assert message is not None
        return message

    def root(self, without: Mapping[int, NDArray[np.bool_] | None] | None = None) -> Message:
        """Return the message to the root.

        Parameters
        ----------
        without : mapping of int to (n,) bool or None, optional
            States of which not all errors are used: the errors that are, or None for none.
        """
        to_root = self._of((), without or {})
        if to_root is None:
            message = "nothing is left to say anything"
            raise ValueError(message)
        return to_root

    def _of(self, node: Path, without: Mapping[int, NDArray[np.bool_] | None]) -> Message | None:
        tree = self.problem.tree
        below = [c for c, path in enumerate(tree.paths) if path[: len(node)] == node]
        whole = not any(c in without for c in below)
        if whole and node in self._kept:
            return self._kept[node]
        depth = len(node)
        if depth == len(tree.shares):
            message = self._leaf(below[0], without)
        else:
            children = dict.fromkeys(tree.paths[c][: depth + 1] for c in below)
            parts = [part for part in (self._of(child, without) for child in children) if part is not None]
            message = together(parts) if parts else None
            share = tree.shares[depth - 1] if depth else 0.0
            if message is not None and share > 0.0:
                above = any(s > 0.0 for s in tree.shares[: depth - 1])
                message = integrated(message, self.size**2 * share, above=above)
        if whole:
            self._kept[node] = message
        return message

    def _leaf(self, c: int, without: Mapping[int, NDArray[np.bool_] | None]) -> Message | None:
        kept = without.get(c)
        if c in without and (kept is None or not kept.any()):
            return None
        leaf, shares = self.problem.leaves[c], self.problem.tree.shares
        product, log = leaf.information(self.size * float(np.sqrt(shares[-1])), kept)
        if not any(s > 0.0 for s in shares[:-1]):
            product = product[: 1 + leaf.touched.size, : 1 + leaf.touched.size]
        return Message(leaf.touched, product, log)


def pulls(problem: TreeProblem, size: float) -> list[tuple[Vector, Vector]]:
    """Return the errors of each state over their covariance, (n, m), and the inverse's blocks by mode, (n, m, m).

    Messages on each shared discrepancy come down from the root (Rauch, Tung and Striebel 1965).
    """
    tree, depths = problem.tree, range(1, len(problem.tree.shares))
    state_size = size * float(np.sqrt(tree.shares[-1]))
    white, messages = [], dict[Path, tuple[Vector, Vector]]()
    for path, leaf in zip(tree.paths, problem.leaves, strict=True):
        inverse = la.inv(leaf.noise + state_size**2 * leaf.discrepancy, check_finite=False)
        follows = leaf.columns[:, 1 + leaf.touched.size :]
        weighed = inverse @ follows
        white.append((inverse, weighed, inverse @ leaf.columns[:, 0]))
        _add_message(messages, path[:-1], follows.T @ weighed, weighed.T @ leaf.columns[:, 0])
    inner = dict[Path, Vector]()
    for depth in reversed(depths):
        for node in dict.fromkeys(path[:depth] for path in tree.paths):
            precision, pull = messages[node]
            inner[node] = la.inv(np.eye(pull.size) + size**2 * tree.shares[depth - 1] * precision)
            _add_message(messages, node[:-1], precision @ inner[node], inner[node] @ pull)
    p = messages[()][1].size
    known: dict[Path, tuple[Vector, Vector]] = {(): (np.zeros(p), np.zeros((p, p)))}
    for depth in depths:
        variance = size**2 * tree.shares[depth - 1]
        for node in dict.fromkeys(path[:depth] for path in tree.paths):
            mean, covariance = known[node[:-1]]
            known[node] = (
                inner[node] @ (mean + variance * messages[node][1]),
                variance * inner[node] + inner[node] @ covariance @ inner[node],
            )
    by_state = []
    for (inverse, weighed, pull), path, errors in zip(white, tree.paths, problem.errors, strict=True):
        mean, covariance = known[path[:-1]]
        n, m = errors.value.shape
        mode = np.arange(n)
        by_mode = weighed.reshape(n, m, p)
        blocks = inverse.reshape(n, m, n, m)[mode, :, mode] - by_mode @ covariance @ by_mode.transpose(0, 2, 1)
        by_state.append(((pull - weighed @ mean).reshape(n, m), blocks))
    return by_state


def _add_message(messages: dict[Path, tuple[Vector, Vector]], node: Path, precision: Vector, pull: Vector) -> None:
    """Add a message on the discrepancy of a node."""
    known = messages.get(node)
    messages[node] = (precision, pull) if known is None else (known[0] + precision, known[1] + pull)


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
    for of_state in errors:
        touched = everything if of_state.touched is None else of_state.touched
        first = of_state is errors[0]
        turn = np.eye(of_state.value.shape[1]) if first else rotation(errors[0], of_state)
        turned.append(of_state.weight @ turn.T)
        leaves.append(_leaf_of(of_state, turn, turned[-1], touched))
        curvature[np.ix_(touched, touched)] += of_state.curvature.sum(axis=0)
        jacobian = np.zeros((len(of_state.damping), n_coordinate))
        jacobian[:, touched] = of_state.damping_jacobian
        damping_jacobian.append(jacobian)
    ratio = np.concatenate([e.damping for e in errors])
    seen, at = (np.isfinite(ratio), np.concatenate([np.full(len(e.damping), c) for c, e in enumerate(errors)]))
    common = shared_levels(tree.paths, tree.shares)
    all_turned = np.vstack(turned)
    of_damping = common[np.ix_(at, at)] * (all_turned @ all_turned.T) ** 2 + _DAMPING_NUGGET * np.eye(at.size)
    return TreeProblem(
        tree=tree,
        leaves=tuple(leaves),
        n_coordinate=n_coordinate,
        damping=ratio[seen],
        damping_jacobian=np.vstack(damping_jacobian)[seen],
        damping_noise=np.diag(np.concatenate([e.damping_std for e in errors])[seen] ** 2),
        damping_discrepancy=of_damping[np.ix_(seen, seen)],
        damping_at=at[seen].astype(np.intp),
        log_map=sum(e.log_map for e in errors),
        curvature=curvature,
        turned=tuple(turned),
        errors=tuple(errors),
    )


def _leaf_of(errors: Errors, turn: Vector, turned: Vector, touched: NDArray[np.intp]) -> Leaf:
    """Return the errors of a state; `turn` (m, m) leads to the reference, where its modal coordinates are `turned`."""
    n, m = errors.value.shape
    low, high = np.tril_indices(m)
    # e_sr = sum_ij turn_is E_ij turned_rj: of each number of E once, on the diagonal with twice the variance
    follows = turn[low][:, :, None] * turned.T[high][:, None, :]  # (p, m, n)
    follows = follows + turn[high][:, :, None] * turned.T[low][:, None, :]
    follows *= np.where(low == high, np.sqrt(0.5), 1.0)[:, None, None]
    of_stiffness = follows.transpose(2, 1, 0).reshape(n * m, low.size)
    of_mass = errors.inertia.reshape(-1, 1) * of_stiffness
    latent = np.hstack([np.sqrt(1.0 - OF_MASS) * of_stiffness, np.sqrt(OF_MASS) * of_mass])
    return Leaf(
        touched=touched,
        noise=la.block_diag(*errors.noise) + _NUGGET * np.eye(n * m),
        discrepancy=latent @ latent.T,
        columns=np.column_stack([errors.value.ravel(), errors.jacobian.reshape(n * m, -1), latent]),
        mode=np.repeat(np.arange(n), m),
    )
