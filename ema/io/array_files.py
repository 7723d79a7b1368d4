"""Named arrays in MATLAB, HDF5, NumPy and TDMS files: the one door to h5py, npTDMS and SciPy's MATLAB reader.

SciPy's reader looks up the type of an element in a table without asking whether it is in it, so that a file which
lost some bytes ends the whole process instead of raising an error. So their tags are walked through before.
"""

from __future__ import annotations

import logging
import os
import re
import struct
import warnings
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from math import prod
from numbers import Real
from pathlib import Path
from typing import IO, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ema.io.measured_function import si_label
from ema.types.errors import MeasurementError


def check_elements(path: Path, *, header: int = 128) -> None:
    """Walk through all elements that are not compressed; those carry a checksum.

    Parameters
    ----------
    path : Path
        MATLAB file of version 5 to 7.2.
    header : int
        Bytes before the first element.

    Raises
    ------
    ValueError
        An element has an unknown type, or is longer than what it is in; the message says at which byte.
    """
    with path.open("rb") as file:
        order = ">" if file.read(header)[-2:] == b"MI" else "<"
        _check(file, header, os.fstat(file.fileno()).st_size, order, 0)


def _check(
    file: BinaryIO,
    position: int,
    end: int,
    order: str,
    depth: int,
    *,
    matrix: int = 14,
    compressed: int = 15,
    deepest: int = 30,
) -> None:
    """Check the elements between two positions of a file; below the top they are the parts of one matrix.

    `deepest`: structures in structures.
    """
    numbers = frozenset((1, 2, 3, 4, 5, 6, 7, 9, 12, 13))
    text = frozenset((16, 17, 18))
    numeric_classes = range(6, 16)
    numeric = False
    first = True
    while position + 8 <= end:
        file.seek(position)
        tag = file.read(16)
        kind, size = struct.unpack(f"{order}II", tag[:8])
        start = position + 8
        if kind >> 16:  # up to four bytes that stand in the tag itself
            kind, size, start = kind & 0xFFFF, kind >> 16, position + 4
            stop = position + 8
        else:
            stop = start + size + (-size % 8 if kind != compressed else 0)
        expected = {matrix, compressed} if depth == 0 else numbers if numeric else numbers | text | {matrix}
        if kind not in expected or start + size > end or depth > deepest:
            raise ValueError(f"the element at byte {position} has type {kind} and {size} bytes, which cannot be")
        if depth > 0 and first and len(tag) > 8:  # the flags of a matrix, whose lowest byte is its class
            numeric = struct.unpack(f"{order}I", tag[8:12])[0] & 0xFF in numeric_classes
        if kind == matrix and size:
            _check(file, start, start + size, order, depth + 1)
        position, first = stop, False


MAGIC = b"TDSm"
"""First bytes of such a file."""

Channel = tuple[tuple[int, ...], Any, str]
"""Shape of an array, what reads it while the file is open, and its unit, empty where the file states none."""

_CUT_OFF = "Last segment", "Data size"
"""How npTDMS begins what it says of a file that ends before its numbers do."""
_OF_NUMBERS = "Cropping data", "Unsupported scale"
"""How it begins what it says of numbers that it could not scale; other words are of names."""


class _Listener(logging.Handler):
    """Hears that a file is cut off, and raises what else npTDMS says of numbers: they are not those of the file."""

    def __init__(self) -> None:
        super().__init__()
        self.cut_off = False

    def emit(self, record: logging.LogRecord) -> None:
        said = record.getMessage()
        self.cut_off |= said.startswith(_CUT_OFF)
        if said.startswith(_OF_NUMBERS):
            raise ValueError(said)


class CutOffError(ValueError):
    """A file ends before all channels have numbers."""


