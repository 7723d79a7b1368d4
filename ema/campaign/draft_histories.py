"""What files of time histories seem to be: which are of one record, which are averaged, which channel is the force."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ema.campaign.campaign_file import format_of
from ema.campaign.estimate import find_hits
from ema.io.array_histories import PULSE, pulse_share, read_histories, read_wav
from ema.io.files import FORCE, UNKNOWN, Code, Contents, dofs_in, natural, with_names
from ema.io.measured_function import MeasuredFunction, Unit, parse_unit
from ema.io.sdynpy import read_data_arrays
from ema.io.table import TableLayout, read_table
from ema.io.uff import read_uff_functions
from ema.io.variables import VariableLayout
from ema.types.errors import MeasurementError
from lamella_shared import Booleans, Integers, Reals

Set = tuple[Contents, ...]
"""Files that hold channels of the same records."""
_FORCE_FILE = re.compile(r"^(f|force|forces|hammer|ham|impact|kraft|sila|kladivo|exc|excitation|input)$", re.IGNORECASE)
_MOTION = re.compile(r"^a(cc)?[ _]?[xyz]$|accel|^acc(?![a-z])|beschl|\bveloc|displac|pospe[sš]", re.IGNORECASE)
"""What a channel of a motion may be called, in English, German or Slovene."""
_NUMBER_OR_DOF = re.compile(r"[ _-]*(?:\d*[+-]?[xyz][+-]?(?![A-Za-z])|\d*)", re.IGNORECASE)
_BLOW = re.compile(r"(hit|blow|strike|schlag|udar\w*|rep|repeat|average|avg|trial)[ _-]*\d+", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class Guessed:
    """A key's value and the comment that stands beside it."""

    value: Any
    comment: str


def side_by_side(contents: Sequence[Contents]) -> list[Set]:
    """Return the files of each record, the force first, as far as their names tell; else each file alone.

    Files belong to one record where their names are the same but for a word, which in one of them is of a force, such
    as ``hit1_force.csv`` and ``hit1_acc.csv``.
    """
    forces = {key: c for c in contents if (key := _force_key(c)) is not None}
    if len(forces) < sum(_force_key(c) is not None for c in contents):
        return [(files,) for files in contents]
    sets: dict[str, list[Contents]] = {key: [c] for key, c in forces.items()}
    for c in contents:
        if _force_key(c) is None:
            key = next((key for key in _keys(c) if key in forces), None)
            if key is None:
                return [(files,) for files in contents]
            sets[key].append(c)
    if len({len(files) for files in sets.values()}) != 1 or any(len(files) == 1 for files in sets.values()):
        return [(files,) for files in contents]
    return [tuple(files) for files in sets.values()]


def _words(contents: Contents) -> list[re.Match[str]]:
    return list(re.finditer(r"[A-Za-z]+?(?=[A-Z][a-z]|[^A-Za-z]|$)", contents.file.stem))


def _without(contents: Contents, start: int, end: int) -> str:
    """Return a name without a word and all signs: what files of one record share."""
    stem = contents.file.stem
    return "/".join((str(contents.file.parent), re.sub(r"[\W_]+", "", f"{stem[:start]} {stem[end:]}").lower()))


def is_of_force(contents: Contents) -> bool:
    """Whether a file's name says that it holds a force."""
    return _force_key(contents) is not None


def _force_key(contents: Contents) -> str | None:
    for word in _words(contents):
        if _FORCE_FILE.match(word[0]):
            return _without(contents, *word.span())
    return None


def _keys(contents: Contents) -> list[str]:
    """Return the name of a file without each of its words, and without each with the number or DOF behind it."""
    number = [_NUMBER_OR_DOF.match(contents.file.stem, word.end()) for word in _words(contents)]
    ends = [(word.start(), {word.end(), n.end()}) for word, n in zip(_words(contents), number, strict=True) if n]
    return [_without(contents, start, end) for start, both in ends for end in sorted(both)]


