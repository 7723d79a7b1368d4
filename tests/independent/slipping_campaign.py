"""A campaign at three forces of a stack whose interfaces slip, by integration in time of the layered model.

The layered model's modes are driven by a force of constant amplitude at each line of a stepped sine. At points of the
interfaces Jenkins elements slide, with slip limits in proportion to the pressure; what their springs would carry and
they do not acts back on the modes. Motion goes on until it is steady, and the first harmonic is what is measured.

python -m tests.independent.slipping_campaign data/hidden_effect/slip
"""

from __future__ import annotations

import dataclasses
import json
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyuff
from numpy.typing import NDArray

from tests.independent.bench import Array, Bench, read_bench
from tests.independent.campaign import SHAKER, Configuration, Plan, deviating, nominal_points, tightened
from tests.independent.layered import Layered, LayeredStack
from tests.independent.layered_terms import SLIP

MODEL = Layered(laminas_per_layer=6, n_element=(16, 3), n_function=(7, 4))
PLAN = Plan(
    seed=34,
    model_key="layered",
    kind="single",
    configurations=(Configuration(name="M1", torque=1.5, pressure=160e3),),
    band=(225.0, 560.0),
    step=0.5,
)
FORCE = (0.3, 1.2, 4.0)
"""N, amplitude at every line."""
FRICTION, EXPONENT = 0.6, -0.4
"""Traction over pressure from which everything slides, and exponent of the power law of slip limits."""
NOISE = 3e-3
"""Of the force, common to all points, and of each response over its root mean square."""
N_MODE = 16
"""With six of the rigid body."""
POINTS = (8, 2, 3)
"""Along x and y, and interfaces."""
N_SLIDER = 7
SMALLEST = 0.004
"""Of the largest slip limit, up to which the first slider goes."""
STEPS, PERIODS = 40, 120
LEAST_DAMPING = 4e-3
"""Of modes beside what slip loses: cords, air and instruments; motion is steady sooner with it."""


@dataclass(frozen=True, kw_only=True)
class Contact:
    """Strains of contact points in each mode, (2, n_point, n_mode), and what each point's strain carries, N m."""

    strain: Array
    stiffness: Array


def contact_points(
    stack: LayeredStack, fields: list[Array], bench: Bench, points: tuple[int, int, int] = POINTS
) -> Contact:
    """Return so many Gauss points along x, along y and over the interfaces, with the modulus G_f p."""
    along, across = (np.polynomial.legendre.leggauss(n) for n in points[:2])
    x, y = 0.5 * bench.length * along[0], 0.5 * bench.width * across[0]
    area = np.multiply.outer(0.5 * bench.length * along[1], 0.5 * bench.width * across[1])
    n_interface = stack.n_layer - 1
    node, share = np.polynomial.legendre.leggauss(points[2])
    level = 0.5 * (n_interface - 1) * (1.0 + node)
    lower = np.minimum(level.astype(int), n_interface - 2)
    part = level - lower
    strain = []
    for parts in SLIP:
        total: Array | float = 0.0
        for component, (d_x, d_y), what in parts:
            over_z = stack.height.take(component, what)
            taken = (1.0 - part)[:, None] * over_z[lower] + part[:, None] * over_z[lower + 1]
            values = [line.at(place, d) for line, place, d in zip(stack.plan.lines, (x, y), (d_x, d_y), strict=True)]
            total = total + np.einsum("pa,qb,zc,abcr->pqzr", *values, taken, fields[component], optimize=True)
        strain.append(np.reshape(total, (-1, fields[0].shape[-1])))
    volume = np.multiply.outer(area, 0.5 * share * n_interface * stack.height.pitch)
    return Contact(strain=np.stack(strain), stiffness=bench.G_f * bench.pressure * volume.ravel())


