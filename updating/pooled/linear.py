"""Specimens about a fit, to first order: what the algebra of `updating.pooled.algebra` is done with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from model import Parameter, ReducedEquations
from updating.diagnosis import discrepancy
from updating.diagnosis.calibration import P_ADEQUATE
from updating.diagnosis.coordinates import bounds_of
from updating.diagnosis.discrepancy import CORRELATION, KINDS, MEDIAN, Kind, Sizes, log_density, log_together
from updating.diagnosis.explanation import weights
from updating.diagnosis.residual import Residual, Spread, residual, rough_about, spread_of
from updating.pooled.algebra import Block, Strengths
from updating.pooled.beside import Bench, with_spreads
from updating.pooled.term import Coordinate

Vector = NDArray[np.float64]

SHARED_PART = 0.5
"""Share of the variance of a nuisance, such as Young's modulus, that all specimens have in common."""
SPREAD = {"stiffness": (0.15, 0.6), "loss": (0.3, 0.6)}
"""Medians, and standard deviations of the logarithms, of the scatter of ln G_f and ln d_f from specimen to specimen.
Table 6 of Pirnat, Cepon and Boltezar (2013) has 0.2 and 0.5 over six stacks, most of them treated."""


OWN = float(np.sqrt(1.0 - CORRELATION))
"""Part of a discrepancy that a configuration has of its own, over its size, beforehand."""


@dataclass(frozen=True, kw_only=True)
class Scales:
    """What is estimated of how much scatters.

    Attributes
    ----------
    frequency, damping, shape : float
        Sizes of the discrepancy, see `updating.diagnosis.discrepancy.Sizes`, by what all configurations have in common.
    own_frequency, own_damping, own_shape : float
        Sizes of it, by what each configuration has of its own: no two stacks are built alike, and by how much is no
        matter of the model.
    stiffness, loss : float
        Standard deviations of ln G_f and ln d_f from specimen to specimen.
    """

    frequency: float = MEDIAN["frequency"]
    damping: float = MEDIAN["damping"]
    shape: float = MEDIAN["shape"]
    own_frequency: float = MEDIAN["frequency"]
    own_damping: float = MEDIAN["damping"]
    own_shape: float = MEDIAN["shape"]
    stiffness: float = SPREAD["stiffness"][0]
    loss: float = SPREAD["loss"][0]

    def log_prior(self, stated: Sequence[str] = ()) -> float:
        """Return the logarithm of the prior density of their logarithms, up to a constant.

        What is said of sizes together is said where the laboratory has stated none of them.
        """
        sizes = sum(
            float(log_density(kind, np.asarray(size)))
            for kind in KINDS
            for size in (getattr(self, kind), self.own(kind))
        )
        if not stated:
            sizes += float(log_together(np.array([self.whole(kind) for kind in KINDS])))
        away = [np.log(getattr(self, name) / median) / std for name, (median, std) in SPREAD.items()]
        return sizes - 0.5 * float(np.sum(np.square(away)))

    def weights(self, stated: Sequence[Kind]) -> Scales:
        """Return scales by which a fit is weighed, see `updating.diagnosis.explanation.weights`."""
        whole = Sizes(frequency=self.whole("frequency"), shape=self.whole("shape"))
        share = weights(whole, stated).frequency / whole.frequency
        return replace(self, frequency=share * self.frequency, own_frequency=share * self.own_frequency)

    @property
    def adequate(self) -> bool:
        """Whether models that are nearly right leave as much: more is left by one that lacks something."""
        away = [np.log(self.whole(kind) / MEDIAN[kind]) / discrepancy.SPREAD for kind in KINDS]
        return bool(ndtr(-max(away)) >= P_ADEQUATE)

    def own(self, kind: Kind) -> float:
        """Return the size of a discrepancy by what each configuration has of its own."""
        return float(getattr(self, f"own_{kind}"))

    def whole(self, kind: Kind) -> float:
        """Return the size of a discrepancy, what is common and what is own together."""
        return float(np.hypot(np.sqrt(CORRELATION) * getattr(self, kind), OWN * self.own(kind)))


