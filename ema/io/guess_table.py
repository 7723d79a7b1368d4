"""How the columns of a text file seem to hold FRFs or time histories, beside each other or below each other by DOF."""

from __future__ import annotations

import gzip
import re
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ema.io.files import (
    FORCE,
    UNKNOWN,
    Code,
    Contents,
    dof_of_cells,
    dofs_in,
    is_other_ratio,
    lacks_sign,
    polar_units,
    ratios_in,
    unit_in,
    volts_in,
    with_names,
)
from ema.io.guess_variables import LONGEST_SAMPLE
from ema.io.measured_function import is_uneven, rate_of_rounded
from ema.io.rows import (
    DELIMITERS,
    FEWEST_ROWS,
    SEPARATORS,
    TextTable,
    cells_of,
    cut_text,
    encoding_of,
    is_number,
    number,
    numbers_of,
    rows_of,
    titles_of,
    unpacked,
)
from lamella_shared import Reals

_OF_FREQUENCY = r"frequency response|transfer function|\bfrf\b|x-axis unit\W*hz\b|x_dimension\W+freq"
_OF_FRFS = (
    r"frequency.?response|transfer|\bfrf|\bH[12v]?\b|response.?func|/\W?(?:[km]?N|lbf?)\b|accelerance|"
    r"inertance|mobility|receptance|compliance|Übertragung|prenosn"
)
_OF_SPECTRA = (
    r"auto.?(?:power.?)?(?:spectr|spekt)\w*|(?:power|cross|frequency|leistungs|amplituden).?(?:spectr|spekt)\w*|"
    r"\b(?:psd|asd|csd)\b|spectral densit\w*|\b(?:amplitude|linear|complex) spectrum|\bspectrum$"
)
OF_INPUT = r"\bref|\binp|\bdof in\b|\bin dof\b|\bexc|forc|anreg|kraft"
_OF_OUTPUT = r"resp|\bout|antwort"
_OF_POINTS = rf"{_OF_OUTPUT}|{OF_INPUT}|\bdof\b|point|node|punkt"
_OF_A_PART = (
    r"(?:^|[\W_])(real|re|imag(?:inary|inaer)?|im|mag(?:nitude)?s?|amp(?:l(?:itude)?)?s?|abs|phase|phas|angle|betrag)"
    r"(?:$|[\W_\d])"
)
_OF_ONE_POINT = re.compile(
    r"\b(?:point|node|punkt|knoten|position)[ _]?(?:index|number|no|nr|id)?\b\W{1,4}(\d{1,9})\b", re.IGNORECASE
)
_TITLE_OF_AXIS = r"freq|\bhz\b|^f\b|\btime\b|\bzeit\b|^t\b"
_NAMELESS = r"(?:var|col(?:umn)?|c|y|x|data|unnamed|field|feld|wert|value|spalte)?\W*\d+"
"""A title that says nothing, as programs number columns: two such may be the parts of one function."""
_OF_TIME = r"sampl(e|ing) (rate|frequency|freq|interval|period)|abtast(rate|freq|int)|vzor[cč]enj|x_dimension\W+time"
_NUMBER = r"[^0-9\n]{0,20}(\d+(?:[.,]\d+)?(?:e[+-]?\d+)?)"
_RATE = rf"(?:sampl\w*[ _]?(?:rate|freq\w*)|abtast(?:rate|freq\w*)|vzor[cč]enj\w*){_NUMBER}\s*(khz)?"
_STEP = rf"(?:delta_x|sampl\w*[ _]?(?:interval|period|time)|abtastint\w*){_NUMBER}\s*(ms)?"
_FACTORS = {
    "khz": 1e3, "rad/s": 1.0 / (2.0 * np.pi), "ms": 1e-3, "msec": 1e-3, "milli": 1e-3, "µs": 1e-6, "us": 1e-6,
    "micro": 1e-6, "ns": 1e-9, "nano": 1e-9,
}  # fmt: skip
_TITLE_OF_TIME = (
    r"\btime|\bdate|\bzeit|\b[cč]as\b|^t\b|[\[(]s[\])]|\b(milli|micro|nano)(s\b|sec)|\bsec(onds?|s)?\b|elapsed|"
    r"epoch"
)
_KINDS = (
    ("coherence", r"[ck]oh[eä]|\bcoh|gamma"),
    ("phase", r"phase|\bphi\b|angle|\bfaza|\bfazni|winkel"),
    ("imaginary", r"\bim(ag\w*)?\b"),
    ("real", r"\breal\w*\b|(?<!\bdb )\bre\b(?!\.? *\d)"),  # "dB re 1 g/N" is a magnitude
    ("magnitude", r"\bmag\w*|\bamp\w*|\babs\b|\bdb\b|modulus|betrag"),
)  # fmt: skip
_PAIRS = {"real-imaginary": ("real", "imaginary"), "magnitude-phase": ("magnitude", "phase")}


