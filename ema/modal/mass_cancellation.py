"""The structure without the sensors that were on it: what roving masses do to modes, and how it is taken out.

A mass m at a point with the mass-normalised shapes ``phi`` changes ``Lambda q = omega**2 q`` to ``Lambda q = omega**2
(I + m phi.T phi) q``. This is the identity of Sherman and Morrison for the receptance of the loaded structure
(Çakar and Sanliturk, Mech. Syst. Signal Process. 19, 2005, 87-104), written in the modes of the band. Every run has a
structure of its own; the one without sensors is that whose runs, loaded, have the poles and modal constants that were
measured.
Where neither the mass nor the scale of a mode is known, the shifts from run to run tell their product: mass-change
scaling (Parloo, Verboven, Guillaume and Van Overmeire, Mech. Syst. Signal Process. 16, 2002, 757-767).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np
import scipy

from lamella_shared import Booleans, Integers, Reals

_LOG = logging.getLogger(__name__)


def yielding_beyond(shape: Reals, square: Reals) -> Reals:
    """Return what modes above the band are thought to yield at a sensor per unit force at each mode, m/N, (n_mode,).

    They go on as far apart as those of the band are, and are felt as they are: the sum of phi**2 / (lambda_s - lambda).
    """
    n_above = 30  # modes above the band that are thought to let a point yield
    omega = np.sqrt(square)
    apart = np.ptp(omega) / (omega.size - 1) if omega.size > 1 else 0.5 * omega[0]
    above = omega.max() + apart * np.arange(1, n_above + 1)
    return np.asarray(np.mean(shape**2) * np.sum(1.0 / (above[:, None] ** 2 - square), axis=0))


def moved_by_beyond(square: Reals, lost: Reals) -> Reals:
    """Return what the next modes beyond both ends of the band may move the frequencies by, as shares of them.

    To second order a mode s moves the squared frequency of a mode r by its share m**2 phi_r**2 phi_s**2 /
    (1 - lambda_s / lambda_r), see Fox and Kapoor, AIAA J. 6, 1968. It is taken to be as far beyond the band as the
    modes in it are apart, and to feel the sensors as they do in the mean.

    Parameters
    ----------
    square : (n_mode,) float
        Squared angular frequencies without the sensors.
    lost : (n_mode,) float
        Shares that the squared frequencies lose by the sensors, m phi**2.
    """
    omega = np.sort(np.sqrt(square))
    apart = (omega[-1] - omega[0]) / (omega.size - 1) if omega.size > 1 else 0.5 * omega[0]
    ends = np.array([end for end in (omega[0] - apart, omega[-1] + apart) if end > 0.0])
    near = np.abs(1.0 - ends[:, None] ** 2 / square)
    return np.asarray(0.5 * lost * lost.mean() * np.sum(1.0 / near, axis=0))


def loaded(square: Reals, shape: Reals) -> tuple[Reals, Reals]:
    """Return the modes of a structure with masses on it; of many at once, along leading axes.

    Parameters
    ----------
    square : (..., n_mode) float
        Squared angular frequencies without the masses.
    shape : (..., n_load, n_mode) float
        Mass-normalised shapes at the masses, times the square root of each mass.

    Returns
    -------
    square : (..., n_mode) float
        Squared angular frequencies with the masses, in the order of the modes without.
    turn : (..., n_mode, n_mode) float
        Modes with the masses, in columns, as combinations of those without, mass-normalised and of like sign.
    """
    mass = np.eye(square.shape[-1]) + np.swapaxes(shape, -1, -2) @ shape
    inverse = np.linalg.inv(np.linalg.cholesky(mass))
    back = np.swapaxes(inverse, -1, -2)
    value, vector = np.linalg.eigh((inverse * square[..., None, :]) @ back)
    turn = back @ vector
    places = _places(np.abs(turn))
    turn = np.take_along_axis(turn, places[..., None, :], axis=-1)
    sign = np.sign(np.diagonal(turn, axis1=-2, axis2=-1))
    return np.take_along_axis(value, places, axis=-1), turn * sign[..., None, :]


def _places(size: Reals) -> Integers:
    """Return for each row of square matrices, (..., n, n), a column of its own, so that the sum there is largest."""
    n = size.shape[-1]
    every = size.reshape(-1, n, n)
    place = np.argmax(every, axis=-1)  # the largest of all, where no two rows want the same column
    for i in np.flatnonzero((np.sort(place, axis=-1) != np.arange(n)).any(axis=-1)):
        place[i] = scipy.optimize.linear_sum_assignment(-every[i])[1]
    return np.asarray(place.reshape(size.shape[:-1]))


def yielding(pair: Integers, size: Reals, flexibility: Reals, *, most_yielding: float = 0.5) -> tuple[Reals, Reals]:
    """Return by what sensors move more than the modes of the band have them move, for modes above it let points yield.

    With flexibilities R between them the masses m move by the inverse of I - omega**2 m R, and modes feel m times
    that (as of one point, m / (1 - omega**2 m R)).

    Parameters
    ----------
    pair : (n_pair, 2) int
        Sensors that each flexibility is between.
    size : (n, n_mode) float
        Squared angular frequencies times masses and the unit of the flexibilities.
    flexibility : (n, n_pair) float
        Of n structures.
    most_yielding : float
        Share of the motion of a sensor's mass that may be the yielding of its point.

    Returns
    -------
    root, whole : (n, n_mode, n_sensor, n_sensor) float
        The square root of that inverse, and itself.
    """
    a, b = pair.T
    n_sensor = int(a.max()) + 1
    matrix = np.zeros((len(flexibility), n_sensor, n_sensor))
    matrix[:, a, b] = matrix[:, b, a] = flexibility
    value, vector = np.linalg.eigh(matrix)
    moves = 1.0 / (1.0 - np.clip(size[:, :, None] * value[:, None], -most_yielding, most_yielding))
    root, whole = (np.einsum("nai,nri,nbi->nrab", vector, factor, vector) for factor in (np.sqrt(moves), moves))
    return root, whole


_UNEVEN = 0.5
"""By how much, relative to their mean, the flexibilities that modes above the band have differ from place to place."""
_HEAVIEST = 0.5
"""Largest share of a modal mass that sensors of one run may add; beyond it the modes of the band do not suffice."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RovedModes:
    """Modes of a structure as each run of a roving test has them.

    Attributes
    ----------
    frequency : (n_run, n_mode) float
        Undamped natural frequencies of each run, Hz.
    std : (n_run, n_mode) float
        Their standard deviations, Hz; infinite where a run does not determine a mode.
    shape : (n_output, n_mode) float
        Modal constants of each output in its own run over the shape at the force in `drive_run`, 1/sqrt(kg); in any
        unit for modes without a scale.
    run : (n_output,) int
        Row of `frequency` that each output belongs to.
    drive : (n_mode,) float
        Shape at the force in the same unit as `shape`, as the run has it that measured the driving point; where none
        did, the modal constant of an output over its `shape`.
    drive_run : int or None
        That run.
    rest : (n_output, n_mode) float or None
        What the modes beyond the band add to the receptance between each output and the force at the frequency of each
        mode, m/N; None where that is not known.
    drive_output : int or None
        Output at the driving point.
    drive_std : (n_mode,) float or None
        Standard deviation of the shape at the force; None where it is as certain as the shapes.
    """

    frequency: Reals
    std: Reals
    shape: Reals
    run: Integers
    drive: Reals
    drive_run: int | None
    rest: Reals | None = None
    drive_output: int | None = None
    drive_std: Reals | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class BareModes:
    """Modes of the structure without sensors.

    Attributes
    ----------
    frequency : (n_mode,) float
        Undamped natural frequencies, Hz.
    frequency_std : (n_mode,) float
        Standard deviations, Hz, with the scatter of the runs about what the mass explains, and with what the modes
        beyond the band may be worth.
    shape : (n_output, n_mode) float
        Shapes in the unit of those that were measured.
    load : (n_mode,) float
        Mass of one sensor in the unit of the shapes: in kg where they are mass-normalised.
    load_std : (n_mode,) float
        Its standard deviations; 0 where it was given.
    off : (n_run, n_mode) float
        By how much the frequencies of the loaded runs are off, as shares: measured less predicted.
    off_as_measured : (n_run, n_mode) float
        The same with the shapes as they were measured, where `off` has them as frequencies and modal constants together
        tell: what mass explains without the help of shapes that are moved for it.
    """

    frequency: Reals
    frequency_std: Reals
    shape: Reals
    load: Reals
    load_std: Reals
    off: Reals
    off_as_measured: Reals


