"""Figures of a fit: its objectives, mode shapes measured and modelled, and the functions of the fitted model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from ema.plot import palette
from ema.types.frf import Dofs, Geometry, Quantity
from ema.types.modal_model import ModalModel
from lamella_shared import Complexes, Integers, Reals, arrays
from model import frf, solve_modes
from updating.correlation.registration import register
from updating.fitting.fit import Fit, ModelFit, reduced_about

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def fitted_frf(
    fit: Fit,
    geometry: Geometry,
    *,
    output: Dofs,
    input: Dofs,  # noqa: A002  # the field's word for where the force acts
    frequency: Reals,
    quantity: Quantity,
) -> Complexes:
    """Synthesise the functions of a fitted model from its modes, with the static residual of those left out.

    Where the modes are those of an ever finer mesh, lines are taken where this mesh has them, so that resonances lie at
    the frequencies of the modes.

    Parameters
    ----------
    fit : Fit
        The fitted model.
    geometry : Geometry
        Measured points, those of the forces among them.
    output, input : Dofs
        Measured DOFs of the responses and the forces.
    frequency : (n_frequency,) float
        Lines, Hz.
    quantity : {"receptance", "mobility", "accelerance"}
        What the response is.

    Returns
    -------
    (n_output, n_input, n_frequency) complex

    Raises
    ------
    PairingError
        A point has no coordinates, or lies too far from the stack.
    """
    responses, forces = (
        register(fit.stack, geometry, dofs.node, dofs.direction).observation for dofs in (output, input)
    )
    n_mode = 6 + fit.modes.frequency.size
    system = reduced_about(fit.stack, n_mode)
    G_f, d_f = fit.G_f.value, fit.d_f.value
    plain = solve_modes(system, G_f=G_f, d_f=d_f, n_mode=n_mode, observation=responses, by=()).elastic()
    n = min(plain.frequency.size, fit.modes.frequency.size)
    natural = np.sort(fit.modes.frequency[:n])
    ratio = np.interp(frequency, natural, np.sort(plain.frequency[:n]) / natural)
    return frf(system, G_f=G_f, d_f=d_f, frequency=ratio * frequency, output=responses, input=forces, quantity=quantity)


SWELL = 0.1
"""Largest drawn displacement, as a share of the structure's size."""

AZIMUTH, ELEVATION = -0.5, 0.42
"""Where figures look from, rad; the page's shapes start from there too."""


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"n 3": "coordinate measured model", "n": "node", "any 2": "line"})
class ShapePair:
    """A measured mode and its partner of the model as displacements of the measured points.

    Attributes
    ----------
    measured_frequency, model_frequency : float
        Natural frequencies, Hz; NaN for a model that there is not.
    mac : float
        Their MAC; NaN likewise.
    node : (n_point,) int
        Numbers of the points that were measured.
    coordinate : (n_point, 3) float
        Where they are, m.
    line : (n_line, 2) int
        Rows of points that trace lines join.
    measured : (n_point, 3) complex
        Displacements over the largest one, turned so that the real part is largest.
    model : (n_point, 3) float
        Those of the model, scaled to fit the measured ones; 0 for a model that there is not.
    """

    measured_frequency: float
    model_frequency: float
    mac: float
    node: Integers
    coordinate: Reals
    line: Integers
    measured: Complexes
    model: Reals

    @property
    def has_model(self) -> bool:
        """Whether there is a modelled shape."""
        return bool(np.isfinite(self.model_frequency))


def shape_pairs(measured: ModalModel, fit: ModelFit | None) -> tuple[ShapePair, ...]:
    """Return the measured shapes, each with its partner where the fit paired it.

    A point measured in skew directions moves so as to meet them in the least-squares sense. Modes that are paired as
    a subspace are compared after turning the model's shapes within it.
    """
    partner = _partners(measured, fit)
    pairs = []
    for r in range(measured.frequency.size):
        if fit is None or r not in partner:
            pairs.append(_shape_pair(measured, r))
            continue
        s, shape = partner[r]
        likeness = float(fit.pairing.mac[r, s])
        pairs.append(_shape_pair(measured, r, float(fit.modes.frequency[s]), likeness, shape))
    return tuple(pairs)


def any_pair(measured: ModalModel, fit: ModelFit, r: int, s: int) -> ShapePair:
    """Return the measured shape `r` beside the model's shape `s`, whether or not they were paired."""
    return _shape_pair(measured, r, float(fit.modes.frequency[s]), float(fit.pairing.mac[r, s]), fit.modes.shape[:, s])


def beside_shape(measured: ModalModel, r: int, partner: tuple[float, float, Reals]) -> ShapePair:
    """Return the measured shape `r` beside a partner (n_dof,), given with its frequency (Hz) and its MAC with it."""
    return _shape_pair(measured, r, *partner)


def _shape_pair(
    measured: ModalModel, r: int, frequency: float = np.nan, likeness: float = np.nan, partner: Reals | None = None
) -> ShapePair:
    """Return a measured shape beside a partner (n_dof,) of a frequency and a MAC with it, or alone."""
    dofs = Dofs(node=measured.node, direction=measured.direction)
    pair = lone_shape(measured.geometry, dofs, measured.shape[:, r], float(measured.frequency[r]))
    if partner is None:
        return pair
    shape = _most_real(measured.shape[:, r])
    scaled = partner * float(partner @ shape.real) / float(partner @ partner)
    seen = np.isin(measured.geometry.node, measured.node)
    moved = [measured.geometry.displacement(measured, value)[seen].real for value in (shape, scaled)]
    model = moved[1] / _largest(moved[0])
    return replace(pair, model_frequency=frequency, mac=likeness, model=model)


