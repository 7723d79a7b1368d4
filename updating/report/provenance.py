"""What made the results: versions, options and input files with their digests."""

from __future__ import annotations

import hashlib

from updating.report.part import Section, Table
from updating.report.results import Results


def provenance_section(results: Results) -> Section:
    """List what each result was made with and from."""
    return Section(title="Provenance", blocks=(result_table(results), input_table(results)))


def result_table(results: Results) -> Table:
    """List versions and options of every result, and a digest over all of its inputs; equal ones together."""
    files: dict[tuple[str, str, str], list[str]] = {}
    for file, made in results.origin.items():
        row = (
            ", ".join(f"{name} {number}" for name, number in made["versions"].items()),
            ", ".join(f"{name} = {value}" for name, value in made["options"].items()) or "none",
            f"{len(made['inputs'])}, all: {_digest(made['inputs'])}",
        )
        files.setdefault(row, []).append(file)
    rows = tuple(
        (own[0] if len(own) == 1 else f"{own[0]} and {len(own) - 1} more", *row) for row, own in files.items()
    )
    return Table(
        title="",
        header=("result", "versions", "options", "input files and the SHA-256 of their digests"),
        rows=rows,
        note="The numbers of every figure stand beside it as CSV in the folder figures.",
    )


def input_table(results: Results) -> Table:
    """List every input file with its digest."""
    digest = {(name, value) for made in results.origin.values() for name, value in made["inputs"].items()}
    return Table(
        title="Input files",
        header=("file", "SHA-256"),
        rows=tuple(sorted(digest)),
        note="Files of the same name are of different configurations.",
        folded=True,
    )


def _digest(inputs: dict[str, str]) -> str:
    """First digits of the digest over the digests of all files."""
    return hashlib.sha256("".join(inputs[name] for name in sorted(inputs)).encode()).hexdigest()[:16]
