"""Plate elements of skfem that evaluate their powers once for all shape functions, not once for each."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray
from skfem.element.discrete_field import DiscreteField
from skfem.element.element_global import ElementGlobal


class PowersOnce(ElementGlobal):  # type: ignore[misc]  # skfem has no types
    """An element whose shape functions are sums of powers of places."""

    _evaluated: tuple[Any, Any, Any] | None = None  # places, cells, and the powers there

    def gbasis(self, mapping: Any, X: Any, i: int, tind: Any = None) -> tuple[Any]:
        """Return the i-th shape function with its derivatives; sums are those of `ElementGlobal`, to the last bit."""
        if self.V is None:  # what it is made of is made there
            super().gbasis(mapping, X[..., :1], i, tind)
        if self._evaluated is None or self._evaluated[0] is not X or self._evaluated[1] is not tind:
            self._evaluated = (X, tind, self._powers(mapping.F(X, tind=tind)))
        powers = self._evaluated[2]
        if i == self.V.shape[-1] - 1:  # the last one: elements are sent to other processes, places are not
            self._evaluated = None
        weight = self.V[:, :, i] if tind is None else self.V[tind][:, :, i]
        shape = next(iter(powers.values()))[0].shape
        found = [np.zeros((self.dim,) * k + shape) for k in range(self.derivatives + 1)]
        for which, values in powers.items():
            for row, value in enumerate(values):
                found[len(which)][which] += weight[:, row][:, None] * value
        return (DiscreteField(value=found[0], grad=found[1], hess=found[2]),)

    def shapes(self, mapping: Any, X: Any, tind: Any, which: tuple[int, ...]) -> NDArray[np.float64]:
        """Return one derivative of all shape functions at places of cells, (n_shape, n_cell, n_place)."""
        if self.V is None:  # what it is made of is made there
            super().gbasis(mapping, X[..., :1], 0, tind)
        x = mapping.F(X, tind=tind)
        powers = np.array([np.broadcast_to(power(*x), x.shape[1:]) for power in self._pbasis[which]])
        return np.asarray(np.einsum("crs,rcp->scp", self.V[tind], powers, optimize=True))

    def _powers(self, x: Any) -> dict[tuple[int, ...], list[Any]]:
        """Return all powers and their derivatives at places of each cell."""
        every = (
            which
            for k in range(self.derivatives + 1)
            for which in itertools.product(range(self.dim), repeat=k)
        )
        size = np.broadcast_shapes(*(part.shape for part in x))
        return {which: [np.broadcast_to(power(*x), size) for power in self._pbasis[which]] for which in every}


class ElementQuadBFS(PowersOnce, skfem.ElementQuadBFS):  # type: ignore[misc]
    """Bogner-Fox-Schmit's rectangle."""


class ElementTriArgyris(PowersOnce, skfem.ElementTriArgyris):  # type: ignore[misc]
    """Argyris's triangle."""
