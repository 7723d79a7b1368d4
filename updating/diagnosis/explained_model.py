"""A stack as an explanation was fitted with it, and its modes beside those of one configuration."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema.types.modal_model import ModalModel
from ema.types.threads import single_threaded
from model import Effect, Stack, observe, solve_modes
from updating.correlation.pairing import pair
from updating.correlation.registration import register
from updating.correlation.rig_check import RigCheck
from updating.diagnosis.answer import Ranked
from updating.diagnosis.candidates import DIMENSIONS
from updating.diagnosis.evidence import D_F_START
from updating.errors import FitError
from updating.fitting.fit import Fit, frequency_error, kept_estimate, opt_d, opt_G, reduced_about

_CLAMP = re.compile(r"clamp_(\d+)_([xy])")


def explained_stack(
    stack: Stack, explanation: Ranked, effects: Sequence[Effect], *, state: str, pressure: float | None = None
) -> Stack:
    """Return a stack with everything that an explanation moved, as it is in one configuration.

    Parameters
    ----------
    stack : Stack
        As its file states it.
    explanation : Ranked
        The explanation.
    effects : sequence of Effect
        Those of its effects that change the stack.
    state : str
        The configuration.
    pressure : float, optional
        Its pressure, Pa; by default that of the stack.
    """
    at, contact, material = explanation.nuisance, stack.contact, stack.material

    def ratio(*names: str) -> float:
        return float(np.exp(sum(at.get(name, 0.0) for name in names)))

    moved = [(int(m[1]) - 1, m[2], value) for name, value in at.items() if (m := _CLAMP.fullmatch(name))]
    clamps = list(stack.clamps)
    for i, axis, value in moved:
        clamps[i] = replace(clamps[i], **{axis: getattr(clamps[i], axis) + value})
    known = {p.name for effect in effects for p in effect.parameters}
    values = {p.name: p.value for p in explanation.parameter if p.name in known}
    made = replace(
        stack,
        **{name: ratio(name) * getattr(stack, name) for name in DIMENSIONS},
        material=replace(material, young=ratio("young") * material.young, density=ratio("density") * material.density),
        contact=replace(
            contact,
            G_f=ratio("G_f", f"G_f[{state}]") * contact.G_f,
            d_f=ratio("d_f", f"d_f[{state}]") * (contact.d_f or D_F_START),
            normal_modulus=ratio("normal_modulus") * contact.normal_modulus,
            pressure=contact.pressure if pressure is None else pressure,
        ),
        clamps=tuple(clamps),
    )
    return made.with_effects(*effects, **values) if effects else made


@single_threaded
def explained_model(
    stack: Stack, measured: ModalModel, modelled: Sequence[float], rig: RigCheck, *, threshold: float = 0.8
) -> Fit:
    """Put a stack as an explanation has it beside measured modes; nothing is fitted.

    Parameters
    ----------
    stack : Stack
        The stack.
    measured : ModalModel
        The identified modes.
    modelled : sequence of float
        The explanation's natural frequencies, Hz: those of an ever finer mesh.
    rig : RigCheck
        What contradicts the measurement.
    threshold : float
        Smallest MAC that makes a pair.

    Raises
    ------
    EffectError, FitError, PairingError, SolveError
        The stack cannot have its effects, no mode pairs, or points of the measurement do not lie on it.
    """
    n_mode = 22  # that are solved for pairing, rigid-body modes included
    registration = register(stack, measured.geometry, measured.node, measured.direction)
    system, contact = reduced_about(stack, n_mode), stack.contact
    observed = observe(system, registration.observation)
    modes = solve_modes(system, G_f=contact.G_f, d_f=contact.d_f, n_mode=n_mode, observation=observed, by=()).elastic()
    modes = replace(modes, frequency=modes.frequency * finer_ratio(modes.frequency, modelled))
    pairing = pair(measured, modes, threshold=threshold)
    if pairing.measured.size == 0:
        raise FitError(f"{measured.name}: no measured mode pairs with this model by a MAC of {threshold:g}")
    frequency, damping = measured.frequency[pairing.measured], measured.damping[pairing.measured]
    return Fit(
        name=measured.name,
        stack=stack,
        G_f=kept_estimate("G_f", "Pa/Pa", contact.G_f, opt_G(frequency, modes.frequency[pairing.model])),
        d_f=kept_estimate("d_f", "s/Pa", contact.d_f, opt_d(damping, modes.damping[pairing.model])),
        modes=modes,
        pairing=pairing,
        distance=registration.distance,
        error=frequency_error(frequency, modes.frequency[pairing.model]),
        rig=rig,
    )


def finer_ratio(frequency: NDArray[np.float64], modelled: Sequence[float]) -> NDArray[np.float64]:
    """Return an explanation's frequencies, of an ever finer mesh, over those of a mesh, (n,), both ascending.

    The explanation has the lowest of them; the last ratio holds for the others.
    """
    n = min(frequency.size, len(modelled))
    ratio = np.asarray(modelled[:n]) / frequency[:n]
    return np.append(ratio, np.full(frequency.size - n, ratio[-1] if n else 1.0))
