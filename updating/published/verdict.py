"""The diagnosis of the published campaign: which shared effect its frequencies ask for, and how sure that is.

The tables have neither intervals nor shapes, so what a model leaves has to tell its own scatter. With errors of
Laplace's distribution the mean error of eq. (2) is the likeliest scale b, and minus twice the log-likelihood of n
frequencies is 2 n ln b up to a constant; falls of it are weighed as `verdict` weighs falls of the misfit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from model import printed_effects
from updating.fitting.modal_table import ModalTable
from updating.published.screening import Screening, Tried

MEASURED = 0.002
"""What a frequency of such a test is known to, relative."""


SEPARATE = 3.0
"""Discrimination distance below which two explanations are an ambiguity."""
GAIN_SINGLE, GAIN_SECOND = 16.0, 20.0
"""Fall of the squared misfit that a missing effect must bring, and a second one beside it."""


def published_verdict(found: Sequence[Screening], table: ModalTable) -> str:
    """Say under each calibration which effect is missing, what cannot be resolved from it, and what is still left.

    Parameters
    ----------
    found : sequence of Screening
        What was tried under each calibration.
    table : ModalTable
        Table 7. Each stack has a G_f of its own, so one frequency of each is taken up by it.
    """
    n_free = sum(int(np.isfinite(row.frequency).sum()) - 1 for row in table.rows)
    return "\n".join(_sentences(one, n_free) for one in found)


def _sentences(one: Screening, n_free: int) -> str:
    def fall(before: float, after: float) -> float:
        """Return the fall of minus twice the log-likelihood."""
        return float(2.0 * n_free * np.log(before / after))

    tried = [t for t in one.tried if np.isfinite(t.error) and not t.at_bound]
    singles = sorted((t for t in tried if len(t.effects) == 1), key=lambda t: t.error)
    everyone = [t.error for t in one.tried if len(t.effects) == 1 and np.isfinite(t.error)]
    if not singles:
        return f"{one.calibration}: no effect could be fitted inside its range."
    base, best = max(everyone), singles[0]
    if fall(base, best.error) < GAIN_SINGLE:
        return f"{one.calibration}: unlike anything in the catalogue; no effect in its range lowers {base:.1%} much."
    left = [t for t in singles if fall(t.error, best.error) < SEPARATE**2]
    names = " or ".join(_name(t) for t in left)
    text = f"{one.calibration}: {'identified' if len(left) == 1 else 'one of'}: {names}. "
    text += f"The error falls from {base:.1%} to {best.error:.1%}; "
    if len(singles) > len(left):
        text += f"the next, {_name(singles[len(left)])}, leaves {singles[len(left)].error:.1%}. "
    pair = min((t for t in tried if len(t.effects) == 2), key=lambda t: t.error, default=None)
    if pair is not None and fall(best.error, pair.error) > GAIN_SECOND:
        text += f"A second effect is called for: {_name(pair)} leave {pair.error:.1%}. "
    elif pair is not None:
        text += f"No pair that was tried calls for a second effect: the best, {_name(pair)}, leaves {pair.error:.1%}. "
    untried = sum(len(t.effects) == 2 and not np.isfinite(t.error) for t in one.tried)
    if untried:
        text += f"Pairs without a result: {untried}. "
    last = min([best.error, *([] if pair is None else [pair.error])])
    if last > 3.0 * MEASURED:
        text += (
            f"What is left is {last / MEASURED:.0f} times what a frequency is known to: stacks differ from each "
            "other, or more is missing that these tables cannot resolve."
        )
    return text


def _name(tried: Tried) -> str:
    return " with ".join(printed_effects(tried.effects))