def guess_table(path: Path) -> Contents | None:
    """Return what a text file seems to hold; None where it seems to hold no measured function.

    Delimiter, decimal mark and header are those with which its rows are numbers. What the columns are is what their
    titles say, else what their numbers look like.

    Raises
    ------
    MeasurementError
        One of its first rows of numbers has other cells than the others.
    """
    text = cut_text(path)
    with np.errstate(over="ignore", invalid="ignore"):  # of numbers that are not finite
        contents = None if text is None else _guess(path, text)
    if text is None or contents is None:
        return contents
    if not contents.is_time and len(contents.dofs) == 1 and contents.dofs[0][0] is None:
        contents = replace(contents, dofs=tuple(_dofs_in_header(head) for head in text.heads))
        stated = {int(point) for point in _OF_ONE_POINT.findall("\n".join(text.heads))} - {0}
        contents = replace(contents, point=stated.pop() if len(stated) == 1 == text.n_segment else None)
    if text.n_segment == 1:
        return contents
    what = (
        "records that are averaged; one that goes on where the one before ends is joined to it"
        if contents.is_time
        else "functions of their own"
    )
    guess = f"the {text.n_segment} segments of the file are {what}"
    told = contents.is_time or len(contents.dofs) == text.n_segment > 1
    dofs = contents.dofs if told else contents.dofs * text.n_segment
    return replace(contents, dofs=dofs, guesses=(guess, *contents.guesses))


def _dofs_in_header(head: str) -> tuple[Code | None, Code | None]:
    """Return output and input of a segment of one FRF as its header says, in rows that tell of points.

    A row of one DOF may say which of both it is; else the output comes first.
    """
    rows = [
        row for row in head.splitlines()
        if re.search(_OF_POINTS, row, re.IGNORECASE) or ("/" in row and len(dofs_in(row)) == 2)
    ]  # fmt: skip
    dofs = [code for row in rows for code in dofs_in(row)]
    outputs, inputs = (
        [dofs_in(row)[0] for row in rows if len(dofs_in(row)) == 1 and _tells_of(row, this, other)]
        for this, other in ((_OF_OUTPUT, OF_INPUT), (OF_INPUT, _OF_OUTPUT))
    )
    if len(outputs) + len(inputs) == len(dofs) and len(outputs) < 2 and len(inputs) == 1:
        return (outputs[0] if outputs else None, inputs[0])
    return (dofs[0] if dofs else None, dofs[1] if len(dofs) > 1 else None)


def _tells_of(row: str, this: str, other: str) -> bool:
    return bool(re.search(this, row, re.IGNORECASE)) and not re.search(other, row, re.IGNORECASE)


