"""What a workbench has open: a campaign and the folder of its results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ema.campaign.campaign import Campaign
from updating.errors import StoreError
from updating.report.results import Results, Tested, read_results
from updating.results.store import read_result
from updating.results.stored_campaign import campaign_file

_FILE = "campaign.toml"


@dataclass(frozen=True, kw_only=True)
class Opened:
    """A campaign file and the folder of its results."""

    campaign: Path
    folder: Path

    def results(self) -> Results:
        """Read what the folder holds now."""
        return read_results(self.folder)

    def stated(self) -> Campaign:
        """Read the campaign as the results have it."""
        return read_result(self.folder / "campaign.json", Campaign)

    def tested(self, name: str) -> Tested:
        """Read one configuration as it is now."""
        return next(own for own in self.results().tested if own.name == name)


def find(path: Path, output: Path | None, make: Callable[[Path, Path], object]) -> Opened:
    """Find what a path means: results, a campaign file, or a folder with one.

    Parameters
    ----------
    path : Path
        What is to be opened.
    output : Path, optional
        Folder for the results of a campaign; by default `out` and the name of the campaign's folder.
    make : callable
        Makes the results of a campaign file in a folder where there are none.

    Raises
    ------
    StoreError
        There is nothing of this kind, or the campaign file of the results is not where it was.
    """
    if (path / "campaign.json").exists():
        return Opened(campaign=campaign_file(path), folder=path)
    file = path / _FILE if (path / _FILE).exists() else path
    if not file.is_file():
        message = (
            f"{path}: nothing to open; give a campaign file, a folder with a campaign.toml, or a folder of results "
            "with a campaign.json"
        )
        raise StoreError(message)
    folder = output if output is not None else Path("out") / file.absolute().parent.name
    if not (folder / "campaign.json").exists():
        make(file, folder)
    return Opened(campaign=file, folder=folder)
