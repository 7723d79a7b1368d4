"""What a fit over several configurations is to meet: measured modes, how well each is known, and the stack."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema import Campaign, Configuration
from ema.modal.mac import real_shape
from ema.types.arrays import readonly
from ema.types.modal_model import ModalModel
from model import Observation, Stack
from updating.correlation.registration import register
from updating.correlation.shape_class import class_grid
from updating.errors import FitError


@dataclass(frozen=True, eq=False, kw_only=True)
class Target:
    """Measured modes of one configuration.

    Attributes
    ----------
    name : str
        The configuration; each has its own.
    specimen : str
        The stack that it was measured on: configurations of one stack have the same.
    stack : Stack
        Its model, at the configuration's pressure, with the effects that may be fitted.
    observation : Observation
        Where the model's shapes are sampled: the measured DOFs, or the grid that shapes are named from.
    frequency : (n_mode,) float
        Natural frequencies, Hz; NaN where a mode was not measured.
    damping : (n_mode,) float
        Damping ratios; NaN where unknown.
    covariance : (2 n_mode, 2 n_mode) float
        Covariance of ln(frequency) and damping ratio of each mode in turn.
    shape_class : tuple of str
        Class of each mode, by which it is paired; empty where modes are paired by MAC.
    shape : (n_dof, n_mode) float
        Real mode shapes of unit length, by which modes are paired and which are fitted; (0, n_mode) with classes.
    shape_std : (n_dof, n_mode) float
        Their standard deviations.
    """

    name: str
    specimen: str
    stack: Stack
    observation: Observation
    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]
    covariance: NDArray[np.float64]
    shape_class: tuple[str, ...]
    shape: NDArray[np.float64]
    shape_std: NDArray[np.float64]

    def __post_init__(self) -> None:
        n_mode = np.size(self.frequency)
        n_dof = 0 if self.shape_class else self.observation.node.size
        expected = {
            "frequency": (n_mode,),
            "damping": (n_mode,),
            "covariance": (2 * n_mode, 2 * n_mode),
            "shape": (n_dof, n_mode),
            "shape_std": (n_dof, n_mode),
        }
        for name, shape in expected.items():
            object.__setattr__(self, name, readonly("Target", name, getattr(self, name), shape))

    @property
    def node(self) -> NDArray[np.int64]:
        """Point number of each DOF."""
        return self.observation.node

    @property
    def direction(self) -> NDArray[np.float64]:
        """Direction of each DOF (n_dof, 3)."""
        return self.observation.direction


def model_file(campaign: Campaign, job: str) -> Path:
    """Return the file of the model's stack, which `job`, such as "a fit", needs.

    Raises
    ------
    FitError
        The campaign names none, or no file of the points, by which shapes are compared.
    """
    if campaign.stack is None:
        message = (
            f'{campaign.path}: {job} needs the model\'s stack; add stack = "stack.toml" under [structure]'
        )
        raise FitError(message)
    if campaign.points is None:
        message = (
            f"{campaign.path}: {job} compares shapes and needs the coordinates of the points; add file = "
            '"points.csv" and its unit under [points]'
        )
        raise FitError(message)
    return campaign.stack


def stack_in_state(stack: Stack, configuration: Configuration) -> Stack:
    """Put a configuration's pressure and height, where it states them, in place of those of the stack file."""
    if configuration.pressure is not None:
        stack = stack.with_contact(pressure=configuration.pressure)
    return stack if configuration.height is None else replace(stack, height=configuration.height)


def specimen_name(name: str, height: float, heights: Collection[float]) -> str:
    """Name the stack of a configuration: configurations of other heights (m) are other stacks."""
    return name if len(set(heights)) == 1 else f"{name}, {1e3 * height:g} mm"


def target_of_modes(
    stack: Stack, measured: ModalModel, *, specimen: str = "", tolerance: float = 0.01
) -> Target:
    """Return identified modes as a target, with the covariance and the shapes of the identification.

    The poles' covariance is carried over to ln(frequency) and damping ratio to first order.

    Parameters
    ----------
    stack : Stack
        The stack at the configuration's pressure.
    measured : ModalModel
        The identified modes.
    specimen : str
        Name of the stack; by default that of `stack`.
    tolerance : float
        Largest distance between a measured point and the stack, m.

    Raises
    ------
    PairingError
        Points of the measurement do not lie on the stack.
    """
    registration = register(stack, measured.geometry, measured.node, measured.direction, tolerance=tolerance)
    n_mode = measured.frequency.size
    slope = np.zeros((2 * n_mode, 2 * n_mode))
    for r, pole in enumerate(measured.free_pole):
        size, a, b = abs(pole), pole.real, pole.imag
        slope[2 * r : 2 * r + 2, 2 * r : 2 * r + 2] = [
            [a / size**2, b / size**2],
            [-(b**2) / size**3, a * b / size**3],
        ]
    length = np.linalg.norm(measured.shape, axis=0)
    return Target(
        name=measured.name,
        specimen=specimen or stack.name,
        stack=stack,
        observation=registration.observation,
        frequency=measured.frequency,
        damping=measured.damping,
        covariance=slope @ measured.covariance @ slope.T,
        shape_class=(),
        shape=real_shape(measured.shape / length),
        shape_std=measured.shape_std / length,
    )


def target_of_table(
    stack: Stack,
    shape_class: tuple[str, ...],
    frequency: NDArray[np.float64],
    *,
    name: str,
    specimen: str = "",
    damping: NDArray[np.float64] | None = None,
) -> Target:
    """Return modes of a table, which are known by their classes and have no stated uncertainty, as a target.

    Parameters
    ----------
    stack : Stack
        The stack at the configuration's pressure.
    shape_class : tuple of str
        Class of each mode, such as "torsion 1".
    frequency : (n_mode,) float
        Natural frequencies, Hz; NaN where a mode was not measured.
    name, specimen : str
        The configuration, and its stack; by default `name` for both.
    damping : (n_mode,) float, optional
        Damping ratios.
    """
    n_mode = np.size(frequency)
    return Target(
        name=name,
        specimen=specimen or name,
        stack=stack,
        observation=class_grid(stack),
        frequency=np.asarray(frequency, float),
        damping=np.full(n_mode, np.nan) if damping is None else damping,
        covariance=np.zeros((2 * n_mode, 2 * n_mode)),
        shape_class=shape_class,
        shape=np.empty((0, n_mode)),
        shape_std=np.empty((0, n_mode)),
    )
