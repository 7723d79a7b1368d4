"""Figure of frequency and damping over amplitude."""

from __future__ import annotations

from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from ema.identification.amplitude import AmplitudeDependence
from ema.types.modal_model import frequency_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def amplitude_figure(found: AmplitudeDependence) -> Figure:
    """Draw the frequency of every mode, over that of its smallest amplitude, and its damping, over the motion.

    Parameters
    ----------
    found : AmplitudeDependence
        Modes that fewer than two levels have are left out.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    followed = np.flatnonzero(np.isfinite(found.softening))
    for r, marker in zip(followed.tolist(), cycle("osD^vPX<>"), strict=False):
        seen = np.isfinite(found.frequency[:, r])
        f, motion = found.frequency[seen, r], 1e6 * found.motion[seen, r]
        style = {
            "marker": marker,
            "markersize": 4,
            "linewidth": 1.0,
            "capsize": 2,
            "label": f"{frequency_text(f[0], 0)} Hz",
        }
        left.errorbar(motion, 100.0 * (f / f[0] - 1.0), 200.0 * found.frequency_std[seen, r] / f[0], **style)
        damping, std = found.damping[seen, r], found.damping_std[seen, r]
        right.errorbar(motion, 100.0 * damping, 200.0 * std, **style)
    label = f"displacement amplitude at {found.point} [µm]"
    left.set(xscale="log", xlabel=label, ylabel="change of natural frequency [%]")
    right.set(xscale="log", xlabel=label, ylabel="damping ratio [%]")
    if followed.size:
        handles = left.get_legend_handles_labels()
        figure.legend(*handles, loc="outside right center", title="mode", frameon=False)
    return figure