@contextmanager
def channels_in(path: Path) -> Iterator[dict[str, Channel]]:
    """Open a TDMS file and give its channels of numbers, ``group/channel``, and their properties that are numbers.

    Properties are named ``group/channel@wf_increment``, as attributes of HDF5 are; dates are in seconds. Of a file that
    is cut off, groups that are whole are given; where none is, channels are given as far as the shortest of their group
    goes. Whatever npTDMS raises of a damaged file is raised.

    Raises
    ------
    CutOffError
        A file that is cut off has a channel without a number, and no group that is whole.
    """
    from nptdms import TdmsFile  # here: few tests come in such files

    with path.open("rb") as stream, _listening() as heard, TdmsFile.open(stream) as file:
        groups = [[c for c in group.channels() if c.dtype.kind in "fiubc"] for group in file.groups()]
        groups = [channels for channels in groups if channels]
        length = {id(channels): {len(c) for c in channels} for channels in groups}
        if heard.cut_off:
            whole = [channels for channels in groups if len(length[id(channels)]) == 1 and len(channels[0])]
            groups = whole or groups
            if any(min(length[id(channels)]) == 0 for channels in groups) or not groups:
                raise CutOffError
        arrays: dict[str, Channel] = {}
        for channels in groups:
            for channel in channels:
                name = f"{channel.group_name}/{channel.name}"
                n = min(length[id(channels)]) if heard.cut_off else len(channel)
                if n:
                    unit = channel.properties.get("unit_string", "")
                    arrays[name] = (n,), partial(_values, channel, n), str(unit)
                for key, value in channel.properties.items():
                    if isinstance(value, np.datetime64) and not np.isnat(value):
                        value = (value - np.datetime64(0, "s")) / np.timedelta64(1, "s")  # noqa: PLW2901
                    if isinstance(value, Real):
                        arrays[f"{name}@{key}"] = (), partial(np.asarray, value), ""
        yield arrays


def is_cut_off(path: Path) -> bool:
    """Whether a file is a TDMS file that ends before its numbers do."""
    with path.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            return False
    from nptdms import TdmsFile

    with path.open("rb") as stream, _listening() as heard:
        TdmsFile.read_metadata(stream)
    return heard.cut_off


def _values(channel: Any, n: int) -> NDArray[Any]:
    return np.asarray(channel[:n])


@contextmanager
def _listening() -> Iterator[_Listener]:
    """Hear what npTDMS says, and keep it from the terminal."""
    from nptdms.log import log_manager

    log, console, heard = logging.getLogger("nptdms"), log_manager.console_handler, _Listener()
    level = console.level
    log.addHandler(heard)
    console.setLevel(logging.ERROR)
    try:
        yield heard
    finally:
        console.setLevel(level)
        log.removeHandler(heard)


LARGEST = 100_000_000
"""Values that one array may hold: five times 200 functions to 3 forces of 32000 lines. A damaged size is larger."""
_PART = re.compile(r"(.+)\[([-\d:, ]+)\]")
"""A part of an array, as ``FRF[:, 0]``: places are counted from 0, as in Python."""
NPY, _ZIP = b"\x93NUMPY", b"PK\x03\x04"
"""First bytes of files of numpy.save, and of numpy.savez."""
_UNITS = ("unit", "units", "Unit", "Units")  # attributes of HDF5
_COMPLEX_FIELDS = (("real", "imag"), ("re", "im"), ("r", "i"))
"""Fields of complex numbers in HDF5, as MATLAB and others store them, in letters of any size."""


@dataclass(frozen=True, kw_only=True)
class ArrayInFile:
    """An array of numbers that a file holds, before it is read.

    Attributes
    ----------
    shape : tuple of int
        As MATLAB shows it, or as an HDF5 file states it.
    read : callable
        Reads it, while the file is open.
    unit : str
        As the file states it; empty where it does not.
    """

    shape: tuple[int, ...]
    read: Callable[[], NDArray[Any]]
    unit: str = ""

    def __str__(self) -> str:
        return " x ".join(map(str, self.shape)) or "one number"