def without_sensors(
    modes: RovedModes, load: Reals | None, *, least_gain: float = 1e-7, rough_gain: float = 1e-4
) -> BareModes:
    """Return the modes that the structure has without the sensors of any run.

    From a first guess, each run is loaded by its own sensors (`loaded`); what its poles and modal constants then differ
    from the measured ones by corrects the guess, by Gauss-Newton steps with Levenberg-Marquardt damping. Modes above
    the band let the points of the sensors yield, by a flexibility for each run that the shifts tell as far as they can.

    Parameters
    ----------
    modes : RovedModes
    load : (n_mode,) float or None
        Mass of one sensor in the unit of the shapes; NaN for a mode where the shifts from run to run are to tell it,
        None where they tell one mass for all modes.
    least_gain, rough_gain : float
        Share of the squared misfit by which a step must lower it, in a first fit the latter: directions that no data
        tell go on for long.
    """
    # Standard deviation of squared frequencies, relative, that is added to theirs in a first fit: exact ones make a
    # valley so narrow that a fit ends on its side.
    wider = 1e-2
    _LOG.info("take the mass of the sensors out of %d runs", len(modes.frequency))
    problem = _Problem.of(modes, load)
    wide = replace(problem, rough=np.hypot(problem.rough, wider))
    ends = [_fitted(problem, _fitted(wide, start, rough_gain)[0], least_gain) for start in problem.starts()]
    return _result(problem, *min(ends, key=lambda end: float(end[2] @ end[2])))


