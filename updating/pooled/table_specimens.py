"""Rows of a modal table as specimens: one stack each, its modes known by the classes of their shapes."""

from __future__ import annotations

import numpy as np

from updating.fitting.modal_table import ModalTable
from updating.pooled.classed import Classes
from updating.pooled.modal_files import usual_poles
from updating.pooled.specimen import Specimen


def table_specimens(table: ModalTable) -> tuple[Specimen, ...]:
    """Return the rows of a modal table as specimens; a table has no damping.

    Raises
    ------
    FitError
        The model of a row has no mode of a class.
    """
    classes, specimens = Classes(), []
    for row in table.rows:
        poles = usual_poles(row.frequency, np.full(row.frequency.size, np.nan))
        modes = classes.modes(f"stack {row.name}", row.stack, table.shape_class, poles)
        tested = ((row.name, row.stack.contact.pressure, modes),)
        specimens.append(Specimen(name=row.name, stack=row.stack, tested=tested, classed=True))
    return tuple(specimens)