def lone_shape(geometry: Geometry, dofs: Dofs, shape: Complexes, frequency: float) -> ShapePair:
    """Return a measured shape (n_dof,) of a frequency (Hz) as displacements, without a model."""
    seen = np.isin(geometry.node, dofs.node)
    moved = geometry.displacement(dofs, _most_real(shape))[seen]
    return ShapePair(
        measured_frequency=frequency,
        model_frequency=np.nan,
        mac=np.nan,
        node=geometry.node[seen],
        coordinate=geometry.coordinate[seen],
        line=geometry.line_rows(geometry.node[seen]),
        measured=moved / _largest(moved.real),
        model=np.zeros(moved.shape),
    )


def _most_real(shape: Complexes) -> Complexes:
    """Turn a shape so that its real part is largest."""
    return shape * np.exp(-0.5j * np.angle(np.sum(shape**2)))


def _largest(moved: Reals) -> float:
    """Return the largest displacement of a point; 1 where none moves."""
    return float(np.max(np.linalg.norm(moved, axis=1), initial=0.0)) or 1.0


def shape_pair_figure(pair: ShapePair, names: tuple[str, str] = ("measured", "model")) -> Figure:
    """Draw a measured shape, the modelled one, and both over each other; the measured alone without a model.

    `names` are written above the two.
    """
    from matplotlib.figure import Figure

    titles = {"measured": f"{names[0]} {pair.measured_frequency:.1f} Hz"}
    if pair.has_model:
        titles |= {"model": f"{names[1]} {pair.model_frequency:.1f} Hz", "both": f"both, MAC {pair.mac:.4f}"}
    figure = Figure(figsize=(2.4 * len(titles), 1.65))
    figure.subplots_adjust(0.005, 0.01, 0.995, 0.88, 0.02)
    for axes, (what, title) in zip(np.atleast_1d(figure.subplots(1, len(titles))), titles.items(), strict=True):
        _draw(axes, pair, what)
        axes.set_title(title, fontsize=8)
    return figure


def _partners(measured: ModalModel, fit: ModelFit | None) -> dict[int, tuple[int, Reals]]:
    """Return for each paired measured mode the model's mode and its shape, turned within its subspace."""
    if fit is None:
        return {}
    pairing, shape = fit.pairing, fit.pairing.partners(measured, fit.modes)
    return {
        int(r): (int(s), shape[:, k].real) for k, (r, s) in enumerate(zip(pairing.measured, pairing.model, strict=True))
    }


def _draw(axes: Axes, pair: ShapePair, what: str) -> None:
    """Draw the points at rest and one or both shapes, seen as the page starts."""
    size = SWELL * float(np.max(np.ptp(pair.coordinate, axis=0)))
    layers = [(pair.coordinate, palette.PALE, 0.8)]
    for name, color, width in (("measured", palette.MEASURED, 2.2), ("model", palette.ACCENT, 1.0)):
        if what in (name, "both"):
            layers.append((pair.coordinate + size * getattr(pair, name).real, color, width))
    for points, color, width in layers:
        seen = project(points)
        ends = np.insert(seen[pair.line].astype(float), 2, np.nan, axis=1)  # one path with gaps
        axes.plot(*ends.reshape(-1, 2).T, color=color, linewidth=width)
        axes.plot(*seen.T, ".", color=color, markersize=2.5 * width)
    axes.set_aspect("equal")
    axes.margins(0.03)
    axes.axis("off")


def project(points: Reals) -> Reals:
    """Project points (n, 3) without perspective, to the right and upwards."""
    x, y, z = points.T
    depth = y * np.cos(AZIMUTH) - x * np.sin(AZIMUTH)
    right = x * np.cos(AZIMUTH) + y * np.sin(AZIMUTH)
    return np.column_stack([right, z * np.cos(ELEVATION) + depth * np.sin(ELEVATION)])


def faces(line: Integers) -> Integers:
    """Return triangles (n, 3) that fill what three or four trace lines enclose, in rows of points.

    A ring of four with a line across is filled as the two rings of three that it consists of.

    Parameters
    ----------
    line : (n_line, 2) int
        Rows of points that trace lines join.
    """
    beside: dict[int, set[int]] = {}
    for a, b in line:
        if a != b:
            beside.setdefault(int(a), set()).add(int(b))
            beside.setdefault(int(b), set()).add(int(a))
    triangles: list[tuple[int, int, int]] = []
    for a, around in sorted(beside.items()):
        for b, d in combinations(sorted(p for p in around if p > a), 2):
            if d in beside[b]:
                triangles.append((a, b, d))
                continue
            opposite = (c for c in beside[b] & beside[d] if c > a and c not in around)
            triangles += [triangle for c in sorted(opposite) for triangle in ((a, b, c), (a, c, d))]
    return np.array(triangles, dtype=np.int64).reshape(-1, 3)