def sliders(G_f: float, friction: float, exponent: float, smallest: float, number: int) -> tuple[Array, Array]:
    """Return slip limits, as strains, and shares of the stiffness, (n,), of Segalman's power law without a spike.

    The first takes all limits up to `smallest` of the largest one.
    """
    largest = friction / G_f * (exponent + 2.0) / (exponent + 1.0)
    # finer where the first ones slip: the share below a limit grows with its power 1 + chi
    edge = np.concatenate([[0.0], np.geomspace(smallest, 1.0, number)])
    share = np.diff(edge ** (exponent + 1.0))
    first = (exponent + 1.0) / (exponent + 2.0) * np.diff(edge ** (exponent + 2.0))
    return largest * first / share, share


def steady(
    modes: tuple[Array, Array, Array], contact: Contact, bench: Bench, force: float, line: Array
) -> NDArray[np.complex128]:
    """Return the first harmonics (n_line, n_mode), m sqrt(kg), of modes under a force at each line, Hz.

    `modes` are their angular frequencies, damping ratios and shapes at the shaker.
    """
    omega, damping, drive = modes
    law = sliders(bench.G_f, FRICTION, EXPONENT, SMALLEST, N_SLIDER)
    limit, share = (value.astype(np.float32) for value in law)
    n_line, n_mode = line.size, omega.size
    step = 1.0 / (line * STEPS)
    decay, damped = damping * omega, omega * np.sqrt(1.0 - damping**2)
    angle, fall = damped * step[:, None], np.exp(-decay * step[:, None])
    a = fall * (np.cos(angle) + decay / damped * np.sin(angle))
    b = fall * np.sin(angle) / damped
    c = -fall * omega**2 / damped * np.sin(angle)
    d = fall * (np.cos(angle) - decay / damped * np.sin(angle))
    strain = contact.strain.astype(np.float32)
    back = (contact.stiffness[:, None] * contact.strain).astype(np.float32)
    turn = 2.0 * np.pi * line[:, None]
    start = force * drive / (omega**2 - turn**2 + 2j * damping * omega * turn)
    q, v = start.real.copy(), (1j * turn * start).real.copy()
    held = np.zeros((2, n_line, contact.stiffness.size, limit.size), dtype=np.float32)
    before = np.zeros((2, n_line, contact.stiffness.size), dtype=np.float32)
    lost = np.zeros((n_line, n_mode))
    harmonic = np.zeros((n_line, n_mode), dtype=complex)
    for t in range(STEPS * PERIODS):
        gamma = np.einsum("lr,ipr->ilp", q.astype(np.float32), strain, optimize=True)
        held += (gamma - before)[..., None]
        size = np.sqrt(held[0] ** 2 + held[1] ** 2)
        held *= np.minimum(np.float32(1.0), limit / np.maximum(size, np.float32(1e-30)))
        before = gamma
        slid = gamma - held @ share
        now = np.einsum("ilp,ipr->lr", slid, back, optimize=True).astype(float)
        load = force * np.cos(2.0 * np.pi * (t + 0.5) / STEPS) * drive + 1.5 * now - 0.5 * lost
        lost = now
        if t >= STEPS * (PERIODS - 1):
            harmonic += 2.0 / STEPS * q * np.exp(-2j * np.pi * t / STEPS)
        rest = load / omega**2
        q, v = rest + a * (q - rest) + b * v, c * (q - rest) + d * v
    return harmonic


