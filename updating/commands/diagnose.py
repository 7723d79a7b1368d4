"""The commands that ask what the model lacks, what changed, and which test would show more, also of many specimens."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ema import Campaign, Change, change_sentence, read_campaign
from ema.campaign.campaign_file import repeats_of
from ema.types.arrays import single_threaded
from model import Stack, catalogue, find_effects, read_matrices, read_stack
from model.matrices.structure_file import is_structure_file, matrices_inputs
from model.stack.stack_file import stack_inputs
from updating.commands.terminal import MOST_EXPLANATIONS, OUT, Run, print_lines, print_results, progress
from updating.diagnosis.answer import Diagnosis
from updating.diagnosis.cached_model import cached_model
from updating.diagnosis.candidates import MESSAGES, instruments_of
from updating.diagnosis.diagnosis import diagnose as diagnose_stack
from updating.diagnosis.evidence import Campaigned, DiagnosisScatter, read_scatter
from updating.diagnosis.slipping import AtLevel
from updating.diagnosis.text import next_command, second_level_text
from updating.errors import FitError
from updating.fitting.fit import model_file, stack_in_state
from updating.pooled.campaign_file import has_specimens, read_specimens, specimens_of
from updating.pooled.diagnosis import diagnose_specimens
from updating.results.campaign import (
    AMPLITUDE,
    WHAT_CHANGED,
    OverAmplitude,
    compared,
    measurement_findings,
    over_amplitude,
    stored_amplitude,
)
from updating.results.identified import Identified, assignments, every_identified, forget_choices
from updating.results.pooled import SPECIMEN_HEADER, PooledDiagnosis, explanation_text, specimen_row
from updating.results.store import kept, write_result
from updating.results.text import Table, in_percent
from updating.results.what_changed import WhatChanged
from updating.workers.workers import workers

if TYPE_CHECKING:
    from updating.changes.reference import FittedReference

FITTED = ("support_compliance",)
"""Effects that the model of a reference has in any case where the structure can: no edge is held rigidly."""


def changed_names(campaign: Campaign) -> frozenset[str]:
    """Return the configurations that have a reference, and those that repeat them."""
    names = [c.name for c in campaign.configurations if c.compare_to]
    return frozenset(repeats_of(campaign.configurations, names))


def diagnose_changes(run: Run) -> tuple[WhatChanged, ...]:
    """Say of every configuration that has a reference whether it changed, and, with a model, what and where.

    Writes change.json and what_changed.json beside the modes of each; those that an earlier run left are read back.

    Raises
    ------
    FitError
        A state and its reference are not of one height, or no state can be compared.
    """
    campaign, console = read_campaign(run.campaign), run.console
    tests = every_identified(assignments(campaign, run.output, keep=run.keep), "identify", console, run.cluster)
    changes, lost = compared(campaign, tests)
    changes = tuple(sorted(changes, key=lambda change: not change.changed))
    print_lines(console, lost, indent="")
    if campaign.stack is None or campaign.points is None:
        for change in changes:
            console.print(f"{change_sentence(change)}.")
        what = 'stack = "stack.toml" under [structure]' if campaign.stack is None else "file under [points]"
        console.print(f"What changed, and where, takes a model: add {what}.")
        return ()
    models = _Models(campaign, tests, _scatter(run))
    stack_file = campaign.stack
    named = matrices_inputs(stack_file) if is_structure_file(stack_file) else stack_inputs(stack_file)
    answers = []
    for change in changes:
        console.print(f"{change_sentence(change)}.")
        try:
            with progress(f"what changed in {change.name}", console):
                answer = models.kept(change, (run.campaign, *named, *run.stated), keep=run.keep)
        except FitError as error:
            console.print(f"{change.name}, what and where: {error}")
            continue
        print_lines(console, answer.sentences)
        answers.append(answer)
    return tuple(answers)


def _scatter(run: Run) -> DiagnosisScatter | None:
    """Return what a laboratory states of its scatter; None where it states nothing."""
    return None if run.scatter_file is None else read_scatter(run.scatter_file)


class _Models:
    """The model of a campaign's structure, and its fits to references, each made at its first use."""

    def __init__(self, campaign: Campaign, tests: Sequence[Identified], scatter: DiagnosisScatter | None) -> None:
        self.campaign, self.scatter = campaign, scatter
        self.tested = {test.configuration.name: test for test in tests}
        file = model_file(campaign, "what changed")
        self.model = read_matrices(file) if is_structure_file(file) else read_stack(file)
        self.fitted: dict[tuple[str, ...], FittedReference] = {}

    def _campaigned(self, name: str) -> Campaigned:
        test, pressure = self.tested[name], float("nan")
        if isinstance(self.model, Stack):
            pressure = stack_in_state(self.model, test.configuration).contact.pressure
        return name, pressure, test.modal_model

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
        from updating.changes.compare import what_changed
        from updating.changes.reference import fit_matrices_reference

        name, reference, repeats = change.name, change.reference, change.repeats
        model, of_reference = self.model, [self._campaigned(n) for n in reference]
        if isinstance(model, Stack):
            stack = self._in_one_height(model, (*reference, *repeats))
            if reference not in self.fitted:
                self.fitted[reference] = self._fitted_stack(stack, of_reference)
        elif reference not in self.fitted:
            self.fitted[reference] = fit_matrices_reference(model, of_reference, scatter=self.scatter)
        states = [self._campaigned(n) for n in (name, *(n for n in repeats if n != name))]
        return what_changed(self.fitted[reference], states, self.campaign.reassembly, seen=change.changed)

    def _in_one_height(self, stack: Stack, names: Sequence[str]) -> Stack:
        """Return the stack in the height of some states; raises FitError where they have several."""
        heights = {stack_in_state(stack, self.tested[n].configuration).height for n in names}
        if len(heights) > 1:
            listed = " and ".join(f"{1e3 * height:g}" for height in sorted(heights))
            raise FitError(f"it and its reference are {listed} mm high; what changed is asked of one structure")
        return replace(stack, height=heights.pop())

    def _fitted_stack(self, stack: Stack, reference: Sequence[Campaigned]) -> FittedReference:
        from updating.changes.reference import fit_reference

        known = catalogue()
        effects = {n: known[n] for n in FITTED} if stack.supports else {}
        candidates = cached_model(stack, instruments_of(reference[0][2]), effects)
        return fit_reference(candidates, reference, scatter=self.scatter)


