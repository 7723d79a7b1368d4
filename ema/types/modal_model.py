"""The modal model: what identification hands to the rest of the program."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ema.types.errors import IdentificationError
from ema.types.frf import DERIVATIVE, Dofs, Geometry, Quantity
from lamella_shared import Booleans, Complexes, Integers, Reals, Shown, arrays, readonly

RESOLVED = 0.01
"""Half bandwidths by which a pole of one run may be off for other reasons than noise: the flanks of modes beyond the
band, which residual terms meet nearly, moved those of one and the same simulated stack by up to 0.006."""


@dataclass(frozen=True, kw_only=True)
class UnexplainedPeak:
    """A peak of the measured functions that no mode was taken in for.

    Attributes
    ----------
    frequency : float
        Its place, Hz.
    share : float
        Share of its power that the modes leave, in the sum of all functions, each relative to its mean power.
    channel : tuple of int
        Positions of the outputs in which the modes leave more than half of it.
    reason : str
        Why it was not taken for a mode.
    """

    frequency: float
    share: float
    channel: tuple[int, ...]
    reason: str


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays(
    {
        "mode": "frequency damping frequency_std damping_std pole scaled",
        "node input.node mode": "residue residue_std",
        "node input.node": "lower upper noise correlation error",
        "outside": "outside_pole",
        "node input.node outside": "outside_residue",
        "node mode": "shape shape_std",
        "any": "node run",
        "node 3": "direction",
        "node": "sensor",
        "run mode": "run_pole run_frequency_std run_damping_std run_probability",
        "run outside": "run_outside_pole",
    }
)
class ModalModel(Shown):
    """Poles, residues and shapes of one configuration, ascending in frequency.

    The receptance it stands for is, with ``s = i omega``,

        H(s) = sum_r [ A_r / (s - pole_r) + conj(A_r) / (s - conj(pole_r)) ] + lower / s**2 + upper

    Attributes
    ----------
    name : str
        The configuration.
    frequency, damping : (n_mode,) float
        Undamped natural frequency abs(pole) / 2 pi, Hz, and damping ratio -Re(pole) / abs(pole); where runs disagree
        those of the mean over the runs, and where sensors have mass those of the structure without them.
    frequency_std, damping_std : (n_mode,) float
        Their standard deviations.
    pole : (n_mode,) complex
        Upper half-plane poles, rad/s.
    residue : (n_output, n_input, n_mode) complex
        Residues of the receptance, m/(N s).
    lower, upper : (n_output, n_input) complex
        Residual terms of the modes below (1/kg) and above (m/N) the band.
    outside_pole : (n_outside,) complex
        Poles, rad/s, of modes just outside the band whose flanks the residual terms do not meet, and any that are
        damped too much for a resonance and stand for the background; often none.
        They belong to the sum above and are no result: the band does not determine them.
    outside_residue : (n_output, n_input, n_outside) complex
        Their residues, m/(N s).
    shape : (n_dof, n_mode) complex
        Shapes at the outputs. Mass-normalised (1/sqrt(kg)) for the modes that are `scaled`, else of unit
        largest component.
        Where roving runs disagree they are drawn from each run at its own poles.
    shape_std : (n_dof, n_mode) float
        Standard deviation of each component's magnitude.
    scaled : (n_mode,) bool
        Which modes have a driving-point residue of the phase and sign that a passive structure allows, which
        gives their shapes the mass-normalised scale; False throughout where no driving point was measured.
    node : (n_dof,) int
        Point number of each shape component.
    direction : (n_dof, 3) float
        Measured direction of each shape component.
    sensor : (n_dof,) int
        Number of each shape component among the outputs of its run, from 0: the accelerometer where some rove.
    input : Dofs
        Force DOFs.
    band : (float, float)
        Frequency band that was identified, Hz.
    geometry : Geometry
        The measured points.
    quantity : {"receptance", "mobility", "accelerance"}
        What was measured. What was fitted is that in which the noise is the most even.
    covariance : (2 n_mode, 2 n_mode) float
        Covariance of Re and Im of each pole in turn, (rad/s)**2.
    residue_std : (n_output, n_input, n_mode) float
        Standard deviation of the magnitude of each residue.
    noise : (n_output, n_input) float
        Standard deviation of the residual of each function, in the unit of the measured quantity.
    correlation : (n_output, n_input) float
        Correlation (FRAC) of measured and synthesised functions over the band.
    error : (n_output, n_input) float
        Root mean square of measured less synthesised over that of measured.
    run : (n_run,) int
        Roving runs.
    run_pole : (n_run, n_mode) complex
        Poles that each run alone gives, rad/s.
    run_frequency_std, run_damping_std : (n_run, n_mode) float
        Their standard deviations.
    run_probability : (n_run, n_mode) float
        Probability that noise alone would make any run's frequency of any mode differ this much from those of
        the other runs (Bonferroni's bound); 1 where there is one run only.
    unexplained : tuple of UnexplainedPeak
        What the functions show as a peak and the modes do not explain, the largest first.
    decay_rate : float
        What an exponential window adds to every decay rate, 1/s: it is in the poles, which the functions have, and
        in those of runs, and is taken out of frequencies and damping ratios.
    sensor_shift : tuple of float
        Share by which the sensors lower each frequency in the mean over the runs, negative: it is in the poles and
        residues, which the functions have, and is taken out of frequencies, damping ratios and shapes. Empty where
        nothing was taken out; 0 for modes that the sensors are not known to move.
    sensor_mass : float
        Mass of one sensor that was taken out, kg; 0 where it is not known.
    run_outside_pole : (n_run, n_outside) complex or None
        Where runs are so far apart that modes were followed from run to run: poles that each run has of the modes just
        outside. Residues are then those of each run at its own poles, made those of the mean poles (`synthesize_runs`).
        None where one set of poles serves all runs.
    read_from : str
        The file that the modes were read from where another program identified them; empty where they were identified
        here. There are then no functions: `noise`, `correlation` and `error` are NaN, and residues are zero but those
        that mass-normalised shapes give.
    """

    name: str
    frequency: Reals
    damping: Reals
    frequency_std: Reals
    damping_std: Reals
    pole: Complexes
    residue: Complexes
    lower: Complexes
    upper: Complexes
    outside_pole: Complexes
    outside_residue: Complexes
    shape: Complexes
    shape_std: Reals
    scaled: Booleans
    node: Integers
    direction: Reals
    sensor: Integers
    input: Dofs
    band: tuple[float, float]
    geometry: Geometry
    quantity: Quantity
    covariance: Reals
    residue_std: Reals
    noise: Reals
    correlation: Reals
    error: Reals
    run: Integers
    run_pole: Complexes
    run_frequency_std: Reals
    run_damping_std: Reals
    run_probability: Reals
    unexplained: tuple[UnexplainedPeak, ...] = ()
    decay_rate: float = 0.0
    sensor_shift: tuple[float, ...] = ()
    sensor_mass: float = 0.0
    run_outside_pole: Complexes | None = None
    read_from: str = ""

    def __post_init__(self) -> None:
        size = 2 * len(self.frequency)
        covariance = readonly("ModalModel", "covariance", self.covariance, (size, size))
        object.__setattr__(self, "covariance", covariance)

    @property
    def free_pole(self) -> Complexes:
        """Poles without what a window and the mass of sensors add, rad/s, ``(n_mode,)``."""
        root = 1j * np.sqrt(1.0 - self.damping**2)
        return np.asarray(2.0 * np.pi * self.frequency * (root - self.damping))

    @property
    def resolved_run_std(self) -> Reals:
        """Standard deviations with which frequencies of runs are compared, Hz, ``(n_run, n_mode)``."""
        return np.hypot(self.run_frequency_std, RESOLVED * -self.pole.real / (2.0 * np.pi))

    @property
    def run_frequency(self) -> Reals:
        """Undamped natural frequency that each run alone gives, Hz, ``(n_run, n_mode)``."""
        return np.abs(self.run_pole) / (2.0 * np.pi)

    def disagreeing_runs(self, level: float = 0.05) -> Booleans:
        """Tell which run differs from the others in which mode, ``(n_run, n_mode)``, at a false alarm rate."""
        return self.run_probability < level


def synthesize(modal_model: ModalModel, frequency: Reals, quantity: Quantity) -> Complexes:
    """Evaluate the functions that a modal model stands for.

    Parameters
    ----------
    modal_model : ModalModel
    frequency : (n_frequency,) float
        Lines, Hz.
    quantity : {"receptance", "mobility", "accelerance"}
        What to return.

    Returns
    -------
    (n_output, n_input, n_frequency) complex

    Raises
    ------
    IdentificationError
        A line at 0 Hz is asked of receptance or mobility, where the lower residual term is singular.
    """
    s = 2j * np.pi * np.asarray(frequency, dtype=float)
    exponent = DERIVATIVE[quantity]
    if exponent < 2 and np.any(s == 0.0):
        raise IdentificationError(
            f"{quantity} has no value at 0 Hz: its lower residual term is singular; ask for lines above"
        )
    pole = np.concatenate([modal_model.pole, modal_model.outside_pole])[:, None]
    residue = np.concatenate([modal_model.residue, modal_model.outside_residue], axis=-1)
    terms = [residue, residue.conj(), modal_model.lower[..., None], modal_model.upper[..., None]]
    lines = [s**exponent / (s - pole), s**exponent / (s - pole.conj()), s ** (exponent - 2), s**exponent]
    return np.asarray(np.concatenate(terms, axis=-1) @ np.vstack(lines))  # one product: it may be large


def synthesize_runs(modal_model: ModalModel, frequency: Reals, quantity: Quantity, run: Integers) -> Complexes:
    """Evaluate the functions that were measured, each as its own run has it.

    That is `synthesize` where one set of poles serves all runs. Modal constants stay, a residue is one of them over its
    frequency. The parameters and errors are those of `synthesize`, beside

    Parameters
    ----------
    run : (n_output,) int
        Run of each output.
    """
    value = synthesize(modal_model, frequency, quantity)
    if modal_model.run_outside_pole is None:
        return value
    for k, number in enumerate(modal_model.run):
        inside, outside = modal_model.run_pole[k], modal_model.run_outside_pole[k]
        moved = replace(
            modal_model,
            pole=inside,
            residue=modal_model.residue * (modal_model.pole.imag / inside.imag),
            outside_pole=outside,
            outside_residue=modal_model.outside_residue * (modal_model.outside_pole.imag / outside.imag),
        )
        rows = run == number
        value[rows] = synthesize(moved, frequency, quantity)[rows]
    return value


def frequency_text(frequency: float | np.floating[Any], decimals: int) -> str:
    """Write a frequency, Hz, with some decimals; with more below 10 Hz, where too few digits would tell modes apart."""
    if not 0.0 < frequency < 10.0:
        return f"{frequency:.{decimals}f}"
    return f"{frequency:.{decimals + 1 - int(np.floor(np.log10(frequency)))}f}"
