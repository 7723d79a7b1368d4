"""What the configurations of a campaign, put beside each other, say of the campaign as a whole."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from ema import compare, content_digests, contradicted, shared_functions
from ema.quality.linearity import NOT_LINEAR
from updating.results.chosen_poles import BY_HAND
from updating.results.identified import MEASUREMENT, Identified
from updating.results.store import read_frf

_MOST = 4  # findings of a configuration that are told


def campaign_findings(results: Sequence[Identified]) -> tuple[str, ...]:
    """Say which files stand in several configurations, and what is stated that the modes contradict.

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
    models = [found.modal_model for found in results]
    digests = {
        found.modal_model.name: content_digests(read_frf(found.folder / MEASUREMENT))
        for found in results
        if not found.modal_model.read_from
    }
    stated = contradicted([found.configuration for found in results], models, compare(models))
    return (*shared_functions(digests), *stated)


def measurement_findings(results: Sequence[Identified], followed: Collection[str] = ()) -> Iterator[str]:
    """Say what was found of the measurements that an answer rests on, for it is no better than they are.

    Parameters
    ----------
    results : sequence of Identified
        The configurations that the answer rests on.
    followed : collection of str
        Names of those whose force levels the answer rests on, too: that they differ is then no fault.
    """
    for finding in campaign_findings(results):
        yield f"In the campaign: {finding}"
    for found in results:
        findings = found.quality.findings
        if found.configuration.name in followed:
            findings = tuple(finding for finding in findings if not finding.endswith(NOT_LINEAR))
        by_hand = [
            finding for finding in findings if BY_HAND in finding
        ]  # is said, however many others there are
        findings = (*by_hand, *(finding for finding in findings if finding not in by_hand))
        for finding in findings[:_MOST]:
            yield f"In the measurement of {found.configuration.name}: {finding}"
        if len(findings) > _MOST:
            yield f"{len(findings) - _MOST} more findings are in {found.folder / 'quality.json'}."
