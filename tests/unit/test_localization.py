"""The error map finds planted contact loss and claims no place where there is none."""

import dataclasses
import io
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

import model
from updating.correlation.localization import ENERGY_KINDS, Regions, energy_by_region, map_error, regions
from updating.errors import UpdatingError
from updating.report.state_part import error_map_picture

N_MODE = 6


@dataclass(frozen=True, eq=False)
class LostContact:
    """Pressure between the laminas, lost by a factor inside a box of x, y and of interfaces."""

    stack: model.Stack
    x: tuple[float, float]
    y: tuple[float, float]
    interface: slice
    factor: float

    @property
    def mean(self):
        return self.stack.contact.pressure

    def at(self, points):
        hit = (points[:, 0] > self.x[0]) & (points[:, 0] < self.x[1])
        hit &= (points[:, 1] > self.y[0]) & (points[:, 1] < self.y[1])
        pressure = np.full((self.stack.n_lamina - 1, len(points)), self.mean)
        pressure[self.interface] *= np.where(hit, self.factor, 1.0)
        return pressure, np.full(pressure.shape, self.stack.contact.normal_modulus)


@pytest.fixture(scope="module")
def stack():
    return model.Stack(
        name="test",
        length=0.465,
        width=0.0624,
        height=0.064,
        n_lamina=40,
        material=model.Material(young=200e9, poisson=0.28, density=7650.0),
        contact=model.Contact(G_f=1480.0, d_f=1.5e-11, pressure=320e3, normal_modulus=1e9),
        clamps=tuple(model.Clamp(mass=2.84, x=x, y=0.0, footprint=(0.04, 0.06)) for x in (-0.109, 0.109)),
        mesh=model.Mesh(n_x=10, n_y=2),
    )


@pytest.fixture(scope="module")
def system(stack):
    return model.reduce(stack, G_f_range=(900.0, 2400.0))


@pytest.fixture(scope="module")
def observation(stack):
    """Four edges, eleven stations."""
    half = np.array([stack.length, stack.width, stack.height]) / 2.0
    x, y, z = np.linspace(-1.0, 1.0, 11), [-1.0, 1.0], [-1.0, 1.0]
    location = half * np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    return model.Observation(node=np.arange(44), location=location, direction=np.tile([0.0, 0.0, 1.0], (44, 1)))


def simulate(stack, observation, noise=0.01, seed=0):
    """The modes of a stack as a test would give them."""
    rng = np.random.default_rng(seed)
    system = model.reduce(stack, G_f_range=(900.0, 2400.0))
    modes = model.solve_modes(system, G_f=stack.contact.G_f, d_f=0.0, n_mode=14, observation=observation).elastic()
    std = noise * np.sqrt(np.mean(modes.shape**2, axis=0)) * np.ones((44, 1))
    return SimpleNamespace(
        frequency=modes.frequency * (1.0 + 1e-4 * rng.standard_normal(modes.frequency.size)),
        frequency_std=1e-4 * modes.frequency,
        shape=modes.shape + std * rng.standard_normal(std.shape),
        shape_std=std,
    )


@pytest.fixture(scope="module")
def error_map(system, stack, observation):
    def made(true_stack, seed=0):
        return map_error(
            system,
            simulate(true_stack, observation, seed=seed),
            observation,
            regions(stack),
            G_f=1480.0,
            modes=np.arange(N_MODE),
        )

    return made


def lost(stack, **box):
    return dataclasses.replace(stack, pressing=LostContact(stack, **box))


@pytest.fixture(scope="module")
def local(error_map, stack):
    """Contact lost by two thirds between 0.0465 and 0.1395 m: the 7th and 8th of ten regions along the length."""
    return error_map(lost(stack, x=(0.0465, 0.1395), y=(-1.0, 1.0), interface=slice(None), factor=0.33))


@pytest.fixture(scope="module")
def uniform(error_map, stack):
    return error_map(stack.with_contact(G_f=0.8 * 1480.0))


TANGENTIAL = ENERGY_KINDS.index("tangential contact")