def pattern_of(name: str) -> re.Pattern[str]:
    """Return the pattern of the variables that a name, perhaps with ``*``, stands for, in groups what stands there."""
    return re.compile(re.escape(name).replace(r"\*", "([^./]*)"))


class _Held(dict[str, ArrayInFile]):
    """Arrays by their names, perhaps with ``*`` for what differs from file to file, and parts of them by their places.

    ``FRF_*.y`` is the one array whose name is like this, ``FRF[:, 1::2]`` every second column of an array.
    """

    def __missing__(self, name: str) -> ArrayInFile:
        alike = [n for n in self if pattern_of(name).fullmatch(n)] if "*" in name else []
        if len(alike) == 1:
            return self[alike[0]]
        match = _PART.fullmatch(name)
        if match is None or match[1] not in self:
            raise KeyError(name)
        whole = self[match[1]]
        try:
            index = tuple(
                slice(*(int(n) if n.strip() else None for n in one.split(":"))) if ":" in one else int(one)
                for one in match[2].split(",")
            )
            shape = np.broadcast_to(0, whole.shape)[index].shape
        except (ValueError, IndexError) as error:
            raise KeyError(name) from error

        def read() -> NDArray[Any]:
            part = np.asarray(whole.read()[index])
            return part.real if np.iscomplexobj(part) and not np.any(part.imag) else part

        return ArrayInFile(shape=shape, read=read, unit=whole.unit)


@contextmanager
def arrays_in(path: Path, *, matlab: bool) -> Iterator[Mapping[str, ArrayInFile]]:
    """Open a file and give the arrays of numbers in it by their names; text and objects are passed over.

    Parameters
    ----------
    path : Path
        MATLAB file of any version (7.3 is HDF5), HDF5 file, file of `numpy.save` or `numpy.savez`, or TDMS file. The
        array of `numpy.save` has no name and is called ``array``.
    matlab : bool
        Whether MATLAB wrote it: then fields of structures are named ``data.H``, of lists of them ``data(2).H``,
        elements of cells ``a{2}``, and axes come in its order, which in HDF5 it reverses. Else groups are named
        ``data/H`` and attributes ``data/H@fs``.

    Raises
    ------
    MeasurementError
        The file cannot be read, or an array has more than `LARGEST` values; what is wrong with the file is also
        raised like this where an array is read.
    """
    import h5py  # here: it takes long to import, and most tests come as universal files

    try:
        with path.open("rb") as file:
            begin = file.read(6)
    except (OSError, ValueError) as error:
        raise MeasurementError(f"{path}: cannot be read: {getattr(error, 'strerror', error)}") from error
    is_hdf5 = h5py.is_hdf5(path)
    is_numpy, is_tdms = begin == NPY or begin[:4] == _ZIP, begin[:4] == MAGIC
    if not (is_hdf5 or matlab or is_numpy or is_tdms):
        raise MeasurementError(f"{path}: is not an HDF5 file")
    try:
        if is_hdf5:
            with h5py.File(path, "r") as file:
                yield _Held(_in_hdf5(file, matlab=matlab))
        elif is_numpy:
            yield _Held(_in_numpy(path, single=begin == NPY))
        elif is_tdms:
            with channels_in(path) as channels:
                yield _Held(
                    (name, ArrayInFile(shape=channel[0], read=channel[1], unit=channel[2]))
                    for name, channel in channels.items()
                )
        else:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of a name that is there twice: the last one is taken
                yield _Held(_in_mat(path))
    except MeasurementError:
        raise
    except Exception as error:  # of a damaged file both libraries raise whatever they stumble over
        kind = "NumPy" if is_numpy else "TDMS" if is_tdms else "MATLAB" if matlab else "HDF5"
        message = f"{path}: cannot be read as a {kind} file, it is damaged or of another kind: {error}"
        if isinstance(error, CutOffError | EOFError) and is_tdms:
            message = (
                f"{path}: is cut off: it holds fewer numbers than it announces, as of a recorder or a copy that was "
                "stopped; copy it again from the recorder, or save in LabVIEW what is whole as a new file"
            )
        raise MeasurementError(message) from error


