"""What each effect does to the frequencies beside what the base model lacks."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from updating.diagnosis.answer import Diagnosis, ModeError
from updating.diagnosis.signature_plot import MOST, signature_pattern_figure
from updating.report.part import Picture, Section, Table, as_csv, svg
from updating.results.text import Z95, uncertain

_TOGETHER = 24
"""Modes of one figure whose names can still be read."""


def signature_section(diagnosis: Diagnosis) -> Section:
    """Show what the base model lacks at every mode, and what the best effects, each alone, change there."""
    return Section(
        title="Effect signatures",
        text=(
            "The bars are what the base model's frequencies lack, the lines what an effect changes when it is fitted "
            "alone. An effect explains the measurement where its line meets the bars; lines that run together are "
            "effects that these frequencies do not resolve.",
        ),
        blocks=(*signature_pictures(diagnosis), signature_table(diagnosis)),
    )


def signature_pictures(diagnosis: Diagnosis) -> tuple[Picture, ...]:
    """Draw the configurations of a diagnosis side by side, as many in one picture as can be read."""
    groups = _groups(diagnosis.errors)
    pictures = []
    for number, group in enumerate(groups, start=1):
        errors = [diagnosis.errors[k] for k in group]
        signatures = {e: [change[k] for k in group] for e, change in _ordered(diagnosis).items()}
        drawn = {textwrap.fill(_printed(diagnosis, e), 34): change for e, change in signatures.items()}
        figure = signature_pattern_figure(
            [e.configuration for e in errors],
            [f"{e.frequency:.0f}" for e in errors],
            [-e.base for e in errors],
            [e.std / e.frequency for e in errors],
            drawn,
        )
        pictures.append(
            Picture(
                name="signatures" if len(groups) == 1 else f"signatures_{number}",
                content=svg(figure),
                form="svg",
                data=as_csv(
                    ("configuration", "mode", "frequency [Hz]", "its std [Hz]", "lacking", *signatures),
                    (
                        (e.configuration, e.mode, e.frequency, e.std, -e.base, *(s[k] for s in signatures.values()))
                        for k, e in enumerate(errors)
                    ),
                ),
                alt="Frequency changes that the base model lacks and that effects make",
                caption="Bars: measured less modelled frequency over the measured one, with the 95 % interval of the "
                f"measurement. Lines: change by at most {MOST} effects, the candidates first.",
            )
        )  # fmt: skip
    return tuple(pictures)


def signature_table(diagnosis: Diagnosis) -> Table:
    """List for every mode used what is lacking, what each effect changes, and what the first candidate leaves."""
    signatures = dict(list(_ordered(diagnosis).items())[:MOST])
    first = " + ".join(_printed(diagnosis, name) for effects in diagnosis.set[:1] for name in effects)
    left = f"left by {first} [%]" if first else ""
    brought = [f"{_printed(diagnosis, name)} [%]" for name in signatures]
    rows = tuple(
        (
            e.configuration,
            str(e.mode),
            uncertain(e.frequency, Z95 * e.std),
            f"{-100.0 * e.base:+.3f}",
            f"{-100.0 * e.explained:+.3f}" if left else "",
            *(f"{100.0 * change[k]:+.3f}" for change in signatures.values()),
        )
        for k, e in enumerate(diagnosis.errors)
    )
    table = Table(
        title="What each effect changes, mode by mode",
        header=("configuration", "mode", "measured [Hz]", "lacking [%]", left, *brought),
        rows=rows,
        note="± is half of the 95 % interval. Each effect is fitted alone, with contact and nuisances anew. Further "
        "effects are in the CSV of the figure.",
        folded=True,
    )  # fmt: skip
    return table.without_empty_columns()


def _printed(diagnosis: Diagnosis, name: str) -> str:
    """Return an effect or hypothesis as a person reads it, the key beside the label."""
    return f"{diagnosis.labels[name]} ({name})" if name in diagnosis.labels else name


def _ordered(diagnosis: Diagnosis) -> dict[str, Sequence[float]]:
    """Return the signatures of the candidates' effects first, then the others."""
    own = [name for effects in diagnosis.set for name in effects if name in diagnosis.signatures]
    return {name: diagnosis.signatures[name] for name in dict.fromkeys([*own, *diagnosis.signatures])}


def _groups(errors: Sequence[ModeError]) -> list[list[int]]:
    """Return the numbers of the modes of each picture: whole configurations, no more than can be read."""
    own: dict[str, list[int]] = {}
    for k, error in enumerate(errors):
        own.setdefault(error.configuration, []).append(k)
    groups: list[list[int]] = []
    for modes in own.values():
        if not groups or len(groups[-1]) + len(modes) > _TOGETHER:
            groups.append([])
        groups[-1] += modes
    return groups
