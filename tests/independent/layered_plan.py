"""Cubic splines over a rectangle: values, means over rectangles, and integrals of fields times pairs of derivatives."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline

from tests.independent.bench import Array

DEGREE = 3
"""Of the splines; their slopes are continuous, so thin sheets that follow them bend without kinks."""
GAUSS = 4
"""Points a panel; products of two cubic splines are integrated exactly."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """Cubic splines on equal elements from -length / 2 to length / 2.

    Attributes
    ----------
    length : float
        m.
    n_element : int
        Elements.
    """

    length: float
    n_element: int

    @property
    def n(self) -> int:
        """Number of splines."""
        return self.n_element + DEGREE

    @cached_property
    def edges(self) -> Array:
        """Ends of the elements, m."""
        return np.linspace(-0.5, 0.5, self.n_element + 1) * self.length

    @cached_property
    def _spline(self) -> BSpline:
        knots = np.r_[[self.edges[0]] * DEGREE, self.edges, [self.edges[-1]] * DEGREE]
        return BSpline(knots, np.eye(self.n), DEGREE)

    def at(self, place: Array, derivative: int = 0) -> Array:
        """Return the splines or their derivative at places (k,), m, as (k, n)."""
        inside = np.clip(place, self.edges[0], self.edges[-1])
        return self._spline(inside, nu=derivative)

    def rule(self, low: float, high: float, breaks: Iterable[float] = ()) -> tuple[Array, Array]:
        """Return Gauss points and weights between two places, panels ending at elements' edges and breaks."""
        all_ends = np.unique(np.round([low, high, *self.edges, *breaks], 12))
        ends = all_ends[(all_ends >= low - 1e-9) & (all_ends <= high + 1e-9)]
        point, weight = np.polynomial.legendre.leggauss(GAUSS)
        half = 0.5 * np.diff(ends)[:, None]
        return (0.5 * (ends[1:] + ends[:-1])[:, None] + half * point).ravel(), (half * weight).ravel()

    def mean(self, low: float, high: float, derivative: int = 0) -> Array:
        """Return the mean of each spline (n,), or of its derivative, between two places on the line."""
        low, high = np.clip([low, high], self.edges[0], self.edges[-1])
        place, weight = self.rule(float(low), float(high))
        return weight @ self.at(place, derivative) / weight.sum()


class Plan:
    """Products of splines along x and y, with a grid of points over which fields are integrated.

    Attributes
    ----------
    x, y : (n_point_x, 1), (1, n_point_y) float
        Places of the grid, m.
    """

    def __init__(self, along: Line, across: Line, breaks: tuple[Iterable[float], Iterable[float]] = ((), ())):
        self.lines = (along, across)
        rules = [line.rule(line.edges[0], line.edges[-1], at) for line, at in zip(self.lines, breaks, strict=True)]
        self.x: Array = rules[0][0][:, None]
        self.y: Array = rules[1][0][None, :]
        self.weight: Array = np.multiply.outer(rules[0][1], rules[1][1])
        self._tables = [[line.at(rule[0], d) for d in range(3)] for line, rule in zip(self.lines, rules, strict=True)]
        self._pairs: dict[tuple[int, int, int], Array] = {}

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of splines along x and y."""
        return self.lines[0].n, self.lines[1].n

    def mean(self, field: Array) -> float:
        """Return the mean of a field over the plan."""
        return float(np.sum(self.weight * field) / np.sum(self.weight))

    def form(self, field: Array | float, left: tuple[int, int], right: tuple[int, int]) -> Array:
        """Return the integral (n_x, n_x, n_y, n_y) of a field times a derivative of each of two functions."""
        weighted = self.weight * field
        along, across = (self._pair(axis, left[axis], right[axis]) for axis in (0, 1))
        found = along.T @ (weighted @ across)
        n_x, n_y = self.shape
        return found.reshape(n_x, n_x, n_y, n_y)

    def _pair(self, axis: int, left: int, right: int) -> Array:
        """Return products (n_point, n * n) of derivatives of two splines of a line."""
        key = (axis, left, right)
        if key not in self._pairs:
            one, other = self._tables[axis][left], self._tables[axis][right]
            self._pairs[key] = (one[:, :, None] * other[:, None, :]).reshape(len(one), -1)
        return self._pairs[key]
