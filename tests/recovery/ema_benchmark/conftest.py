"""Seeded sets of generated FRFs, two peers, and the table of the figures of both.

    pytest tests/recovery/ema_benchmark -m benchmark -s

SETS sets the number of seeded sets of each study (300 by default), PEER_SETS that of the peers, sdypy-EMA and SDynPy's
PolyPy (10). The peers are given the true frequencies as guesses, without which they return no modes; order 60.
"""

import contextlib
import importlib.util
import io
import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from ema.identification.identify import identify_frf
from ema.types.frf import FRF, Dofs, Geometry, Quantity
from ema.types.modal_model import ModalModel

EXPONENT: dict[Quantity, int] = {"receptance": 0, "mobility": 1, "accelerance": 2}
NONE = "has none"


@dataclass(frozen=True, kw_only=True)
class Truth:
    frequency: NDArray
    damping: NDArray
    shape: NDArray
    pole: NDArray
    residue: NDArray
    clean: NDArray
    sigma: NDArray


@dataclass(frozen=True)
class Sets:
    """`count` sets for each study: functions at `n` points on `lines`, by default of six modes."""

    count: int
    n: int = 44
    lines: NDArray = field(default_factory=lambda: np.arange(0.5, 2000.25, 0.5))
    frequency: NDArray = field(default_factory=lambda: np.array([152.0, 398.0, 611.0, 800.0, 1100.0, 1390.0]))
    damping: NDArray = field(default_factory=lambda: np.array([0.002, 0.005, 0.01, 0.02, 0.004, 0.04]))

    @property
    def geometry(self) -> Geometry:
        coordinate = np.outer(np.arange(self.n), [0.1, 0.0, 0.0])
        return Geometry(node=np.arange(self.n), coordinate=coordinate, line=np.zeros((0, 2)))

    def clean_functions(self, f: NDArray, z: NDArray, phi: NDArray, drive: int, quantity: Quantity) -> tuple:
        pole = 2 * np.pi * f * (-z + 1j * np.sqrt(1 - z**2))
        residue = phi * phi[drive] / (2j * pole.imag)
        s = 2j * np.pi * self.lines
        value = residue @ (1 / (s - pole[:, None])) + residue.conj() @ (1 / (s - pole.conj()[:, None]))
        return pole, residue, value * s ** EXPONENT[quantity]

    def noisy(
        self,
        rng: np.random.Generator,
        f: NDArray,
        z: NDArray,
        noise: float,
        *,
        phi: NDArray | None = None,
        drive: int = 0,
        quantity: Quantity = "accelerance",
    ) -> tuple[FRF, Truth]:
        if phi is None:
            phi = np.stack([np.cos(k * np.pi * np.linspace(0, 1, self.n)) for k in range(1, f.size + 1)], axis=1)
            phi = phi + 0.15 * rng.standard_normal(phi.shape)
        pole, residue, clean = self.clean_functions(f, z, phi, drive, quantity)
        sigma = noise * np.sqrt(np.mean(np.abs(clean) ** 2, axis=1))
        scatter = rng.standard_normal(clean.shape) + 1j * rng.standard_normal(clean.shape)
        value = clean + sigma[:, None] * scatter / np.sqrt(2)
        truth = Truth(frequency=f, damping=z, shape=phi, pole=pole, residue=residue, clean=clean, sigma=sigma)
        return self.block(value, quantity, drive), truth

    def block(self, value: NDArray, quantity: Quantity, drive: int, run: NDArray | None = None) -> FRF:
        z = np.tile([0.0, 0.0, 1.0], (self.n, 1))
        return FRF(
            frequency=self.lines,
            value=value[:, None],
            quantity=quantity,
            output=Dofs(node=np.arange(self.n), direction=z),
            input=Dofs(node=[drive], direction=z[:1]),
            run=np.zeros(self.n, dtype=int) if run is None else run,
            source=("generated",) * self.n,
        )

    def identified(self, frf: FRF, band: tuple[float, float] | None = None) -> ModalModel:
        return identify_frf(frf, self.geometry, name="set", band=band)


def sdypy_poles(value: NDArray, lines: NDArray, guess: NDArray) -> tuple[NDArray, NDArray]:
    """Frequencies and damping ratios that sdypy-EMA picks next to the guesses."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from sdypy.EMA import Model

        # its axis begins at 0 Hz in even steps
        axis = np.arange(0.0, lines[-1] + 0.25, 0.5)
        padded = np.zeros((len(value), axis.size), dtype=complex)
        padded[:, np.searchsorted(axis, lines - 0.1)] = value
        model = Model(padded, axis, lower=lines[0], upper=lines[-1], pol_order_high=60)
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            model.get_poles(show_progress=False)
            model.select_closest_poles(list(guess))
    return np.asarray(model.nat_freq), np.asarray(model.nat_xi)


def polypy(value: NDArray, lines: NDArray, order: int) -> NDArray:
    """Poles of the highest order that PolyPy finds, as a table with omega and zeta."""
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        import sdynpy

        output = sdynpy.coordinate_array(np.arange(1, len(value) + 1), 3)
        dofs = np.stack([output, np.broadcast_to(sdynpy.coordinate_array(1, 3), output.shape)], axis=1)
        kind = sdynpy.data.FunctionTypes.FREQUENCY_RESPONSE_FUNCTION
        model = sdynpy.modal.PolyPy(sdynpy.data_array(kind, lines, np.array(value), dofs))
        model.compute_poles(np.arange(2, order + 1))
    return np.asarray(model.pole_list[0])


def polypy_poles(value: NDArray, lines: NDArray, guess: NDArray) -> tuple[NDArray, NDArray]:
    """Frequencies and damping ratios of the damped poles of order 60 nearest to the guesses."""
    poles = polypy(value, lines, 60)
    poles = poles[poles["zeta"] > 0]
    nearest = [int(np.argmin(np.abs(poles["omega"] / (2 * np.pi) - g))) for g in guess]
    return poles["omega"][nearest] / (2 * np.pi), poles["zeta"][nearest]


Poles = Callable[[NDArray, NDArray, NDArray], tuple[NDArray, NDArray]]


@dataclass(frozen=True)
class Peers:
    """The peers, each asked with `count` sets; PolyPy is compared where SDynPy is installed."""

    count: int
    has_polypy: bool

    def polypy(self, value: NDArray, lines: NDArray, order: int) -> NDArray:
        """Poles of the highest order that PolyPy finds, as a table with omega and zeta."""
        return polypy(value, lines, order)

    def of(self, figure: Callable[[Poles], str]) -> list[str]:
        """A figure of each peer."""
        return [figure(sdypy_poles), figure(polypy_poles) if self.has_polypy else "not installed"]


@pytest.fixture(scope="session")
def sets() -> Sets:
    return Sets(int(os.environ.get("SETS", "300")))


@pytest.fixture(scope="session")
def peers() -> Peers:
    there = importlib.util.find_spec("sdynpy") is not None
    return Peers(int(os.environ.get("PEER_SETS", "10")), there)


@pytest.fixture(scope="session")
def report(sets: Sets, peers: Peers):
    """Takes figure, target, what Lamella reached and what the peers did; prints the table at the end."""
    rows: list[tuple[str, ...]] = []
    yield lambda figure, target, reached, *other: rows.append((figure, target, reached, *(other or (NONE, NONE))))
    print(
        f"\n\n{sets.count} sets; peers {peers.count} sets, given the true frequencies\n\n"
        "| figure | target | Lamella | sdypy-EMA | PolyPy |\n| --- | --- | --- | --- | --- |"
    )
    for row in rows:
        print("| " + " | ".join(row) + " |")