@single_threaded
def diagnose_command(run: Run, *, reference: bool) -> None:
    """Diagnose what a campaign file lists, and print the answer."""
    if run.identify_anew:
        forget_choices(run.output)
    if has_specimens(run.campaign):
        print_pooled(diagnose_pooled(run), run.output)
        return
    if not reference and changed_names(read_campaign(run.campaign)):
        diagnose_changes(run)
        print_results(OUT, run.output)
        return
    diagnosis = diagnose_campaign(run)
    print_lines(OUT, diagnosis.sentences, indent="")
    OUT.print(diagnosis_table(diagnosis))
    print_measurement_findings(run)
    options = [("--effect-file", str(path)) for path in run.effect_files]
    options += [] if run.scatter_file is None else [("--scatter", str(run.scatter_file))]
    added = next_command(diagnosis, str(run.campaign), str(run.output), options)
    if added is not None:
        OUT.print(f"Add it and see the error fall: {added}", soft_wrap=True)
    print_results(OUT, run.output)


def diagnose_campaign(run: Run, asked: Sequence[Sequence[str]] = ()) -> Diagnosis:
    """Identify a campaign, diagnose its model, and write diagnosis.json.

    What an earlier run left is read back, unless it lacks explanations that are asked for.
    """
    campaign = read_campaign(run.campaign)
    stack_file = model_file(campaign, "a diagnosis")
    stack = None if is_structure_file(stack_file) else read_stack(stack_file)
    changed = changed_names(campaign)  # what a change did to a state is no effect that a model lacks
    states = (
        [] if stack is None else [stack_in_state(stack, c) for c in campaign.configurations if c.name not in changed]
    )
    heights = sorted({state.height for state in states})
    if len(heights) > 1:
        listed = " and ".join(f"{1e3 * height:g}" for height in heights)
        raise FitError(f"{run.campaign}: a diagnosis is of one stack; give the heights {listed} mm a campaign each")
    assigned = [a for a in assignments(campaign, run.output, keep=run.keep) if a.configuration.name not in changed]
    tests = every_identified(assigned, "identify", run.console, run.cluster)
    make: Callable[[], Diagnosis]
    if stack is None:
        make, files = partial(_diagnosed_matrices, run, stack_file, tests, asked), matrices_inputs(stack_file)
    else:
        _require_force(run.campaign, tests)
        over = [over_amplitude(assignment, test) for assignment, test in zip(assigned, tests, strict=True)]
        make = partial(_diagnosed_stack, run, replace(stack, height=heights[0]), by_level(states, tests, over), asked)
        followed = (t.folder / AMPLITUDE for t, amplitude in zip(tests, over, strict=True) if amplitude is not None)
        files = (*stack_inputs(stack_file), *followed)
    modal = (test.folder / "modal_model.json" for test in tests)
    inputs, path = (run.campaign, *files, *run.stated, *modal), run.output / "diagnosis.json"
    diagnosis = kept(path, Diagnosis, make, inputs=inputs, options={}, keep=run.keep)
    if not all(diagnosis.has(effects) for effects in asked):
        diagnosis = make()
        write_result(path, diagnosis, inputs=inputs, options={})
    return diagnosis