def _fitted(
    problem: _Problem, x: Reals, least_gain: float, *, max_step: int = 100, converged: float = 1e-11
) -> tuple[Reals, Reals, Reals]:
    """Return the vector of least misfit near another, its covariance, and its misfit.

    `converged`: relative change of the unknowns.
    """
    damping, misfit = 1e-3, problem.misfit(x)
    for _ in range(max_step):
        jacobian = problem.jacobian(x, misfit)
        scale = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
        normal, gradient = (jacobian / scale).T @ (jacobian / scale), (jacobian / scale).T @ misfit
        while damping < 1e8:
            step = -np.linalg.solve(normal + damping * np.eye(scale.size), gradient) / scale
            proposed = problem.misfit(problem.limited(x + step))
            if proposed @ proposed <= misfit @ misfit:
                break
            damping *= 10.0
        else:
            break
        useless = misfit @ misfit - proposed @ proposed < least_gain * (misfit @ misfit)
        x, misfit, damping = problem.limited(x + step), proposed, max(damping / 10.0, 1e-9)
        moved = np.max(np.abs(step) / np.maximum(np.abs(x), 1e-3 * problem.size))
        if useless or moved < converged:
            break
    return x, np.linalg.pinv(normal) / np.outer(scale, scale), misfit


@dataclass(frozen=True, eq=False, kw_only=True)
class _Problem:
    """Unknowns of the structure without sensors, in one vector, and what they miss of the measured runs.

    The vector holds logarithms of the squared frequencies, the loads that are sought, the shape at the force,
    the flexibilities above the band between the sensors of each run over what they are thought to be, and the shapes.

    Attributes
    ----------
    modes : RovedModes
    given : (n_mode,) float
        Loads that are known, 0 for others.
    sought : (n_mode, n_load) float
        Which modes each of the loads that are sought belongs to.
    rough : (n_run, n_mode) float
        Standard deviations of squared frequencies, relative, infinite where a run does not determine them.
    rough_shape : (n_mode,) float
        Standard deviations of shapes.
    unit : (n_mode,) float
        What modes above the band are thought to yield; 0 where loads are not masses in kg.
    size : (n_unknown,) float
        Sizes of the unknowns, for differences.
    pair : (n_pair, 3) int
        Run and sensors in it, by their place there, that each flexibility belongs to.
    """

    modes: RovedModes
    given: Reals
    sought: Reals
    rough: Reals
    rough_shape: Reals
    unit: Reals
    size: Reals
    pair: Integers

    @classmethod
    def of(cls, modes: RovedModes, load: Reals | None) -> _Problem:
        """Lay out the unknowns for loads as `without_sensors` takes them."""
        # Standard deviation of shapes, relative to their root mean square, where they are weighed against frequencies.
        shape_std = 2e-3
        # Part of the largest shift of a mode by which shapes may be off where it is not known what modes beyond the
        # band add at the force: no more than what sensors change by those of the band.
        uncertain = 1.0
        # Part of the square of a shift by which it may be off for other reasons than noise.
        second_order = 0.02
        n_run, n_mode = modes.frequency.shape
        if load is None:
            given, sought = np.zeros(n_mode), np.ones((n_mode, 1))
        else:
            given, sought = np.nan_to_num(load), np.eye(n_mode)[:, np.isnan(load)]
        known = np.isfinite(modes.std)
        low, high = (f(np.where(known, modes.frequency, np.nan), axis=0) for f in (np.nanmin, np.nanmax))
        shift = 2.0 * (high / low - 1.0)
        rough = 2.0 * np.hypot(modes.std / modes.frequency, second_order * shift**2)
        in_kg = modes.drive_run is not None and (load is None or not np.isnan(load).any())
        rms = np.maximum(np.sqrt(np.mean(modes.shape**2, axis=0)), 1e-300)
        square = np.average((2.0 * np.pi * modes.frequency) ** 2, axis=0, weights=modes.std**-2.0)
        first = _first_load(modes, sought)
        force = rms if modes.drive_run is not None else np.zeros(0)
        pair = _pairs(modes.run, n_run)
        each = np.tile(rms, len(modes.shape))
        size = np.concatenate([np.ones(n_mode), first, force, np.ones(len(pair)), each])
        unit = yielding_beyond(modes.shape, square) if in_kg else np.zeros(n_mode)
        off = shape_std if modes.rest is not None else np.hypot(shape_std, uncertain * shift)
        return cls(
            modes=modes, given=given, sought=sought, rough=rough, rough_shape=off * rms, unit=unit, size=size, pair=pair
        )

    @property
    def rows(self) -> Integers:
        """First row of the misfit of each run, and the one after the last, (n_run + 1,)."""
        n_run, n_mode = self.rough.shape
        count = [np.count_nonzero(self.modes.run == k) + (self.modes.drive_run == k) for k in range(n_run)]
        return np.asarray(n_mode * np.cumsum([0, *(1 + n for n in count)]), dtype=np.int64)

    def parts(self, x: Reals) -> list[Reals]:
        """Return squared frequencies, loads, shape at the force, flexibilities and shapes of vectors (..., n_unknown).

        What is returned has the leading axes of the vectors.
        """
        n_mode = self.rough.shape[1]
        n_drive = 0 if self.modes.drive_run is None else n_mode
        ends = np.cumsum([n_mode, self.sought.shape[1], n_drive, len(self.pair)])
        square, load, drive, beyond, shape = np.split(x, ends, axis=-1)
        return [
            np.exp(square),
            self.given + load @ self.sought.T,
            drive,
            beyond,
            shape.reshape(*x.shape[:-1], *self.modes.shape.shape),
        ]

    def starts(self) -> list[Reals]:
        """Return first guesses: what was measured, as if loads had changed no shape, and with the scale of the shifts.

        At a node of a mode, the driving point says little of its scale; the shifts from run to run tell it to first
        order where the load is one mass.
        """
        # Factor by which the shifts may say that the scale of a mode is another than that at the driving
        # point.
        most_scaled = 5.0
        if self.modes.drive_run is None or self.sought.shape[1] > 1 or not (self.given + self._first()).any():
            return [self._start(np.ones(self.rough.shape[1]))]
        load = self.given + self._first()
        from_runs = _first_load(self.modes, np.eye(load.size))
        ratio = np.divide(from_runs, load, out=np.ones_like(load), where=load > 0.0)
        scale = np.clip(np.sqrt(ratio), 1.0 / most_scaled, most_scaled)
        return [self._start(np.ones(load.size)), self._start(scale)]

    def _first(self) -> Reals:
        """Return the first guess of the loads that are sought, by mode, (n_mode,)."""
        n_mode = self.rough.shape[1]
        return np.asarray(self.sought @ self.size[n_mode : n_mode + self.sought.shape[1]])

    def _start(self, scale: Reals) -> Reals:
        """Return the first guess with the shape of each mode scaled, and that at the force by the inverse."""
        n_run, n_mode = self.rough.shape
        shape = self.modes.shape * scale
        square = np.average((2.0 * np.pi * self.modes.frequency) ** 2, axis=0, weights=self.rough**-2.0)
        first = self.size[n_mode : n_mode + self.sought.shape[1]]
        felt = np.array([np.sum(shape[self.modes.run == k] ** 2, axis=0) for k in range(n_run)])
        load = self.given + self._first()
        square = square * (1.0 + load * np.average(felt, axis=0, weights=self.rough**-2.0))
        drive = self.modes.drive / scale if self.modes.drive_run is not None else np.zeros(0)
        return np.concatenate([np.log(square), first, drive, np.zeros(len(self.pair)), shape.reshape(-1)])

    def limited(self, x: Reals) -> Reals:
        """Return a vector with loads that are no less than nothing and not beyond what modes of the band can tell."""
        n_mode, n_load = self.sought.shape
        most = _HEAVIEST / np.maximum(np.sum(self.modes.shape**2, axis=0) / len(self.rough), 1e-300)
        bound = np.array([most[direction > 0.0].min() for direction in self.sought.T])
        limited = x.copy()
        loads = slice(n_mode, n_mode + n_load)
        limited[loads] = np.clip(x[loads], 1e-9 * self.size[loads], bound)
        return limited

    def misfit(self, x: Reals) -> Reals:
        """Return what a structure misses of the runs, and of what flexibilities are thought to be, over its size."""
        runs = [self._run(k, x[None])[0] for k in range(len(self.rough))]
        return np.concatenate([*runs, self._prior(x[None])[0]])

    def rough_shapes(self, rows: Booleans) -> Reals:
        """Return the standard deviations of the shapes of a run, (n_own, n_mode)."""
        each = np.tile(self.rough_shape, (int(np.count_nonzero(rows)), 1))
        if self.modes.drive_std is not None:
            at_force = np.flatnonzero(rows) == self.modes.drive_output
            each[at_force] = np.hypot(self.rough_shape, self.modes.drive_std)
        return each

    def _prior(self, x: Reals) -> Reals:
        """Return what flexibilities of vectors, (n, n_unknown), are off from what they are thought to be."""
        beyond, diagonal = self.parts(x)[3], self.pair[:, 1] == self.pair[:, 2]
        mean = beyond[:, diagonal].mean(axis=1, keepdims=True)
        return np.concatenate([mean, (beyond - np.where(diagonal, mean, 0.0)) / _UNEVEN], axis=1)

    def _run(self, k: int, x: Reals) -> Reals:
        """Return what vectors, (n, n_unknown), miss of the frequencies, modal constants and driving point of a run."""
        # Factor by which sensors may change the shape at the force: next to its nodes nothing more is seen.
        most_at_force = 10.0
        modes, rows = self.modes, self.modes.run == k
        square, load, drive, beyond, shape = self.parts(x)
        shape = shape[:, rows]
        known = load > 0.0
        unit = np.sqrt(np.where(known, load, 1.0))
        # times the mass, without a driving point: a load is the mass over the square at the force
        force = np.where(known, modes.drive / unit**2, 0.0) if modes.drive_run is None else drive
        reference = force if modes.drive_run is None else modes.drive
        root, moves = yielding(self.pair[self.pair[:, 0] == k, 1:], load * square * self.unit,
                               beyond[:, self.pair[:, 0] == k])  # fmt: skip
        predicted, turn = loaded(square, np.einsum("nrab,nbr->nar", root, shape) * np.sqrt(load)[:, None])
        # load times squared shape counts, whatever the unit of a mode
        here = (shape * unit[:, None]) @ turn / unit[:, None]
        there = np.einsum("nr,nrs->ns", force * unit, turn) / unit
        moved = np.einsum("nrab,nbr->nar", moves, here)
        here = moved / np.sqrt(1.0 + load * np.sum(moved * (moved - here), axis=1))[:, None]
        if modes.rest is not None:
            there = there + predicted * load * np.sum(here * modes.rest[rows], axis=1)
        ratio = np.divide(there, reference, out=np.ones_like(there), where=known & (reference != 0.0))
        ratio = np.clip(ratio, -most_at_force, most_at_force)[:, None]
        off = [
            (np.log(predicted) - 2.0 * np.log(2.0 * np.pi * modes.frequency[k])) / self.rough[k],
            ((here * ratio - modes.shape[rows]) / self.rough_shapes(rows)).reshape(len(x), -1),
        ]
        if modes.drive_run == k:
            std = 0.0 if modes.drive_std is None else modes.drive_std
            off.append((there - modes.drive) / np.hypot(self.rough_shape, std))
        return np.concatenate(off, axis=1)

    def jacobian(self, x: Reals, misfit: Reals) -> Reals:
        """Return the derivatives of the misfit; a shape or flexibility of one run concerns that run alone."""
        difference = 1e-6  # of an unknown, for derivatives
        n_mode, rows = self.rough.shape[1], self.rows
        common = x.size - self.modes.shape.size - len(self.pair)
        run = np.concatenate([np.full(common, -1), self.pair[:, 0], np.repeat(self.modes.run, n_mode)])
        moved = x + np.diag(difference * self.size)
        matrix = np.zeros((misfit.size, x.size))
        for k in range(len(self.rough)):
            concerned = np.flatnonzero((run == -1) | (run == k))
            block = slice(rows[k], rows[k + 1])
            matrix[block, concerned] = (self._run(k, moved[concerned]) - misfit[block]).T
        matrix[rows[-1] :] = (self._prior(moved) - misfit[rows[-1] :]).T
        return np.asarray(matrix / (difference * self.size))


