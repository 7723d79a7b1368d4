"""The campaign beside its results: named as seen from them, so that both may be moved together."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from ema.campaign.campaign import Campaign
from updating.errors import StoreError
from updating.results.store import file_digest, read_document, write_result

CAMPAIGN = "campaign.json"
"""File of the campaign, in the folder of the results."""


def write_campaign(campaign: Campaign, folder: Path) -> None:
    """Write campaign.json; the path of the campaign file in it is relative to the folder of the results.

    Raises
    ------
    StoreError
        The folder cannot be written.
    """
    inputs = (campaign.path, *points_file(campaign))
    named = replace(campaign, path=_from(folder, campaign.path))
    write_result(folder / CAMPAIGN, named, inputs=inputs, options={})


def points_file(campaign: Campaign) -> tuple[Path, ...]:
    """Return the file of the points, none where the campaign names none."""
    return () if campaign.points is None else (campaign.points,)


def _from(folder: Path, file: Path) -> Path:
    """Return a file as seen from a folder; as it is where they are on different drives."""
    try:
        return Path(Path(os.path.relpath(file, folder)).as_posix())
    except ValueError:
        return file.absolute()


def campaign_file(folder: Path) -> Path:
    """Return the campaign file that results come from.

    It is where the results name it, as seen from them, or from where the command was started that made older ones.
    Results that were copied without that place find the same file, by its digest, in or beside any folder above.

    Raises
    ------
    StoreError
        It is nowhere; the message says where it was.
    """
    document = read_document(folder / CAMPAIGN)
    named = Path(document["result"]["path"])
    above = (
        () if ".." in named.parts else (Path(), *folder.absolute().parents)
    )  # of results of older versions
    for place in (folder.absolute(), *above):
        file = Path(os.path.normpath(place / named))
        if file.is_file():
            return _short(file)
    digests = set(document["provenance"]["inputs"].values())
    for file in _likely(folder, named):
        if file.is_file() and file_digest(file) in digests:
            return _short(file)
    message = (
        f"{folder}: these results come from {named}, which is not there; open the campaign file itself: lamella "
        f"open CAMPAIGN -o {folder}"
    )
    raise StoreError(message)


def _likely(folder: Path, named: Path) -> Iterator[Path]:
    """Yield the places above the results that end as the campaign file was named, those with most in common first."""
    parts = [part for part in named.parts if part not in ("..", named.anchor)]
    for first in range(len(parts)):
        for above in folder.absolute().parents:
            yield above.joinpath(*parts[first:])


def _short(file: Path) -> Path:
    """Return a file as seen from the working folder, where it is below it."""
    absolute, here = Path(os.path.normpath(file.absolute())), Path.cwd()
    return absolute.relative_to(here) if absolute.is_relative_to(here) else absolute
