"""Modes at three forces of a stack whose interfaces slip, by harmonic balance of the layered model.

Every point of the contact has Jenkins elements whose sliders turn with the strain; what their springs would carry and
they do not acts back on all modes. A mode is in resonance where the force on it lags by a quarter of a cycle. The
first harmonic is balanced, alternating between frequency and time (T. M. Cameron, J. H. Griffin, An alternating
frequency/time domain method for calculating the steady-state response of nonlinear dynamic systems, J. Appl. Mech. 56,
1989).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.independent.bench import Array, read_bench
from tests.independent.campaign import (
    LEAST_DAMPING,
    SHAKER,
    Configuration,
    ModalTable,
    Plan,
    TableNoise,
    deviating,
    nominal_points,
    tightened,
)
from tests.independent.layered import Layered, LayeredStack
from tests.independent.slipping_campaign import Contact, contact_points, sliders

MODEL = Layered(laminas_per_layer=6, n_element=(16, 3), n_function=(7, 4))
STATE = Configuration(name="M1", torque=1.5, pressure=160e3)
BAND = (200.0, 1000.0)
"""Hz, of the modes that are measured."""
FORCE = (0.3, 1.2, 4.0)
"""N, at every line."""
LEAST = 0.2
"""Of the largest, of the modes that are measured: size of the shape over the points, and at the driving point."""
DRIFT = 1e-4
"""Standard deviation by which all frequencies of a level differ together, as the laboratory gets warmer."""
AMPLITUDE_NOISE = 0.01
N_MODE, N_SLIDER, SMALLEST, POINTS = 20, 32, 1e-5, (32, 4, 9)
"""Modes, sliders of a point and the smallest strain at which one slides, and Gauss points along x, y and interfaces:
contact shears most in strips beside the clamps, and with eight points along x slip does to a mode as little as a third.
"""
_STEPS, _SETTLED, _FORCE_SETTLED, _MOST = 40, 2e-6, 1e-2, 60
_FIRST = 0.05  # of the amplitude without slip, from which it grows


@dataclass(frozen=True, kw_only=True)
class SlippingTest:
    """What is measured at three forces, and what is true.

    Attributes
    ----------
    level : tuple of ModalTable
        Modes of each force.
    motion : (n_level, n_mode) float
        Root mean square of the displacement amplitudes of all points in resonance, m, as measured.
    moved : float
        By how many half-widths of its 95 % interval the frequency that moves most does, without noise.
    friction, exponent : float
        Of the slip law; friction is infinite of a stack that does not slip.
    G_f : float
        Of the true contact.
    nominal : (45, 3) float
        Places of the points that the file states, m.
    """

    level: tuple[ModalTable, ...]
    motion: Array
    moved: float
    friction: float
    exponent: float
    G_f: float
    nominal: Array


def slipping_test(seed: int, *, slips: bool) -> SlippingTest:
    """Return a test whose stack deviates by tolerances, and whose law, where it slips, is drawn by the seed."""
    rng = np.random.default_rng([seed, int(slips), 34])
    plan = Plan(seed=seed, model_key="layered", kind="single", configurations=(STATE,))
    stated = read_bench(plan.stack)
    nominal = nominal_points(stated)
    bench, point = deviating(plan, stated, nominal, rng)
    bench = tightened(plan, bench, 0, rng)
    friction, exponent = float(np.exp(rng.uniform(np.log(0.3), np.log(10.0)))), float(rng.uniform(-0.7, -0.2))
    stack = LayeredStack.of(MODEL, bench)
    value, fields, _ = stack.solve(N_MODE)
    elastic = value > (2.0 * np.pi) ** 2
    each = MODEL.modes(bench, N_MODE)
    damping = np.maximum(each.damping[elastic], LEAST_DAMPING)
    shape = stack.reader(fields)(point)[:, 2][:, elastic]
    frequency = np.sqrt(value[elastic]) / (2.0 * np.pi)
    size, driven = np.linalg.norm(shape, axis=0), np.abs(shape[SHAKER - 1])
    inside = (frequency > BAND[0]) & (frequency < BAND[1])
    seen = np.flatnonzero(inside & (size > LEAST * size.max()) & (driven > LEAST * driven.max()))
    contact = contact_points(stack, [field[..., elastic] for field in fields], bench, POINTS)
    law = sliders(bench.G_f, friction if slips else 1e9, exponent, SMALLEST, N_SLIDER)
    balance = HarmonicBalance(value[elastic], damping, contact, law)
    force = np.outer(FORCE, driven[seen])
    found = balance.resonance(np.tile(seen, len(FORCE)), force.ravel())
    f, xi, q = (np.reshape(one, (*force.shape, *one.shape[1:])) for one in found)
    moving = np.einsum("pn,lrn->plr", shape[: SHAKER - 1], q)
    noise = TableNoise()
    motion = np.sqrt(np.mean(np.abs(moving) ** 2, axis=0)) * (1.0 + AMPLITUDE_NOISE * rng.standard_normal(f.shape))
    level = tuple(
        _table(force, f[i] * (1.0 + DRIFT * rng.standard_normal()), xi[i], moving[:, i].real, noise, rng)
        for i, force in enumerate(FORCE)
    )
    return SlippingTest(
        level=level,
        motion=motion,
        moved=float(np.max(np.ptp(f, axis=0) / (1.96 * noise.frequency * f[0]))),
        friction=friction if slips else np.inf,
        exponent=exponent,
        G_f=bench.G_f,
        nominal=nominal,
    )


def _table(
    force: float, frequency: Array, damping: Array, shape: Array, noise: TableNoise, rng: np.random.Generator
) -> ModalTable:
    """Return what is identified of one level."""
    n, size = frequency.size, noise.shape * np.linalg.norm(shape, axis=0) / np.sqrt(len(shape))
    return ModalTable(
        configuration=Configuration(name=f"M1 at {force:g} N", torque=STATE.torque, pressure=STATE.pressure),
        frequency=frequency * (1.0 + noise.frequency * rng.standard_normal(n)),
        damping=damping * (1.0 + noise.damping * rng.standard_normal(n)),
        shape=shape + size * rng.standard_normal(shape.shape),
        frequency_std=noise.frequency * frequency,
        damping_std=noise.damping * damping,
        shape_std=np.broadcast_to(size, shape.shape).copy(),
    )


class HarmonicBalance:
    """Modes in resonance; `value` are squared angular frequencies, `damping` ratios, `law` limits and shares."""

    def __init__(self, value: Array, damping: Array, contact: Contact, law: tuple[Array, Array]) -> None:
        self.value, self.damping, self.contact = value, damping, contact
        self.limit, self.share = law

    def slid(self, gamma: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return first harmonics of the strain that sliders take up of strains (n, 2, n_point), cycle by cycle."""
        turn = np.exp(2j * np.pi * np.arange(_STEPS) / _STEPS)
        moves = self.limit < np.sqrt(np.sum(np.abs(gamma) ** 2, axis=1)).max()  # the others always stick
        limit, share = self.limit[moves], self.share[moves]
        held = np.zeros((*gamma.shape, limit.size))
        before, found = np.zeros(gamma.shape), np.zeros_like(gamma)
        for t in range(2 * _STEPS):
            now = (gamma * turn[t % _STEPS]).real
            held += (now - before)[..., None]
            size = np.sqrt(held[:, 0] ** 2 + held[:, 1] ** 2)
            held *= np.minimum(1.0, limit / np.maximum(size, 1e-300))[:, None]
            before = now
            if t >= _STEPS:
                found += 2.0 / _STEPS * turn[t % _STEPS].conj() * (share.sum() * now - held @ share)
        return found

    def resonance(self, mode: NDArray[np.intp], force: Array) -> tuple[Array, Array, NDArray[np.complex128]]:
        """Return frequencies (Hz), damping ratios, (n,), and first harmonics (n, n_mode) of modes under modal forces.

        What sliders take up is taken as proportional to the strain of its point for a step, which only speeds it up.

        Raises
        ------
        RuntimeError
            It does not settle.
        """
        row, strain, viscous = (np.arange(force.size), self.contact.strain, 2.0 * self.damping * np.sqrt(self.value))
        omega, diagonal = np.sqrt(self.value[mode]), np.arange(self.value.size)
        amplitude = _FIRST * force / (omega * viscous[mode])
        q = np.zeros((force.size, self.value.size), complex)
        q[row, mode] = amplitude
        for _ in range(_MOST):
            gamma = np.einsum("dpn,bn->bdp", strain, q)
            slid = self.slid(gamma)
            near = np.sum(slid * gamma.conj(), axis=1) / np.sum(np.abs(gamma) ** 2, axis=1)
            secant = np.einsum("bp,p,dpn,dpm->bnm", near, self.contact.stiffness, strain, strain, optimize=True)
            rest = np.einsum(
                "bdp,p,dpn->bn", slid - near[:, None] * gamma, self.contact.stiffness, strain, optimize=True
            )
            system = -secant
            system[:, diagonal, diagonal] += self.value + 1j * omega[:, None] * viscous
            pinned, known = system.copy(), rest.copy()
            pinned[:, diagonal, diagonal] -= omega[:, None] ** 2
            pinned[row, mode], known[row, mode] = np.eye(self.value.size)[mode], amplitude
            q = np.linalg.solve(pinned, known[..., None])[..., 0]
            needed = (np.einsum("bnm,bm->bn", system, q) - rest)[row, mode]
            turned = np.sqrt(needed.real / amplitude)
            grown = np.clip(np.sqrt(force / needed.imag), 0.7, 1.5)
            settled = np.abs(turned / omega - 1.0) + _SETTLED * np.abs(grown - 1.0) / _FORCE_SETTLED
            lost = needed.imag * amplitude / (turned**2 * np.sum(np.abs(q) ** 2, axis=1))
            if np.all(settled < _SETTLED):
                return turned / (2.0 * np.pi), lost / 2.0, q
            omega, amplitude, q = turned, grown * amplitude, grown[:, None] * q
        message = "harmonic balance does not settle"
        raise RuntimeError(message)