def _guess(path: Path, text: TextTable) -> Contents | None:
    """Return what a text file cut into header and numbers seems to hold."""
    keys: dict[str, Any] = {}
    guesses: list[str] = []
    for key, value, usual in (
        ("delimiter", text.delimiter, "comma"),
        ("decimal", text.decimal, "."),
        ("header_rows", text.n_header, 0),
        ("encoding", text.encoding, "utf-8"),
    ):
        if value != usual:
            keys[key] = value
    axis = _axis(text)
    if axis is None and (histories := _without_times(path, text, keys)) is not None:
        return histories
    has_axis = axis is not None
    if axis is None:
        keys |= {"axis_column": 0, "axis_step": UNKNOWN}
    elif axis > 0:
        keys["axis_column"] = axis + 1
        guesses.append(
            "the first column counts the rows, and the second is taken as the axis"
            if _counts_rows(text)
            else f"column {axis + 1} is taken as the axis, as its title says"
        )
    columns = _beside(text, axis)
    if axis is not None and _is_time(text, axis, guesses):
        return _with_times(path, text, axis, keys, guesses)
    n_guessed = len(guesses)
    if _spectrum_in(text, columns):
        return None
    if _other_ratio_in(text) or _one_part(path, text, columns):
        return None
    guessed = functions_of(text, columns, guesses)
    by_numbers = len(guesses) > n_guessed
    if guessed is None or (guesses and not has_axis):  # any table of numbers
        return None
    layout, groups, coherence = guessed
    factor = _axis_factor(text, axis, r"\bkhz\b|rad/s")
    if factor != 1.0 and axis is not None:
        keys |= _axis_keys(text.value[:, axis].real, factor)
        guesses.append(f"the frequencies are those of their column times {factor:.6g}")
    if axis or factor != 1.0 or [c for group in groups for c in group] != list(range(1, text.value.shape[1])):
        keys["columns"] = [[c + 1 for c in group] for group in groups]
    if coherence:
        keys["coherence_columns"] = [c + 1 for c in coherence]
    if layout == "magnitude-phase":
        titles = [" ".join(text.title(group[k]) for group in groups) for k in (0, 1)]
        size, phase = (text.value[:, [group[k] for group in groups]].real for k in (0, 1))
        keys |= polar_units((titles[0], titles[1]), size, phase, guesses)
    if any(lacks_sign(text.title(group[0])) for group in groups):
        guesses.append("DOFs without a sign are taken as +")
    said = " ".join(cell for row in text.header for cell in row)
    dofs, named = with_names(path, [dofs_in(text.title(group[0])) for group in groups])
    return Contents(
        file=path,
        section="table",
        keys={"layout": layout} | keys,
        unit=unit_in(said),
        odd_unit=volts_in(said),
        dofs=dofs,
        by_numbers=by_numbers,
        guesses=(*guesses, *named),
    )


def not_understood(path: Path) -> str:
    """Return in words what a text file lacks to be a measurement."""
    text = cut_text(path)
    if text is None:
        return _no_table(path)
    width = text.value.shape[1]
    titles = ", ".join(filter(None, (text.title(c) for c in range(width))))
    spectrum = _spectrum_in(text, list(range(1, width)))
    if spectrum:
        return f"it tells of {spectrum!r}: spectra of one channel are no FRFs; export FRFs, response over force"
    if other := _other_ratio_in(text):
        return f"it states the unit {other}, which is no response over a force; export FRFs, response over force"
    if one_part := _one_part(path, text, list(range(1, width))):
        return one_part
    rows = np.flatnonzero(np.all(np.diff(text.value.real, axis=1) > 0, axis=1))
    if width >= FEWEST_ROWS and rows.size == 1:
        row = text.n_header + int(rows[0]) + 1
        return f"row {row} ascends as frequencies do: functions lie along rows; write them in columns (transpose)"
    columns = f"{width} columns" + (f" ({titles})" if titles else "") + " of numbers, "
    if np.all(np.diff(text.value[:, 0].real) > 0):
        return (
            f"{columns}of which those after the first are no pairs: an FRF is real and imaginary part, or magnitude "
            "and phase, and histories have a force and a response; export these"
        )
    return (
        f"{columns}none of frequencies or times before them; write a campaign file by hand, with layout, "
        "axis_column = 0 and axis_step, or of histories sampling_Hz, under [measurement.table]"
    )


