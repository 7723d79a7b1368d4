"""A fit of several configurations as an updating file states it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

import model
from ema import read_campaign
from ema.io.files import Section
from ema.plot.figures import as_png
from ema.types.arrays import single_threaded
from lamella_shared import csv_text, read_form
from model.stack.stack_file import stack_inputs
from updating.commands.diagnose import by_level, changed_names
from updating.commands.fit import ledger_table
from updating.commands.terminal import OUT, Run, print_lines, progress
from updating.diagnosis.cached_model import cached_model
from updating.diagnosis.candidates import MESSAGES
from updating.diagnosis.evidence import DiagnosisScatter
from updating.diagnosis.explained_model import JointFit, Updated, convergence_figure, correlation_figure
from updating.diagnosis.fit_settings import CONTACT, RATIOS, FitSettings, Scope, require_known
from updating.diagnosis.moved import REPORTED, moved_text
from updating.diagnosis.slipping import AtLevel
from updating.errors import FitError
from updating.fitting.fit import model_file, specimen_name, stack_in_state
from updating.pooled.joint_fit import joint_fit
from updating.pooled.specimen import Specimen
from updating.results.campaign import measurement_findings, over_amplitude
from updating.results.identified import assignments, every_identified, forget_choices
from updating.results.ledger import write_ledger
from updating.results.store import folder_name, write_bytes, write_result
from updating.results.text import Table
from updating.workers.workers import workers


class CampaignSection(Section):
    """One campaign; `file` is relative to the file that names it.

    By default all its configurations take part, and it is known by the name in its file.
    """

    file: str
    name: str | None = None
    configurations: Annotated[tuple[str, ...], Field(min_length=1)] | None = None


class ParameterSection(Section):
    """What is known of one parameter: who shares it, its bounds, a prior (mean, standard deviation), or its value."""

    scope: Scope | None = None
    bounds: tuple[float, float] | None = None
    prior: tuple[float, Annotated[float, Field(gt=0)]] | None = None
    start: float | None = None
    fixed: float | None = None

    @model_validator(mode="after")
    def _fixed_alone(self) -> ParameterSection:
        if self.fixed is not None and len(self.model_fields_set) > 1:
            further = ", ".join(sorted(self.model_fields_set - {"fixed"}))
            raise ValueError(f"a fixed parameter is not fitted; take out 'fixed' or {further}")
        return self


class ScatterSection(Section):
    """Standard deviations of what separates a right model from a right measurement; see `DiagnosisScatter`.

    Those of `frequency` and `damping` are estimated where they are not stated. `pressure` is that of the contact's
    stiffness from torque to torque.
    """

    frequency: Annotated[float, Field(gt=0)] | None = None
    damping: Annotated[float, Field(gt=0)] | None = None
    pressure: Annotated[float, Field(ge=0)] | None = None


class UpdateFile(Section):
    """An updating as its file describes it.

    Attributes
    ----------
    name : str
        Its title.
    effects : tuple of str
        Effects whose parameters are fitted.
    damping : bool
        Whether damping ratios take part.
    campaign : tuple of CampaignSection
        The campaigns.
    parameter : mapping of str to ParameterSection
        What differs from the defaults. A ratio such as `young` is free when it is named here.
    hold_out : mapping of str to tuple of int
        Modes by configuration, counted from 1, that are predicted instead of fitted. With several campaigns a
        configuration is called "campaign/configuration".
    scatter : ScatterSection
        Weights.
    """

    name: str
    effects: tuple[str, ...] = ()
    damping: bool = True
    campaign: Annotated[tuple[CampaignSection, ...], Field(min_length=1)]
    parameter: Mapping[str, ParameterSection] = Field(default_factory=dict)
    hold_out: Mapping[str, tuple[Annotated[int, Field(ge=1)], ...]] = Field(default_factory=dict)
    scatter: ScatterSection = ScatterSection()

    @model_validator(mode="after")
    def _starts_of_effects(self) -> UpdateFile:
        for name in (*CONTACT, *RATIOS):
            if name in self.parameter and self.parameter[name].start is not None:
                raise ValueError(
                    f"parameter.{name}.start: every fit starts where frequencies are met best; take it out"
                )
        return self

    def settings(self, hold_out: Mapping[str, tuple[int, ...]]) -> FitSettings:
        """Return what is known of parameters beforehand, and the modes that are held out, counted from 0."""
        least = 1e-6  # relative standard deviation of what is known exactly
        of = self.parameter
        usual, stated = DiagnosisScatter(), self.scatter
        return FitSettings(
            scope={name: p.scope for name, p in of.items() if p.scope is not None},
            fixed={name: p.fixed for name, p in of.items() if p.fixed is not None},
            bounds={name: p.bounds for name, p in of.items() if p.bounds is not None},
            priors={name: p.prior for name, p in of.items() if p.prior is not None},
            free=[n for n in RATIOS if n in of and of[n].fixed is None and of[n].prior is None],
            start={name: p.start for name, p in of.items() if p.start is not None},
            hold_out=hold_out,
            damping=self.damping,
            scatter=DiagnosisScatter(
                frequency=stated.frequency,
                damping=stated.damping,
                stiffness=usual.stiffness if stated.pressure is None else max(stated.pressure, least),
            ),
        )


def read_update_file(path: Path) -> UpdateFile:
    """Read the description of an updating.

    Raises
    ------
    FitError
        The file is missing, is not TOML, or has a key that is unknown, missing or impossible.
    """
    return read_form(path, UpdateFile, FitError)


@single_threaded
def update_command(run: Run) -> None:
    """Fit what an updating file says, and print parameters and ledger."""
    if run.identify_anew:
        forget_choices(run.output)
    updated = run_update(run)
    OUT.print(parameter_table(updated.fit))
    OUT.print(ledger_table(updated.ledger, model.catalogue(run.effect_files)))
    OUT.print(f"Results in {run.output}")


def run_update(run: Run) -> Updated:
    """Do what an updating file says and write update.json, ledger.json and tables and pictures of both.

    Raises
    ------
    FitError
        The file is wrong, or what it asks for cannot be fitted.
    """
    given = read_update_file(run.campaign)
    known = model.catalogue(run.effect_files)
    effects = {e.name: e for e in model.find_effects(given.effects, known)}
    inputs = [run.campaign, *run.effect_files]
    tested: list[_Tested] = []
    for section in given.campaign:
        stacks, files = _tested(run, section, given)
        tested += stacks
        inputs += files
    labels = [label for test in tested for label in test.labels]
    sizes = [modes.frequency.size for test in tested for _, _, modes in test.specimen.tested]
    settings = given.settings(held_out(given, dict(zip(labels, sizes, strict=True))))
    with workers(MESSAGES, run.cluster) as executor, progress("fit", run.console):
        result = joint_fit(
            given.name, [test.specimen for test in tested], effects, settings, labels=labels, known=known,
            levels=tested[0].levels if len(tested) == 1 else None, executor=executor, reduced=cached_model,
        )  # fmt: skip
    _write(result, tuple(inputs), given, run.output)
    return result


@dataclass(frozen=True, eq=False)
class _Tested:
    """A stack with what was identified, what its configurations are called, and which are force levels of one."""

    specimen: Specimen
    labels: tuple[str, ...]
    levels: Mapping[str, AtLevel]


def parameter_table(fit: JointFit) -> Table:
    """Print the estimates with their intervals, and the errors before and after."""
    held_out = fit.error(held_out=True)
    errors = f"mean frequency error {100 * fit.error(before=True):.2f} % before, {100 * fit.error():.2f} % after"
    if np.isfinite(held_out):
        errors += f", {100 * held_out:.2f} % on the modes held out"
    far = [moved_text(p) for p in fit.moved if abs(p.deviations or 0.0) > REPORTED]
    if far:
        errors += "\nMoved by more than two standard deviations of what was known: " + "; ".join(far)
    rows = [
        (
            p.name if p.unit == "1" else f"{p.name} [{p.unit}]", p.group or "all", f"{p.value:.5g}", f"{p.std:.2g}",
            f"{p.interval[0]:.4g} to {p.interval[1]:.4g}",
            "at its bound" if p.at_bound else "" if p.determined else "not determined",
        )
        for p in fit.parameter
    ]  # fmt: skip
    return Table("Fitted together", ("parameter", "of", "value", "std", "95 %", ""), rows, errors)


def _tested(run: Run, section: CampaignSection, given: UpdateFile) -> tuple[list[_Tested], list[Path]]:
    """Return the stacks of one campaign with what was identified, and the files that they come from."""
    file, several = run.campaign.parent / section.file, len(given.campaign) > 1
    campaign = read_campaign(file)
    stack_file = model_file(campaign, "a fit")
    name = section.name or campaign.name
    known = [c.name for c in campaign.configurations]
    changed = changed_names(campaign)  # what a change did to a state is no effect that the model lacks
    if section.configurations is not None:
        require_known(f"{run.campaign}: configuration of {section.file}:", section.configurations, known)
    chosen = section.configurations or [c for c in known if c not in changed]
    stack = model.read_stack(stack_file)
    configurations = tuple(c for c in campaign.configurations if c.name in chosen)
    states = [stack_in_state(stack, c) for c in configurations]
    output = run.output / folder_name(name) if several else run.output
    assigned = assignments(replace(campaign, configurations=configurations), output)
    tests = every_identified(assigned, f"identify {name}", run.console, run.cluster)
    over = [over_amplitude(assignment, test) for assignment, test in zip(assigned, tests, strict=True)]
    print_lines(run.console, measurement_findings(tests), indent="")
    heights = sorted({state.height for state in states})
    stacks = []
    for height in heights:
        here = [i for i, state in enumerate(states) if state.height == height]
        of_height, levels = by_level([states[i] for i in here], [tests[i] for i in here], [over[i] for i in here])
        of_stack, whole = specimen_name(name, height, heights), replace(stack, height=height)
        labels = tuple(f"{name}/{label}" if several else label for label, _, _ in of_height)
        stacks.append(_Tested(Specimen(name=of_stack, stack=whole, tested=tuple(of_height)), labels, levels))
    modal = [test.folder / "modal_model.json" for test in tests]
    return stacks, [file, *stack_inputs(stack_file), *modal]


def held_out(given: UpdateFile, size: Mapping[str, int]) -> Mapping[str, tuple[int, ...]]:
    """Return the modes held out, counted from 0, of configurations with so many modes."""
    require_known("hold_out: configuration", given.hold_out, size)
    for name, modes in given.hold_out.items():
        if max(modes, default=0) > size[name]:
            raise FitError(f"hold_out.{name}: there is no mode {max(modes)}; it has {size[name]}")
    return {name: tuple(m - 1 for m in modes) for name, modes in given.hold_out.items()}


def _write(result: Updated, inputs: tuple[Path, ...], given: UpdateFile, output: Path) -> None:
    options = given.model_dump(mode="json")
    write_result(output / "update.json", result, inputs=inputs, options=options)
    write_ledger(result.ledger, options, inputs, output)
    fit = result.fit
    names = [f"{p.name} {p.group}".strip() for p in fit.parameter]
    header = ["parameter", "group", "unit", "value", "std", "lower_95", "upper_95", "determined"]
    rows: list[list[object]] = [
        [p.name, p.group, p.unit, p.value, p.std, *p.interval, p.determined] for p in fit.parameter
    ]
    correlation = [[name, *map(float, row)] for name, row in zip(names, fit.correlation, strict=True)]
    modes: list[list[object]] = [
        [
            c.name, r + 1, bool(c.used[r]), c.measured_frequency[r], c.frequency_before[r], c.frequency[r],
            c.measured_damping[r], c.damping_before[r], c.damping[r], c.mac[r],
        ]
        for c in fit.configuration
        for r in range(c.used.size)
    ]  # fmt: skip
    columns = [
        "configuration", "mode", "fitted", "measured_Hz", "before_Hz", "after_Hz", "measured_damping",
        "damping_before", "damping_after", "mac",
    ]  # fmt: skip
    for name, content in (
        ("parameters.csv", _csv([header, *rows])),
        ("correlation.csv", _csv([["", *names], *correlation])),
        ("modes.csv", _csv([columns, *modes])),
        ("correlation.png", as_png(correlation_figure(fit))),
        ("convergence.png", as_png(convergence_figure(fit))),
    ):
        write_bytes(output / name, content)


def _csv(rows: Sequence[Sequence[object]]) -> bytes:
    blank = (["" if isinstance(v, float) and not np.isfinite(v) else v for v in row] for row in rows)
    return csv_text(next(blank), blank).encode()