def _diagnosed_stack(
    run: Run, stack: Stack, tested: tuple[list[Campaigned], dict[str, AtLevel]], asked: Sequence[Sequence[str]]
) -> Diagnosis:
    with workers(MESSAGES, run.cluster) as executor, progress("diagnose", run.console):
        return diagnose_stack(
            stack, tested[0], catalogue(run.effect_files), scatter=_scatter(run), executor=executor,
            reduced=cached_model, asked=asked, levels=tested[1],
        )  # fmt: skip


def _diagnosed_matrices(run: Run, file: Path, tests: Sequence[Identified], asked: Sequence[Sequence[str]]) -> Diagnosis:
    from updating.diagnosis.matrices_answer import diagnose_matrices

    tested = [(test.configuration.name, test.modal_model) for test in tests]
    with progress("diagnose", run.console):
        return diagnose_matrices(read_matrices(file), tested, scatter=_scatter(run), asked=asked)


def _require_force(campaign_file: Path, tests: Sequence[Identified]) -> None:
    """Refuse modes of another program without the place of the force, where the shaker hangs."""
    unknown = [
        test.configuration.name
        for test in tests
        if test.configuration.has_modes and not any(group.input for group in test.configuration.files)
    ]
    if unknown:
        raise FitError(
            f"{campaign_file}: configuration {unknown[0]!r}: a diagnosis needs to know where the force acted; write "
            'input = "12+z" with its point and direction into each [[configuration]] with modes = "file"'
        )


def by_level(
    states: Sequence[Stack], tests: Sequence[Identified], over: Sequence[OverAmplitude | None]
) -> tuple[list[Campaigned], dict[str, AtLevel]]:
    """Return configurations for a diagnosis, each force level as a separate one, and which level each is."""
    tested: list[Campaigned] = []
    levels = {}
    for state, test, amplitude in zip(states, tests, over, strict=True):
        pressure = state.contact.pressure
        if amplitude is None:
            tested.append((test.configuration.name, pressure, test.modal_model))
            continue
        by_force = zip(amplitude.dependence.level, amplitude.level, amplitude.rms_motion, amplitude.motion, strict=True)
        for name, modes, rms, motion in by_force:
            tested.append((name, pressure, modes))
            levels[name] = AtLevel(state=test.configuration.name, rms_motion=rms, motion=motion)
    return tested, levels


def print_measurement_findings(run: Run) -> None:
    """Print the findings about the measurement on which an answer rests."""
    assigned = assignments(read_campaign(run.campaign), run.output, keep=run.keep)
    results = every_identified(assigned, "identify", OUT)
    followed = [result.configuration.name for result in results if stored_amplitude(result) is not None]
    print_lines(OUT, measurement_findings(results, followed), indent="")