def _no_table(path: Path, *, most_shown: int = 60, looked_at: int = 200) -> str:
    """Return in words why a text file holds no table of numbers, with a row from its middle.

    `most_shown`: characters of the row; `looked_at`: rows in which numbers are counted.
    """
    lacking = "no rows of two or more columns of numbers"
    try:
        data = unpacked(path.read_bytes(), path.suffix)
        text = data.decode(encoding_of(data) or "utf-8", errors="replace")
    except (OSError, EOFError, LookupError, gzip.zlib.error):  # type: ignore[attr-defined]
        return lacking
    rows = [row for row in text.splitlines() if row.strip()]
    if not rows:
        return f"{lacking}: it is empty"
    row = rows[len(rows) // 2]
    numbers = [cells for d in DELIMITERS for cells in (row.split(SEPARATORS[d])[1:],) if len(cells) >= FEWEST_ROWS]
    if any(all(map(is_number, cells)) for cells in numbers):
        return f"{lacking}: each row holds a function behind its name; write functions in columns, frequencies first"
    counts = [sum(len(n or ()) > 1 for n in (numbers_of(r, d, ".") for r in rows[:looked_at])) for d in DELIMITERS]
    if 0 < max(counts) < FEWEST_ROWS:
        return (
            f"only {max(counts)} rows of two or more numbers, too few for a measured function; modes of another "
            "program are a table with columns called frequency_Hz, damping and as DOFs such as 12+z"
        )
    shown = row.strip() if len(row.strip()) <= most_shown else f"{row.strip()[:most_shown]}..."
    return f"{lacking}, but such as {shown!r}: export frequencies with real and imaginary parts beside them as numbers"


def _other_ratio_in(text: TextTable) -> str:
    """Return a unit in the header of a ratio that is no FRF, where none of an FRF is there; empty where it has none.

    A force over a response is a dynamic stiffness or an apparent mass, a response over another a transmissibility.
    """
    said = " ".join(cell for row in text.header for cell in row)
    other = [label for label, _ in ratios_in(said) if is_other_ratio(label)]
    other += ["kg" for k in range(1, text.value.shape[1]) if re.search(r"[\[(]kg[\])]", text.title(k))]
    return "" if unit_in(said) or volts_in(said) else next(iter(other), "")


def _one_part(path: Path, text: TextTable, columns: list[int]) -> str:
    """Say that a table holds one part of each function alone; empty where nothing tells that it does.

    Columns of which each is called by its own point or channel are no pairs, nor are those of a file that is called by
    one part.
    """
    titles = [text.title(c) for c in columns]
    if any(re.search(words, title.lower()) for _, words in _KINDS for title in titles) or text.value.imag.any():
        return ""
    named = [re.fullmatch(_NAMELESS, title, re.IGNORECASE) is None and bool(title) for title in titles]
    alike = {re.sub(r"\d+", "#", title) for title in titles}
    titled = len(titles) > 1 and all(named) and len(alike) == 1 and len(set(titles)) == len(titles)
    part = re.search(_OF_A_PART, path.stem, re.IGNORECASE)
    if not titled and part is None:
        return ""
    said = (
        f"its name says {part[1]!r}"
        if part
        else f"its columns are called {', '.join(titles[:4])}, one for each channel"
    )
    return (
        f"{said}: it seems to hold one part of each FRF alone; put real and imaginary parts, or magnitude and phase, "
        "of each function beside each other into one file"
    )


def _spectrum_in(text: TextTable, columns: list[int]) -> str:
    """Return the words by which titles or header tell of spectra and of no FRFs; empty where they do not."""
    titles = [text.title(c) for c in columns]
    if re.search(_OF_FRFS, "\n".join((text.words, *titles)), re.IGNORECASE):
        return ""
    match = re.search(_OF_SPECTRA, "\n".join((text.words, *titles)), re.IGNORECASE)
    return "" if match is None else match[0].strip()


def _with_times(path: Path, text: TextTable, axis: int, keys: dict[str, Any], guesses: list[str]) -> Contents:
    """Return the time histories of a table with times."""
    # Least time since 1970 of these years in ns, us and ms, and its unit in s; in s it is some 1e9
    epochs = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))
    columns = _beside(text, axis)
    if columns != list(range(1, text.value.shape[1])):
        keys["columns"] = [[c + 1] for c in columns]
    time = text.value[:, axis].real
    factor = _axis_factor(text, axis, r"\b[mµun]s\b|msec|milli|micro|nano")
    factor = next((f for least, f in epochs if time[0] > least), factor)
    if factor != 1.0:
        keys["sampling_Hz"] = float(f"{1.0 / _axis_keys(time, factor)['axis_step']:.9g}")
        guesses.append("the times are not in s")
    elif is_uneven(time):
        rate = rate_of_rounded(time)
        keys["sampling_Hz"] = rate or UNKNOWN
        guesses.append(
            f"the times are rounded: the first {len(time)} samples in {np.ptp(time):.6g} s give the sampling rate"
            if rate
            else "the steps of the times differ: state the sampling rate, or correct the times"
        )
    return Contents(
        file=path, section="table", keys={"layout": "time"} | keys, is_time=True,
        titles=tuple(text.title(c) for c in columns), guesses=tuple(guesses),
    )  # fmt: skip


