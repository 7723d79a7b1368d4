"""A stack solved by CalculiX, as an independent peer of `model`; its frequencies are stored beside this file.

Every lamina is a layer of solid elements with 20 nodes, every interface a thin orthotropic layer of such elements whose
shear and normal stiffness per area are those of the contact. So nothing is shared with `model`: no shell theory, no
functions of z, no assembly, no eigensolver. Soft springs at the corners keep the free stack in its place.

The command that makes the stored result anew, with CalculiX 2.20 as `ccx` on the path (about a minute):

    python tests/peers/calculix_stack.py
"""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
import tempfile
from pathlib import Path

RESULT = Path(__file__).with_suffix(".json")

LENGTH, WIDTH, HEIGHT = (0.3, 0.08, 0.018)  # m; thin laminas: the free edges of a solid twist softer by 0.63 t / width
N_LAMINA, N_X, N_Y = 18, 24, 8
YOUNG, POISSON, DENSITY = 2e11, 0.28, 7650.0
SHEAR, NORMAL = 264e6, 5e9  # moduli of the contact over the pitch, Pa
WEAK, WEAK_SHARE = 5, 0.1  # the interface above lamina 5 (from 0) has a tenth of the shear modulus
LAYER = 0.02  # thickness of a contact layer over the pitch
N_MODE = 10
SPRING = 1e3  # N/m, at eight corners along three axes: rigid-body modes stay below 10 Hz

# corners and sides of a brick in the order of its nodes, in half element lengths
_BRICK = (
    (0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2),
    (1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2),
    (0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1),
)  # fmt: skip


def deck() -> str:
    """Return the input of CalculiX."""
    pitch = HEIGHT / N_LAMINA
    heights = [0.0]
    for k in range(2 * N_LAMINA - 1):
        heights.append(heights[-1] + pitch * (LAYER if k % 2 else 1.0 - LAYER))
    number: dict[tuple[int, int, int], int] = {}
    elements: dict[str, list[str]] = {"LAMINAS": [], "CONTACT": [], "WEAK": []}
    count = 0
    for k in range(2 * N_LAMINA - 1):
        name = "LAMINAS" if k % 2 == 0 else "WEAK" if k // 2 == WEAK else "CONTACT"
        for i in range(N_X):
            for j in range(N_Y):
                nodes = []
                for di, dj, dk in _BRICK:
                    key = (2 * i + di, 2 * j + dj, 2 * k + dk)
                    nodes.append(number.setdefault(key, len(number) + 1))
                count += 1
                parts = [count, *nodes]
                elements[name].append(",".join(map(str, parts[:11])) + ",\n" + ",".join(map(str, parts[11:])))
    lines = ["*NODE"]
    for (i, j, k), node in number.items():
        low, high = heights[k // 2], heights[(k + 1) // 2]
        x, y, z = i * LENGTH / N_X / 2, j * WIDTH / N_Y / 2, (low + high) / 2
        lines.append(f"{node},{x:.12g},{y:.12g},{z:.12g}")
    for name, rows in elements.items():
        lines += [f"*ELEMENT,TYPE=C3D20R,ELSET={name}", *rows]
    corners = [number[i, j, k] for i in (0, 2 * N_X) for j in (0, 2 * N_Y) for k in (0, 4 * N_LAMINA - 2)]
    for axis in (1, 2, 3):
        lines.append(f"*ELEMENT,TYPE=SPRING1,ELSET=GROUND{axis}")
        for node in corners:
            count += 1
            lines.append(f"{count},{node}")
        lines += [f"*SPRING,ELSET=GROUND{axis}", str(axis), f"{SPRING:.1f}"]
    full = 1.0 / (1.0 - LAYER)  # a lamina takes the stiffness and mass of its pitch
    lines += ["*MATERIAL,NAME=STEEL", "*ELASTIC", f"{YOUNG * full:.12g},{POISSON}"]
    lines += ["*DENSITY", f"{DENSITY * full:.12g}", "*SOLID SECTION,ELSET=LAMINAS,MATERIAL=STEEL"]
    for name, share in (("CONTACT", 1.0), ("WEAK", WEAK_SHARE)):
        shear, normal = SHEAR * LAYER * share, NORMAL * LAYER
        lines += [
            f"*MATERIAL,NAME=M{name}",
            "*ELASTIC,TYPE=ENGINEERING CONSTANTS",
            f"1e6,1e6,{normal:.12g},0,0,0,1e6,{shear:.12g}",
            f"{shear:.12g}",
            "*DENSITY",
            "1.0",
            f"*SOLID SECTION,ELSET={name},MATERIAL=M{name}",
        ]
    lines += ["*STEP", "*FREQUENCY", str(6 + N_MODE), "*END STEP", ""]
    return "\n".join(lines)


def solve() -> dict[str, object]:
    """Run CalculiX and return its elastic frequencies with what made them."""
    with tempfile.TemporaryDirectory() as folder:
        text = deck()
        (Path(folder) / "stack.inp").write_text(text)
        version = subprocess.run(["ccx", "-v"], capture_output=True, text=True, check=False).stdout
        subprocess.run(["ccx", "stack"], cwd=folder, check=True, capture_output=True)
        table = (Path(folder) / "stack.dat").read_text().split("P A R T I C I P A T I O N")[0]
    rows = re.findall(r"^\s*\d+\s+\S+\s+\S+\s+(\S+)\s+\S+\s*$", table, flags=re.MULTILINE)
    nodes = text.split("*ELEMENT")[0].count("\n") - 1
    return {
        "program": " ".join(version.split()).replace("This is", "CalculiX"),
        "command": "python tests/peers/calculix_stack.py",
        "deck_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "degrees_of_freedom": 3 * nodes,
        "frequency_Hz": [float(row) for row in rows][6:],
    }


if __name__ == "__main__":
    RESULT.write_text(json.dumps(solve(), indent=2) + "\n")
