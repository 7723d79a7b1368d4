"""Tests that a second model simulates, as the modal models that a diagnosis reads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import ema
from ema.types.frf import Dofs, Geometry
from tests.independent.campaign import SHAKER, Plan, TableNoise, modal_tables, simulate


def simulated(test: Plan, second_model, noise: TableNoise | None = None):
    """Return what is simulated, and of each configuration name, stated pressure and identified modes."""
    made = simulate(replace(test, step=25.0), second_model)
    geometry = Geometry(node=np.arange(1, SHAKER + 1), coordinate=made.nominal, line=np.empty((0, 2), dtype=int))
    tables = modal_tables(made, noise or TableNoise())
    return made, [
        (table.configuration.name, table.configuration.pressure, modal_model(table, geometry, test.band))
        for table in tables
    ]


def modal_model(table, geometry, band):
    """Return a table of modes as an identification gives it."""
    n_dof, n = table.shape.shape
    largest = np.abs(table.shape).max(axis=0)
    pole = 2.0 * np.pi * table.frequency * (-table.damping + 1j * np.sqrt(1.0 - table.damping**2))
    zero = np.zeros((n_dof, 1))
    upwards = np.tile([0.0, 0.0, 1.0], (n_dof, 1))
    return ema.ModalModel(
        name=table.configuration.name,
        frequency=table.frequency,
        damping=table.damping,
        frequency_std=table.frequency_std,
        damping_std=table.damping_std,
        pole=pole,
        residue=np.zeros((n_dof, 1, n), complex),
        lower=zero.astype(complex),
        upper=zero.astype(complex),
        outside_pole=np.empty(0, complex),
        outside_residue=np.empty((n_dof, 1, 0), complex),
        shape=(table.shape / largest).astype(complex),
        shape_std=table.shape_std / largest,
        scaled=np.zeros(n, dtype=bool),
        node=np.arange(1, n_dof + 1),
        direction=upwards,
        sensor=np.arange(n_dof) % 2,
        input=Dofs(node=np.array([SHAKER]), direction=np.array([[0.0, 0.0, 1.0]])),
        band=band,
        geometry=geometry,
        quantity="accelerance",
        covariance=np.eye(2 * n),
        residue_std=np.zeros((n_dof, 1, n)),
        noise=zero,
        correlation=zero + 1.0,
        error=zero,
        run=np.array([1]),
        run_pole=pole[None, :],
        run_frequency_std=table.frequency_std[None, :],
        run_damping_std=table.damping_std[None, :],
        run_probability=np.ones((1, n)),
    )


__all__ = ["modal_model", "simulated"]
