"""`lamella new`: look at the files in a folder and write a first campaign file."""

from __future__ import annotations

from pathlib import Path

from ema.campaign.draft import draft
from ema.campaign.draft_file import draft_file, draft_modes, write_draft
from ema.types.errors import CampaignError
from model.matrices.text import write_structure
from updating.commands.terminal import OUT, print_lines


def new_command(folder: Path) -> None:
    """Look at the files in a folder, write a first campaign file, and say what it takes and what is left to fill in."""
    structure = write_structure(folder) if folder.is_dir() else None
    if structure is not None:
        OUT.print(f"Structure: {structure}; fill in units and reduction.band_Hz, and what may vary; see lamella model.")
    try:
        drafted = draft_modes(folder) or draft(folder)
    except CampaignError as error:
        if structure is None:
            raise
        OUT.print(f"No campaign: {error}", soft_wrap=True)
        return
    file = draft_file(drafted)
    path = write_draft(drafted, file)
    for name, files in drafted.modes.items():
        OUT.print(f"  {name}: modes in {', '.join(f.name for f in files)}")
    for name, contents in drafted.configurations.items():
        n_frf = sum(len(c.dofs) for c in contents)
        held = "time histories" if any(c.is_time for c in contents) else f"{n_frf} functions"
        OUT.print(f"  {name}: {len(contents)} files, {held}")
    print_lines(OUT, drafted.left_out, indent="  left out: ", soft_wrap=True)
    OUT.print(f"Campaign: {path}; look at what is marked as guessed.")
    OUT.print("To be filled in, since the files do not tell:")
    print_lines(OUT, file.missing, soft_wrap=True)
