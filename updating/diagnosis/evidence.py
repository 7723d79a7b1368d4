"""Measured modes of all configurations of a stack beside its model with effects.

All configurations count together. Contact stiffness and damping are shared; each configuration may deviate by the
scatter of reassembly and torque. Young's modulus, density and normal modulus carry priors. What the model cannot be
expected to meet better than, such as mesh and dimensions, is a scatter of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from ema.modal.mac import mac
from model import Effect, Modes, Observed, Parameter, ReducedEquations, Stack, shared_parameters, solve_modes
from model.modes.modes import Wanted
from updating.diagnosis.candidates import N_SOLVED
from updating.diagnosis.discrepancy import KINDS, Discrepancy, Kind, Sizes
from updating.diagnosis.sensor_place import USUAL

Vector = NDArray[np.float64]

SHARED = ("G_f", "d_f", "young", "density", "normal_modulus")
"""Nuisances that all configurations share; the deviations of G_f and d_f of each follow them."""
POINTS_SHIFT = "points_x"
"""Nuisance: how far all measured points sit along x from where the files have them, m."""
DECAY = "window"
"""Nuisance: the rate, 1/s, by which an exponential window that nobody stated makes everything decay faster."""
_NO_WINDOW = 1e-3  # standard deviation of that rate where no window is supposed, 1/s
_FIXED = 1e-3  # standard deviation of the logarithm of what nothing depends on
D_F_START = 2e-11
"""Contact damping parameter, s, from which a search starts where the stack states none."""


@dataclass(frozen=True, kw_only=True)
class DiagnosisScatter:
    """What a laboratory knows of what separates a right model from a right measurement, relative standard deviations.

    Attributes
    ----------
    frequency, damping, shape : float, optional
        Discrepancy of a model to which nothing is missing: of a frequency, a damping ratio, and of a shape's length.
        They are estimated where they are not stated, see `discrepancy`.
    mesh : float
        Of what the mesh is corrected by, relative to it.
    gain : float
        Of an accelerometer that roves, relative to that of the first.
    stiffness, loss : float
        Of G_f and d_f between configurations: reassembly and torque.
    young, density, normal_modulus, length, width, height : float
        Of what the stack file says of the steel, of the contact across, and of the dimensions.
    clamp_place : float
        Of where the clamps sit along x and y, m.
    point_place : float, optional
        Of where each measured point sits, along x and y, m; estimated where it is not stated, see `sensor_place`.
    points_shift : float
        Of how far all points together sit along x from where the files have them, m.
    """

    frequency: float | None = None
    damping: float | None = None
    shape: float | None = None
    mesh: float = 0.3
    gain: float = 0.01
    stiffness: float = 0.03
    loss: float = 0.06
    young: float = 0.02
    density: float = 0.01
    normal_modulus: float = 0.2
    length: float = 1e-3
    width: float = 2e-3
    height: float = 2e-3
    clamp_place: float = 2e-3
    point_place: float | None = None
    points_shift: float = 1e-3

    @property
    def stated(self) -> tuple[Kind, ...]:
        """Kinds of data whose discrepancy is stated."""
        return tuple(kind for kind in KINDS if getattr(self, kind) is not None)

    @property
    def sizes(self) -> Sizes:
        """The sizes that are stated, and elsewhere those that are usual."""
        return Sizes(**{kind: getattr(self, kind) for kind in self.stated})


class Identified(Protocol):
    """Modes with standard deviations, as `ema.ModalModel` has them."""

    @property
    def frequency(self) -> Vector:
        """Natural frequencies (n_mode,), Hz."""

    @property
    def frequency_std(self) -> Vector:
        """Their standard deviations."""

    @property
    def damping(self) -> Vector:
        """Damping ratios (n_mode,)."""

    @property
    def damping_std(self) -> Vector:
        """Their standard deviations."""

    @property
    def shape(self) -> NDArray[np.complex128]:
        """Shapes (n_dof, n_mode)."""

    @property
    def shape_std(self) -> Vector:
        """Standard deviations of their components."""

    @property
    def sensor(self) -> NDArray[np.int64]:
        """The accelerometer that measured each component, (n_dof,), from 0."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Tested:
    """One configuration: its pressure and what was identified.

    Attributes
    ----------
    name : str
        The configuration.
    pressure : float
        Mean pressure, Pa.
    modes : Identified
        The identified modes, or those that a test is expected to give.
    known : mapping of str to float
        Values of effect parameters that the test sets, such as a known mass.
    state : str
        What it has in common with other force levels of the same state; empty where it is a state of its own.
    strain : (n_mode, n_share) float, optional
        Strains of equal parts of the contact's energy in resonance of each mode, where amplitudes are known.
    motion : (n_mode,) float, optional
        Displacement amplitude at the driving point there, m.
    """

    name: str
    pressure: float
    modes: Identified
    known: Mapping[str, float] = field(default_factory=dict)
    state: str = ""
    strain: Vector | None = None
    motion: Vector | None = None

    @property
    def assembled(self) -> str:
        """What was put together once: all its force levels share this name."""
        return self.state or self.name


