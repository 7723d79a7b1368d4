"""A structure of ten thousand equations is read, reduced and fitted in the time and memory that its size allows."""

import pytest

from tests.studies.large_matrices import run


@pytest.mark.slow
def test_terms_of_a_large_structure_are_fitted():
    found = run(10_000, "text")
    assert found.error < 4.0
    assert found.read + found.fitted < 20.0  # s of a processor; 100,000 equations take five times that of 10,000
    assert found.memory < 1.0