def averaged(sets: list[Set]) -> list[list[Set]]:
    """Return the records of each run: those whose names differ in the number of a blow alone; else each alone."""
    runs: dict[str, list[Set]] = defaultdict(list)
    for files in sets:
        name = str(files[-1].file)
        place, _, last = name.rpartition("/")
        runs[f"{place}/{_BLOW.sub('', last)}" if _BLOW.search(last) else name].append(files)
    return list(runs.values())


def averaging_of(sets: list[Set], *, looked_at: int = 3) -> dict[str, Guessed]:
    """Return the keys of ``[measurement.time]`` as far as the first records tell, `UNKNOWN` where they do not.

    `looked_at`: records from which the force and the window are seen.
    """
    records = [r for unit in sets[:looked_at] if (r := _record(unit)) is not None]
    titles = _titles(sets[0])
    guessed: dict[str, Guessed] = {}
    force = _force(sets[0], records, titles)
    position = 0 if force is None else force.value
    states = any(f.kind == "force" for record in records for f in record)
    if force is not None and not states:
        guessed["force"] = Guessed(value=position + 1, comment=force.comment)
    guessed |= _window([_forces_first(r)[0] if states else r[position] for r in records if len(r) > position])
    if all(format_of(c.file) == "uff" for c in sets[0]):
        return guessed  # universal files state their units
    if force is None:
        position = int(np.argmin(_are_motions(titles, len(titles)))) if titles else 0
        guessed["force"] = Guessed(value=position + 1, comment="guessed: nothing tells which channel is the force")
    units = [_unit(title) for title in titles]
    unit = units[position] if position < len(units) else None
    others = {label for k, label in enumerate(units) if k != position}
    responses = next(iter(others)) if len(others) == 1 else None
    for key, label, fits in (("force", unit, _is_force), ("response", responses, _is_motion)):
        stated = label is not None and fits(parse_unit(label))
        guessed[f"{key}_unit"] = Guessed(
            value=label if stated else UNKNOWN, comment="as the header says" if stated else "to be filled in"
        )
    return guessed


def dofs_of(files: Set, position: int) -> list[tuple[Code | None, Code | None]]:
    """Return output and input of each function of a record, from the titles of its channels and its file names."""
    if all(c.section is None and c.dofs for c in files):
        return [pair for c in files for pair in c.dofs]
    titles = _titles(files)
    responses = [title for k, title in enumerate(titles) if k != position]
    dofs, _ = with_names(files[-1].file, [dofs_in(title) for title in responses])
    stated = dofs_in(titles[position]) if position < len(titles) else []
    return [(output, stated[0] if stated else force) for output, force in dofs] * files[0].n_run


def _titles(files: Set) -> list[str]:
    """Return what each channel is called; the only one of a file among others is called like the file."""
    return [
        title or (c.file.stem if len(files) > 1 and len(c.titles) == 1 else "") for c in files for title in c.titles
    ]


def _record(files: Set) -> list[MeasuredFunction] | None:
    """Return the channels of a first record; None where its description lacks something, or it cannot be read."""
    channels: list[MeasuredFunction] = []
    for c in files:
        keys = {key: 1.0 if (key, value) == ("sampling_Hz", UNKNOWN) else value for key, value in c.keys.items()}
        keys = {key: (value,) if key == "history" and isinstance(value, str) else value for key, value in keys.items()}
        kind = format_of(c.file)
        try:
            if kind == "uff":
                channels += [f for f in read_uff_functions(c.file)[0] if f.kind in ("force", "response")]
            elif kind == "wav":
                channels += read_wav(c.file, (1.0,))
            elif c.section is None:
                channels += [f for f in read_data_arrays(c.file, None) if f.kind == "response"]
            elif kind == "csv":
                channels += read_table(c.file, TableLayout.model_validate(keys), None)
            else:
                layout = VariableLayout.model_validate(keys)
                channels += read_histories(c.file, layout, matlab=kind == "mat")[0][0]
        except (MeasurementError, ValueError):
            return None
    return channels