def diagnosis_table(diagnosis: Diagnosis) -> Table:
    """Return the explanations that were fitted in full, the most probable first; the page has their parameters."""
    rows = [
        (
            " +\n".join(explanation.effects) or "none",
            f"{explanation.probability:.3f}",
            f"{100 * explanation.explained:.0f}",
            in_percent(explanation.frequency_error),
            in_percent(explanation.left_out_error),
        )
        for explanation in diagnosis.shown(MOST_EXPLANATIONS)
    ]
    header = ("effects", "proba-\nbility", "explained\n[%]", "f error\n[%]", "left out\n[%]")
    return Table("Explanations", header, rows)


@single_threaded
def next_test_command(run: Run) -> None:
    """Print further tests, those first that separate best what a diagnosis leaves open."""
    if run.identify_anew:
        forget_choices(run.output)
    read_stack(model_file(read_campaign(run.campaign), "a further test"))  # tests are of stacks
    diagnosis = diagnose_campaign(run)
    from updating.report.answer import next_test_table  # its pictures are not needed before

    if not diagnosis.next_tests:
        OUT.print(f"Nothing to separate: the verdict is {diagnosis.verdict!r}.")
    else:
        OUT.print(next_test_table(diagnosis))
    further = second_level_text(diagnosis)
    if further is not None:
        OUT.print(further)
    print_measurement_findings(run)


def diagnose_pooled(run: Run, fitted: Sequence[str] | None = None) -> PooledDiagnosis:
    """Diagnose all specimens of a campaign together, or fit effects of the rig to them, and write the answer.

    FRFs are identified first, in parallel. What an earlier run left is read back.

    Parameters
    ----------
    run : Run
        What to diagnose.
    fitted : sequence of str, optional
        Effects of the rig that are fitted, one after the other; the catalogue is searched by default.
    """
    known = catalogue(run.effect_files)
    effects = known if fitted is None else {effect.name: effect for effect in find_effects(fitted, known)}
    campaign = read_specimens(run.campaign)
    assigned = () if campaign.measured is None else assignments(campaign.measured, run.output)
    tests = every_identified(assigned, "identify", run.console, run.cluster) if assigned else ()
    by_name = {test.configuration.name: test.modal_model for test in tests}
    specimens = specimens_of(campaign, by_name.__getitem__)
    asked = fitted is not None

    def make() -> PooledDiagnosis:
        with workers(MESSAGES, run.cluster) as executor, progress("fit" if asked else "diagnose", run.console):
            return diagnose_specimens(
                campaign.name, specimens, effects, asked=asked, scatter=_scatter(run), executor=executor,
                reduced=cached_model,
            )  # fmt: skip

    inputs = (*campaign.inputs, *(test.folder / "modal_model.json" for test in tests), *run.stated)
    path = run.output / ("pooled_fit.json" if asked else "pooled_diagnosis.json")
    return kept(path, PooledDiagnosis, make, inputs=inputs, options={"effects": list(effects)} if asked else {})


def print_pooled(diagnosis: PooledDiagnosis, output: Path) -> None:
    """Print the answer, the explanations and the specimens."""
    print_lines(OUT, diagnosis.sentences, indent="")
    OUT.print(pooled_table(diagnosis))
    OUT.print(Table("Specimens", SPECIMEN_HEADER, [specimen_row(specimen) for specimen in diagnosis.specimens]))
    print_results(OUT, output)


def pooled_table(diagnosis: PooledDiagnosis) -> Table:
    """Return the explanations that were fitted in full, the most probable first."""
    rows = [
        (
            explanation_text(explanation),
            f"{explanation.probability:.3f}",
            in_percent(explanation.frequency_error),
            in_percent(explanation.left_out_error),
            in_percent(explanation.left_out_torque_error),
        )
        for explanation in diagnosis.ranking[:MOST_EXPLANATIONS]
    ]
    header = (
        "effects, and whose they are",
        "proba-\nbility",
        "f error\n[%]",
        "specimen\nleft out\n[%]",
        "torque\nleft out\n[%]",
    )
    return Table("Explanations", header, rows)
