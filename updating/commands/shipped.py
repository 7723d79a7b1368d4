"""Data that travels with the program: beside its packages in a checkout, in the environment's share/ if installed."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

from updating.errors import StoreError

_FOLDER = "share/lamella"
_CHECKOUT = Path(__file__).parents[2] / "data"


def shipped_data(name: str) -> Path:
    """Return a folder of data that travels with the program, as seen from the working directory where it is below.

    Parameters
    ----------
    name : str
        Such as "demo_diagnosis".

    Raises
    ------
    StoreError
        This installation lacks it.
    """
    found = _CHECKOUT / name
    if not found.is_dir():
        found = _installed(name)
    here = Path.cwd()
    return found.relative_to(here) if found.is_relative_to(here) else found


def _installed(name: str) -> Path:
    try:
        listed = files("lamella") or []
    except PackageNotFoundError:
        listed = []
    places = {
        Path(str(file.locate())).resolve().parent
        for file in listed
        if f"{_FOLDER}/{name}/" in file.as_posix()
    }
    top = min(places, key=lambda place: len(place.parts), default=None)
    if top is None or not top.is_dir():
        message = (
            f"this installation of Lamella lacks the data {name!r}: install it as built, or run in a checkout, "
            f"where it is data/{name}"
        )
        raise StoreError(message)
    return top
