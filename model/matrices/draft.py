"""A first structure file for a folder with matrices of another program."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

from model.matrices.text import kind_of
from model.stack.errors import MatricesError

FILE = "structure.toml"
_PAIRS = (
    (r"\.sti$", r"\.mas$"),  # CalculiX
    (r"_STIF\d*\.mtx$", r"_MASS\d*\.mtx$"),  # Abaqus
    (r"^(k|stiff)[^/]*\.(mmf|mtx|npz|mat)$", r"^(m|mass)[^/]*\.(mmf|mtx|npz|mat)$"),
)
"""Names of stiffness and mass as programs, and people, give them."""
_LABELS, _NODES = (".dof", ".mapping"), (".inp", ".bdf", ".dat", ".nas", ".cdb")


def draft_structure(folder: Path) -> str | None:
    """Return a structure file for the matrices in a folder, with "?" where it is to be filled in; None without any.

    Parameters
    ----------
    folder : Path
        The folder.
    """
    names = sorted(own.name for own in folder.iterdir() if own.is_file())
    plain = {name: name.removesuffix(".gz") for name in names}

    def first(pattern: str) -> str | None:
        return next((name for name, own in plain.items() if re.search(pattern, own, re.IGNORECASE)), None)

    def one_of(kinds: Sequence[str]) -> str | None:
        return next((name for name in names if kind_of(Path(name)) in kinds), None)

    pair = next(((k, m) for k, m in ((first(a), first(b)) for a, b in _PAIRS) if k and m and k != m), None)
    full, punch = one_of((".full",)), one_of((".pch",))
    if pair is None and (full or punch):
        pair = (full, full) if full else (f"{punch}#KAAX", f"{punch}#MAAX")
    if pair is None:
        return None
    labels = one_of(_LABELS) or next((name for name in names if name.lower() == "dofs.csv"), None)
    lines = [
        f"name = {json.dumps(folder.resolve().name)}",
        "",
        "[matrices]",
        'units = "?"              # to be filled in: of all files, such as "mm-t-s" or "m-kg-s"',
        f"stiffness = {json.dumps(pair[0])}   # guessed by its name",
        f"mass = {json.dumps(pair[1])}   # guessed by its name",
    ]
    if labels:
        lines.append(f"dofs = {json.dumps(labels)}   # node and direction of each row")
    nodes = one_of(_NODES)
    if nodes:
        lines.append(f"nodes = {json.dumps(nodes)}   # where nodes are, and their sets")
    elif not labels:
        lines.append('# nodes = "job.inp"   # to be filled in: where nodes are')
    lines += [
        "# total_mass_kg = 1.0   # what the structure weighs, which checks units and density",
        "",
        "# [[term]]               # what may vary: see docs/matrices.md",
        '# name = "plate"',
        f"# stiffness = {json.dumps(pair[0])}",
        "# std = 0.1",
        "",
        "[reduction]",
        'band_Hz = "?"            # to be filled in: up to which frequency modes are wanted',
    ]
    return "\n".join(lines) + "\n"


def write_structure(folder: Path) -> Path | None:
    """Write the draft into its folder and return its path; None where there are no matrices, or a file is there.

    Raises
    ------
    MatricesError
        The folder cannot be read or written.
    """
    path = folder / FILE
    try:
        text = None if path.exists() or (folder / "stack.toml").exists() else draft_structure(folder)
        if text is None:
            return None
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        message = f"{folder}: cannot be read or written ({error.strerror})"
        raise MatricesError(message) from error
    return path