def simulate() -> tuple[dict[float, NDArray[np.complex128]], Array, Array, dict[str, object]]:
    """Return accelerances (44, n_line) by force, lines, stated places of the points and what is true."""
    rng = np.random.default_rng(PLAN.seed)
    stated = read_bench(PLAN.stack)
    nominal = nominal_points(stated)
    bench, point = deviating(PLAN, stated, nominal, rng)
    bench = tightened(PLAN, bench, 0, rng)
    stack = LayeredStack.of(MODEL, bench)
    value, fields, _ = stack.solve(N_MODE)
    shape = stack.reader(fields)(point)[:, 2]
    damping = MODEL.modes(bench, N_MODE).damping
    elastic = value > (2.0 * np.pi * 1.0) ** 2
    omega, xi = np.sqrt(value[elastic]), np.maximum(damping[elastic], LEAST_DAMPING)
    contact = contact_points(stack, [field[..., elastic] for field in fields], bench)
    line = np.arange(PLAN.band[0], PLAN.band[1] + PLAN.step / 2.0, PLAN.step)
    drive, rigid = shape[SHAKER - 1], shape[:, ~elastic]
    found = {}
    for force in FORCE:
        q = steady((omega, xi, drive[elastic]), contact, bench, force, line)
        true = -((2.0 * np.pi * line) ** 2) * (shape[: SHAKER - 1, elastic] @ q.T) / force
        true += (rigid[: SHAKER - 1] @ rigid[SHAKER - 1])[:, None]
        noise = rng.standard_normal((2, len(true) + 1, line.size))
        both = (noise[0] + 1j * noise[1]) / np.sqrt(2.0)
        level = NOISE * np.sqrt(np.mean(np.abs(true) ** 2, axis=1, keepdims=True))
        found[force] = true * (1.0 + NOISE * both[-1]) + level * both[:-1]
    truth = {
        "bench": {k: v for k, v in dataclasses.asdict(bench).items() if k not in ("clamps", "planted")},
        "frequency": (omega / (2.0 * np.pi)).tolist(),
        "damping": xi.tolist(),
        "friction": FRICTION,
        "exponent": EXPONENT,
        "force": list(FORCE),
    }
    return found, line, nominal, truth


def write(folder: Path) -> None:
    """Write the campaign with its stack, points, FRFs (dataset 58b) and truth."""
    found, line, nominal, truth = simulate()
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(PLAN.stack, folder / "stack.toml")
    rows = [f"{i + 1}," + ",".join(f"{1e3 * value:.3f}" for value in place) for i, place in enumerate(nominal)]
    (folder / "points.csv").write_text("\n".join(["node,x,y,z", *rows]) + "\n", encoding="utf-8")
    for force, functions in found.items():
        file = folder / f"force_{force:g}N.uff"
        file.unlink(missing_ok=True)
        pyuff.UFF(str(file)).write_sets(_sets(line, functions), mode="add")
    (folder / "campaign.toml").write_text(_text(), encoding="utf-8")
    (folder / "truth.json").write_text(json.dumps(truth, indent=1), encoding="utf-8")


def _sets(frequency: Array, functions: NDArray[np.complex128]) -> list[dict[str, object]]:
    common = {
        "type": 58,
        "binary": 1,
        "func_type": 4,
        "rsp_dir": 3,
        "ref_node": SHAKER,
        "ref_dir": 3,
        "ord_data_type": 5,
        "abscissa_spec_data_type": 18,
        "ordinate_spec_data_type": 12,
        "orddenom_spec_data_type": 13,
        "x": frequency,
    }
    return [
        common | {"rsp_node": i + 1, "data": value.astype(np.complex64), "id1": f"point {i + 1}"}
        for i, value in enumerate(functions)
    ]


def _text() -> str:
    levels = "".join(
        f'\n[[configuration.force_level]]\nforce_N = {force:g}\nfiles = ["force_{force:g}N.uff"]\n'
        for force in FORCE[1:]
    )
    return f"""[campaign]
name = "Hidden effect at three forces"

[structure]
stack = "stack.toml"

[points]
file = "points.csv"          # node,x,y,z with the origin in the centre of the stack, z in stacking direction
unit = "mm"

[measurement]
unit = "(m/s2)/N"

[[configuration]]
name = "M1"
torque_Nm = 1.5
pressure_kPa = 160
force_N = {FORCE[0]:g}                # amplitude of a stepped sine, the same at every line
files = ["force_{FORCE[0]:g}N.uff"]
{levels}"""


if __name__ == "__main__":
    write(Path(sys.argv[1]))
