"""Modal data of a virtual test without FRFs: quick, for studies of many tests."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import model
from ema.types.frf import Dofs, place_in_run
from ema.types.modal_model import ModalModel
from model import Mesh, ReducedSystem
from tests.enrichment import enriched
from updating.virtual.campaign import N_MODE, TrueModes, runs_of, true_modes
from updating.virtual.vibration_test import Specimen, VirtualTest, specimens

QUICK_MESH = Mesh(n_x=30, n_y=6)
"""Still finer than a fit's, under the clamps too."""
_BEYOND = 1.1  # of the shear stiffnesses that specimens have, as a ratio, for which they are reduced
_MODAL_NOISE = 2  # stream of random numbers


@dataclass(frozen=True, kw_only=True)
class ModalNoise:
    """Standard deviations of modal data, all independent of each other.

    Attributes
    ----------
    frequency, damping : float
        Relative to each frequency and each damping ratio.
    shape : float
        Of each component relative to the root mean square of its shape.
    """

    frequency: float = 2e-4
    damping: float = 0.02
    shape: float = 0.01


def simulate_modes(test: VirtualTest, noise: ModalNoise) -> dict[str, tuple[ModalModel, TrueModes]]:
    """Draw modal data of every configuration without FRFs: quick, for many tests.

    The mesh is `QUICK_MESH`. Data are normally distributed about the true modes as tested, with the standard
    deviations of `noise`; shapes have unit largest component, as there is no driving-point response.
    """
    rng = np.random.default_rng([_MODAL_NOISE, test.seed])
    bench = specimens(replace(test, stack=replace(test.stack, mesh=QUICK_MESH)))
    simulated = {}
    for specimen, system in zip(bench, _reduced(bench), strict=True):
        true = true_modes(test, specimen, system)
        simulated[specimen.configuration.name] = (_drawn(test, specimen, true, noise, rng), true)
    return simulated


def _reduced(bench: Sequence[Specimen]) -> Iterator[ReducedSystem]:
    """Yield the reduced equations of specimens that differ in pressure and contact alone, reduced once for all."""
    first, states = bench[0], [s.configuration for s in bench]
    shear = [c.pressure * c.G_f / first.configuration.pressure for c in states]
    G_f_range = (min(shear) / _BEYOND, max(shear) * _BEYOND)
    system = model.reduce(first.stack, G_f_range=G_f_range, n_snapshot=2, n_mode=N_MODE)
    one = [{"pressure": c.pressure, "G_f": c.G_f, "d_f": c.d_f} for c in states]
    system = enriched(system, one, N_MODE)
    for specimen, theta in zip(bench, one, strict=True):
        yield replace(system, stack=specimen.stack, theta={**system.theta, **theta})


def _signed(shape: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return shapes, (n_output, n_mode), of a sign that no rounding decides, so that noise falls alike everywhere."""
    generic = np.cos(np.arange(shape.shape[0]))  # which no symmetric or antisymmetric shape is orthogonal to
    return shape * np.where(generic @ shape < 0.0, -1.0, 1.0)


def _drawn(
    test: VirtualTest, specimen: Specimen, true: TrueModes, noise: ModalNoise, rng: np.random.Generator
) -> ModalModel:
    """Return a modal model as an identification would give it."""
    seen = true.visible(test.band)
    frequency = true.tested_frequency[seen] * (1.0 + noise.frequency * rng.standard_normal(seen.sum()))
    damping = true.tested_damping[seen] * (1.0 + noise.damping * rng.standard_normal(seen.sum()))
    shape = _signed(true.shape[:, seen])
    spread = noise.shape * np.sqrt(np.mean(shape**2, axis=0)) * np.ones_like(shape)
    shape = shape + spread * rng.standard_normal(shape.shape)
    largest = np.abs(shape).max(axis=0)
    frequency_std, damping_std = noise.frequency * frequency, noise.damping * damping
    n_output, n_mode = shape.shape
    zero = np.zeros((n_output, 1))
    omega = 2.0 * np.pi * frequency
    pole = omega * (-damping + 1j * np.sqrt(1.0 - damping**2))
    covariance = np.zeros((2 * n_mode, 2 * n_mode))
    for r in range(n_mode):
        root = np.sqrt(1.0 - damping[r] ** 2)
        by = np.array(  # of Re and Im of the pole by frequency and damping ratio
            [[-2.0 * np.pi * damping[r], -omega[r]], [2.0 * np.pi * root, -omega[r] * damping[r] / root]]
        )
        part = slice(2 * r, 2 * r + 2)
        covariance[part, part] = by @ np.diag([frequency_std[r] ** 2, damping_std[r] ** 2]) @ by.T
    return ModalModel(
        name=specimen.configuration.name,
        frequency=frequency,
        damping=damping,
        frequency_std=frequency_std,
        damping_std=damping_std,
        pole=pole,
        residue=(shape / (2j * pole.imag))[:, None, :],
        outside_pole=np.empty(0, complex),
        outside_residue=np.empty((n_output, 1, 0), complex),
        lower=zero,
        upper=zero,
        shape=shape / largest,
        shape_std=spread / largest,
        scaled=np.zeros(n_mode, dtype=bool),
        node=true.node,
        direction=true.direction,
        sensor=place_in_run(runs_of(specimen)),
        input=Dofs(node=test.shaker.node, direction=test.shaker.direction),
        band=test.band,
        geometry=test.geometry,
        quantity="accelerance",
        covariance=covariance,
        residue_std=(spread / (2.0 * pole.imag))[:, None, :],
        noise=zero,
        correlation=zero + 1.0,
        error=zero,
        run=np.zeros(1, dtype=int),
        run_pole=pole[None],
        run_frequency_std=frequency_std[None],
        run_damping_std=damping_std[None],
        run_probability=np.ones((1, n_mode)),
    )
