"""Band and order written into a campaign file, all other lines of which stay as they are."""

from __future__ import annotations

from pathlib import Path

import tomlkit
from tomlkit.exceptions import TOMLKitError

from ema.io.files import plain_bytes
from updating.errors import StoreError
from updating.results.store import write_bytes

_SECTION = "identification"


def write_identification(campaign: Path, band: tuple[float, float], order: int) -> None:
    """Set `band_Hz` and `order` of a campaign file.

    Parameters
    ----------
    campaign : Path
        The file; its comments and all else stay.
    band : (float, float)
        Frequency band, Hz.
    order : int
        Highest model order.

    Raises
    ------
    StoreError
        The file cannot be read or written.
    """
    try:
        content = tomlkit.parse(plain_bytes(campaign).decode("utf-8-sig"))
    except (OSError, UnicodeDecodeError, TOMLKitError) as error:
        message = f"{campaign}: cannot be read: {error}"
        raise StoreError(message) from error
    section = content.setdefault(_SECTION, tomlkit.table())
    section["band_Hz"] = list(band)
    section["order"] = order
    write_bytes(campaign, tomlkit.dumps(content).encode())