def _off(problem: _Problem, misfit: Reals) -> Reals:
    """Return the part of a misfit that squared frequencies are off by, as shares, (n_run, n_mode)."""
    n_mode = problem.rough.shape[1]
    rough = np.where(np.isfinite(problem.rough), problem.rough, 0.0)
    return np.asarray(-np.array([misfit[row : row + n_mode] for row in problem.rows[:-1]]) * rough)


def _as_measured(problem: _Problem, x: Reals, misfit: Reals) -> Reals:
    """Return a vector with its shapes moved by what their modal constants miss of those measured."""
    n_mode = problem.rough.shape[1]
    moved = x.copy()
    shape = moved[x.size - problem.modes.shape.size :].reshape(problem.modes.shape.shape)
    for k, row in enumerate(problem.rows[:-1]):
        rows = problem.modes.run == k
        size = n_mode * np.count_nonzero(rows)
        missed = misfit[row + n_mode : row + n_mode + size].reshape(-1, n_mode)
        shape[rows] -= missed * problem.rough_shapes(rows)
    return moved


def _result(problem: _Problem, x: Reals, covariance: Reals, misfit: Reals) -> BareModes:
    """Return the modes of a vector and, from its covariance, their standard deviations."""
    n_mode = problem.rough.shape[1]
    square, load, _, _, shape = problem.parts(x)
    known = np.isfinite(problem.rough)
    off = _off(problem, misfit)
    n_load = problem.sought.shape[1]
    freedom = np.maximum(known.sum(axis=0) - 1.0 - n_load / n_mode, 1.0)
    scatter = np.sum(np.where(known, off / problem.rough, 0.0) ** 2, axis=0) / freedom
    std = np.sqrt(np.diag(covariance))
    lost = np.abs(
        np.average((2.0 * np.pi * problem.modes.frequency) ** 2, axis=0, weights=problem.rough**-2.0) / square - 1.0
    )
    unsure = (1.0 if problem.modes.rest is None else _UNEVEN) * moved_by_beyond(square, np.where(load > 0.0, lost, 0.0))
    frequency = np.sqrt(square) / (2.0 * np.pi)
    noise = 0.5 * std[:n_mode] * np.sqrt(np.maximum(scatter, 1.0))
    return BareModes(
        frequency=frequency,
        frequency_std=np.hypot(noise, unsure) * frequency,
        shape=shape,
        load=load,
        load_std=problem.sought @ std[n_mode : n_mode + n_load] * np.sqrt(max(float(scatter.mean()), 1.0)),
        off=0.5 * off,
        off_as_measured=0.5 * _off(problem, problem.misfit(_as_measured(problem, x, misfit))),
    )