def _axis_factor(text: TextTable, axis: int | None, units: str) -> float:
    """Return what makes s or Hz of a column of times or frequencies, by the unit in its title."""
    match = re.search(units, "" if axis is None else text.title(axis).lower())
    return 1.0 if match is None else _FACTORS[match[0]]


def _axis_keys(axis: Reals, factor: float) -> dict[str, float]:
    """Return the keys of an axis in another unit, which is read without its column."""
    rate = rate_of_rounded(axis)
    step = factor / rate if rate else factor * float(np.diff(axis).mean())
    return {"axis_column": 0, "axis_start": float(f"{factor * axis[0]:.12g}"), "axis_step": float(f"{step:.12g}")}


def _beside(text: TextTable, axis: int | None) -> list[int]:
    """Return the columns of functions: those beside the axis, without those that repeat it or count the rows."""
    columns = range(1 if axis and _counts_rows(text) else 0, text.value.shape[1])
    return [c for c in columns if axis is None or np.any(text.value[:, c] != text.value[:, axis])]


def _counts_rows(text: TextTable) -> bool:
    """Whether the first column counts the rows, from 0 or 1, and no title calls it an axis."""
    first = text.value[:, 0].real
    called = re.search(_TITLE_OF_AXIS, text.title(0), re.IGNORECASE)
    return called is None and bool(np.ptp(first - np.arange(len(first))) == 0.0) and first[0] in (0.0, 1.0)


def _without_times(path: Path, text: TextTable, keys: dict[str, Any]) -> Contents | None:
    """Return the time histories of a table without times, of which a title names the force or the header the rate."""
    columns = [c for c in range(text.value.shape[1]) if not np.isnan(text.value[:, c]).any()]
    titles = tuple(text.title(c) for c in columns)
    rate = _rate(text.words)
    if text.value[:, columns].imag.any() or not (rate or any(FORCE.search(title) for title in titles)):
        return None
    if any(re.search(words, title.lower()) for _, words in _KINDS for title in titles):
        return None  # functions of frequency
    if len(columns) < text.value.shape[1]:
        keys["columns"] = [[c + 1] for c in columns]
    said = () if rate is None else ("the sampling rate is that of the header",)
    return Contents(
        file=path, section="table",
        keys={"layout": "time"} | keys | {"axis_column": 0, "sampling_Hz": rate or UNKNOWN},
        is_time=True, titles=titles, guesses=("no column is a time", *said),
    )  # fmt: skip


