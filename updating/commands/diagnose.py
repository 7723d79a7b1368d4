"""The commands that ask what the model lacks, what changed, and which test would show more, also of many specimens."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from ema import Campaign, Change, change_sentence, read_campaign
from ema.campaign.campaign_file import repeats_of
from ema.types.arrays import single_threaded
from model import Stack, catalogue, find_effects, read_matrices, read_stack
from model.matrices.structure_file import is_structure_file, matrices_inputs
from model.stack.stack_file import stack_inputs
from updating.commands.terminal import MOST_EXPLANATIONS, OUT, print_lines, print_results, progress
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


def diagnose_changes(
    campaign_file: Path,
    output: Path,
    console: Console,
    *,
    scatter_file: Path | None = None,
    cluster: str | None = None,
    keep: bool = False,
) -> tuple[WhatChanged, ...]:
    """Say of every configuration that has a reference whether it changed, and, with a model, what and where.

    Writes change.json and what_changed.json beside the modes of each; those that an earlier run left are read back.

    Raises
    ------
    FitError
        A state and its reference are not of one height, or no state can be compared.
    """
    campaign = read_campaign(campaign_file)
    tests = every_identified(assignments(campaign, output, keep=keep), "identify", console, cluster)
    changes, lost = compared(campaign, tests)
    changes = tuple(sorted(changes, key=lambda change: not change.changed))
    print_lines(console, lost, indent="")
    if campaign.stack is None or campaign.points is None:
        for change in changes:
            console.print(f"{change_sentence(change)}.")
        what = 'stack = "stack.toml" under [structure]' if campaign.stack is None else "file under [points]"
        console.print(f"What changed, and where, takes a model: add {what}.")
        return ()
    models = _Models(campaign, tests, None if scatter_file is None else read_scatter(scatter_file))
    stated = () if scatter_file is None else (scatter_file,)
    answers = []
    stack_file = campaign.stack
    named = matrices_inputs(stack_file) if is_structure_file(stack_file) else stack_inputs(stack_file)
    inputs = (campaign_file, *named, *stated)
    for change in changes:
        console.print(f"{change_sentence(change)}.")
        try:
            with progress(f"what changed in {change.name}", console):
                answer = models.kept(change, inputs, keep=keep)
        except FitError as error:
            console.print(f"{change.name}, what and where: {error}")
            continue
        print_lines(console, answer.sentences)
        answers.append(answer)
    return tuple(answers)


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
def diagnose_command(
    campaign: Path,
    output: Path,
    effect_file: Sequence[Path],
    scatter: Path | None,
    cluster: str | None,
    *,
    keep: bool,
    identify_anew: bool,
    reference: bool,
) -> None:
    """Diagnose what a campaign file lists, and print the answer."""
    if identify_anew:
        forget_choices(output)
    if has_specimens(campaign):
        pooled = diagnose_pooled(campaign, output, effect_file, OUT, scatter_file=scatter, cluster=cluster)
        print_pooled(pooled, output, OUT)
        return
    if not reference and changed_names(read_campaign(campaign)):
        diagnose_changes(campaign, output, OUT, scatter_file=scatter, cluster=cluster, keep=keep)
        print_results(OUT, output)
        return
    diagnosis = diagnose_campaign(campaign, output, effect_file, OUT, scatter_file=scatter, cluster=cluster, keep=keep)
    print_lines(OUT, diagnosis.sentences, indent="")
    OUT.print(diagnosis_table(diagnosis))
    print_measurement_findings(campaign, output, keep=keep)
    options = [("--effect-file", str(path)) for path in effect_file]
    options += [] if scatter is None else [("--scatter", str(scatter))]
    added = next_command(diagnosis, str(campaign), str(output), options)
    if added is not None:
        OUT.print(f"Add it and see the error fall: {added}", soft_wrap=True)
    print_results(OUT, output)


def diagnose_campaign(
    campaign_file: Path,
    output: Path,
    effect_files: Sequence[Path],
    console: Console,
    *,
    scatter_file: Path | None = None,
    asked: Sequence[Sequence[str]] = (),
    cluster: str | None = None,
    keep: bool = False,
) -> Diagnosis:
    """Identify a campaign, diagnose its model, and write diagnosis.json.

    What an earlier run left is read back, unless it lacks explanations that are asked for; with `keep`, whatever it
    came from.
    """
    scatter = None if scatter_file is None else read_scatter(scatter_file)
    campaign = read_campaign(campaign_file)
    stack_file = model_file(campaign, "a diagnosis")
    if is_structure_file(stack_file):
        return _diagnose_matrices(campaign, stack_file, output, scatter_file, asked, keep=keep)
    stack, known = read_stack(stack_file), catalogue(effect_files)
    changed = changed_names(campaign)  # what a change did to a state is no effect that the model lacks
    states = [stack_in_state(stack, c) for c in campaign.configurations if c.name not in changed]
    heights = {state.height for state in states}
    if len(heights) > 1:
        listed = " and ".join(f"{1e3 * height:g}" for height in sorted(heights))
        raise FitError(f"{campaign_file}: a diagnosis is of one stack; give the heights {listed} mm a campaign each")
    assigned = [
        assignment
        for assignment in assignments(campaign, output, keep=keep)
        if assignment.configuration.name not in changed
    ]
    tests = every_identified(assigned, "identify", console, cluster)
    _require_force(campaign_file, tests)
    over = [over_amplitude(assignment, test) for assignment, test in zip(assigned, tests, strict=True)]
    tested, levels = by_level(states, tests, over)

    def make() -> Diagnosis:
        with workers(MESSAGES, cluster) as executor, progress("diagnose", console):
            return diagnose_stack(
                replace(stack, height=states[0].height),
                tested,
                known,
                scatter=scatter,
                executor=executor,
                reduced=cached_model,
                asked=asked,
                levels=levels,
            )

    modal = [test.folder / "modal_model.json" for test in tests]
    modal += [test.folder / AMPLITUDE for test, amplitude in zip(tests, over, strict=True) if amplitude is not None]
    stated = () if scatter_file is None else (scatter_file,)
    inputs = (campaign_file, *stack_inputs(stack_file), *effect_files, *stated, *modal)
    path = output / "diagnosis.json"
    return _kept(path, make, inputs, asked, keep=keep)


def _diagnose_matrices(
    campaign: Campaign,
    file: Path,
    output: Path,
    scatter_file: Path | None,
    asked: Sequence[Sequence[str]],
    *,
    keep: bool,
) -> Diagnosis:
    """Identify a campaign whose model is a structure of matrices, diagnose that, and write diagnosis.json."""
    from updating.diagnosis.matrices_answer import diagnose_matrices

    tests = every_identified(assignments(campaign, output, keep=keep), "identify", OUT)
    tested = [(test.configuration.name, test.modal_model) for test in tests]

    def make() -> Diagnosis:
        with progress("diagnose", OUT):
            scatter = None if scatter_file is None else read_scatter(scatter_file)
            return diagnose_matrices(read_matrices(file), tested, scatter=scatter, asked=asked)

    stated = () if scatter_file is None else (scatter_file,)
    modal = [test.folder / "modal_model.json" for test in tests]
    inputs = (campaign.path, *matrices_inputs(file), *stated, *modal)
    return _kept(output / "diagnosis.json", make, inputs, asked, keep=keep)


def _kept(
    path: Path, make: Callable[[], Diagnosis], inputs: tuple[Path, ...], asked: Sequence[Sequence[str]], *, keep: bool
) -> Diagnosis:
    """Return the diagnosis that an earlier run left, or make it where there is none or it lacks what is asked for."""
    diagnosis = kept(path, Diagnosis, make, inputs=inputs, options={}, keep=keep)
    if all(diagnosis.has(effects) for effects in asked):
        return diagnosis
    diagnosis = make()
    write_result(path, diagnosis, inputs=inputs, options={})
    return diagnosis


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


def print_measurement_findings(campaign_file: Path, output: Path, *, keep: bool = False) -> None:
    """Print the findings about the measurement on which an answer rests."""
    results = every_identified(assignments(read_campaign(campaign_file), output, keep=keep), "identify", OUT)
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
def next_test_command(
    campaign: Path, output: Path, effect_file: Sequence[Path], scatter: Path | None, *, identify_anew: bool
) -> None:
    """Print further tests, those first that separate best what a diagnosis leaves open."""
    if identify_anew:
        forget_choices(output)
    read_stack(model_file(read_campaign(campaign), "a further test"))  # tests are of stacks
    diagnosis = diagnose_campaign(campaign, output, effect_file, OUT, scatter_file=scatter)
    if not diagnosis.next_tests:
        OUT.print(f"Nothing to separate: the verdict is {diagnosis.verdict!r}.")
    else:
        OUT.print(next_test_table(diagnosis))
    further = second_level_text(diagnosis)
    if further is not None:
        OUT.print(further)
    print_measurement_findings(campaign, output)


def next_test_table(diagnosis: Diagnosis) -> Table:
    """Return the further tests, the one that separates best first."""
    rows = [(test.instruction, f"{test.distance:.1f}", f"{test.now:.1f}") for test in diagnosis.next_tests]
    return Table("Further tests", ("test", "smallest distance", "now"), rows)


def diagnose_pooled(
    campaign_file: Path,
    output: Path,
    effect_files: Sequence[Path],
    console: Console,
    *,
    fitted: Sequence[str] | None = None,
    scatter_file: Path | None = None,
    cluster: str | None = None,
) -> PooledDiagnosis:
    """Diagnose all specimens of a campaign together, or fit effects of the rig to them, and write the answer.

    What an earlier run left in pooled_diagnosis.json, or in pooled_fit.json, is read back.

    Parameters
    ----------
    campaign_file, output : Path
        The campaign and the folder for its results.
    effect_files : sequence of Path
        Files with effects of the user.
    console : Console
        Where progress is shown.
    fitted : sequence of str, optional
        Effects to fit; without them, all are asked about.
    scatter_file : Path, optional
        What a laboratory knows of what separates a right model from a right measurement.
    cluster : str, optional
        Address of a Dask scheduler.
    """
    known, asked = catalogue(effect_files), fitted is not None
    effects = known if fitted is None else {effect.name: effect for effect in find_effects(fitted, known)}
    scatter = None if scatter_file is None else read_scatter(scatter_file)
    campaign = read_specimens(campaign_file)
    assigned = () if campaign.measured is None else assignments(campaign.measured, output)
    tests = every_identified(assigned, "identify", console, cluster) if assigned else ()
    by_name = {test.configuration.name: test.modal_model for test in tests}
    specimens = specimens_of(campaign, by_name.__getitem__)

    def make() -> PooledDiagnosis:
        with workers(MESSAGES, cluster) as executor, progress("fit" if asked else "diagnose", console):
            return diagnose_specimens(
                campaign.name, specimens, effects, asked=asked, scatter=scatter, executor=executor, reduced=cached_model
            )

    stated = () if scatter_file is None else (scatter_file,)
    inputs = (*campaign.inputs, *(test.folder / "modal_model.json" for test in tests), *effect_files, *stated)
    path = output / ("pooled_fit.json" if asked else "pooled_diagnosis.json")
    options = {"effects": list(effects)} if asked else {}
    return kept(path, PooledDiagnosis, make, inputs=inputs, options=options)


def print_pooled(diagnosis: PooledDiagnosis, output: Path, console: Console) -> None:
    """Print the answer, the explanations and the specimens."""
    print_lines(console, diagnosis.sentences, indent="")
    console.print(pooled_table(diagnosis))
    console.print(Table("Specimens", SPECIMEN_HEADER, [specimen_row(specimen) for specimen in diagnosis.specimens]))
    print_results(console, output)


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