def _pairs(run: Integers, n_run: int, *, few_sensors: int = 4) -> Integers:
    """Return run and sensors, by their place in it, between which there are flexibilities; with many, each alone.

    `few_sensors`: sensors of a run up to which it counts that a force at one lets the point of another yield.
    """
    pairs = []
    for k in range(n_run):
        n = int(np.count_nonzero(run == k))
        pairs += [(k, a, b) for a in range(n) for b in range(a + 1) if a == b or n <= few_sensors]
    return np.array(pairs, dtype=np.int64).reshape(-1, 3)


def _first_load(modes: RovedModes, sought: Reals) -> Reals:
    """Return the loads that shifts tell to first order, (n_load,), more than nothing."""
    weight = modes.std**-2.0 * modes.frequency**2
    shift = np.log(modes.frequency / np.average(modes.frequency, axis=0, weights=weight))
    felt = np.array([np.sum(modes.shape[modes.run == k] ** 2, axis=0) for k in range(len(shift))])
    around = felt - np.average(felt, axis=0, weights=weight)
    pull = sought.T @ np.sum(-2.0 * weight * around * shift, axis=0)
    stiffness = sought.T @ np.sum(weight * around**2, axis=0)
    most = _HEAVIEST / np.maximum(sought.T @ felt.max(axis=0), 1e-300)
    return np.clip(pull / np.maximum(stiffness, 1e-300), 1e-3 * most, most)
