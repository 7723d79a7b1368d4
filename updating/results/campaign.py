"""What identified configurations say together: modes over force levels, states beside references, findings."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ema import Campaign, Change, change, change_csv, compare, content_digests, contradicted, shared_functions
from ema.campaign.campaign_file import repeats_of
from ema.identification.amplitude import (
    AmplitudeDependence,
    Level,
    amplitude_dependence,
    at_resonance,
    identify_force_levels,
)
from ema.modal.change import KINDS, STATED_FREEDOM
from ema.quality.linearity import NOT_LINEAR
from ema.types.errors import IdentificationError
from ema.types.modal_model import ModalModel
from lamella_shared import Reals
from updating.results.identified import BY_HAND, MEASUREMENT, Assignment, Identified, made_from
from updating.results.store import read_current, read_frf, read_result, write_bytes, write_result
from updating.results.text import Table, uncertain

AMPLITUDE = "amplitude.json"
"""File of modes over amplitude, in the folder of a configuration."""


@dataclass(frozen=True, eq=False, kw_only=True)
class OverAmplitude:
    """What a configuration shows at its force levels.

    Attributes
    ----------
    dependence : AmplitudeDependence
        Its modes over amplitude.
    level : tuple of ModalModel
        The modes of each level, in the order of `dependence.level`, with frequencies and damping ratios in resonance.
    lost : tuple of str
        Why levels are left out.
    """

    dependence: AmplitudeDependence
    level: tuple[ModalModel, ...]
    lost: tuple[str, ...]

    @property
    def rms_motion(self) -> tuple[Reals, ...]:
        """Root mean square of the displacement amplitudes of all responses of each mode of each level, m."""
        return self._of_each_level(self.dependence.rms_motion)

    @property
    def motion(self) -> tuple[Reals, ...]:
        """Displacement amplitude at `dependence.point` of each mode of each level, m."""
        return self._of_each_level(self.dependence.motion)

    def _of_each_level(self, table: Reals) -> tuple[Reals, ...]:
        """Return a table of the dependence in the order of the modes of each level."""
        by_level = []
        for modes, number, values in zip(self.level, self.dependence.mode, table, strict=True):
            in_order = np.full(modes.frequency.size, np.nan)
            in_order[number[number >= 0]] = values[number >= 0]
            by_level.append(in_order)
        return tuple(by_level)

    @property
    def findings(self) -> tuple[str, ...]:
        """What a user should read."""
        return (*self.lost, *self.dependence.findings)


def over_amplitude(assigned: Assignment, identified: Identified) -> OverAmplitude | None:
    """Follow a configuration's modes over its force levels; write amplitude.json, or read back what a run left.

    Parameters
    ----------
    assigned : Assignment
        The configuration.
    identified : Identified
        It at the force of its own files.

    Returns
    -------
    OverAmplitude or None
        None where it has no further level, or does not state its own force.

    Raises
    ------
    EmaError
        The files of a level cannot be read.
    StoreError
        The result cannot be written.
    """
    configuration = assigned.configuration
    if not configuration.force_levels or configuration.force is None:
        return None
    inputs, options = made_from(assigned)
    inputs = (*inputs, identified.folder / MEASUREMENT)
    path = identified.folder / AMPLITUDE
    earlier = read_current(path, OverAmplitude, inputs=inputs, options=options)
    if earlier is not None:
        return earlier
    base = Level(
        force=configuration.force, frf=read_frf(identified.folder / MEASUREMENT), modal_model=identified.modal_model
    )
    others, lost = identify_force_levels(assigned.campaign, configuration.name)
    levels = sorted((base, *others), key=lambda level: level.force)
    result = OverAmplitude(
        dependence=amplitude_dependence(configuration.name, levels),
        level=tuple(at_resonance(level) for level in levels),
        lost=lost,
    )
    write_result(path, result, inputs=inputs, options=options)
    return result


def stored_amplitude(identified: Identified) -> OverAmplitude | None:
    """Return what `over_amplitude` wrote of a configuration; None of one without force levels.

    Raises
    ------
    StoreError
        It is missing or damaged.
    """
    configuration = identified.configuration
    if not configuration.force_levels or configuration.force is None:
        return None
    return read_result(identified.folder / AMPLITUDE, OverAmplitude)


def campaign_findings(results: Sequence[Identified]) -> tuple[str, ...]:
    """Say which files several configurations name, and which statements the modes contradict.

    Parameters
    ----------
    results : sequence of Identified
        The configurations, whose measurements are in their folders.

    Raises
    ------
    StoreError
        A measurement cannot be read.
    """
    if len(results) < 2:
        return ()
    models = [identified.modal_model for identified in results]
    digests = {
        identified.modal_model.name: content_digests(read_frf(identified.folder / MEASUREMENT))
        for identified in results
        if not identified.modal_model.read_from
    }
    stated = contradicted([identified.configuration for identified in results], models, compare(models))
    return (*shared_functions(digests), *stated)


def measurement_findings(results: Sequence[Identified], followed: Collection[str] = ()) -> Iterator[str]:
    """Yield the findings about the measurements that an answer is computed from.

    Parameters
    ----------
    results : sequence of Identified
        The configurations that the answer rests on.
    followed : collection of str
        Names of those whose force levels the answer rests on, too: that they differ is then no fault.
    """
    most = 4  # findings of a configuration that are reported
    for finding in campaign_findings(results):
        yield f"In the campaign: {finding}"
    for identified in results:
        findings = identified.quality.findings
        if identified.configuration.name in followed:
            findings = tuple(finding for finding in findings if not finding.endswith(NOT_LINEAR))
        # these are always given, however many others there are
        by_hand = [finding for finding in findings if BY_HAND in finding]
        findings = (*by_hand, *(finding for finding in findings if finding not in by_hand))
        for finding in findings[:most]:
            yield f"In the measurement of {identified.configuration.name}: {finding}"
        if len(findings) > most:
            yield f"{len(findings) - most} more findings are in {identified.folder / 'quality.json'}."


CHANGE = "change.json"
"""File of what differs between a configuration and its reference, in the folder of the configuration."""

WHAT_CHANGED = "what_changed.json"
"""File of what changed there, and where, by a model."""


def compared(campaign: Campaign, results: Sequence[Identified]) -> tuple[tuple[Change, ...], tuple[str, ...]]:
    """Compare every configuration that has a reference with it; write change.json and change.csv beside its modes.

    Parameters
    ----------
    campaign : Campaign
        It says which configuration has which reference, and what repeats what.
    results : sequence of Identified
        Configurations that were identified.

    Returns
    -------
    tuple of (tuple of Change, tuple of str)
        What was found, in the order of the campaign, and why others cannot be compared.

    Raises
    ------
    StoreError
        A result cannot be written.
    """
    by_name = {identified.configuration.name: identified for identified in results}
    changes, lost = [], []
    for configuration in campaign.configurations:
        if not configuration.compare_to:
            continue
        states = [n for n in repeats_of(campaign.configurations, (configuration.name,)) if n in by_name]
        references = [n for n in repeats_of(campaign.configurations, configuration.compare_to) if n in by_name]
        if configuration.name not in by_name or not references:
            which = configuration.name if configuration.name not in by_name else ", ".join(configuration.compare_to)
            lost.append(
                f"{configuration.name} is not compared with {', '.join(configuration.compare_to)}: {which} has no modes"
            )
            continue
        used = [by_name[name] for name in (*states, *references)]
        models = [identified.modal_model for identified in used]
        try:
            difference = change(models[: len(states)], models[len(states) :], campaign.reassembly)
        except IdentificationError as error:
            lost.append(f"{configuration.name} is not compared with {', '.join(configuration.compare_to)}: {error}")
            continue
        folder = by_name[configuration.name].folder
        inputs = tuple(identified.folder / "modal_model.json" for identified in used)
        write_result(folder / CHANGE, difference, inputs=inputs, options={})
        write_bytes(folder / "change.csv", change_csv(difference).encode())
        changes.append(difference)
    return tuple(changes), tuple(lost)


def change_table(change: Change) -> Table:
    """List the modes of both states side by side."""
    f_half, d_half = half_intervals(change)
    angle = np.where(np.isnan(change.angle), "", [f"{a:.1f}" for a in np.rad2deg(change.angle)])
    return Table(
        title=f"{change.name} against {', '.join(change.reference)}",
        header=(
            "mode", "f reference [Hz]", "f [Hz]", "shift of f [%]", "damping reference [%]", "damping [%]",
            "shift of damping [%]", "MAC", "angle of shapes [°]", "changed",
        ),
        rows=tuple(
            (
                str(change.reference_mode[r] + 1), f"{change.reference_frequency[r]:.2f}", f"{change.frequency[r]:.2f}",
                uncertain(100 * np.expm1(change.frequency_shift[r]), 100 * f_half[r]),
                f"{100 * change.reference_damping[r]:.3g}", f"{100 * change.damping[r]:.3g}",
                uncertain(100 * np.expm1(change.damping_shift[r]), 100 * d_half[r]),
                f"{change.mac[r]:.3f}", str(angle[r]),
                ", ".join(name for name, changed in zip(KINDS, change.which[r], strict=True) if changed),
            )
            for r in range(change.mode.size)
        ),
        note="± is half of the interval in which the shift of one mode of an unchanged structure lies in 95 of 100 "
        "cases, by what assemblies scatter and what noise leaves. Changed: what all tests together call changed, with "
        f"at most {100 * change.level:g} % false alarms.",
    )  # fmt: skip


def half_intervals(change: Change) -> tuple[Reals, Reals]:
    """Return half of the 95 % intervals of the shifts of an unchanged structure, frequency and damping, (n_mode,)."""
    factor = -scipy.special.stdtrit(STATED_FREEDOM + change.freedom, 0.025)
    return factor * change.frequency_scatter, factor * change.damping_scatter
