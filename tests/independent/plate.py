"""A thin plate held along an edge, of quintic triangles (Argyris) in scikit-fem, with something changed at a place."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse.linalg as sla
import skfem
from numpy.typing import NDArray
from skfem.helpers import dd, ddot, dot, eye, grad, trace

Array = NDArray[np.float64]
_STEP = 2e-3
"""Step, m, of differences along a stiffener."""


@dataclass(frozen=True, kw_only=True)
class Plate:
    """A plate in SI units, origin in its middle, and how the edge at the lowest x is held.

    Attributes
    ----------
    length, width, thickness, young, poisson, density : float
        Of the plate.
    translation, rotation : float
        N/m per m against moving, N m/rad per m against turning.
    mesh : (int, int)
        Cells along x and y, two triangles each.
    cut : tuple of float
        Of a through crack x and y of its middle, its length, m, and 0 where it is along x, 1 along y; else empty.
    """

    length: float = 0.42
    width: float = 0.26
    thickness: float = 3e-3
    young: float = 2e11
    poisson: float = 0.3
    density: float = 7850.0
    translation: float = 2e9
    rotation: float = 2e4
    mesh: tuple[int, int] = (14, 9)
    cut: tuple[float, ...] = ()

    @property
    def rigidity(self) -> float:
        """Bending stiffness, N m."""
        return self.young * self.thickness**3 / (12.0 * (1.0 - self.poisson**2))

    @cached_property
    def basis(self) -> Any:
        """Its finite elements."""
        sides = ((self.length, self.mesh[0]), (self.width, self.mesh[1]))
        lines = [np.linspace(-side / 2.0, side / 2.0, n + 1) for side, n in sides]
        if not self.cut:
            return skfem.Basis(skfem.MeshTri.init_tensor(*lines), skfem.ElementTriArgyris(), intorder=10)
        x, y, length, along = self.cut
        (middle, across), axis = ((x, y), (y, x))[int(along)], int(along)
        tips = middle - length / 2.0, middle + length / 2.0
        # finer towards the tips, where curvatures grow as the root of the distance falls
        part = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, 9))
        within = tips[0] + length * np.concatenate([-part[1:3][::-1], part, 1.0 + part[1:3]])
        within = within[np.abs(within) < sides[axis][0] / 2.0]
        beside = across + length * np.array([-0.4, -0.15, 0.0, 0.15, 0.4])
        beside = beside[np.abs(beside) < sides[1 - axis][0] / 2.0]
        lines[axis], lines[1 - axis] = _with_lines(lines[axis], within), _with_lines(lines[1 - axis], beside)
        whole = skfem.MeshTri.init_tensor(*lines)
        return skfem.Basis(_slit(whole, axis, across, tips), skfem.ElementTriArgyris(), intorder=10)

    def rows(self, place: Array) -> Any:
        """Return deflections at places (n, 2) as rows over all freedoms, sparse."""
        half = np.array([self.length, self.width]) / 2.0 - 1e-9
        return self.basis.probes(np.clip(place, -half, half).T)

    def modes(
        self, n_mode: int, place: Array, planted: Mapping[str, Mapping[str, float]], *, damping: float = 4e-3
    ) -> tuple[Array, Array, Array]:
        """Return frequencies, Hz, and damping ratios (n_mode,), and deflections (n_place, n_mode), unit modal mass.

        `planted` may hold "mass", "absorber", "spring", "patch", "hole", "crack", "stiffener", "edge" and "mounting".
        """
        if "crack" in planted:
            one = planted["crack"]
            broken = dataclasses.replace(self, cut=(one["x"], one["y"], one["length"], one["along"]))
            return broken.modes(
                n_mode, place, {key: v for key, v in planted.items() if key != "crack"}, damping=damping
            )
        stiffness, mass = self._matrices(planted)
        at = self.rows(place)
        if "absorber" in planted:
            stiffness, mass, at = _with_absorber(self, planted["absorber"], stiffness, mass, at)
        value, vector = sla.eigsh(stiffness, k=n_mode, M=mass, sigma=-1.0)
        ratio = np.full(n_mode, damping)
        omega = np.sqrt(value)
        if "absorber" in planted:
            one = planted["absorber"]
            jump = self.rows(np.array([[one["x"], one["y"]]])) @ vector[:-1] - vector[-1]
            dashpot = 2.0 * one["damping"] * one["mass"] * 2.0 * np.pi * one["frequency"]
            ratio = ratio + dashpot * np.ravel(jump) ** 2 / (2.0 * omega)
        if "spring" in planted:
            one = planted["spring"]
            seen = self.rows(np.array([[one["x"], one["y"]]])) @ vector[: self.basis.N]
            ratio = ratio + one["damping"] * np.ravel(seen) ** 2 / (2.0 * omega)
        return omega / (2.0 * np.pi), ratio, np.asarray(at @ vector)

    def _matrices(self, planted: Mapping[str, Mapping[str, float]]) -> tuple[Any, Any]:
        stiff, heavy = self._factors(planted)
        poisson, rigidity, area = self.poisson, self.rigidity, self.density * self.thickness

        @skfem.BilinearForm
        def bending(u: Any, v: Any, w: Any) -> Any:
            moment = (1.0 - poisson) * dd(u) + poisson * eye(trace(dd(u)), 2)
            return rigidity * stiff(*w.x) * ddot(moment, dd(v))

        @skfem.BilinearForm
        def inertia(u: Any, v: Any, w: Any) -> Any:
            return area * heavy(*w.x) * u * v

        stiffness = skfem.asm(bending, self.basis) + self._edge(planted)
        mass = skfem.asm(inertia, self.basis)
        for key, scale in (("mass", "mass"), ("spring", "stiffness")):
            if key in planted:
                row = self.rows(np.array([[planted[key]["x"], planted[key]["y"]]]))
                added = planted[key][scale] * (row.T @ row)
                stiffness, mass = (stiffness, mass + added) if key == "mass" else (stiffness + added, mass)
        if "stiffener" in planted:
            bent, moved = self._stiffener(planted["stiffener"])
            stiffness, mass = stiffness + bent, mass + moved
        return stiffness.tocsc(), mass.tocsc()

    def _factors(
        self, planted: Mapping[str, Mapping[str, float]]
    ) -> tuple[Callable[[Array, Array], Array], Callable[[Array, Array], Array]]:
        """Return by which factors stiffness and mass per area differ over the plan."""

        def stiff(x: Array, y: Array) -> Array:
            found = np.ones_like(x)
            if "patch" in planted:
                one = planted["patch"]
                inside = np.hypot(x - one["x"], y - one["y"]) < one["radius"]
                found = np.where(inside, one["ratio"], found)
            if "hole" in planted:
                found = found * hole(x, y)
            return found

        def hole(x: Array, y: Array) -> Array:
            if "hole" not in planted:
                return np.ones_like(x)
            one = planted["hole"]
            inside = np.hypot(x - one["x"], y - one["y"]) < one["diameter"] / 2.0
            return np.where(inside, 1e-3, 1.0)

        return stiff, hole

    def _edge(self, planted: Mapping[str, Mapping[str, float]]) -> Any:
        """Return the springs of the held edge: "edge" changes a part of them, "mounting" all."""
        left = self.basis.mesh.facets_satisfying(lambda x: np.isclose(x[0], -self.length / 2.0))
        held = skfem.FacetBasis(self.basis.mesh, self.basis.elem, facets=left, intorder=16)
        whole = planted.get("mounting", {}).get("ratio", 1.0)
        part = planted.get("edge", {"y": 0.0, "length": 0.0, "ratio": 1.0})

        @skfem.BilinearForm
        def springs(u: Any, v: Any, w: Any) -> Any:
            inside = np.abs(w.x[1] - part["y"]) < part["length"] / 2.0
            factor = whole * np.where(inside, part["ratio"], 1.0)
            turn = dot(grad(u), w.n) * dot(grad(v), w.n)
            return factor * (self.translation * u * v + self.rotation * turn)

        return skfem.asm(springs, held)

    def _stiffener(self, one: Mapping[str, float]) -> tuple[Any, Any]:
        """Return what a strip of the plate's material adds to stiffness and mass."""
        node, weight = np.polynomial.legendre.leggauss(40)
        along = np.array([np.cos(one["angle"]), np.sin(one["angle"])])
        middle = np.array([one["x"], one["y"]]) + one["length"] / 2.0 * node[:, None] * along
        before, at, after = (self.rows(middle + d * along) for d in (-_STEP, 0.0, _STEP))
        curvature = (before - 2.0 * at + after) / _STEP**2
        share = one["length"] / 2.0 * weight
        height, width = one["height"], one["width"]
        inertia = width * (height**3 / 12.0 + height * ((height + self.thickness) / 2.0) ** 2)
        bent = self.young * inertia * (curvature.T.multiply(share)) @ curvature
        return bent, self.density * width * height * (at.T.multiply(share)) @ at