def test_energies_add_up_to_the_terms_of_the_equations(system, stack, observation):
    theta = {**system.theta, "G_f": 1700.0, "young": 1.1, "density": 0.9, "normal_modulus": 0.8}
    modes = model.solve_modes(system, G_f=1700.0, d_f=0.0, n_mode=9, observation=observation).elastic()
    where = regions(stack, 3, 2, 2)
    x = system.basis @ modes.coordinate
    energy = energy_by_region(system, x, theta, where).sum(axis=(2, 3, 4))

    def of(*names):
        krons = [t for t in system.assembly.terms if t.name in names and t.target in "KM"]
        return sum(t.factor(theta) * np.sum(x * system.assembly.apply(t.krons, x), axis=0) for t in krons)

    np.testing.assert_allclose(energy[:, :2].sum(axis=1), of("laminas"), rtol=1e-9)
    np.testing.assert_allclose(energy[:, 2], of("tangential contact"), rtol=1e-9)
    np.testing.assert_allclose(energy[:, 3], of("normal contact"), rtol=1e-9, atol=1e-9 * energy.max())
    np.testing.assert_allclose(energy[:, 4], of("lamina mass", "clamp 0 mass", "clamp 1 mass"), rtol=1e-9)


def modal_energy(system, modes, theta, where):
    """Share of each mode's energy by kind and region: strain energy of the four kinds of stiffness, kinetic of mass."""
    energy = energy_by_region(system, system.basis @ modes.coordinate, theta, where)
    stiffness, mass = (
        np.einsum("ir,ij,jr->r", modes.coordinate, system.matrix(target, theta), modes.coordinate) for target in "KM"
    )
    energy[:, :-1] /= stiffness[:, None, None, None, None]
    energy[:, -1] /= mass[:, None, None, None]
    return energy


def test_energies_follow_uneven_pressure(stack, observation):
    system = model.reduce(lost(stack, x=(0.0, 1.0), y=(-1.0, 1.0), interface=slice(None), factor=0.5))
    modes = model.solve_modes(system, G_f=1480.0, d_f=0.0, n_mode=9, observation=observation).elastic()
    energy = modal_energy(system, modes, system.theta, regions(stack))
    np.testing.assert_allclose(energy[:, :4].sum(axis=(1, 2, 3, 4)), 1.0, rtol=1e-5)
    np.testing.assert_allclose(energy[:, 4].sum(axis=(1, 2, 3)), 1.0, rtol=1e-9)


def test_a_clamp_counts_where_it_is(system, stack, observation):
    modes = model.solve_modes(system, G_f=1480.0, d_f=0.0, n_mode=9, observation=observation).elastic()
    energy = modal_energy(system, modes, system.theta, regions(stack, 20, 1, 1))[:, 4, :, 0, 0]
    clamped = np.flatnonzero(np.histogram([-0.109, 0.109], bins=20, range=(-0.2325, 0.2325))[0])
    beside = np.concatenate([clamped - 1, clamped + 1])
    assert energy[:, clamped].sum() > 3.0 * energy[:, beside].sum() / 2.0


def test_lost_contact_is_found_along_the_stack(local):
    along = local.relative[TANGENTIAL].mean(axis=(1, 2))
    assert set(np.argsort(along)[-2:].tolist()) == {6, 7}
    assert along[[6, 7]].min() > 2.0 * np.median(along)
    low, high = local.peak("tangential contact")
    assert 0.0465 - 1e-9 <= low[0] < high[0] <= 0.1395 + 1e-9
    assert local.contrast[TANGENTIAL] > 0.2


@pytest.mark.parametrize(
    ("centre", "factor"),
    [(-0.07, 0.6), (0.15, 0.3), *(pytest.param(x, 0.9, marks=pytest.mark.slow) for x in (-0.19, 0.01))],
)
def test_lost_contact_is_found_wherever_it_is(error_map, stack, centre, factor):
    half = 0.045
    zone = (centre - half, centre + half)
    found = error_map(lost(stack, x=zone, y=(-1.0, 1.0), interface=slice(None), factor=factor), seed=3)
    edge = found.regions.x
    along = found.relative[TANGENTIAL].mean(axis=(1, 2))
    peak = (edge[:-1] + edge[1:])[np.argmax(along)] / 2.0
    assert zone[0] < peak < zone[1]
    assert found.contrast[TANGENTIAL] > 0.15


