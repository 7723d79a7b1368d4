"""Poles chosen by hand: kept with the results, so that every later command identifies with them."""

from __future__ import annotations

from pathlib import Path

from ema.campaign.campaign import Campaign
from ema.identification.exchange import read_poles
from ema.io.files import plain_bytes
from updating.errors import StoreError
from updating.results.store import folder_name, write_bytes
from updating.results.stored_campaign import CAMPAIGN, campaign_file

CHOSEN = "chosen_poles.txt"
"""File of the poles that a user chose, in the folder of a configuration."""
BY_HAND = "chosen by hand"
_ABOVE = (
    2  # folders above the results, which may be results, too: what a fit in the workbench writes is in them
)


def keep_choice(poles: Path, folder: Path) -> None:
    """Make the poles of a file those that every later command identifies a configuration with.

    Parameters
    ----------
    poles : Path
        The file, see `ema.identification.exchange`.
    folder : Path
        Folder of the configuration.

    Raises
    ------
    IdentificationError
        The file cannot be read or holds no poles.
    StoreError
        The folder cannot be written.
    """
    read_poles(poles)  # what is wrong with it is said of this file
    write_bytes(folder / CHOSEN, plain_bytes(poles))


def forget_choices(output: Path) -> None:
    """Let the poles of all configurations in a results folder, and in results in it, be chosen automatically again."""
    for file in (*output.glob(f"*/{CHOSEN}"), *output.glob(f"*/*/{CHOSEN}")):
        file.unlink()


def chosen_poles(campaign: Campaign, output: Path, given: Path | None = None) -> dict[str, Path]:
    """Return the file of the chosen poles of every configuration that has one.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    output : Path
        Folder of the results. Results that lie in other results of the same campaign take the choice from there.
    given : Path, optional
        Folder whose poles.txt files are chosen from now on.

    Raises
    ------
    IdentificationError
        A poles.txt cannot be read.
    StoreError
        `given` holds no poles.txt of this campaign, or the results cannot be written.
    """
    output = output.absolute()
    if given is not None:
        files = {
            c.name: given.absolute() / folder_name(c.name) / "poles.txt" for c in campaign.configurations
        }
        found = {name: file for name, file in files.items() if file.exists()}
        if not found:
            message = (
                f"{given}: no */poles.txt of this campaign; `lamella ema` writes them beside its results"
            )
            raise StoreError(message)
        for name, file in found.items():
            keep_choice(file, output / folder_name(name))
    places = [output, *(p for p in output.parents[:_ABOVE] if _is_of(campaign, p))]
    chosen = {}
    for configuration in campaign.configurations:
        files_ = (place / folder_name(configuration.name) / CHOSEN for place in places)
        chosen[configuration.name] = next((file for file in files_ if file.exists()), None)
    return {name: file for name, file in chosen.items() if file is not None}


def _is_of(campaign: Campaign, folder: Path) -> bool:
    """Whether a folder holds results of a campaign."""
    try:
        return (folder / CAMPAIGN).exists() and campaign_file(folder).samefile(campaign.path)
    except (StoreError, OSError):
        return False


def choice_note(poles: Path) -> str:
    """Say that the poles of a configuration were chosen by hand, and how that is undone."""
    number = read_poles(poles).size
    return (
        f"its {number} poles were {BY_HAND} ({poles.parent.name}/{poles.name}) and are used by every command; "
        "the same command with --identify-anew chooses them automatically again"
    )
