"""Run a study, or go on with it, and print its figures: `python -m tests.studies NAME -o RECORD`."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from tests.independent.layered import Layered
from tests.studies import (
    blind,
    changes,
    corruptions,
    large_matrices,
    other_models,
    pooled,
    reduced_basis,
    slipping,
    smallest_changes,
)
from tests.studies.blind_figures import figures

Study = Callable[[int, Path], Sequence[str]]


def _rows(found: Any) -> list[str]:
    return [one.row for one in found]


STUDIES: dict[str, tuple[Study, int]] = {
    "blind": (lambda n, file: _rows(figures(blind.study_of(blind.planned(full=True)[:n], file))), 134),
    "other_models": (
        lambda n, file: _rows(
            other_models.figures(other_models.study_of(other_models.planned(n), "layered", file))
        ),
        306,
    ),
    "pooled": (lambda n, file: _rows(pooled.figures(pooled.study_of(n, Layered(), file))), 60),
    "changes": (lambda n, file: _rows(changes.figures(changes.study_of(n, file))), 40),
    "smallest_changes": (
        lambda n, file: _rows(smallest_changes.study_of(n, file)), len(smallest_changes.CASES),
    ),
    "slipping": (
        lambda n, file: _rows(slipping.figures(slipping.study_of(slipping.planned(n), file))), 100,
    ),
    "corruptions": (
        lambda n, file: corruptions.rows(
            corruptions.study_of(range(corruptions.FIRST_SEED, corruptions.FIRST_SEED + n), file)
        ),
        corruptions.SEEDS,
    ),
    "large_matrices": (lambda n, file: large_matrices.rows(large_matrices.study_of(n, file)), 8),
    "reduced_basis": (lambda n, file: reduced_basis.rows(reduced_basis.study_of(n, file)), 1000),
}  # fmt: skip
"""Each study with the number of its cases, or of the campaigns that are spoiled, where none is asked for."""

if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tests.studies", description=__doc__)
    parser.add_argument("name", choices=STUDIES)
    parser.add_argument("-o", "--record", type=Path, required=True, help="file of the cases, a line each")
    parser.add_argument("-n", "--number", type=int, help="how many cases")
    asked = parser.parse_args()
    run, number = STUDIES[asked.name]
    print("\n".join(run(asked.number or number, asked.record)))