def labels_in(path: Path) -> list[tuple[str, ...]]:
    """Return the lists of texts that a file holds, as of the names of channels; none where it cannot be read."""
    import h5py

    labels: list[tuple[str, ...]] = []

    def visit(_: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and h5py.check_string_dtype(item.dtype) and len(item.shape or ()) == 1:
            labels.append(tuple(str(text) for text in item.asstr(errors="replace")[()]))

    try:
        if h5py.is_hdf5(path):
            with h5py.File(path, "r") as file:
                file.visititems(visit)
        elif zipfile.is_zipfile(path):
            with np.load(path, allow_pickle=False) as archive:
                headers = {name: numpy_header(archive.zip.open(f"{name}.npy")) for name in archive.files}
                texts = [
                    archive[name] for name, (shape, kind) in headers.items() if kind.kind == "U" and len(shape) == 1
                ]
            labels += [tuple(map(str, text)) for text in texts]
        elif path.suffix.lower() == ".mat":
            for name in (name for name, _, kind in _variables(path) if kind == "cell"):
                cells = [_text(one) for one in _variable(path, name).ravel()]
                labels += [tuple(cells)] if all(cells) else []
    except Exception:
        return []
    return labels


def array(path: Path, arrays: Mapping[str, ArrayInFile], key: str, name: str, *, listed: int = 20) -> NDArray[Any]:
    """Read one array by its name.

    Parameters
    ----------
    path : Path
        The file, for messages.
    arrays : mapping
        What `arrays_in` gave.
    key : str
        Key of the campaign file that asks for it, for messages.
    name : str
        Its name, perhaps with the part of it that is wanted, ``FRF[:, 0]``.
    listed : int
        Names of a file that a message lists.

    Returns
    -------
    array : float or complex
        In the shape that the file states.

    Raises
    ------
    MeasurementError
        There is none of that name, which lists those that are, or it is too large.
    """
    try:
        held = arrays[name]
    except KeyError:
        there = [f"{other} ({arrays[other]})" for other in list(arrays)[:listed]]
        more = f" and {len(arrays) - listed} more" if len(arrays) > listed else ""
        message = f"{path}: variable {name!r} ({key}): no numbers of that name; the file holds "
        raise MeasurementError(message + (", ".join(there) or "no numbers") + more) from None
    if not 0 < prod(held.shape) <= LARGEST:
        raise MeasurementError(f"{path}: variable {name!r} ({key}): holds {held}, expected 1 to {LARGEST} values")
    value = held.read()
    return np.asarray(value, complex if np.iscomplexobj(value) else float)


def _in_hdf5(file: Any, *, matlab: bool) -> dict[str, ArrayInFile]:
    import h5py

    arrays: dict[str, ArrayInFile] = {}

    def add(name: str, item: Any) -> None:
        if isinstance(item, h5py.Group):  # an element of a cell that is a structure
            for field in item:
                add(f"{name}.{field}", item[field])
        elif isinstance(item, h5py.Dataset) and item.shape is not None:
            if matlab and h5py.check_ref_dtype(item.dtype) is not None:
                for k, reference in enumerate(item[()].ravel(), start=1):
                    add(_element(name, k, is_cell=item.attrs.get("MATLAB_class") == b"cell"), file[reference])
            elif _holds_complex(item) or item.dtype.kind in "fiubc":
                arrays[name] = _dataset(item, matlab=matlab)

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and not name.startswith("#"):
            add(name.replace("/", ".") if matlab else name, item)  # MATLAB keeps what cells refer to in #refs#

    file.visititems(visit)
    if not matlab:
        arrays |= {name: value for item in (file, *_items(file)) for name, value in _attributes(item)}
    return arrays


def _items(file: Any) -> list[Any]:
    """Return all groups and data sets of a file."""
    items: list[Any] = []
    file.visititems(lambda _, item: items.append(item))
    return items


def _attributes(item: Any) -> Iterator[tuple[str, ArrayInFile]]:
    """Give the attributes of a group or a data set that are numbers, such as ``hit_1/acc@fs``."""
    for key in item.attrs:
        value = np.asarray(item.attrs[key])
        if value.dtype.kind in "fiub" and value.size:
            yield (f"{item.name.strip('/')}@{key}", ArrayInFile(shape=value.shape, read=partial(np.asarray, value)))


def _holds_complex(item: Any) -> bool:
    """Whether the fields of a data set are those of complex numbers."""
    return tuple(name.lower() for name in item.dtype.names or ()) in _COMPLEX_FIELDS


def _dataset(item: Any, *, matlab: bool) -> ArrayInFile:
    """Return the array of a data set of HDF5, as MATLAB shows it where MATLAB wrote it."""
    empty = matlab and bool(item.attrs.get("MATLAB_empty", 0))  # its numbers are then its shape
    shape = (0,) if empty else item.shape[::-1] if matlab else item.shape

    def read() -> NDArray[Any]:
        value = item[()]
        if _holds_complex(item):
            first, second = item.dtype.names
            value = value[first] + 1j * value[second]
        return np.asarray(value.T if matlab else value)

    unit = next((item.attrs[key] for key in _UNITS if key in item.attrs), "")
    unit = unit.decode("utf-8", "replace") if isinstance(unit, bytes) else unit
    return ArrayInFile(shape=tuple(shape), read=read, unit=unit if isinstance(unit, str) else "")


def _element(name: str, number: int, *, is_cell: bool) -> str:
    """Return the name of an element of a cell, ``a{2}``, or of a structure in a list of them, ``data(2).H``."""
    if is_cell:
        return f"{name}{{{number}}}"
    structure, _, field = name.rpartition(".")
    return f"{structure}({number}).{field}"


def _in_numpy(path: Path, *, single: bool) -> dict[str, ArrayInFile]:
    """Return the arrays of a file of `numpy.save` or `numpy.savez`; objects, which could be programs, are not read."""
    if single:
        shape, dtype = numpy_header(path.open("rb"))
        read = partial(np.load, path, allow_pickle=False)
        return {"array": ArrayInFile(shape=shape, read=read)} if dtype.kind in "fiubc" else {}
    arrays: dict[str, ArrayInFile] = {}
    with zipfile.ZipFile(path) as archive:
        members = [member for member in archive.namelist() if member.endswith(".npy")]
        headers = {member.removesuffix(".npy"): numpy_header(archive.open(member)) for member in members}
    texts = (name for name in _UNITS if name in headers and headers[name][1].kind == "U")
    unit = next((_text(_in_archive(path, name)) for name in texts), "")
    for name, (shape, dtype) in headers.items():
        if dtype.kind in "fiubc":
            arrays[name] = ArrayInFile(shape=shape, read=partial(_in_archive, path, name), unit=unit)
    return arrays


def numpy_header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return the shape of an array in a file of NumPy and the type of its values, and close the file."""
    with stream:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(stream)
    return shape, dtype


def _in_archive(path: Path, name: str) -> NDArray[Any]:
    with np.load(path, allow_pickle=False) as archive:
        return np.asarray(archive[name])


def _in_mat(path: Path) -> dict[str, ArrayInFile]:
    """Return the arrays of a file of version 7.2 or older; structures are read to see their fields."""
    from scipy import io

    if io.matlab.matfile_version(str(path), appendmat=False)[0] == 1:  # of version 4 the reader is safe
        check_elements(path)
    arrays: dict[str, ArrayInFile] = {}
    of_file = next((_text(_variable(path, n)) for n, _, kind in _variables(path) if n in _UNITS and kind == "char"), "")
    for name, shape, kind in _variables(path):
        if kind in ("struct", "cell"):
            content = io.loadmat(str(path), appendmat=False, variable_names=[name])
            units = dict(_units(name, content.get(name)))
            for field, value in _fields(name, content.get(name)):
                inside = [end.start() for end in re.finditer(r"\.", field)][::-1]  # of a structure and those around it
                unit = next((units[field[:end]] for end in inside if field[:end] in units), of_file)
                arrays[field] = ArrayInFile(shape=value.shape, read=partial(np.asarray, value), unit=unit)
        elif kind in ("double", "single", "logical") or kind.startswith(("int", "uint")):
            arrays[name] = ArrayInFile(shape=tuple(shape), read=partial(_variable, path, name), unit=of_file)
    return arrays


def _variables(path: Path) -> list[tuple[str, tuple[int, ...], str]]:
    """Return name, shape and class of each variable."""
    from scipy import io

    try:
        return list(io.whosmat(str(path), appendmat=False))
    except TypeError:  # at an object of MATLAB's, such as a table or a figure, which has no shape
        content = io.loadmat(str(path), appendmat=False)
    kinds = {"V": "struct", "O": "cell", "f": "double", "c": "double", "i": "int", "u": "uint", "b": "logical"}
    return [
        (name, value.shape, kinds[value.dtype.kind])
        for name, value in content.items()
        if type(value) is np.ndarray and value.dtype.kind in kinds and not name.startswith("__")
    ]


def _variable(path: Path, name: str) -> NDArray[Any]:
    from scipy import io

    return np.asarray(io.loadmat(str(path), appendmat=False, variable_names=[name])[name])


def _units(name: str, value: Any) -> Iterator[tuple[str, str]]:
    """Give the unit that a structure states of its numbers, of those in it, too, each with the structure's name.

    Testlab writes it as ``quantity.label``, of numbers that are in SI whichever label is shown.
    """
    if type(value) is not np.ndarray or value.dtype.kind not in "VO" or value.dtype.names is None:
        return
    for k, element in enumerate(value.ravel(order="F"), start=1):
        prefix = name if value.size == 1 else f"{name}({k})"
        told = {field: _text(element[field]) for field in value.dtype.names}
        unit = next((told[key] for key in _UNITS if told.get(key)), "")
        quantity = element["quantity"] if "quantity" in told else None
        if type(quantity) is np.ndarray and quantity.size == 1 and "label" in (quantity.dtype.names or ()):
            unit = _text(quantity.ravel()[0]["label"])
            is_si = "info" in quantity.dtype.names and "MKS" in _text(quantity.ravel()[0]["info"])
            unit = si_label(unit) if is_si else unit
        if unit:
            yield prefix, unit
        for field in value.dtype.names:
            yield from _units(f"{prefix}.{field}", element[field])


def _text(value: Any) -> str:
    """Return a text of a MATLAB or NumPy file; empty where it is something else."""
    return (
        str(value.ravel()[0]).strip()
        if type(value) is np.ndarray and value.dtype.kind == "U" and value.size == 1
        else ""
    )


def _fields(name: str, value: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """Give the arrays of numbers in structures, lists of structures and cells, and in those in them."""
    if type(value) is not np.ndarray:
        return  # sparse, or an object of MATLAB's
    if value.dtype.names is not None:
        for k, element in enumerate(value.ravel(order="F"), start=1):
            for field in value.dtype.names:
                yield from _fields(f"{name}.{field}" if value.size == 1 else f"{name}({k}).{field}", element[field])
    elif value.dtype.kind == "O":
        for k, element in enumerate(value.ravel(order="F"), start=1):
            yield from _fields(f"{name}{{{k}}}", element)
    elif value.dtype.kind in "fiubc":
        yield name, value
