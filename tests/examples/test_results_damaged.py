"""Damaged results are read or refused with a message, by the report as by the command that goes on with them."""

import os
import shutil

import pytest

from updating.errors import UpdatingError
from updating.report.results import read_results
from updating.results.store import read_frf

COUNTS = [10, pytest.param(300, marks=pytest.mark.benchmark)]
FILES = ["campaign.json", "M1/modal_model.json", "M1/fit.json", "M1/quality.json"]


@pytest.fixture
def results(demo, tmp_path):
    """The results of one configuration of the demo, by links."""
    folder = tmp_path / "results"
    shutil.copytree(demo[0], folder, copy_function=os.symlink)
    return folder


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", FILES)
def test_documents(results, survives, damage, name, count, copied):
    file = copied(results / name)
    survives(lambda _: read_results(results), file, UpdatingError, damage(file, count))


@pytest.mark.parametrize("count", COUNTS)
def test_frfs(results, survives, damage, count, copied):
    file = copied(results / "M1/measurement.npz")
    survives(read_frf, file, UpdatingError, damage(file, count))
