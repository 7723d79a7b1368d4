"""One run of the main job on the shipped campaign, shared by the tests of its results."""

from pathlib import Path

import pytest
from rich.console import Console

from updating import jobs

DATA = Path(__file__).parents[2] / "data"


@pytest.fixture(scope="session")
def demo(tmp_path_factory):
    """The folder of `lamella fit data/demo_stack/campaign.toml` and what it returned."""
    folder = tmp_path_factory.mktemp("demo")
    results = jobs.fit(DATA / "demo_stack/campaign.toml", folder, 0.8, Console(quiet=True))
    return folder, results