@dataclass(frozen=True, eq=False, kw_only=True)
class Place:
    """Where an explanation stands.

    Attributes
    ----------
    nuisance : tuple of (n_nuisance,) float
        Own coordinates of each specimen.
    coordinate : (n_coordinate,) float
        Of the terms.
    """

    nuisance: tuple[Vector, ...]
    coordinate: Vector


def means(bench: Bench) -> tuple[str, ...]:
    """Return the names of all nuisances, of each of which specimens have a common mean."""
    return tuple(bench.nuisance_std)


def strengths(bench: Bench, s: int, scales: Scales) -> Strengths:
    """Return what a specimen is weighed with."""
    known, scattered = bench.nuisance_std, {"G_f": scales.stiffness, "d_f": scales.loss}
    loose = {name for name in scattered if not np.isfinite(known[name])}
    own_std = {
        name: scattered[name] if name in loose else np.sqrt(1.0 - SHARED_PART) * std
        for name, std in known.items()
    }
    common = {name: np.inf if name in loose else np.sqrt(SHARED_PART) * std for name, std in known.items()}
    size = {"frequency": scales.frequency, "damping": scales.damping, "shape": scales.shape}
    latent = [
        1.0 if own.kind == "mesh" else np.sqrt(CORRELATION) * size[own.kind]
        for own in bench.latents
        for _ in range(own.direction.shape[1])
    ]
    return Strengths(
        size=tuple(scales.own(kind) for kind in KINDS),
        own=tuple(float(own_std[name]) for name in bench.own[s].evidence.nuisances),
        mean=tuple(float(std) for std in common.values()),
        latent=tuple(float(std) for std in latent),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Linear:
    """All specimens about a place.

    Attributes
    ----------
    block : tuple of Block
        Of each specimen; their effect columns are by `column`.
    column : tuple of str
        Effect parameters and nuisances that something is tried with.
    found : tuple of Residual
        Of each specimen.
    """

    block: tuple[Block, ...]
    column: tuple[str, ...]
    found: tuple[Residual, ...]

    def placed(self, s: int, coordinates: Sequence[Coordinate]) -> Vector:
        """Return how a specimen's effect columns follow coordinates, (n_column, n_coordinate)."""
        where = np.zeros((len(self.column), len(coordinates)))
        for k, own in enumerate(coordinates):
            if s in own.members:
                where[self.column.index(own.name), k] = 1.0
        return where


def linearized(
    bench: Bench,
    at: Place,
    coordinates: Sequence[Coordinate],
    tried: Sequence[Parameter] = (),
    where: Vector | None = None,
) -> Linear:
    """Return all specimens to first order.

    Parameters
    ----------
    bench : Bench
        The specimens.
    at : Place
        About which; coordinates of the terms first.
    coordinates : sequence of Coordinate
        Of the terms.
    tried : sequence of Parameter
        Further effect parameters that get columns.
    where : (n_tried,) float, optional
        Their coordinates, neutral by default.
    """
    fitted = {own.parameter.name: own.parameter for own in coordinates if own.parameter is not None}
    further = [p for p in tried if p.name not in fitted]
    start = dict(zip((p.name for p in tried), np.zeros(len(tried)) if where is None else where, strict=True))
    parameters = [*fitted.values(), *further]
    shifts = means(bench)
    column = (*(p.name for p in parameters), *shifts)
    blocks, results = [], []
    mean = {name: i for i, name in enumerate(shifts)}
    for s, own in enumerate(bench.own):
        names = own.evidence.nuisances
        nuisance, values = state(bench, s, at, coordinates)
        values |= {p.name: float(start[p.name]) for p in further}
        found = residual(own.evidence, nuisance, parameters, _within(parameters, values))
        n = len(names)
        jacobian = found.rotated_jacobian
        shifting = np.zeros((len(jacobian), len(shifts)))
        shifting[:, [mean[name] for name in names]] = jacobian[:, :n]
        blocks.append(
            Block(
                value=found.rotated,
                own=jacobian[:, :n],
                shared=own.shared,
                effect=np.hstack([jacobian[:, n:], shifting]),
                kind=own.evidence.rows.kind,
                growth=own.evidence.covariance.growth,
                away=at.nuisance[s] - own.known,
                mean=np.array([mean[name] for name in names]),
            )
        )
        results.append(found)
    return Linear(block=tuple(blocks), column=column, found=tuple(results))


def state(
    bench: Bench, s: int, at: Place, coordinates: Sequence[Coordinate]
) -> tuple[Vector, dict[str, float]]:
    """Return a specimen's nuisances, shifts included, and the coordinates of effect parameters by name.

    Of an effect that it does not have they are neutral, 0.
    """
    names, nuisance = bench.own[s].evidence.nuisances, at.nuisance[s].copy()
    values = {c.name: 0.0 for c in coordinates if c.parameter is not None}
    for c, z in zip(coordinates, at.coordinate, strict=True):
        if s in c.members and c.parameter is not None:
            values[c.name] += float(z)
        elif s in c.members and c.name in names:
            nuisance[names.index(c.name)] += z
    return nuisance, values


def weighed_at(bench: Bench, at: Place, coordinates: Sequence[Coordinate]) -> Bench:
    """Return the specimens weighed with what separates model and measurement by the modes at a place."""
    return with_spreads(bench, _spreads(bench, at, coordinates))


def shapes_that_meet(
    bench: Bench, at: Place, coordinates: Sequence[Coordinate]
) -> tuple[frozenset[int], ...]:
    """Return which shapes of each specimen are those of modes that are close to others of the model at a place."""
    return tuple(
        frozenset(i for i, shape in enumerate(own.shape) if shape.mixing.meets)
        for own in _spreads(bench, at, coordinates)
    )


def _spreads(bench: Bench, at: Place, coordinates: Sequence[Coordinate]) -> list[Spread]:
    parameters = list({c.name: c.parameter for c in coordinates if c.parameter is not None}.values())
    spreads = []
    for s, own in enumerate(bench.own):
        nuisance, values = state(bench, s, at, coordinates)
        spreads.append(spread_of(own.evidence, nuisance, parameters, _within(parameters, values)))
    return spreads


def roughly(bench: Bench, at: Place | None = None, coordinates: Sequence[Coordinate] = ()) -> Bench:
    """Return the specimens beside rough models for a quick look, which agree with the full ones at a place, if any.

    Parameters
    ----------
    bench : Bench
        The specimens.
    at : Place, optional
        Where what a rough model is off by is taken off; see `updating.diagnosis.residual.rough_about`.
    coordinates : sequence of Coordinate
        Of the terms there.
    """
    parameters = list({c.name: c.parameter for c in coordinates if c.parameter is not None}.values())
    shared: dict[int, ReducedEquations] = {}
    found = []
    for s, own in enumerate(bench.own):
        if at is None:
            rough = own.evidence.rough
        else:
            nuisance, values = state(bench, s, at, coordinates)
            rough = rough_about(own.evidence, nuisance, parameters, _within(parameters, values))
        equations = shared.setdefault(id(own.evidence.equations), rough.equations)
        found.append(replace(own, evidence=replace(rough, equations=equations)))
    return replace(bench, own=tuple(found))


def _within(parameters: Sequence[Parameter], values: dict[str, float]) -> Vector:
    """Return the coordinates of parameters, none beyond an end of its range."""
    low, high = bounds_of(parameters)
    return np.clip([values[p.name] for p in parameters], low, high) if parameters else np.zeros(0)


def only(linear: Linear, coordinates: Sequence[Coordinate]) -> Linear:
    """Return the same with the columns alone that some coordinates need, which is what a fit takes."""
    needed = tuple(name for name in linear.column if any(name == own.name for own in coordinates))
    at = [linear.column.index(name) for name in needed]
    return replace(
        linear,
        column=needed,
        block=tuple(replace(own, effect=own.effect[:, at]) for own in linear.block),
    )