def _rate(header: str) -> float | None:
    """Return the sampling rate that a header states, Hz, or one over its step."""
    rate, step = (re.search(pattern, header, re.IGNORECASE) for pattern in (_RATE, _STEP))
    if rate is not None:
        return float(rate[1].replace(",", ".")) * (1e3 if rate[2] else 1.0) or None
    value = 0.0 if step is None else float(step[1].replace(",", ".")) * (1e-3 if step[2] else 1.0)
    return float(f"{1.0 / value:.9g}") if value > 0.0 else None


def _axis(text: TextTable) -> int | None:
    """Return the column of frequencies or times: the first that ascends and does not count the rows, or None.

    It is one of the first two, or any whose title says so.
    """
    value = text.value
    ascends = [bool(np.all(np.diff(column.real) > 0)) and not column.imag.any() for column in value.T]
    first = value[:, 0].real
    rounded = bool(np.all(np.diff(first) >= 0) and np.ptp(first) > 0) and not value[:, 0].imag.any()
    if rounded and not ascends[0] and rate_of_rounded(first) is not None:
        return 0  # times of few digits, of which some repeat
    falls = bool(np.all(np.diff(first) < 0)) and not value[:, 0].imag.any()
    if falls and re.search(r"freq|\bhz\b|^f\b", text.title(0), re.IGNORECASE):
        return 0
    if _counts_rows(text) and value.shape[1] > 3 and ascends[1]:
        return 1
    if ascends[0]:
        return 0
    titled = (c for c, fits in enumerate(ascends) if fits and re.search(_TITLE_OF_AXIS, text.title(c), re.IGNORECASE))
    return next(titled, None)


def _is_time(text: TextTable, axis: int, guesses: list[str]) -> bool:
    """Whether an axis is the time: its title or the header says so or, without one, its step is none of a frequency."""
    title = text.title(axis).lower()
    if re.search(_TITLE_OF_TIME, title):
        return True
    header = text.words.lower()
    titles = [text.title(c).lower() for c in range(axis + 1, text.value.shape[1])]
    if re.search(_OF_FREQUENCY, header) or any(re.search(r"\bfft\b|spectr|spekt", heading) for heading in titles):
        return False
    if re.search(_OF_TIME, header):
        guesses.append("the columns are taken as time histories, for the header tells of sampling")
        return True
    step = float(np.diff(text.value[:, axis].real).mean())
    if title or step > LONGEST_SAMPLE or text.value[:, axis + 1 :].imag.any():
        return False
    guesses.append(f"the first column is taken as the time in s, since a step of {step:.4g} Hz is none of a frequency")
    return True


def functions_of(
    text: TextTable, columns: list[int], guesses: list[str]
) -> tuple[str, list[list[int]], list[int]] | None:
    """Return the layout, the columns of each function and those of the coherences."""
    kinds = {c: next((k for k, words in _KINDS if re.search(words, text.title(c).lower())), "") for c in columns}
    coherence = [c for c in columns if kinds[c] == "coherence"]
    for layout, (first, second) in _PAIRS.items():
        groups = [[c, c + 1] for c in columns[:-1] if kinds[c] == first and kinds[c + 1] == second]
        blocks = [[c for c in columns if kinds[c] == kind] for kind in (first, second)]
        if len(blocks[0]) == len(blocks[1]) > len(groups):  # all of the first kind before those of the second
            groups = [list(pair) for pair in zip(*blocks, strict=True)]
        if groups:
            return layout, groups, coherence if len(coherence) == len(groups) else []
    columns = [c for c in columns if c not in coherence]
    if text.value[:, columns].imag.any():
        return "complex", [[c] for c in columns], coherence if len(coherence) == len(columns) else []
    third = text.value[:, columns[2::3]].real if len(columns) % 3 == 0 else np.empty(0)
    if third.size and np.all((third >= 0.0) & (third <= 1.0)):
        guesses.append("every third column looks like a coherence")
        coherence, columns = columns[2::3], [c for k, c in enumerate(columns) if k % 3 < 2]
    if not columns or len(columns) % 2:
        return None
    groups = [columns[k : k + 2] for k in range(0, len(columns), 2)]
    real = text.value.real
    if real[:, columns[::2]].min() >= 0 and real[:, columns[1::2]].min() < 0:
        guesses.append("the columns look like magnitude and phase")
        return "magnitude-phase", groups, coherence
    guesses.append("the columns are taken as real and imaginary parts")
    return "real-imaginary", groups, coherence


