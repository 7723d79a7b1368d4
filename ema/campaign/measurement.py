"""Measured functions of a configuration, merged into one block of FRFs with global, signed DOFs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ema.campaign.campaign import Campaign, Configuration, Correction, Files
from ema.campaign.reading import (
    Run,
    frfs_from_records,
    frfs_of,
    of_common_length,
    records_of,
    snapped,
    with_finite_lines,
)
from ema.io.measured_function import MeasuredFunction
from ema.types.errors import CampaignError, MeasurementError
from ema.types.frf import DERIVATIVE, FRF, Dof, Dofs, Geometry, Quantity
from lamella_shared import Complexes, Integers, Reals, readonly


@dataclass(frozen=True, eq=False, kw_only=True)
class Measurement:
    """The FRFs of one configuration, with all that had to be resolved to make one block of them.

    Attributes
    ----------
    name : str
        The configuration.
    configuration : Configuration
        Its torque, pressure and files.
    frf : FRF
        All functions. Where there are more force points than responses (a roving hammer) it is given by
        reciprocity, with the force points as outputs, so that the shapes live on all measured points.
    geometry : Geometry
        The measured points.
    overload : (n_output,) float
        Share of overloaded samples in the records of each output or its force; 0 for files of FRFs.
    notes : tuple of str
        What was odd in the files and how it was resolved: duplicates, exclusions, units.
    """

    name: str
    configuration: Configuration
    frf: FRF
    geometry: Geometry
    overload: Reals
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        shape = (self.frf.output.node.size,)
        object.__setattr__(self, "overload", readonly("Measurement", "overload", self.overload, shape))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Entry:
    """One FRF on its way into the block."""

    frequency: Reals
    value: Complexes
    coherence: Reals | None
    quantity: Quantity
    output: Dof
    input: Dof
    run: int
    source: str
    component: str = ""
    overload: float = 0.0
    decay_rate: float = 0.0


def read_measurement(campaign: Campaign, name: str) -> Measurement:
    """Read all files of a configuration and merge them into one block of FRFs.

    Rules, each reported in the notes where it was applied: of several measurements of the same pair of DOFs
    the last one is used; functions of another quantity are differentiated to the highest one; functions with
    another frequency axis are cropped to the common lines, or left out where the lines differ; where some
    pairs of DOFs are missing, the force points or responses with most of them missing are left out.

    Parameters
    ----------
    campaign : Campaign
    name : str
        The configuration's name.

    Raises
    ------
    CampaignError
        There is no such configuration, or its DOF lists do not fit its files.
    MeasurementError
        A file cannot be read, does not say what the campaign file leaves open, or measures at a point that is
        not in the list of points.
    """
    configuration = campaign.configuration(name)
    if configuration.has_modes:
        raise CampaignError(
            f'{campaign.path}: configuration {name!r} has modes = "file": its files hold modes, and there are no '
            "functions to identify or to pick poles in; read them with ema.read_modes"
        )
    return _merged(campaign, configuration)


def read_force_levels(campaign: Campaign, name: str) -> tuple[Measurement, ...]:
    """Read what was measured of a configuration at other force levels, each as `read_measurement` does.

    Raises
    ------
    CampaignError, MeasurementError
        As `read_measurement`.
    """
    return tuple(_merged(campaign, level) for level in campaign.configuration(name).force_levels)


def _merged(campaign: Campaign, configuration: Configuration) -> Measurement:
    notes = list(campaign.notes)
    entries: list[_Entry] = []
    n_run = 0
    records = _records(campaign, configuration, notes)
    for files in configuration.files:
        functions, n_run = _entries(campaign, files, n_run, records, notes)
        entries += functions
    if not entries:
        raise MeasurementError(f"{campaign.path}: configuration {configuration.name!r}: its files hold no usable FRF")
    entries = _as_one_run(configuration, entries, notes)
    _require_not_negative(entries)
    entries = _one_sided(_with_axis(entries, notes), notes)
    entries = _one_quantity(entries, notes)
    entries = with_finite_lines(_one_axis(entries, notes), campaign.identification.band, notes)
    pairs = _without_duplicates(entries, notes)
    outputs, inputs = _full_block(pairs, notes)
    frf, overload = _block(pairs, outputs, inputs, notes)
    absent = sorted({int(n) for n in frf.output.node} - {int(n) for n in campaign.geometry.node})
    if campaign.points is None:
        notes.append("no list of points (file under [points]): shapes are not drawn, nor compared with a model")
    elif absent:
        notes.append(f"points without coordinates, measured but not drawn: {absent}")
    return Measurement(
        name=configuration.name,
        configuration=configuration,
        frf=frf,
        geometry=campaign.geometry,
        overload=overload,
        notes=tuple(notes),
    )


def _as_one_run(configuration: Configuration, entries: list[_Entry], notes: list[str]) -> list[_Entry]:
    """Return files of the same responses, each with forces of its own, as one run where no runs are stated.

    A hammer that roves while the sensors stay changes nothing on the structure: a run for each file would only lend
    each function poles of its own.
    """
    if any(files.together for files in configuration.files):
        return entries
    ends: dict[int, tuple[set[Dof], set[Dof]]] = {}
    for entry in entries:
        outputs, inputs = ends.setdefault(entry.run, (set(), set()))
        outputs.add(entry.output)
        inputs.add(entry.input)
    sensors = next(iter(ends.values()))[0] if ends else set()
    forces = [force for _, inputs in ends.values() for force in inputs]
    stay = all(outputs == sensors for outputs, _ in ends.values())
    if len(ends) < 2 or not stay or len(set(forces)) < len(forces) or len(forces) <= len(sensors):
        return entries
    notes.append(
        f"{len(ends)} files are one run: the sensors stay while the hammer roves, and nothing on the structure "
        "changes; if it did, write each file as a [[configuration.run]]"
    )
    return [replace(entry, run=0) for entry in entries]


def _groups(files: Files) -> list[tuple[tuple[Path, ...], ...]]:
    """Return the files of each run."""
    return [files.sets] if files.together else [(one,) for one in files.sets]


def _records(campaign: Campaign, configuration: Configuration, notes: list[str]) -> Iterator[list[Run]]:
    """Give the runs of time histories of each group of files; records that are one block come in a common length."""
    if campaign.averaging is None:
        return
    groups = [group for files in configuration.files for group in _groups(files)]
    of_groups = (records_of(campaign, group, notes) for group in groups)
    whole = campaign.averaging.block_s is None
    yield from of_common_length(list(of_groups), notes) if whole else of_groups


def _entries(
    campaign: Campaign, files: Files, n_run: int, records: Iterator[list[Run]], notes: list[str]
) -> tuple[list[_Entry], int]:
    """Read files that share a list of DOFs; return their FRFs and the number of runs so far."""
    collected: list[_Found] = []
    for group in _groups(files):
        if campaign.averaging is not None:
            position = 1
            for contents in next(records):
                estimated = frfs_from_records(contents, campaign.averaging, notes)
                collected += [(*f, n_run, i) for i, f in enumerate(estimated, start=position)]
                position += len(estimated)
                n_run += 1
            continue
        for (file,) in group:
            functions = frfs_of(campaign, file, notes)
            collected += [(*f, 0.0, campaign.decay_rate, n_run, i) for i, f in enumerate(functions, start=1)]
        n_run += 1
    if not campaign.corrections and not (files.output or files.input):
        collected = _with_dofs(collected, notes)
    outputs = _listed(campaign, "output", files, files.output, len(collected))
    inputs = _listed(campaign, "input", files, files.input, len(collected))
    entries: list[_Entry] = []
    for (function, coherence, overload, decay_rate, run, position), output, force in zip(
        collected, outputs, inputs, strict=True
    ):
        entry = _corrected(campaign, function, coherence, run, position, output, force, notes)
        if entry is not None:
            if entries and np.array_equal(entry.frequency, entries[-1].frequency):
                entry = replace(entry, frequency=entries[-1].frequency)  # held once for all
            entries.append(replace(entry, overload=overload, decay_rate=decay_rate))
    return entries, n_run


_Found = tuple[MeasuredFunction, MeasuredFunction | None, float, float, int, int]


def _with_dofs(entries: list[_Found], notes: list[str]) -> list[_Found]:
    """Leave out functions whose file states no DOF, such as point -1, where it states those of others."""
    stated = [f.output is not None and f.input is not None for f, *_ in entries]
    if not any(stated):
        return entries
    notes.extend(
        f"{one[0].source}: left out, it states no point and direction of response or force, as others do"
        for one, good in zip(entries, stated, strict=True)
        if not good
    )
    return [one for one, good in zip(entries, stated, strict=True) if good]


def _listed(campaign: Campaign, key: str, files: Files, dofs: tuple[Dof, ...], count: int) -> Sequence[Dof | None]:
    if not dofs:
        return [None] * count
    if len(dofs) not in (1, count):
        names = ", ".join(f.name for f in files.files[:3])
        raise CampaignError(
            f"{campaign.path}: {key}: {len(dofs)} DOFs are listed for {count} FRFs in {names}"
            f"{', ...' if len(files.files) > 3 else ''}; list one for each FRF, or one for all"
        )
    return dofs if len(dofs) == count else dofs * count


def _corrected(
    campaign: Campaign,
    function: MeasuredFunction,
    coherence: MeasuredFunction | None,
    run: int,
    position: int,
    output: Dof | None,
    force: Dof | None,
    notes: list[str],
) -> _Entry | None:
    """Return the function with its DOFs and corrections, or None where a correction excludes it."""
    output = output or _from_file(campaign.geometry, function.output)
    force = force or _from_file(campaign.geometry, function.input)
    value = np.asarray(function.value, complex)
    for correction in campaign.corrections:
        if not _applies(correction, function, position, output):
            continue
        notes.append(f"{function.source}: corrected as the campaign file says: {correction.reason}")
        if correction.exclude:
            return None
        value = correction.changed(value)
        output, force = correction.new_output or output, correction.new_input or force
    for key, dof in (("output", output), ("input", force)):
        if dof is None:
            raise MeasurementError(
                f"{function.source}: the file does not state the {key} DOF (point 0 or direction 0); "
                f"list it in the campaign file, such as {key} = ['12+z']"
            )
    if function.quantity is None:
        raise MeasurementError(
            f"{function.source}: the file does not state which quantity over force this FRF is; "
            "say [measurement] unit = 'm/s2/N' or what it is in the campaign file, of volts with the sensor's "
            "sensitivity: unit = 'V/N/(100 mV/g)'"
        )
    assert output is not None
    assert force is not None
    _require_points(campaign, function, (output, force))
    return _Entry(
        frequency=snapped(function.abscissa),
        value=value,
        coherence=None if coherence is None else coherence.value,
        quantity=function.quantity,
        output=output,
        input=force,
        run=run,
        source=function.source,
        component=function.component,
    )


def _require_points(campaign: Campaign, function: MeasuredFunction, dofs: tuple[Dof, Dof]) -> None:
    """Refuse a response or force at a point that is not listed: it is more often mistyped than meant."""
    known = campaign.geometry.node
    if campaign.points is None:
        return
    for role, dof in zip(("response", "force"), dofs, strict=True):
        if dof.node not in known and dof.node not in campaign.without_coordinates:
            raise MeasurementError(
                f"{function.source}: point {dof.node} of the {role} is not in {campaign.points}, which lists "
                f"{known.size} points from {known.min()} to {known.max()}. Add it there, correct the DOF in the "
                "campaign file ('output', 'input' or a [[correction]]), or, where nobody knows where it is, say "
                f"without_coordinates = [{dof.node}] under [points]"
            )


def _from_file(geometry: Geometry, stated: tuple[int, int] | None) -> Dof | None:
    return None if stated is None else Dof(stated[0], geometry.direction(*stated))


def _applies(correction: Correction, function: MeasuredFunction, position: int, output: Dof | None) -> bool:
    return (
        any(function.source.startswith(f"{file}:") for file in correction.files)
        and correction.function in (None, position)
        and (correction.output is None or (output is not None and _key(correction.output) == _key(output)))
    )


def _key(dof: Dof) -> tuple[int, tuple[float, ...]]:
    return dof.node, tuple(round(d, 6) + 0.0 for d in dof.direction)


def _name(key: tuple[int, tuple[float, ...]]) -> str:
    return _dofs([Dof(key[0], key[1])]).name(0)  # type: ignore[arg-type]  # three components


def _require_not_negative(entries: list[_Entry]) -> None:
    for entry in entries:
        if np.any(entry.frequency < 0.0):
            raise MeasurementError(
                f"{entry.source}: the frequency axis reaches down to {np.nanmin(entry.frequency):g} Hz; export "
                "one-sided functions, of 0 Hz and above, and check the column, the start and the step of the axis"
            )


def _with_axis(entries: list[_Entry], notes: list[str]) -> list[_Entry]:
    """Turn functions round that begin at their highest frequency, and leave out those whose axis goes no way at all."""
    good = []
    for given in entries:
        step = np.diff(given.frequency)
        entry = _turned_round(given) if step.size and np.all(step < 0) else given
        step = np.diff(entry.frequency)
        if step.size and np.all(step > 0) and np.isfinite(entry.frequency).all():
            good.append(entry)
        else:
            notes.append(f"{entry.source}: left out, its frequency axis does not ascend")
    if not good:
        raise MeasurementError(f"{entries[0].source}: no function has an ascending frequency axis")
    return good


def _turned_round(entry: _Entry) -> _Entry:
    """Return a function with its lines in the opposite order, as a sweep downwards gives them."""
    coherence = None if entry.coherence is None else entry.coherence[::-1]
    return replace(entry, frequency=entry.frequency[::-1], value=entry.value[::-1], coherence=coherence)


def _one_sided(entries: list[_Entry], notes: list[str]) -> list[_Entry]:
    """Leave out the lines above half the sampling rate that a discrete Fourier transform has: mirror images."""
    alike = 1e-6  # of the whole: rounding
    good = []
    for given in entries:
        entry, value = given, given.value[np.count_nonzero(given.frequency == 0.0) :]
        n = value.size // 2  # mirror images; the line between them, if there is one, is its own
        apart = np.linalg.norm(value[:n] - value[: -n - 1 : -1].conj())
        if value.imag.any() and apart < alike * np.linalg.norm(value):
            one = slice(len(given.value) - n)
            coherence = None if given.coherence is None else given.coherence[one]
            entry = replace(given, frequency=given.frequency[one], value=given.value[one], coherence=coherence)
            notes.append(f"{given.source}: its lines above {entry.frequency[-1]:g} Hz mirror those below; left out")
        good.append(entry)
    return good


def _one_quantity(entries: list[_Entry], notes: list[str]) -> list[_Entry]:
    """Differentiate all functions to the highest quantity present; that needs no division at 0 Hz."""
    highest = max((e.quantity for e in entries), key=DERIVATIVE.__getitem__)
    lower = sorted({e.quantity for e in entries} - {highest})
    if not lower:
        return entries
    notes.append(f"functions of {' and '.join(lower)} are differentiated to {highest}")
    converted = []
    for entry in entries:
        factor = (2j * np.pi * entry.frequency) ** (DERIVATIVE[highest] - DERIVATIVE[entry.quantity])
        converted.append(replace(entry, value=entry.value * factor, quantity=highest))
    return converted


def _one_axis(entries: list[_Entry], notes: list[str]) -> list[_Entry]:
    """Bring all functions onto the lines that they share: of the axes that some have, that which keeps most values."""
    axes = {(e.frequency.size, float(e.frequency[0]), float(e.frequency[-1])): e.frequency for e in entries}
    if len(axes) == 1:
        reference = entries[0].frequency
        if all(np.allclose(e.frequency, reference) for e in entries):
            return [replace(e, frequency=reference) for e in entries]
    count = Counter((e.frequency.size, float(e.frequency[0]), float(e.frequency[-1])) for e in entries)
    kept = {
        key: sum(count[other] * _lines_in(axis, reference).size for other, axis in axes.items())
        for key, reference in axes.items()
    }
    reference = axes[max(axes, key=lambda key: (kept[key], count[key]))]
    lines = [_lines_in(e.frequency, reference) for e in entries]
    for entry, own in zip(entries, lines, strict=True):
        if not own.size:
            notes.append(
                f"{entry.source}: left out, its {entry.frequency.size} lines from {entry.frequency[0]:g} to "
                f"{entry.frequency[-1]:g} Hz are not among those of the others, "
                f"{reference.size} from {reference[0]:g} to {reference[-1]:g} Hz"
            )
    fitting = [(entry, own) for entry, own in zip(entries, lines, strict=True) if own.size]
    thinned = [entry for entry, own in fitting if own.size > 1 and np.any(np.diff(own) > 1)]
    if thinned:
        notes.append(
            f"of {len(thinned)} functions, such as {thinned[0].source}, those lines are used that the others have, "
            f"{reference[1] - reference[0]:g} Hz apart"
        )
    near = 0.1 * float(np.median(np.diff(reference))) if reference.size > 1 else 0.1
    lower = max(entry.frequency[own[0]] for entry, own in fitting)
    upper = min(entry.frequency[own[-1]] for entry, own in fitting)
    common = reference[(reference >= lower - near) & (reference <= upper + near)]
    if common.size < 2:
        raise MeasurementError(f"{fitting[0][0].source} and the other functions share fewer than two frequency lines")
    if common.size < reference.size:
        notes.append(f"all functions are cropped to their common lines, {common[0]:g} to {common[-1]:g} Hz")
    cropped = []
    for entry, _ in fitting:
        keep = _lines_in(entry.frequency, common)
        coherence = None if entry.coherence is None else entry.coherence[keep]
        cropped.append(replace(entry, frequency=common, value=entry.value[keep], coherence=coherence))
    return cropped


def _lines_in(axis: Reals, reference: Reals, *, aside: float = 0.1) -> Integers:
    """Return where the lines of another axis lie in one, as far as it reaches; none where it lacks some, or half.

    `aside`: share of a step that a line may lie beside the other.
    """
    near = aside * float(np.median(np.diff(reference))) if reference.size > 1 else aside
    wanted = reference[(reference >= axis[0] - near) & (reference <= axis[-1] + near)]
    at = np.minimum(np.searchsorted(axis, wanted - near), axis.size - 1)
    fits = wanted.size > 1 and wanted.size >= reference.size // 2 and np.all(np.abs(axis[at] - wanted) <= near)
    return at if fits else at[:0]


_Pairs = dict[tuple[tuple[int, tuple[float, ...]], tuple[int, tuple[float, ...]]], _Entry]


def _without_duplicates(entries: list[_Entry], notes: list[str]) -> _Pairs:
    """Keep the last measurement of each pair of DOFs: one repeats what was in doubt."""
    pairs: _Pairs = {}
    for entry in entries:
        key = (_key(entry.output), _key(entry.input))
        earlier = pairs.get(key)
        if earlier is not None:
            with np.errstate(invalid="ignore", divide="ignore"):
                change = np.linalg.norm(entry.value - earlier.value) / np.linalg.norm(entry.value)
            _require_repeat(entry, earlier, key, float(change))
            notes.append(
                f"{_name(key[0])} over {_name(key[1])} is measured twice: {entry.source} replaces "
                f"{earlier.source}, from which it differs by {100 * change:.2g} %"
            )
        pairs[key] = entry
    return pairs


def _require_repeat(entry: _Entry, earlier: _Entry, key: tuple[Any, Any], change: float) -> None:
    """Refuse what is no repeat of one function: of two parts of a structure, or two that differ as strangers do.

    Of two functions that have nothing in common the difference is larger than either. In another run the structure may
    carry a sensor elsewhere, which moves narrow resonances aside.
    """
    where = f"{entry.source} and {earlier.source} are both {_name(key[0])} over {_name(key[1])}, but "
    remedy = "by a [[correction]] with new_output, or exclude its functions"
    if entry.component != earlier.component:
        raise MeasurementError(
            f"{where}of the components {entry.component!r} and {earlier.component!r}: give the points of one of them "
            f"other numbers, {remedy}"
        )
    larger = max(np.linalg.norm(entry.value), np.linalg.norm(earlier.value))
    if entry.run == earlier.run and change * np.linalg.norm(entry.value) > larger:
        raise MeasurementError(
            f"{where}differ by {100 * change:.2g} %, so that neither repeats the other: give one of them its own DOF "
            f"in 'output' or 'input', or {remedy}"
        )


def _full_block(
    pairs: _Pairs, notes: list[str]
) -> tuple[list[tuple[int, tuple[float, ...]]], list[tuple[int, tuple[float, ...]]]]:
    """Return outputs and inputs of which every pair is measured; leave out what has most pairs missing."""
    outputs = list(dict.fromkeys(output for output, _ in pairs))
    inputs = list(dict.fromkeys(force for _, force in pairs))
    while True:
        missing = np.array([[(o, i) not in pairs for i in inputs] for o in outputs])
        if not missing.any():
            return outputs, inputs
        of_output, of_input = missing.mean(axis=1), missing.mean(axis=0)
        if of_output.max() >= of_input.max():
            left_out, role = outputs.pop(int(of_output.argmax())), "response"
        else:
            left_out, role = inputs.pop(int(of_input.argmax())), "force"
        notes.append(f"{role} {_name(left_out)} is left out: not measured with all of the others")


def _block(
    pairs: _Pairs,
    outputs: list[tuple[int, tuple[float, ...]]],
    inputs: list[tuple[int, tuple[float, ...]]],
    notes: list[str],
) -> tuple[FRF, Reals]:
    table = [[pairs[o, i] for i in inputs] for o in outputs]
    responses, forces = [row[0].output for row in table], [entry.input for entry in table[0]]
    reciprocal = len(inputs) > len(outputs)
    if reciprocal:
        notes.append(
            f"{len(inputs)} force points and {len(outputs)} response(s): given by reciprocity as "
            f"{len(inputs)} responses to {len(outputs)} force(s)"
        )
        table = [list(column) for column in zip(*table, strict=True)]
        responses, forces = forces, responses
    coherence = None
    entries = [entry for row in table for entry in row]
    if all(e.coherence is not None for e in entries):
        coherence = np.array([[e.coherence for e in row] for row in table])
    elif any(e.coherence is not None for e in entries):
        notes.append("only some functions have a coherence; it is left out")
    overload = np.array([max(e.overload for e in row) for row in table])
    value = np.empty((len(table), len(table[0]), entries[0].frequency.size), complex)
    for row, of_output in zip(value, table, strict=True):
        for function, e in zip(row, of_output, strict=True):
            function[:] = e.value
    value.flags.writeable = False  # so that it is not copied again: it may be the larger part of the memory
    frf = FRF(
        frequency=entries[0].frequency,
        value=value,
        quantity=entries[0].quantity,
        output=_dofs(responses),
        input=_dofs(forces),
        run=np.array([row[0].run for row in table]),
        source=tuple(row[0].source for row in table),
        coherence=coherence,
        decay_rate=_decay_rate(entries),
        reciprocal=reciprocal,
    )
    return frf, overload


def _decay_rate(entries: Sequence[_Entry], *, same_window: float = 1e-3) -> float:
    """Return what the exponential window adds to decay rates, 1/s, the same in all functions.

    `same_window`: relative difference of decay rates by the rounding of a block's length.
    """
    slow, fast = (limit(entries, key=lambda e: e.decay_rate) for limit in (min, max))
    if fast.decay_rate > (1.0 + same_window) * slow.decay_rate:
        raise MeasurementError(
            f"the exponential window adds {fast.decay_rate:.4g} 1/s to the decay rates in {fast.source} and "
            f"{slow.decay_rate:.4g} in {slow.source}; use one window, or make each a configuration"
        )
    return fast.decay_rate


def _dofs(dofs: list[Dof]) -> Dofs:
    return Dofs(node=np.array([d.node for d in dofs]), direction=np.array([d.direction for d in dofs]))
