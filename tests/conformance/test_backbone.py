"""Frequency and damping over amplitude beside harmonic balance of the same stack with sliding Jenkins elements."""

import time

import numpy as np
import pytest

import model
from model.contact.contact import SlipLaw
from model.modes.backbone import backbone, contact_strain
from model.modes.modes import full_parameters, reduced_eigenpairs

DROP = 0.05


def stack(n_lamina, n_x, n_y):
    return model.Stack(
        name="stack",
        length=0.3,
        width=0.08,
        height=0.06,
        n_lamina=n_lamina,
        material=model.Material(young=200e9, poisson=0.28, density=7650.0),
        contact=model.Contact(pressure=320e3, G_f=800.0, d_f=1e-11, normal_modulus=1e9),
        mesh=model.Mesh(n_x=n_x, n_y=n_y),
    )


class HarmonicBalance:
    """A mode in resonance, by alternating between frequency and time (Cameron and Griffin 1989).

    Every point of the contact has Jenkins elements whose sliders turn with the strain (radial return), no Masing's
    rule and no equivalent stiffness; all elastic modes and harmonics 1 and 3 move.
    """

    def __init__(self, system, strain, law, *, n_slider, n_step):
        contact = system.stack.contact
        theta = full_parameters(system, contact.G_f, contact.d_f, None)
        value, vectors, n_rigid = reduced_eigenpairs(system, theta, system.size)
        self.value, modes = value[n_rigid:], vectors[:, n_rigid:]
        self.damping = modes.T @ system.matrix("C", theta) @ modes
        slide = law.sliding_strain(contact.G_f)
        self.rows = strain.rows @ modes / slide
        self.weight = contact.G_f * contact.pressure * slide**2 * strain.weight
        self.limit, self.stiffness = law.sliders(n_slider)
        self.n_step = n_step
        self.harmonic = np.array([1, 3])

    def lost_force(self, q):
        """Harmonics of what the springs would carry and the sliders do not, for harmonics q (2, n_mode)."""
        angle = 2 * np.pi * np.arange(self.n_step) / self.n_step
        turn = np.exp(1j * np.outer(angle, self.harmonic))
        gamma = np.einsum("th,hn,dpn->tdp", turn, q, self.rows, optimize=True).real
        held = np.zeros((2, self.weight.size, self.limit.size))
        before, lost = np.zeros(gamma.shape[1:]), np.empty_like(gamma)
        for t in range(2 * self.n_step):
            now = gamma[t % self.n_step]
            held += (now - before)[..., None]
            size = np.maximum(np.hypot(*held), 1e-300)
            held *= np.minimum(1.0, self.limit / size)
            lost[t % self.n_step] = now - held @ self.stiffness
            before = now
        force = np.einsum("tdp,p,dpn->tn", lost, self.weight, self.rows, optimize=True)
        return 2 / self.n_step * turn.conj().T @ force

    def resonance(self, r, a):
        """Frequency, Hz, and damping ratio where the force M phi_r lags by a quarter of a cycle, at amplitude a."""
        q = np.zeros((2, self.value.size), complex)
        q[0, r], omega = a, np.sqrt(self.value[r])
        for _ in range(80):
            g, last, before = self.lost_force(q), omega, q.copy()
            dynamic = [np.diag(self.value - (h * omega) ** 2) + 1j * h * omega * self.damping for h in self.harmonic]
            first = np.delete(np.arange(self.value.size), r)
            q[1] = np.linalg.solve(dynamic[1], g[1])
            q[0, first] = np.linalg.solve(dynamic[0][np.ix_(first, first)], (g[0] - dynamic[0][:, r] * a)[first])
            q = 0.5 * (q + before)  # half a step, for a whole one may swing
            rest = self.value[r] * a + 1j * omega * (self.damping[r] @ q[0]) - g[0, r]
            omega = np.sqrt(rest.real / a)
            if abs(omega - last) < 1e-8 * omega:
                energy = omega**2 * np.sum(np.abs(q[0]) ** 2)
                return omega / (2 * np.pi), rest.imag * a / (2 * energy)
        pytest.fail("harmonic balance does not settle")


def softened(system, strain, law, mode):
    """The backbone of a mode at a drop of 5 % of its frequency, and the mode of the linear model."""
    contact = system.stack.contact

    def at(*amplitude):
        found = np.array(amplitude)
        return backbone(system, strain, law, mode=mode, amplitude=found, G_f=contact.G_f, d_f=contact.d_f)

    linear, size = at(0.0), strain.amplitude(np.ones(system.size)).max()
    tried = law.sliding_strain(contact.G_f) / size * np.geomspace(1e-4, 1.0, 9)
    while at(tried[-1]).frequency[0] > (1 - DROP) * linear.frequency[0]:
        tried *= 2
    drop = 1 - at(*tried).frequency / linear.frequency[0]
    return at(np.exp(np.interp(np.log(DROP), np.log(drop), np.log(tried)))), linear


def beside(system, law, mode, *, n_slider, n_step):
    """Ratios of frequency and of damping, at a drop of 5 %, to those of harmonic balance, less 1; and the drop."""
    strain = contact_strain(system, n_interface=4)
    found, linear = softened(system, strain, law, mode)
    one = found.coordinate[:, 0] @ system.matrix("M", system.theta) @ linear.coordinate[:, 0]
    balance = HarmonicBalance(system, strain, law, n_slider=n_slider, n_step=n_step)
    f, damping = balance.resonance(mode, found.amplitude[0] * one)
    return (found.frequency[0] / f - 1, found.damping[0] / damping - 1, found.frequency[0] / linear.frequency[0] - 1)


def test_a_mode_is_that_of_harmonic_balance():
    system = model.reduce(stack(8, 4, 1), n_snapshot=1)
    law = SlipLaw(friction=0.3, exponent=-0.4, spike=0.5)
    f, damping, drop = beside(system, law, 0, n_slider=30, n_step=64)
    assert abs(drop + DROP) < 2e-3
    assert abs(f) < 1e-3
    assert abs(damping) < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("mode", range(4))
def test_four_modes_are_those_of_harmonic_balance(mode):
    system = model.reduce(stack(40, 8, 2))
    law = SlipLaw(friction=0.3, exponent=-0.4, spike=0.5)
    f, damping, drop = beside(system, law, mode, n_slider=40, n_step=128)
    assert abs(drop + DROP) < 2e-3
    assert abs(f) < 1e-3
    assert abs(damping) < 0.03


@pytest.mark.benchmark
def test_a_backbone_costs_half_a_second(capsys):
    """Of each of four modes of 240 laminas at eight amplitudes, to a drop of 5 %; of the processor, whoever waits."""
    system = model.reduce(stack(240, 16, 4))
    strain, law = contact_strain(system), SlipLaw(friction=0.3, exponent=-0.4)
    contact = system.stack.contact
    for mode in range(4):
        top = softened(system, strain, law, mode)[0].amplitude[0]
        start = time.process_time()
        found = backbone(
            system, strain, law, mode=mode, amplitude=top * np.geomspace(0.01, 1.0, 8), G_f=contact.G_f, d_f=contact.d_f
        )  # fmt: skip
        spent = time.process_time() - start
        drop = 1.0 - found.frequency[-1] / found.frequency[0]
        with capsys.disabled():
            print(f"\nmode {mode + 1}, {system.size} directions: {spent:.2f} s, from lowest to highest {drop:.3f}")
        assert spent < 0.5
