"""Write the example with CalculiX: the matrices of a cantilever plate on springs, and a test with a hidden mass.

    python data/matrices_example/make.py

It needs CalculiX as `ccx` on the path (Debian and Ubuntu: `apt install calculix-ccx`), and takes seconds. The model is
written twice, the second time with the modulus of the outer strip doubled, so that the strip's share of the stiffness
is the difference.

The tests are simulated with a finer mesh, softer springs and a mass that the model lacks; what these are stands in
truth.json, which no command reads. Of four states each is mounted anew, on springs a little different, and one has a
second mass.
"""

from __future__ import annotations

import gzip
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from ema.io.uff import write_uff
from ema.types.frf import FRF, Dofs, Geometry
from model.matrices.rows import read_nodes

HERE = Path(__file__).parent
LENGTH, WIDTH, THICKNESS = 240.0, 160.0, 4.0  # mm
N_X, N_Y = 6, 4  # elements of second order
YOUNG, POISSON, DENSITY = 2.1e5, 0.3, 7.85e-9  # MPa, 1, t/mm3
SPRING = 2e4  # N/mm for each node of the root, along each axis

# corners and sides of a brick in the order of its nodes, in half element lengths
_BRICK = (
    (0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2),
    (1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2),
    (0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1),
)  # fmt: skip


TRUTH = {"springs": 0.7, "strip": 1.0, "mass_kg": 0.045, "at_mm": [240.0, 160.0]}
MOUNTED = {"again": 0.708, "control": 0.694, "after": 0.703}  # springs of further states
CHANGE = {"state": "after", "added_kg": 0.03, "at_mm": [80.0, 40.0]}
FINE = (12, 8)  # elements of the second model
SENSOR_MM = [(40.0 * i, 40.0 * j) for i in range(1, 7) for j in range(5)]
DRIVE = 21  # number of the point of the force
DAMPING, NOISE = 0.01, 0.01  # ratio; of each function's root mean square


def deck(
    outer: float = 1.0,
    springs: bool = False,
    step: str = "*FREQUENCY, SOLVER=MATRIXSTORAGE\n1",
    elements: tuple[int, int] = (N_X, N_Y),
) -> str:
    """Return the input of CalculiX, the modulus of the outer strip multiplied by `outer`."""
    n_x, n_y = elements
    number: dict[tuple[int, int, int], int] = {}
    solids: dict[str, list[str]] = {"INNER": [], "STRIP": []}
    for i in range(n_x):
        for j in range(n_y):
            keys = [(2 * i + a, 2 * j + b, c) for a, b, c in _BRICK]
            nodes = [str(number.setdefault(key, len(number) + 1)) for key in keys]
            name = "STRIP" if 3 * i >= 2 * n_x else "INNER"
            label = str(i * n_y + j + 1)
            solids[name].append(", ".join([label, *nodes[:9]]) + ",\n" + ", ".join(nodes[9:]))
    place = {n: (i * LENGTH / n_x / 2, j * WIDTH / n_y / 2, k * THICKNESS / 2) for (i, j, k), n in number.items()}
    root = [n for (i, _, _), n in number.items() if i == 0]
    lines = ["*NODE, NSET=ALL", *(f"{n}, {x:.6g}, {y:.6g}, {z:.6g}" for n, (x, y, z) in place.items())]
    for name, one in solids.items():
        lines += [f"*ELEMENT, TYPE=C3D20R, ELSET={name}", *one]
    lines += ["*NSET, NSET=ROOT", *(f"{n}," for n in root)]
    lines += ["*NSET, NSET=TOP", *(f"{n}," for (i, j, k), n in number.items() if k == 2 and i % 2 == j % 2 == 0)]
    for name, factor in (("INNER", 1.0), ("STRIP", outer)):
        lines += [f"*MATERIAL, NAME={name}", "*ELASTIC", f"{factor * YOUNG}, {POISSON}", "*DENSITY", f"{DENSITY}"]
        lines += [f"*SOLID SECTION, ELSET={name}, MATERIAL={name}"]
    if springs:
        for axis in (1, 2, 3):
            lines += [f"*ELEMENT, TYPE=SPRING1, ELSET=S{axis}"]
            lines += [f"{1000 * axis + k}, {n}" for k, n in enumerate(root)]
            lines += [f"*SPRING, ELSET=S{axis}", f"{axis}", f"{SPRING}"]
    return "\n".join([*lines, "*STEP", step, "*END STEP", ""])


def run(text: str, folder: Path, name: str) -> None:
    """Run CalculiX on a deck."""
    (folder / f"{name}.inp").write_text(text, encoding="utf-8")
    subprocess.run(["ccx", name], cwd=folder, check=True, stdout=subprocess.DEVNULL)


