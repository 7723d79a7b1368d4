"""Measured modes beside a model with effects, as one whitened residual: what fits, diagnosis and experiments share.

All configurations of a stack count together. Contact stiffness and damping are shared; each configuration may deviate
by the scatter of reassembly and torque. Young's modulus, density and normal modulus carry priors. What the model
cannot be expected to meet better than, such as mesh and dimensions, is a scatter of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.optimize import least_squares, linear_sum_assignment

from ema.mac import mac
from ema.modes import ModalModel
from model import (
    Effect,
    EffectError,
    Instruments,
    Modes,
    Observed,
    Parameter,
    ReducedSystem,
    Stack,
    assemble,
    observe,
    reduce,
    shared_parameters,
    solve_modes,
)
from updating.errors import FitError
from updating.registration import register

Vector = NDArray[np.float64]
Campaigned = tuple[str, float, ModalModel]  # name, pressure in Pa, identified modes

G_F_RANGE = (300.0, 6000.0)
"""Contact stiffness parameters, Pa/Pa, for which the model is reduced: three times beyond Table 6 of the paper."""
D_F_START = 2e-11
N_SNAPSHOT = 4
SAMPLED = ("clamp_roll_inertia", "clamp_station")
"""Parameters over whose range the model is sampled: they change modes too much for first-order answers."""
N_MODEL = 20
_MAC_USED = 0.6
_NEIGHBOUR = 0.05
_TRIALS = 17


@dataclass(frozen=True, kw_only=True)
class Scatter:
    """What separates a right model from a right measurement, as standard deviations relative to the value.

    Attributes
    ----------
    frequency, damping : float
        Of every mode, beside the measurement's own: mesh, dimensions, and how a mode's damping repeats.
    shape : float
        Of every shape component, relative to the shape's root mean square: places and calibration of sensors.
    stiffness, loss : float
        Of G_f and d_f between configurations: reassembly and torque.
    young, density, normal_modulus : float
        Of what the stack file says of the steel and of the contact across.
    """

    frequency: float = 1e-3
    damping: float = 0.03
    shape: float = 0.01
    stiffness: float = 0.03
    loss: float = 0.06
    young: float = 0.02
    density: float = 0.01
    normal_modulus: float = 0.2


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
    """

    name: str
    pressure: float
    modes: Identified
    known: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """Configurations of a stack beside its reduced model with all effects that are considered.

    Attributes
    ----------
    stack : Stack
        Without effects.
    tested : tuple of Tested
        The configurations.
    used : tuple of (n,) int
        For each configuration, the measured modes that the model has.
    system : ReducedSystem
        The model with all `effects`.
    observed : tuple of Observed
        The measured points of each configuration.
    effects : mapping of str to Effect
        Those that this stack can have.
    impossible : mapping of str to str
        Why the others cannot be.
    scatter : Scatter
        What separates a right model from a right measurement.
    start : (n_nuisance,) float
        Nuisance coordinates from which fits start.
    """

    stack: Stack
    tested: tuple[Tested, ...]
    used: tuple[NDArray[np.int64], ...]
    system: ReducedSystem
    observed: tuple[Observed, ...]
    effects: Mapping[str, Effect]
    impossible: Mapping[str, str]
    scatter: Scatter
    start: Vector

    @property
    def nuisances(self) -> tuple[str, ...]:
        """Names of the nuisance coordinates; all are logarithms of a ratio."""
        n = len(self.tested)
        return (
            "G_f",
            "d_f",
            "young",
            "density",
            "normal_modulus",
            *(f"G_f[{t.name}]" for t in self.tested[: n if n > 1 else 0]),
            *(f"d_f[{t.name}]" for t in self.tested[: n if n > 1 else 0]),
        )

    @property
    def prior_std(self) -> Vector:
        """Prior standard deviation of each nuisance coordinate; infinite for G_f and d_f."""
        s, n = self.scatter, len(self.tested)
        each = [s.stiffness] * n + [s.loss] * n if n > 1 else []
        return np.array([np.inf, np.inf, s.young, s.density, s.normal_modulus, *each])

    def parameters(self, names: Sequence[str]) -> tuple[Parameter, ...]:
        """Return the parameters of some effects, each once."""
        return tuple(shared_parameters(self.effects[name] for name in names).values())


