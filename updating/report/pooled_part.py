"""Many specimens on one rig: the answer, and a line for each specimen."""

from __future__ import annotations

from updating.report.part import Section, Table
from updating.results.pooled_answer import PooledDiagnosis
from updating.results.pooled_text import SPECIMEN_HEADER, specimen_row


def pooled_section(found: PooledDiagnosis) -> Section:
    """Say what specimens tell together, and list them with their notes; a click on a heading sorts."""
    columns = tuple(dict.fromkeys(name for own in found.specimens for name in own.notes))
    table = Table(
        title="All specimens",
        header=(SPECIMEN_HEADER[0], *columns, *SPECIMEN_HEADER[1:]),
        rows=tuple(
            (own.name, *(own.notes.get(name, "") for name in columns), *specimen_row(own)[1:])
            for own in found.specimens
        ),
        note="Frequency errors are means over the modes of a specimen: of the base model, with what was found, and "
        "where what specimens share is taken from the others. Odd: effects that a specimen has alone. A click on a "
        "heading sorts.",
    )
    return Section(title="Answer", text=found.sentences, blocks=(table.without_empty_columns(),))