def simulated(folder: Path) -> None:
    """Write the points, the functions and the truth of a test of the second model."""
    run(deck(elements=FINE), folder, "fine")
    label = np.array([line.split(".") for line in (folder / "fine.dof").read_text().split()], dtype=int)
    nodes = read_nodes(folder / "fine.inp")
    place = nodes.location[nodes.at(label[:, 0])]  # mm

    def matrix(file: str) -> sp.csc_matrix:
        row, column, value = np.loadtxt(folder / file).T
        upper = sp.csc_matrix((value, (row.astype(int) - 1, column.astype(int) - 1)))
        return sp.csc_matrix(upper + sp.triu(upper, 1).T)

    root = place[:, 0] == 0.0
    spring = TRUTH["springs"] * 23 * SPRING / (root.sum() / 3)  # N/mm on each of more nodes
    free, mass = matrix("fine.sti"), matrix("fine.mas")
    rows = [
        int(np.flatnonzero(np.all(place == [x, y, THICKNESS], axis=1) & (label[:, 1] == 3))[0]) for x, y in SENSOR_MM
    ]

    def bolted(at_mm: object, kg: object) -> sp.dia_array:
        heavy = np.all(place[:, :2] == at_mm, axis=1)  # a bolt: all through the thickness
        return sp.diags_array(heavy * 1e-3 * kg / (heavy.sum() / 3))

    mass = mass + bolted(TRUTH["at_mm"], TRUTH["mass_kg"])
    rng = np.random.default_rng(67)
    omega = measured("plate", free + sp.diags_array(root * spring), mass, rows, rng)
    for state, springs in MOUNTED.items():
        one = free + sp.diags_array(root * spring * springs / TRUTH["springs"])
        more = bolted(CHANGE["at_mm"], CHANGE["added_kg"]) if state == CHANGE["state"] else 0.0 * mass
        measured(state, one, mass + more, rows, rng)
    (HERE / "points.csv").write_text(
        "node,x,y,z\n" + "".join(f"{n + 1},{x:g},{y:g},{THICKNESS:g}\n" for n, (x, y) in enumerate(SENSOR_MM))
    )
    truth = {**TRUTH, "frequency_Hz": (omega / (2.0 * np.pi))[:12].round(4).tolist(), "damping": DAMPING}
    truth |= {"springs_of": MOUNTED, "change": CHANGE}
    (HERE / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")


def measured(
    name: str, stiffness: sp.sparray, mass: sp.sparray, rows: list[int], rng: np.random.Generator
) -> np.ndarray:
    """Write what a test measures of a structure in mm-t-s, and return its angular frequencies."""
    square, shape = sla.eigsh(sp.csc_matrix(stiffness), 30, sp.csc_matrix(mass), sigma=-1e4, v0=np.ones(mass.shape[0]))
    omega = np.sqrt(square)
    seen = shape[rows] * 1e3**-0.5  # 1/sqrt(t) to 1/sqrt(kg)
    w = 2.0 * np.pi * np.arange(20.0, 1600.0, 1.0)
    gain = 1.0 / (omega[:, None] ** 2 - w**2 + 2j * DAMPING * omega[:, None] * w)
    value = -(w**2) * ((seen * seen[DRIVE - 1]) @ gain)  # (m/s2)/N
    noise = rng.standard_normal((2, *value.shape)) * np.sqrt(np.mean(abs(value) ** 2, axis=1))[:, None] / 2**0.5
    value = value + NOISE * (noise[0] + 1j * noise[1])
    node = np.arange(1, len(rows) + 1)
    up = np.tile([0.0, 0.0, 1.0], (len(rows), 1))
    geometry = Geometry(
        node=node,
        coordinate=1e-3 * np.array([(x, y, THICKNESS) for x, y in SENSOR_MM]),
        line=np.zeros((0, 2), dtype=int),
    )
    frf = FRF(
        frequency=w / (2.0 * np.pi),
        value=value[:, None],
        quantity="accelerance",
        output=Dofs(node=node, direction=up),
        input=Dofs(node=np.array([DRIVE]), direction=up[:1]),
        run=np.zeros(len(rows), dtype=int),
        source=("simulated",) * len(rows),
        coherence=None,
    )
    write_uff(HERE / f"{name}.uff", geometry, frf)
    return omega


def main() -> None:
    """Write deck, labels, compressed matrices and the test beside this file."""
    if shutil.which("ccx") is None:
        sys.exit("CalculiX is not here; install it, on Debian and Ubuntu by: apt install calculix-ccx")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run(deck(), folder, "plate")
        run(deck(outer=2.0), folder, "strip_doubled")
        for file in ("plate.inp", "plate.dof"):
            shutil.copy(folder / file, HERE / file)
        for file in ("plate.sti", "plate.mas", "strip_doubled.sti"):
            with (HERE / f"{file}.gz").open("wb") as raw, gzip.GzipFile(fileobj=raw, mode="wb", mtime=0) as packed:
                packed.write((folder / file).read_bytes())
        simulated(folder)


if __name__ == "__main__":
    main()
