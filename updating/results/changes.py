"""States of a campaign against their references: compared once all modes are there, written, and read back."""

from __future__ import annotations

from collections.abc import Sequence

from ema import Campaign, Change, change, change_csv
from ema.campaign.campaign_file import repeats_of
from ema.types.errors import IdentificationError
from updating.results.identified import Identified
from updating.results.store import write_bytes, write_result

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
    done = {found.configuration.name: found for found in results}
    changes, lost = [], []
    for own in campaign.configurations:
        if not own.compare_to:
            continue
        states = [n for n in repeats_of(campaign.configurations, (own.name,)) if n in done]
        references = [n for n in repeats_of(campaign.configurations, own.compare_to) if n in done]
        if own.name not in done or not references:
            which = own.name if own.name not in done else ", ".join(own.compare_to)
            lost.append(f"{own.name} is not compared with {', '.join(own.compare_to)}: {which} has no modes")
            continue
        used = [done[name] for name in (*states, *references)]
        models = [found.modal_model for found in used]
        try:
            found = change(models[: len(states)], models[len(states) :], campaign.reassembly)
        except IdentificationError as error:
            lost.append(f"{own.name} is not compared with {', '.join(own.compare_to)}: {error}")
            continue
        folder = done[own.name].folder
        inputs = tuple(each.folder / "modal_model.json" for each in used)
        write_result(folder / CHANGE, found, inputs=inputs, options={})
        write_bytes(folder / "change.csv", change_csv(found).encode())
        changes.append(found)
    return tuple(changes), tuple(lost)
