"""What the configurations of a campaign, put beside each other, say of the campaign as a whole."""

from __future__ import annotations

from collections.abc import Sequence

from ema import compare, content_digests, contradicted, shared_functions
from updating.results.identified import MEASUREMENT, Identified
from updating.results.store import read_frf


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
    models = [found.modal_model for found in results]
    digests = {found.modal_model.name: content_digests(read_frf(found.folder / MEASUREMENT)) for found in results}
    stated = contradicted([found.configuration for found in results], models, compare(models))
    return (*shared_functions(digests), *stated)