@dataclass(frozen=True, eq=False, kw_only=True)
class Residual:
    """Whitened differences of measurement and model.

    Attributes
    ----------
    value : (n,) float
        Measured less modelled, over the standard deviation; last the priors.
    jacobian : (n, n_coordinate) float
        Its derivatives by the coordinates: nuisances, then effect parameters over their range.
    kind : (n,) str
        "frequency", "damping", "shape" or "prior".
    label : tuple of str
        Configuration and number of the mode, of each value.
    """

    value: Vector
    jacobian: Vector
    kind: NDArray[np.str_]
    label: tuple[str, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class CandidateModel:
    """The reduced model of a stack with all effects that it can have.

    Attributes
    ----------
    stack : Stack
        Without effects.
    system : ReducedSystem
        With all of them, neutral.
    effects : mapping of str to Effect
        Those that this stack can have.
    impossible : mapping of str to str
        Why the others cannot be.
    """

    stack: Stack
    system: ReducedSystem
    effects: Mapping[str, Effect]
    impossible: Mapping[str, str]


def candidate_model(
    stack: Stack, instruments: Instruments, effects: Mapping[str, Effect], aids: Sequence[Effect] = ()
) -> CandidateModel:
    """Reduce the model of a stack so that it holds for all effects that the stack can have.

    Parameters
    ----------
    stack : Stack
        Of the stack file.
    instruments : Instruments
        Where the test's instruments touch it.
    effects : mapping of str to Effect
        What to consider.
    aids : sequence of Effect
        What further tests could do to the stack; the reduction holds for them too.
    """
    base = replace(stack, instruments=instruments)
    small = replace(base, mesh=replace(base.mesh, n_x=2, n_y=1))
    possible, impossible = {}, {}
    for name, effect in effects.items():
        try:
            assemble(small.with_effects(effect))
            possible[name] = effect
        except EffectError as error:
            impossible[name] = str(error)
    sampled = {
        p.name: (p.lower, p.upper)
        for effect in possible.values()
        for p in effect.parameters
        if p.name in SAMPLED
    }
    system = reduce(
        base.with_effects(*possible.values(), *aids),
        G_f_range=G_F_RANGE,
        n_snapshot=N_SNAPSHOT * (1 + len(sampled)),
        n_mode=N_MODEL,
        ranges=sampled,
    )
    return CandidateModel(stack=base, system=system, effects=possible, impossible=impossible)


def instruments_of(modes: ModalModel) -> Instruments:
    """Return where the instruments of a test touched the stack."""
    place = {int(n): i for i, n in enumerate(modes.geometry.node)}
    x, y, z = modes.geometry.coordinate[place[int(modes.input.node[0])]]
    sensor = modes.geometry.coordinate[[place[int(n)] for n in modes.node]]
    return Instruments(shaker=(float(x), float(y), float(z)), sensor=sensor)


def gather(
    candidates: CandidateModel, tested: Sequence[Campaigned], *, scatter: Scatter | None = None
) -> Evidence:
    """Put measured configurations beside a model and find the measured modes that it has.

    Parameters
    ----------
    candidates : CandidateModel
        The model.
    tested : sequence of (str, float, ModalModel)
        Name, pressure in Pa and identified modes of each configuration.
    scatter : Scatter, optional
        What separates a right model from a right measurement.

    Raises
    ------
    FitError
        No configuration is given, or no measured mode resembles one of the model.
    PairingError
        Measured points do not lie on the stack.
    """
    if not tested:
        message = "nothing to compare: no configuration was identified"
        raise FitError(message)
    base = candidates.stack
    observed = tuple(
        observe(candidates.system, register(base, modes.geometry, modes.node, modes.direction).observation)
        for _, _, modes in tested
    )
    evidence = Evidence(
        stack=base,
        tested=tuple(Tested(name=name, pressure=p, modes=modes) for name, p, modes in tested),
        used=tuple(np.arange(modes.frequency.size) for _, _, modes in tested),
        system=candidates.system,
        observed=observed,
        effects=candidates.effects,
        impossible=candidates.impossible,
        scatter=scatter or Scatter(),
        start=np.zeros(0),
    )
    return _started(evidence)


def _started(evidence: Evidence) -> Evidence:
    """Scan G_f for the value that explains most modes, and keep the measured modes that the model has there."""
    best: tuple[float, float, tuple[NDArray[np.int64], ...]] | None = None
    for G_f in np.geomspace(*G_F_RANGE, _TRIALS):
        cost, used = 0.0, []
        for c, tested in enumerate(evidence.tested):
            modes = solved(evidence, c, {"G_f": float(G_f), "d_f": D_F_START}, ())
            row, column = _assignment(tested.modes.shape, tested.modes.frequency, modes)
            alike = mac(tested.modes.shape, modes.shape)[row, column]
            far = np.log(tested.modes.frequency[row] / modes.frequency[column])
            cost += float(np.sum(np.minimum((far / 0.2) ** 2, 1.0) + 1.0 - alike))
            used.append(row[alike >= _MAC_USED])
        if best is None or cost < best[0]:
            best = (cost, float(G_f), tuple(used))
    if best is None or not sum(u.size for u in best[2]):
        message = "no measured mode resembles one of the model; check points, directions and signs"
        raise FitError(message)
    start = np.zeros(len(evidence.nuisances))
    start[0] = np.log(best[1] / evidence.stack.contact.G_f)
    start[1] = np.log(D_F_START / evidence.stack.contact.d_f) if evidence.stack.contact.d_f > 0 else 0.0
    return replace(evidence, used=best[2], start=start)


def solved(evidence: Evidence, configuration: int, theta: Mapping[str, float], by: Sequence[str]) -> Modes:
    """Return the elastic modes of a configuration at model parameters, with derivatives by those named in `by`."""
    rest = {k: v for k, v in theta.items() if k not in ("G_f", "d_f")}
    return solve_modes(
        evidence.system,
        G_f=theta["G_f"],
        d_f=theta["d_f"],
        n_mode=N_MODEL,
        observation=evidence.observed[configuration],
        parameters={
            "pressure": evidence.tested[configuration].pressure,
            **evidence.tested[configuration].known,
            **rest,
        },
        by=tuple(by),
    ).elastic()


def _assignment(
    shape: NDArray[np.complex128], frequency: Vector, modes: Modes
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pair measured with modelled modes by MAC less a small penalty for distance in frequency."""
    far = np.abs(np.log(frequency[:, None] / modes.frequency))
    row, column = linear_sum_assignment(mac(shape, modes.shape) - np.minimum(far, 0.5), maximize=True)
    return row, column


def scaled(parameter: Parameter, coordinate: float) -> tuple[float, float]:
    """Return a parameter's value at a coordinate in units of its range, 0 at neutral, and its derivative."""
    if parameter.scale == "log":
        span = np.log(parameter.upper / parameter.lower)
        value = parameter.neutral * np.exp(span * coordinate)
        return float(value), float(span * value)
    span = parameter.upper - parameter.lower
    return parameter.neutral + span * coordinate, span


def coordinate_of(parameter: Parameter, value: float) -> float:
    """Return the coordinate, in units of its range, of a parameter's value."""
    if parameter.scale == "log":
        return float(np.log(value / parameter.neutral) / np.log(parameter.upper / parameter.lower))
    return (value - parameter.neutral) / (parameter.upper - parameter.lower)


def bounds_of(parameters: Sequence[Parameter]) -> tuple[Vector, Vector]:
    """Return lower and upper bounds of the coordinates of parameters."""
    return (
        np.array([coordinate_of(p, p.lower) for p in parameters]),
        np.array([coordinate_of(p, p.upper) for p in parameters]),
    )


def residual(
    evidence: Evidence,
    nuisance: Vector,
    parameters: Sequence[Parameter] = (),
    coordinate: Vector | None = None,
) -> Residual:
    """Compare the measurement with the model at nuisance coordinates and coordinates of effect parameters.

    Parameters
    ----------
    evidence : Evidence
        Both.
    nuisance : (n_nuisance,)
        Logarithms of ratios to the stack's own values, as `Evidence.nuisances` names them.
    parameters : sequence of Parameter
        Effect parameters that take part.
    coordinate : (n_parameter,)
        Their coordinates in units of their ranges; neutral without.
    """
    z = np.zeros(len(parameters)) if coordinate is None else coordinate
    effect = {p.name: scaled(p, float(x)) for p, x in zip(parameters, z, strict=True)}
    n_own, n_tested = len(evidence.nuisances), len(evidence.tested)
    contact, s = evidence.stack.contact, evidence.scatter
    value, rows, kinds, labels = [], [], [], []
    for c, tested in enumerate(evidence.tested):
        shift = nuisance[5 + c] if n_tested > 1 else 0.0
        loss = nuisance[5 + n_tested + c] if n_tested > 1 else 0.0
        theta = {
            "G_f": contact.G_f * float(np.exp(nuisance[0] + shift)),
            "d_f": (contact.d_f or D_F_START) * float(np.exp(nuisance[1] + loss)),
            **{n: float(np.exp(x)) for n, x in zip(evidence.nuisances[2:5], nuisance[2:5], strict=True)},
        }
        by = ("G_f", "d_f", "young", "density", "normal_modulus", *effect)
        modes = solved(evidence, c, {**theta, **{name: v for name, (v, _) in effect.items()}}, by)
        place = [modes.parameter.index(name) for name in by]
        per = np.array([*theta.values(), *(slope for _, slope in effect.values())])
        used, measured = evidence.used[c], tested.modes
        _, column = _assignment(measured.shape[:, used], measured.frequency[used], modes)

        def spread(gradient: Vector, c: int = c, per: Vector = per, place: list[int] = place) -> Vector:
            """Return derivatives by the coordinates from those by the model's parameters."""
            own = gradient[..., place] * per
            full = np.zeros((*own.shape[:-1], n_own + len(effect)))
            full[..., :5], full[..., n_own:] = own[..., :5], own[..., 5:]
            if n_tested > 1:
                full[..., 5 + c], full[..., 5 + n_tested + c] = own[..., 0], own[..., 1]
            return full

        for kind, std, own in (
            ("frequency", measured.frequency_std, s.frequency),
            ("damping", measured.damping_std, s.damping),
        ):
            of_measured, of_model = getattr(measured, kind)[used], getattr(modes, kind)[column]
            sigma = np.hypot(std[used] / of_measured, own)
            safe = np.maximum(of_model, 1e-12)
            value.append(np.log(of_measured / safe) / sigma)
            rows.append(-spread(getattr(modes, f"{kind}_gradient")[column]) / (safe * sigma)[:, None])
            kinds += [kind] * used.size
            labels += [f"{tested.name}, mode {r + 1}" for r in used]
        for r, m in zip(used, column, strict=True):
            difference, slope = _shape_difference(measured, int(r), modes, int(m), spread, s.shape)
            value.append(difference)
            rows.append(slope)
            kinds += ["shape"] * difference.size
            labels += [f"{tested.name}, mode {r + 1}"] * difference.size
    held = np.isfinite(evidence.prior_std)
    priors = np.flatnonzero(held)
    prior_rows = np.zeros((priors.size, n_own + len(effect)))
    prior_rows[np.arange(priors.size), priors] = -1.0 / evidence.prior_std[held]
    value.append(-nuisance[held] / evidence.prior_std[held])
    rows.append(prior_rows)
    kinds += ["prior"] * priors.size
    labels += [evidence.nuisances[i] for i in priors]
    return Residual(
        value=np.concatenate(value), jacobian=np.vstack(rows), kind=np.array(kinds), label=tuple(labels)
    )


def _shape_difference(
    measured: Identified, r: int, modes: Modes, m: int, spread: Callable[[Vector], Vector], scatter: float
) -> tuple[Vector, Vector]:
    """Return the whitened difference of a measured and a modelled shape, both of unit length, and its derivatives.

    What lies along the shape itself (its scale) and along model modes within 5 % in frequency is taken out: how close
    modes mix is not to be predicted.
    """
    shape = measured.shape[:, r]
    turned = np.exp(-0.5j * np.angle(np.sum(shape**2)))
    length = float(np.linalg.norm(shape))
    u = np.real(shape * turned) / length
    psi = modes.shape[:, m]
    norm = float(np.linalg.norm(psi))
    v = psi / norm
    if u @ v < 0.0:
        u = -u
    near = np.abs(np.log(modes.frequency / modes.frequency[m])) < _NEIGHBOUR
    out = la.orth(np.column_stack([v, modes.shape[:, near] / np.linalg.norm(modes.shape[:, near], axis=0)]))
    sigma = np.hypot(measured.shape_std[:, r] / length, scatter / np.sqrt(u.size))

    def kept(x: Vector) -> Vector:
        return np.asarray(x - out @ (out.T @ x))

    difference = kept(u - v) / sigma
    slope = -kept(spread(modes.shape_gradient[:, m]) / norm) / sigma[:, None]
    return difference, slope


def _nuisance_bounds(evidence: Evidence) -> tuple[Vector, Vector]:
    """Return how far nuisances may go: G_f over the range of the reduction, d_f a hundredfold, others by their priors.

    A first step from a model that lacks an effect can ask for far more, and then the contact turns negative.
    """
    reach = _FARTHEST * evidence.prior_std
    low, high = -reach, reach.copy()
    low[0], high[0] = np.log(np.array(G_F_RANGE) / evidence.stack.contact.G_f)
    low[1], high[1] = evidence.start[1] - np.log(100.0), evidence.start[1] + np.log(100.0)
    return low, high


@dataclass(frozen=True, eq=False, kw_only=True)
class Explanation:
    """The model with some effects, fitted to all configurations together.

    Attributes
    ----------
    effects : tuple of str
        Which; none for the base model.
    parameter : tuple of Parameter
        Their parameters.
    value, lower, upper : (n_parameter,) float
        Estimates and the ends of their 90 % intervals, within the plausible ranges.
    at_bound : (n_parameter,) bool
        Which lie on an end of the plausible range.
    nuisance : (n_nuisance,) float
        Nuisance coordinates.
    coordinate : (n_parameter,) float
        Effect parameters in units of their ranges.
    misfit : float
        Squared length of the whitened residual, priors included.
    log_evidence : float
        Logarithm of the marginal likelihood by Laplace's approximation, up to a constant of the data.
    residual : Residual
        At the estimate.
    """

    effects: tuple[str, ...]
    parameter: tuple[Parameter, ...]
    value: Vector
    lower: Vector
    upper: Vector
    at_bound: NDArray[np.bool_]
    nuisance: Vector
    coordinate: Vector
    misfit: float
    log_evidence: float
    residual: Residual


_Z90 = 1.6449
_FARTHEST = 10.0  # prior standard deviations that a nuisance may move
_EDGE = 1e-4


def explain(
    evidence: Evidence,
    effects: Sequence[str] = (),
    *,
    nuisance: Vector | None = None,
    coordinate: Vector | None = None,
    most: int = 12,
) -> Explanation:
    """Fit nuisances and the parameters of some effects to all configurations by weighted least squares.

    Parameters
    ----------
    evidence : Evidence
        Measurement and model.
    effects : sequence of str
        Names of effects; none fits the base model.
    nuisance, coordinate : optional
        Where the search starts.
    most : int
        Largest number of evaluations.
    """
    parameters = evidence.parameters(effects)
    n_own = len(evidence.nuisances)
    low, high = bounds_of(parameters)
    first = np.concatenate(
        [
            evidence.start if nuisance is None else nuisance,
            np.clip(np.zeros(len(parameters)) if coordinate is None else coordinate, low + 1e-9, high - 1e-9),
        ]
    )
    seen: dict[bytes, Residual] = {}

    def at(x: Vector) -> Residual:
        key = x.tobytes()
        if key not in seen:
            seen.clear()
            seen[key] = residual(evidence, x[:n_own], parameters, x[n_own:])
        return seen[key]

    nuisance_low, nuisance_high = _nuisance_bounds(evidence)
    first[:n_own] = np.clip(first[:n_own], nuisance_low + 1e-9, nuisance_high - 1e-9)
    solution = least_squares(
        lambda x: at(x).value,
        first,
        jac=lambda x: at(x).jacobian,
        bounds=(np.concatenate([nuisance_low, low]), np.concatenate([nuisance_high, high])),
        x_scale="jac",
        xtol=1e-5,
        ftol=1e-4,
        max_nfev=most,
    )
    best = at(solution.x)
    z = solution.x[n_own:]
    hessian = best.jacobian.T @ best.jacobian
    covariance = la.pinvh(hessian)
    std = np.sqrt(np.maximum(np.diag(covariance)[n_own:], 0.0))
    sign, logdet = np.linalg.slogdet(hessian + 1e-9 * np.eye(len(hessian)))
    misfit = float(best.value @ best.value)

    def ends(step: Vector) -> Vector:
        clipped = np.clip(z + step, low, high)
        return np.array([scaled(p, float(x))[0] for p, x in zip(parameters, clipped, strict=True)])

    return Explanation(
        effects=tuple(effects),
        parameter=parameters,
        value=ends(np.zeros(z.size)),
        lower=ends(-_Z90 * std),
        upper=ends(_Z90 * std),
        at_bound=(z - low < _EDGE) | (high - z < _EDGE),
        nuisance=solution.x[:n_own],
        coordinate=z,
        misfit=misfit,
        log_evidence=-0.5 * misfit
        - 0.5 * float(logdet) * float(sign)
        + 0.5 * len(z) * float(np.log(2 * np.pi)),
        residual=best,
    )