@dataclass(frozen=True, eq=False, kw_only=True)
class Shift:
    """What dimensions and mesh do to the measured modes of a configuration, taken from the base model's modes.

    Attributes
    ----------
    slope : (n_mode, n_dimension) float
        How much the logarithm of each frequency grows with the logarithms of `Evidence.dimensions`.
    mesh : (n_mode,) float
        How much it grows with an ever finer mesh.
    mesh_shape : (n_dof, n_mode) float
        What the same adds to each shape of unit length, turned as the measured one.
    """

    slope: Vector
    mesh: Vector
    mesh_shape: Vector


@dataclass(frozen=True, eq=False, kw_only=True)
class Rows:
    """What the rows of data are about: configuration by configuration frequencies, damping ratios, shapes.

    Attributes
    ----------
    kind : (n,) str
        "frequency", "damping" or "shape".
    mode : (n,) int
        The mode of the stack, as `Evidence.identity` numbers it.
    configuration : (n,) int
        The configuration.
    shape : mapping of (int, int) to (n_dof,) int
        Rows of a shape, by configuration and place among the modes that are used.
    """

    kind: NDArray[np.str_]
    mode: NDArray[np.int64]
    configuration: NDArray[np.int64]
    shape: Mapping[tuple[int, int], NDArray[np.intp]]

    @classmethod
    def of(
        cls,
        tested: Sequence[Tested],
        used: Sequence[NDArray[np.int64]],
        identity: Sequence[NDArray[np.int64]],
        *,
        touching: bool,
    ) -> Rows:
        """Return the rows of all configurations.

        Parameters
        ----------
        tested, used, identity
            As `Evidence` has them.
        touching : bool
            Whether laminas touch; the damping of one alone is not compared.
        """
        kind: list[str] = []
        mode: list[int] = []
        configuration: list[int] = []
        shape = {}
        for c, (test, seen, number) in enumerate(zip(tested, used, identity, strict=True)):
            n_dof = test.modes.shape.shape[0]
            damped = seen if touching else seen[:0]
            kind += ["frequency"] * seen.size + ["damping"] * damped.size + ["shape"] * (seen.size * n_dof)
            mode += [*number[seen], *number[damped], *np.repeat(number[seen], n_dof)]
            configuration += [c] * (len(kind) - len(configuration))
            for i in range(seen.size):
                first = len(kind) - (seen.size - i) * n_dof
                shape[c, i] = np.arange(first, first + n_dof)
        return cls(
            kind=np.array(kind),
            mode=np.array(mode, dtype=np.int64),
            configuration=np.array(configuration, dtype=np.int64),
            shape=shape,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """Configurations of a stack beside its reduced equations with all effects that are considered: what fits need.

    Attributes
    ----------
    stack : Stack
        Without effects.
    tested : tuple of Tested
        The configurations.
    used : tuple of (n,) int
        For each configuration, the measured modes that the model has.
    mixed : tuple of (n,) int
        For each configuration, the measured modes that close modes of the model span, and that are not compared.
    equations : ReducedEquations
        The model with all `effects`.
    observed : tuple of Observed
        The measured points of each configuration, tied to them.
    effects : mapping of str to Effect
        Those that this stack can have.
    scatter : DiagnosisScatter
        What separates a right model from a right measurement.
    start : (n_nuisance,) float
        Nuisance coordinates from which fits start.
    dimensions : tuple of str
        Those of the stack that are not known exactly.
    sensor : tuple of (n_dof,) int
        For each configuration, the accelerometer that measured each shape component, from 0.
    n_gain : int
        Accelerometers whose gain relative to the first is not known exactly; all configurations have the same.
    shift : tuple of Shift
        What dimensions and mesh do to the measured modes of each configuration.
    places : tuple of str
        Parameters of the model that say how far parts of the rig are from where the files have them, m.
    identity : tuple of (n_mode,) int
        For each configuration, the mode of the stack that each measured mode is, the same in all configurations.
    sensor_scatter : tuple of (n_mode,) float
        What the sensors' calibration and an identification worse than it states add to each shape, over its length.
    place_slope : tuple of (n_dof, 2, n_basis) float
        For each configuration, how observed displacements change as their points move along x and y, 1/m.
    point_place : float
        Standard deviation of where each point sits, m.
    sizes : Sizes
        Of the discrepancy, by which fits are weighed.
    covariance : Discrepancy
        Of what separates model and measurement, for all sizes.
    hypotheses : mapping of str to mapping of str to float
        What may be wrong with the measurement: by name, nuisances and the standard deviations that they then have.
    released : tuple of str
        Which of these are supposed.
    offset : (n_row,) float, optional
        What is added to measured less modelled data, where a rough model is known to be off by as much.
    """

    stack: Stack
    tested: tuple[Tested, ...]
    used: tuple[NDArray[np.int64], ...]
    equations: ReducedEquations
    observed: tuple[Observed, ...]
    effects: Mapping[str, Effect]
    scatter: DiagnosisScatter
    start: Vector
    dimensions: tuple[str, ...]
    sensor: tuple[NDArray[np.int64], ...]
    n_gain: int
    shift: tuple[Shift, ...]
    mixed: tuple[NDArray[np.int64], ...] = ()
    places: tuple[str, ...] = ()
    identity: tuple[NDArray[np.int64], ...] = ()
    sensor_scatter: tuple[Vector, ...] = ()
    place_slope: tuple[Vector, ...] = ()
    point_place: float = USUAL
    sizes: Sizes = field(default_factory=Sizes)
    covariance: Discrepancy = field(default_factory=lambda: Discrepancy(blocks=()))
    hypotheses: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    released: tuple[str, ...] = ()
    offset: Vector | None = None

    @cached_property
    def states(self) -> tuple[str, ...]:
        """Names of what was assembled anew: configurations, force levels of one counted once."""
        return tuple(dict.fromkeys(t.assembled for t in self.tested))

    def state_of(self, configuration: int) -> int:
        """Return the place of a configuration's state among `states`."""
        return self.states.index(self.tested[configuration].assembled)

    @property
    def touching(self) -> bool:
        """Whether laminas touch: one alone has no contact, so nothing tells its parameters, nor its damping."""
        return self.stack.n_lamina > 1

    @property
    def lacking(self) -> tuple[tuple[int, int], ...]:
        """Configuration and number, from 0, of measured modes that the model lacks amid those that it has."""
        mixed = self.mixed or (np.arange(0),) * len(self.used)
        return tuple(
            (c, r)
            for c, (used, spanned) in enumerate(zip(self.used, mixed, strict=True))
            for r in np.setdiff1d(np.arange(used.max(initial=0)), np.union1d(used, spanned)).tolist()
        )

    @cached_property
    def rows(self) -> Rows:
        """What each row of data is about."""
        return Rows.of(self.tested, self.used, self.identity, touching=self.touching)

    @cached_property
    def unit_shapes(self) -> dict[tuple[int, int], Vector]:
        """Measured shapes at unit length, (n_dof,), by configuration and place among the modes that are used."""
        return {
            (c, i): unit_shape(tested.modes.shape[:, [r]])[:, 0]
            for c, (tested, used) in enumerate(zip(self.tested, self.used, strict=True))
            for i, r in enumerate(used)
        }

    @property
    def modes(self) -> tuple[tuple[int, int], ...]:
        """Configuration and number, from 0, of every mode that is used."""
        return tuple((c, int(r)) for c, used in enumerate(self.used) for r in used)

    def supposing(self, names: Sequence[str]) -> Evidence:
        """Return the evidence with those of some names that are hypotheses about the measurement supposed."""
        found = tuple(name for name in names if name in self.hypotheses)
        return self if found == self.released else replace(self, released=found)

    @property
    def rough(self) -> Evidence:
        """The evidence beside what modes need most of the basis: for a quick look."""
        return replace(self, equations=self.equations.rough)

    @property
    def nuisances(self) -> tuple[str, ...]:
        """Names of the nuisance coordinates: logarithms of a ratio, and of places in m."""
        states = self.states if len(self.states) > 1 else ()
        return (
            *self.shared,
            *self.dimensions,
            *(f"gain[sensor {i + 2}]" for i in range(self.n_gain)),
            POINTS_SHIFT,
            DECAY,
            *(f"G_f[{name}]" for name in states),
            *(f"d_f[{name}]" for name in states),
        )

    def unit(self, nuisance: str) -> str:
        """Return the unit of a nuisance: m of places, 1/s of a decay, 1 where it is the logarithm of a ratio."""
        return "m" if nuisance in (*self.places, POINTS_SHIFT) else "1/s" if nuisance == DECAY else "1"

    @property
    def prior_std(self) -> Vector:
        """Prior standard deviation of each nuisance coordinate; infinite for G_f and d_f of laminas that touch."""
        s, n = self.scatter, len(self.states)
        each = [s.stiffness] * n + [s.loss] * n if n > 1 else []
        contact = [np.inf, np.inf, s.young, s.density, s.normal_modulus]
        if not self.touching:
            each, contact = [_FIXED] * len(each), [_FIXED, _FIXED, s.young, s.density, _FIXED]
        size, gain = [getattr(s, name) for name in self.dimensions], [s.gain] * self.n_gain
        places = [s.clamp_place] * len(self.places)
        std = np.array([*contact, *places, *size, *gain, s.points_shift, _NO_WINDOW, *each])
        for name in self.released:
            for nuisance, wide in self.hypotheses[name].items():
                std[self.nuisances.index(nuisance)] = wide
        return std

    @property
    def shared(self) -> tuple[str, ...]:
        """Parameters of the model that are nuisances of all configurations, the first of the coordinates."""
        return (*SHARED, *self.places)

    @property
    def n_sized(self) -> int:
        """Number of nuisance coordinates before the gains of sensors."""
        return len(self.shared) + len(self.dimensions)

    @property
    def n_common(self) -> int:
        """Number of nuisance coordinates before those of single configurations; last `POINTS_SHIFT` and `DECAY`."""
        return self.n_sized + self.n_gain + 2

    def by_gain(self, configuration: int) -> Vector:
        """Return how the logarithms of shape components grow with the gains, (n_dof, n_gain)."""
        return np.asarray(self.sensor[configuration][:, None] == np.arange(1, self.n_gain + 1), dtype=float)

    def parameters(self, names: Sequence[str]) -> tuple[Parameter, ...]:
        """Return the parameters of some effects, each once."""
        return tuple(shared_parameters(self.effects[n] for n in names if n not in self.hypotheses).values())

    def theta(self, nuisance: Vector, configuration: int) -> dict[str, float]:
        """Return the values of `shared` in a configuration, in their order, at nuisance coordinates."""
        ratio, places = np.split(nuisance[: len(self.shared)], [len(SHARED)])
        n, state = len(self.states), self.state_of(configuration)
        own = np.exp(nuisance[self.n_common :].reshape(2, n)[:, state]) if n > 1 else np.ones(2)
        contact = self.stack.contact
        at = (contact.G_f * own[0], (contact.d_f or D_F_START) * own[1], 1.0, 1.0, 1.0)
        return dict(zip(self.shared, [*(np.exp(ratio) * at).tolist(), *places.tolist()], strict=True))


def solved(
    evidence: Evidence,
    configuration: int,
    theta: Mapping[str, float],
    by: Sequence[str],
    n_mode: int = N_SOLVED,
    differentiated: Wanted | None = None,
) -> Modes:
    """Return the elastic modes of a configuration at model parameters, with derivatives by those named in `by`.

    `differentiated` is that of `solve_modes`.
    """
    own = evidence.tested[configuration]
    moved = {"pressure": own.pressure, **own.known, **theta}
    acting, observed = evidence.equations.acting(moved), evidence.observed[configuration]
    modes = solve_modes(
        acting.equations,
        G_f=theta["G_f"],
        d_f=theta["d_f"],
        n_mode=min(n_mode, acting.equations.size),  # one lamina without effects has few
        observation=replace(observed, reduced_rows=acting.rows(observed.reduced_rows)),
        parameters={k: v for k, v in moved.items() if k not in ("G_f", "d_f")},
        by=tuple(by),
        differentiated=differentiated,
    ).elastic()
    return replace(modes, coordinate=acting.whole(modes.coordinate))


def pair(
    shape: NDArray[np.complex128] | Vector,
    frequency: Vector,
    modelled_shape: Vector,
    modelled_frequency: Vector,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pair measured with modelled modes by MAC less a small penalty for distance in frequency."""
    far = np.abs(np.log(frequency[:, None] / modelled_frequency))
    row, column = linear_sum_assignment(mac(shape, modelled_shape) - np.minimum(far, 0.5), maximize=True)
    return row, column


def unit_shape(measured: NDArray[np.complex128] | Vector) -> Vector:
    """Return measured shapes, (n_dof, n_mode), turned real and at unit length."""
    turned = np.real(measured * np.exp(-0.5j * np.angle(np.sum(measured**2, axis=0))))
    return np.asarray(turned / np.linalg.norm(measured, axis=0))
