"""Write the matrices of the example with CalculiX: a cantilever plate of solids on springs at its root.

    python data/matrices_example/make.py

It needs CalculiX as `ccx` on the path (Debian and Ubuntu: `apt install calculix-ccx`), and takes seconds. The model is
written twice, the second time with the modulus of the outer strip doubled, so that the strip's share of the stiffness
is the difference.
"""

from __future__ import annotations

import gzip
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
LENGTH, WIDTH, THICKNESS = 240.0, 160.0, 4.0  # mm
N_X, N_Y = 6, 4  # elements of second order
YOUNG, POISSON, DENSITY = 2.1e5, 0.3, 7.85e-9  # MPa, 1, t/mm3
SPRING = 2e4  # N/mm for each node of the root, along each axis
OUTER = 4  # columns of elements from the root on that are the outer strip's

# corners and sides of a brick in the order of its nodes, in half element lengths
_BRICK = (
    (0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2),
    (1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2),
    (0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1),
)  # fmt: skip


def deck(outer: float = 1.0, springs: bool = False, step: str = "*FREQUENCY, SOLVER=MATRIXSTORAGE\n1") -> str:
    """Return the input of CalculiX, the modulus of the outer strip multiplied by `outer`."""
    number: dict[tuple[int, int, int], int] = {}
    elements: dict[str, list[str]] = {"INNER": [], "STRIP": []}
    for i in range(N_X):
        for j in range(N_Y):
            keys = [(2 * i + a, 2 * j + b, c) for a, b, c in _BRICK]
            nodes = [str(number.setdefault(key, len(number) + 1)) for key in keys]
            name = "STRIP" if i >= OUTER else "INNER"
            label = str(i * N_Y + j + 1)
            elements[name].append(", ".join([label, *nodes[:9]]) + ",\n" + ", ".join(nodes[9:]))
    place = {
        n: (i * LENGTH / N_X / 2, j * WIDTH / N_Y / 2, k * THICKNESS / 2) for (i, j, k), n in number.items()
    }
    root = [n for (i, _, _), n in number.items() if i == 0]
    lines = ["*NODE, NSET=ALL", *(f"{n}, {x:.6g}, {y:.6g}, {z:.6g}" for n, (x, y, z) in place.items())]
    for name, own in elements.items():
        lines += [f"*ELEMENT, TYPE=C3D20R, ELSET={name}", *own]
    lines += ["*NSET, NSET=ROOT", *(f"{n}," for n in root)]
    lines += [
        "*NSET, NSET=TOP",
        *(f"{n}," for (i, j, k), n in number.items() if k == 2 and i % 2 == j % 2 == 0),
    ]
    for name, factor in (("INNER", 1.0), ("STRIP", outer)):
        lines += [
            f"*MATERIAL, NAME={name}",
            "*ELASTIC",
            f"{factor * YOUNG}, {POISSON}",
            "*DENSITY",
            f"{DENSITY}",
        ]
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


def main() -> None:
    """Write deck, labels and compressed matrices beside this file."""
    if shutil.which("ccx") is None:
        sys.exit("CalculiX is not here; install it, on Debian and Ubuntu by: apt install calculix-ccx")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run(deck(), folder, "plate")
        run(deck(outer=2.0), folder, "strip_doubled")
        for file in ("plate.inp", "plate.dof"):
            shutil.copy(folder / file, HERE / file)
        for file in ("plate.sti", "plate.mas", "strip_doubled.sti"):
            with (
                (HERE / f"{file}.gz").open("wb") as raw,
                gzip.GzipFile(fileobj=raw, mode="wb", mtime=0) as packed,
            ):
                packed.write((folder / file).read_bytes())


if __name__ == "__main__":
    main()