def _forces_first(record: list[MeasuredFunction]) -> list[MeasuredFunction]:
    return sorted(record, key=lambda f: f.kind != "force")


def _force(files: Set, records: list[list[MeasuredFunction]], titles: list[str]) -> Guessed | None:
    """Return the position of the force, from 0: its title, its file, or its short pulse."""
    if len(files) > 1:
        return Guessed(value=0, comment="guessed: the files' names say so")
    called = [k for k, title in enumerate(titles) if FORCE.search(title)]
    if len(called) == 1:
        return Guessed(value=called[0], comment="guessed: its title says so")
    shares = [pulse_share(np.array([f.value for f in record])) for record in records if _of_one_length(record)]
    shares = [np.where(_are_motions(titles, share.size), 1.0, share) for share in shares]
    narrowest = Counter(int(np.argmin(share)) for share in shares if share.min() < PULSE)
    if not narrowest:
        return None
    return Guessed(value=narrowest.most_common(1)[0][0], comment="guessed: it is a short pulse, as of a hammer")


def of_motions_alone(files: Set) -> bool:
    """Whether the titles of all channels of a record state units of motions: there is no force among them."""
    titles = _titles(files)
    return len(titles) > 1 and bool(_are_motions(titles, len(titles)).all())


def _are_motions(titles: list[str], count: int) -> Booleans:
    """Tell whether the title of each channel states the unit or the name of a motion, so that it is no force."""
    if len(titles) != count:
        return np.zeros(count, dtype=bool)
    units = [_unit(title) for title in titles]
    called = [unit is None and _MOTION.search(title) is not None for unit, title in zip(units, titles, strict=True)]
    stated = [unit is not None and _is_motion(parse_unit(unit)) for unit in units]
    return np.array(called) | np.array(stated)


def _of_one_length(record: list[MeasuredFunction]) -> bool:
    return len({f.value.size for f in record}) == 1


def _window(forces: list[MeasuredFunction], *, fewest_hits: int = 3) -> dict[str, Guessed]:
    """Return the window, and of records of many hits the blocks.

    `fewest_hits`: hits in one record; two may be a double hit.
    """
    shares = [float(pulse_share(f.value)) for f in forces]
    if not shares or max(shares) > PULSE:
        return {"window": Guessed(value=UNKNOWN, comment='to be filled in: "hann" or "boxcar"')}
    guessed = {"window": Guessed(value="boxcar", comment="guessed: the force is a short pulse, as of a hammer")}
    hits = [_hits(f.value) for f in forces]
    if min(map(len, hits)) < fewest_hits:
        return guessed
    step = float(np.diff(forces[0].abscissa).mean())
    between = min(float(np.diff(of_record).min()) for of_record in hits) * step
    block = float(f"{0.9 * between:.1e}")
    said = f"guessed: hits are {between:.3g} s apart or more; shorten it where responses have died away before"
    guessed["block_s"] = Guessed(value=block, comment=said)
    guessed["before_hit_s"] = Guessed(value=float(f"{0.02 * block:.1e}"), comment="guessed")
    return guessed


def _hits(
    force: Reals,
    *,
    # Of a record.
    shortest_block: float = 0.02,
) -> Integers:
    return find_hits(force, max(1, int(shortest_block * force.size)))


def _unit(title: str) -> str | None:
    """Return the unit of a channel in its title, in brackets or as its last word."""
    for label in (*re.findall(r"[\[(]([^\[\]]+?)[\])](?:\s|$)", title), *title.split()[-1:]):
        try:
            unit = parse_unit(label)
        except MeasurementError:
            continue
        if _is_force(unit) or _is_motion(unit):
            return label
    return None


def _is_force(unit: Unit) -> bool:
    return unit.is_force


def _is_motion(unit: Unit) -> bool:
    return unit.motion is not None


def in_order(sets: list[Set]) -> bool:
    """Whether the files of every place come in the natural order of their names, as wildcards give them."""
    return all(
        list(column) == sorted(column, key=natural) for column in zip(*([c.file for c in s] for s in sets), strict=True)
    )