_OF_DOF = re.compile(r"point|node|\bdof|punkt|\bdir|\baxis|resp|\bout|\bref|\bexc|\binp|forc|sensor", re.IGNORECASE)
_CELL = re.compile(r"(?:[a-z]{1,6}[ _.]*)?\d+(?:\.0+)?[ :]*[+-]?[xyz]?[+-]?|[+-]?[xyz][+-]?|[+-]?[123]", re.IGNORECASE)
"""What a cell of a DOF holds: a point, a direction, or both."""
_HEADS_FREQUENCY = re.compile(r"freq|\bhz\b|^f\b", re.IGNORECASE)
_Columns = dict[str, list[int]]


def guess_long(path: Path, *, most_header: int = 60) -> Contents | None:
    """Return what a text file holds whose columns state point and direction beside each frequency; else None."""
    text = rows_of(path) if _tells_of_dofs(path) else None
    rows, encoding = ([], "") if text is None else text
    for delimiter in DELIMITERS[:-1]:
        for k, row in enumerate(rows[:most_header]):
            titles = [title.strip("\"' ").replace("_", " ") for title in titles_of(row, delimiter)]
            frequency = [c for c, title in enumerate(titles) if _HEADS_FREQUENCY.search(title)]
            if len(titles) < 3 or len(frequency) != 1 or len(rows) < k + FEWEST_ROWS:
                continue
            cells = [[cell.strip("\"' ") for cell in cells_of(r, delimiter)] for r in rows[k + 1 :] if r.strip()]
            if any(len(c) != len(titles) for c in cells):
                continue
            header = [titles_of(r, delimiter) for r in rows[: k + 1]]
            found = _of_cells(titles, cells, frequency[0])
            if found is not None:
                keys, dofs, first, guesses = found
                keys |= {"delimiter": delimiter, "header_rows": k + 1, "encoding": encoding}
                return _described(path, header, keys, dofs, first, guesses)
    return None


def _tells_of_dofs(path: Path, *, looked_at: int = 10000) -> bool:
    """Whether the beginning of a file has words of points and of frequencies; reading all of others takes time."""
    if path.suffix == ".gz":
        return True
    with path.open("rb") as file:
        head = file.read(looked_at).replace(b"\0", b"").decode("latin-1").replace("_", " ")
    return bool(_OF_DOF.search(head) and _HEADS_FREQUENCY.search(head))