def _with_absorber(plate: Plate, one: Mapping[str, float], stiffness: Any, mass: Any, at: Any) -> tuple[Any, Any, Any]:
    """Return the matrices and rows with the freedom of a mass on a spring, last of all."""
    import scipy.sparse as sp

    n = stiffness.shape[0]
    row = plate.rows(np.array([[one["x"], one["y"]]]))
    jump = sp.hstack([sp.csr_array(row), sp.csr_array([[-1.0]])]).tocsr()
    spring = one["mass"] * (2.0 * np.pi * one["frequency"]) ** 2
    nothing = sp.csr_array((1, 1))
    stiffness = sp.block_diag([stiffness, nothing]) + spring * (jump.T @ jump)
    mass = sp.block_diag([mass, sp.csr_array([[one["mass"]]])])
    return (stiffness.tocsc(), mass.tocsc(), sp.hstack([at, sp.csr_array((at.shape[0], 1))]).tocsr() if n else at)


def _with_lines(line: Array, at: Sequence[float] | Array) -> Array:
    """Return lines of a mesh with some through given places; inner ones that are closer to these than a fifth go."""
    near = (line[1] - line[0]) / 5.0
    keep = np.all(np.abs(line[:, None] - np.array(at)) > near, axis=1)
    keep[[0, -1]] = True
    return np.unique(np.concatenate([line[keep], at]))


def _slit(mesh: Any, axis: int, across: float, tips: tuple[float, float]) -> Any:
    """Return a mesh whose triangles on both sides of a line between two tips share no corner on it."""
    p, t = mesh.p, mesh.t.copy()
    on = np.abs(p[1 - axis] - across) < 1e-9
    on &= (p[axis] > tips[0] + 1e-9) & (p[axis] < tips[1] - 1e-9)
    split = np.flatnonzero(on)
    above = p[1 - axis][t].mean(axis=0) > across
    for k, vertex in enumerate(split):
        t[(t == vertex) & above] = p.shape[1] + k
    return skfem.MeshTri(np.hstack([p, p[:, split]]), t)
