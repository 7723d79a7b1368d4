"""Data types whose arrays are read-only and of checked shapes."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from lamella_shared import arrays


@dataclass(frozen=True, eq=False, kw_only=True)
class Inner:
    node: tuple[int, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"any": "node", "node 3": "direction", "node mode": "shape", "mode": "frequency", "inner.node": "force"})
class Shapes:
    node: "NDArray[np.int64]"
    direction: "NDArray[np.float64]"
    shape: "NDArray[np.complex128]"
    frequency: "NDArray[np.float64]"
    inner: Inner
    force: "NDArray[np.float64] | None" = None

    def __post_init__(self) -> None:
        if np.any(self.frequency <= 0.0):
            message = "no frequency"
            raise ValueError(message)


GIVEN = {
    "node": [1, 2], "direction": np.zeros((2, 3)), "shape": [[1.0], [2.0]], "frequency": [5.0],
    "inner": Inner(node=(7, 8, 9)),
}  # fmt: skip


def test_arrays_are_of_the_types_that_are_stated_and_nobody_writes_them():
    made = Shapes(**GIVEN)
    assert [getattr(made, name).dtype for name in ("node", "shape", "frequency")] == [np.int64, complex, float]
    assert made.force is None
    with pytest.raises(ValueError, match="read-only"):
        made.shape[0, 0] = 0.0
    assert replace(made, force=np.ones(3)).force.size == 3


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("direction", np.zeros((3, 3)), r"Shapes.direction: expected shape \(2, 3\), got \(3, 3\)"),
        ("shape", np.zeros(2), r"Shapes.shape: expected shape \(2, any\), got \(2,\)"),
        ("frequency", [5.0, 6.0], r"Shapes.frequency: expected shape \(1\), got \(2,\)"),
        ("force", np.ones(2), r"Shapes.force: expected shape \(3\), got \(2,\)"),
        ("frequency", [0.0], "no frequency"),
    ],
)
def test_another_shape_is_said(name, value, said):
    with pytest.raises(ValueError, match=said):
        Shapes(**{**GIVEN, name: value})
