"""Whether forces at several points find the same frequencies."""

from __future__ import annotations

import numpy as np

from ema.identification.functions import Functions
from ema.identification.maximum_likelihood import linear_fit
from ema.identification.run_poles import FALSE_ALARM, run_poles
from ema.quality.verdict import Verdict
from ema.types.frf import DERIVATIVE, FRF
from ema.types.modal_model import ModalModel
from ema.types.threads import single_threaded

LEAST_SHIFT = 0.1
"""Half bandwidths by which a frequency differs from force to force for it to be told: shapes are then off by 1 %."""
WANDERS = 4.0
"""Half bandwidths by which a frequency may differ for one mode alone to tell that the structure changed: beyond, one
pole for all forces would not have been found."""
_LISTED = 4


@single_threaded
def check_references(frf: FRF, modal_model: ModalModel) -> tuple[Verdict, ...]:
    """Compare the frequencies that the functions of each force alone give.

    Tests with a force at one point after the other last long: temperature and supports change. One pole for all forces
    is then wrong for each.

    Parameters
    ----------
    frf : FRF
        Functions at the outputs and inputs of the model.
    modal_model : ModalModel
        What was identified. Modes of nearly one pole are not compared.

    Returns
    -------
    tuple of Verdict
        One for the set; none where there is one force.
    """
    n_input = modal_model.input.node.size
    if n_input == 1:
        return ()
    lines = frf.band(max(modal_model.band[0], np.finfo(float).tiny), modal_model.band[1])
    pole = modal_model.pole
    gap = np.abs(pole[:, None] - pole) + np.diag(np.full(pole.size, np.inf))
    alone = gap.min(axis=1) > -2.0 * pole.real
    s = 2j * np.pi * lines.frequency
    near, residue = pole[~alone, None], modal_model.residue[..., ~alone]
    together = residue @ (1.0 / (s - near)) + residue.conj() @ (1.0 / (s - near.conj()))
    value = (lines.value - s ** DERIVATIVE[lines.quantity] * together).reshape(-1, s.size)
    data = Functions(
        frequency=lines.frequency,
        value=value,
        run=np.tile(np.arange(n_input), lines.output.node.size),
        quantity=lines.quantity,
        weight=np.ones(value.shape),
    )
    kept = np.concatenate([pole[alone], modal_model.outside_pole])
    runs = run_poles(data, linear_fit(data.frequency, data.value, kept, data.quantity))
    told, sure = [], False
    number = np.flatnonzero(alone)
    for r in range(number.size):
        found = np.abs(runs.pole[:, r]) / (2.0 * np.pi)
        seen = np.flatnonzero(np.isfinite(runs.frequency_std[:, r]))
        off = 2.0 * np.pi * np.ptp(found[seen]) / -kept[r].real if seen.size else 0.0
        if off > LEAST_SHIFT and runs.probability[:, r].min() < FALSE_ALARM:
            each = (f"{found[i]:.6g} Hz with the force at {modal_model.input.name(int(i))}" for i in seen)
            told.append(f"mode {number[r] + 1}: {' and '.join(each)}")
            sure = sure or off < WANDERS
    return (_verdict(told, sure or len(told) > 1),)


def _verdict(told: list[str], changed: bool) -> Verdict:
    """Say in which modes forces differ, and whether the structure changed or a mode is doubtful."""
    if not told:
        text = "forces at all points find the same frequencies"
        return Verdict(check="references", level="pass", channel=(), band=None, message=text)
    listed = "; ".join(told[:_LISTED]) + ("; ..." if len(told) > _LISTED else "")
    text = f"frequencies differ from force to force: {listed}: "
    if changed:
        text += "the structure changed between these tests; identify each in a configuration of its own"
    else:
        text += (
            "by several bandwidths, and in no other mode, this is no change of the structure between these tests: the "
            "mode is doubtful, or one beside it is missing"
        )
    return Verdict(check="references", level="warn", channel=(), band=None, message=text)
