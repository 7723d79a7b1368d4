"""Arguments and options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Folder = Annotated[
    Path,
    typer.Option("--output", "-o", metavar="DIR", help="Folder for the results; made if it is not there."),
]
SharedEffects = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="NAME",
        help="Physical effect to fit; may be given several times.",
        show_default=False,
    ),
]
ResultsFolder = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder with results.", show_default=False)
]
CampaignFile = Annotated[
    Path, typer.Argument(metavar="CAMPAIGN", help="Campaign file (TOML).", show_default=False)
]
EffectFiles = Annotated[
    list[Path] | None,
    typer.Option(
        "--effect-file",
        metavar="FILE",
        help="Python file that ends in EFFECT = Effect(...), whose code runs; may be given several times.",
    ),
]
ScatterFile = Annotated[
    Path | None,
    typer.Option(
        "--scatter",
        metavar="FILE",
        help="What separates a right model from a right measurement (TOML), where your laboratory knows better.",
        show_default=False,
    ),
]
Keep = Annotated[
    bool,
    typer.Option(
        "--keep",
        help="Use results that are there although they were changed or come from other files; the report says which.",
    ),
]
IdentifyAnew = Annotated[
    bool,
    typer.Option(
        "--identify-anew",
        help="Choose all poles automatically again; without it, poles chosen by hand are used by every command.",
    ),
]
Cluster = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Address of a Dask scheduler whose workers do the work, such as tcp://10.0.0.1:8786; "
        "all processors of this machine by default.",
        show_default=False,
    ),
]
