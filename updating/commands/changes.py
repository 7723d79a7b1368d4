"""The part of `lamella diagnose` on states that have a reference: what changed, and where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from rich.console import Console

from ema import Campaign, Change, change_sentence, read_campaign
from ema.campaign.campaign_file import repeats_of
from ema.types.threads import single_threaded
from model import catalogue, read_stack
from model.stack.stack_file import stack_inputs
from updating.changes.compare import what_changed
from updating.changes.situation import FittedReference, fit_reference
from updating.commands.terminal import progress
from updating.diagnosis.assembly import Campaigned
from updating.diagnosis.cached_model import cached_model
from updating.diagnosis.candidates import instruments_of
from updating.diagnosis.evidence import DiagnosisScatter
from updating.diagnosis.scatter_file import read_scatter
from updating.errors import FitError
from updating.fitting.target import model_file, stack_in_state
from updating.results.changes import WHAT_CHANGED, compared
from updating.results.identified import Identified, assignments, every_identified
from updating.results.store import kept
from updating.results.what_changed import WhatChanged

FITTED = ("support_compliance",)
"""Effects that the model of a reference has in any case where the structure can: no edge is held rigidly."""


def changed_names(campaign: Campaign) -> frozenset[str]:
    """Return the configurations that have a reference, and those that repeat them."""
    own = [c.name for c in campaign.configurations if c.compare_to]
    return frozenset(repeats_of(campaign.configurations, own))


def diagnose_changes(
    campaign_file: Path,
    output: Path,
    console: Console,
    *,
    scatter_file: Path | None = None,
    cluster: str | None = None,
    keep: bool = False,
) -> tuple[WhatChanged, ...]:
    """Say of every configuration that has a reference whether it changed, and, with a stack file, what and where.

    Writes change.json and what_changed.json beside the modes of each; those that an earlier run left are read back.

    Raises
    ------
    FitError
        A state and its reference are not of one height, or no state can be compared.
    """
    campaign = read_campaign(campaign_file)
    tests = every_identified(assignments(campaign, output, keep=keep), "identify", console, cluster)
    changes, lost = compared(campaign, tests)
    for line in lost:
        console.print(line, markup=False, highlight=False)
    if campaign.stack is None or campaign.points is None:
        for change in changes:
            console.print(f"{change_sentence(change)}.", markup=False, highlight=False)
        what = 'stack = "stack.toml" under [structure]' if campaign.stack is None else "file under [points]"
        console.print(f"What changed, and where, takes a model: add {what}.", markup=False, highlight=False)
        return ()
    models = _Models(campaign, tests, None if scatter_file is None else read_scatter(scatter_file))
    stated = () if scatter_file is None else (scatter_file,)
    found = []
    inputs = (campaign_file, *stack_inputs(campaign.stack), *stated)
    for change in changes:
        console.print(f"{change_sentence(change)}.", markup=False, highlight=False)
        try:
            with progress(f"what changed in {change.name}", console):
                own = models.kept(change, inputs, keep=keep)
        except FitError as error:
            console.print(f"{change.name}, what and where: {error}", markup=False, highlight=False)
            continue
        for sentence in own.sentences:
            console.print(f"  {sentence}", markup=False, highlight=False)
        found.append(own)
    return tuple(found)


class _Models:
    """The model of a campaign's stack, and its fits to references, each made when it is first asked for."""

    def __init__(
        self, campaign: Campaign, tests: Sequence[Identified], scatter: DiagnosisScatter | None
    ) -> None:
        self.campaign, self.scatter = campaign, scatter
        self.tested = {own.configuration.name: own for own in tests}
        self.stack = read_stack(model_file(campaign, "what changed"))
        self.fitted: dict[tuple[str, ...], FittedReference] = {}

    def _campaigned(self, name: str) -> Campaigned:
        own = self.tested[name]
        return name, stack_in_state(self.stack, own.configuration).contact.pressure, own.modal_model

    def kept(self, change: Change, inputs: tuple[Path, ...], *, keep: bool) -> WhatChanged:
        """Return what changed in a state as an earlier run left it, or find it and write it."""
        names = (*change.reference, *change.repeats)
        modal = tuple(self.tested[name].folder / "modal_model.json" for name in names)
        return kept(
            self.tested[change.name].folder / WHAT_CHANGED,
            WhatChanged,
            partial(self.what_changed, change),
            inputs=(*inputs, *modal),
            options={},
            keep=keep,
        )

    @single_threaded
    def what_changed(self, change: Change) -> WhatChanged:
        """Say what changed in a state."""
        name, reference, repeats = change.name, change.reference, change.repeats
        heights = {
            stack_in_state(self.stack, self.tested[n].configuration).height for n in (*reference, *repeats)
        }
        if len(heights) > 1:
            listed = " and ".join(f"{1e3 * height:g}" for height in sorted(heights))
            message = f"it and its reference are {listed} mm high; what changed is asked of one structure"
            raise FitError(message)
        if reference not in self.fitted:
            stack = replace(self.stack, height=heights.pop())
            known = catalogue()
            effects = {n: known[n] for n in FITTED} if stack.supports else {}
            candidates = cached_model(stack, instruments_of(self.tested[reference[0]].modal_model), effects)
            self.fitted[reference] = fit_reference(
                candidates, [self._campaigned(n) for n in reference], scatter=self.scatter
            )
        states = [self._campaigned(n) for n in (name, *(n for n in repeats if n != name))]
        return what_changed(self.fitted[reference], states, self.campaign.reassembly, seen=change.changed)