def _of_cells(
    titles: list[str], cells: list[list[str]], frequency: int
) -> tuple[dict[str, Any], list[tuple[Code | None, Code | None]], list[list[str]], list[str]] | None:
    """Return the keys of a table, its DOFs and the rows of the first of them; None where they are no functions."""
    columns = _dof_columns(titles, cells, frequency)
    if not columns.get("output"):
        return None
    places = [c for end in ("output", "input") for c in columns.get(end, [])]
    of_dof: dict[tuple[str, ...], list[list[str]]] = defaultdict(list)
    for row in cells:
        of_dof[tuple(row[c] for c in places)].append(row)
    split = len(columns["output"])
    alone = any(dof_of_cells(words[:split]) is None for words in of_dof)
    direction = "+z" if alone else ""
    dofs = [
        (dof_of_cells(words[:split], direction), dof_of_cells(words[split:], direction) if words[split:] else None)
        for words in of_dof
    ]
    if any(output is None or (columns.get("input") and force is None) for output, force in dofs):
        return None
    decimal = "," if any("," in row[frequency] for row in cells) else "."
    for of_one in of_dof.values():
        try:
            axis = [number(row[frequency].replace(decimal, ".")).real for row in of_one]
        except ValueError:
            return None
        ascends = np.diff(axis) > 0.0
        if len(axis) < FEWEST_ROWS or ascends.any() != ascends.all() or 0.0 in np.diff(axis):
            return None
    keys: dict[str, Any] = {"decimal": decimal, "axis_column": frequency + 1, "direction": direction}
    keys |= {f"{end}_columns": [c + 1 for c in columns.get(end, [])] for end in ("output", "input")}
    guesses = ["points without a direction are taken along +z"] if direction else []
    first = next(iter(of_dof.values()))
    return keys, dofs, first, guesses


def _dof_columns(titles: list[str], cells: list[list[str]], frequency: int) -> _Columns:
    """Return the columns of point and direction of each end, the point first."""
    found: _Columns = defaultdict(list)
    for c, title in enumerate(titles):
        if c != frequency and _OF_DOF.search(title) and all(_CELL.fullmatch(row[c]) for row in cells):
            found["input" if re.search(OF_INPUT, title, re.IGNORECASE) else "output"].append(c)
    sure: _Columns = {}
    for end, columns in found.items():
        points = [c for c in columns if not re.search(r"\bdir|\baxis", titles[c], re.IGNORECASE)]
        directions = [c for c in columns if c not in points]
        if points:
            sure[end] = [points[0], *directions[:1]]
    return sure


def _described(
    path: Path,
    header: list[list[str]],
    keys: dict[str, Any],
    dofs: list[tuple[Code | None, Code | None]],
    first: list[list[str]],
    guesses: list[str],
) -> Contents | None:
    """Return the contents of a table of which the functions of one DOF are these rows; None where they are no FRFs."""
    taken = [c - 1 for c in (keys["axis_column"], *keys["output_columns"], *keys["input_columns"])]
    value = np.full((len(first), len(first[0])), np.nan, complex)
    for c in range(value.shape[1]):
        try:
            value[:, c] = [number(row[c].replace(keys["decimal"], ".")) for row in first]
        except ValueError:
            continue  # words
    text = TextTable(
        encoding=keys["encoding"], delimiter=keys["delimiter"], decimal=keys["decimal"], header=header,
        n_header=keys["header_rows"], heads=("",), value=value,
    )  # fmt: skip
    columns = [c for c in range(value.shape[1]) if c not in taken and not np.isnan(value[:, c]).all()]
    guessed = functions_of(text, columns, guesses)
    if guessed is None or len(guessed[1]) != 1:
        return None
    layout, groups, coherence = guessed
    keys |= {"columns": [[c + 1 for c in groups[0]]], "coherence_columns": [c + 1 for c in coherence]}
    if layout == "magnitude-phase":
        size, phase = (value[:, c].real for c in groups[0])
        keys |= polar_units((text.title(groups[0][0]), text.title(groups[0][1])), size, phase, guesses)
    usual = {"delimiter": "comma", "decimal": ".", "encoding": "utf-8"}
    keys = {key: v for key, v in keys.items() if v != usual.get(key) and v not in ([], "")}
    return Contents(
        file=path,
        section="table",
        keys={"layout": layout} | keys,
        unit=unit_in(text.words),
        odd_unit=volts_in(text.words),
        dofs=tuple(dofs),
        states=frozenset({"output"} | ({"input"} if "input_columns" in keys else set())),
        guesses=(*guesses, "each row states its DOF: rows of the same one are a function"),
    )