def test_lost_contact_in_a_corner_is_found_in_all_three_directions(error_map, stack):
    corner = error_map(lost(stack, x=(0.10, 1.0), y=(0.0, 1.0), interface=slice(20, None), factor=0.2))
    low, high = corner.peak("tangential contact")
    assert low[0] > 0.09
    assert low[1] >= 0.0
    assert high[2] > 0.03


def test_a_uniform_change_claims_no_place(uniform, local):
    along = uniform.relative[TANGENTIAL].mean(axis=(1, 2))
    assert along.max() < 1.3 * along.min()
    assert uniform.contrast[TANGENTIAL] < 0.1
    assert uniform.total.mean() > 1e4 * uniform.floor.mean()


def test_a_uniform_change_is_ascribed_to_its_kind(uniform):
    assert np.argmax(uniform.explained) == TANGENTIAL
    assert uniform.explained[TANGENTIAL] > 0.98
    np.testing.assert_allclose(uniform.change[TANGENTIAL], -0.2, atol=0.02)


def test_wrong_laminas_are_ascribed_to_the_laminas(error_map, stack):
    found = error_map(dataclasses.replace(stack, material=dataclasses.replace(stack.material, young=160e9)))
    assert ENERGY_KINDS[np.argmax(found.explained)] == "lamina membrane"
    np.testing.assert_allclose(found.change[0], -0.2, atol=0.05)


def test_wrong_mass_is_ascribed_to_the_mass(error_map, stack):
    heavy = dataclasses.replace(stack.material, density=1.1 * 7650.0)
    found = error_map(dataclasses.replace(stack, material=heavy))
    assert ENERGY_KINDS[np.argmax(found.explained)] == "mass"
    assert 0.0 < found.change[-1] < 0.1  # the clamps, part of the mass, did not change


def test_a_right_model_leaves_an_error_of_the_size_of_the_noise(error_map, stack):
    found = error_map(stack)
    assert found.total.max() < 30.0 * found.floor.max()


def test_shapes_are_matched_to_their_standard_deviation(local):
    np.testing.assert_allclose(local.misfit, 1.0, rtol=1e-6)


def test_what_is_located_is_all_of_the_error(local):
    np.testing.assert_allclose(local.error.sum(axis=(1, 2, 3, 4)), local.total, rtol=1e-6)
    np.testing.assert_allclose(local.strain.sum(axis=(1, 2, 3, 4)), 1.0, rtol=1e-6)


def test_the_picture_is_dark_where_contact_was_lost(local, stack):
    image = Image.open(io.BytesIO(error_map_picture(local, stack, "tangential contact", size=(800, 320))))
    assert image.size == (800, 320)
    front = np.asarray(image.convert("RGB"), dtype=float)[40:250, :400]  # the heading and the scale lie outside
    dark = np.argwhere((front.sum(axis=2) < 200.0) & (front[..., 0] > 2.0 * front[..., 2]))  # and no ink
    assert dark.shape[0] > 100
    assert 230 < np.median(dark[:, 1]) < 340


def test_unknown_kinds_are_refused(local):
    with pytest.raises(UpdatingError, match="unknown kind of stiffness 'contact'; there are lamina membrane"):
        local.peak("contact")


def test_a_map_needs_a_mode(system, stack, observation):
    with pytest.raises(UpdatingError, match="at least one measured mode"):
        map_error(system, SimpleNamespace(), observation, regions(stack), G_f=1480.0, modes=np.zeros(0, int))


def test_regions_ascend():
    with pytest.raises(UpdatingError, match="edges along y must ascend"):
        Regions(x=[0.0, 1.0], y=[1.0, 0.0], z=[0.0, 1.0])
