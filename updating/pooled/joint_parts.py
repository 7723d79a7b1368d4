"""Parts of what a joint fit says: its parameters with covariance, and each configuration beside the model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.modal.mac import mac
from updating.diagnosis.answer_parts import Moved, Sizes
from updating.diagnosis.coordinates import scaled
from updating.diagnosis.evidence import D_F_START
from updating.diagnosis.fit_settings import CONTACT, RATIOS, FitSettings, is_pinned
from updating.diagnosis.joint_answer import ConfigurationFit, FittedParameter, JointFit
from updating.diagnosis.moved import moved
from updating.diagnosis.stack_model import StackModel
from updating.inference.algebra import scaled_inverse
from updating.inference.equation_error import Errors
from updating.inference.explain import Explanation, Setting, errors_at, setting
from updating.inference.left_out import Kind, LeftOut, left_out
from updating.inference.protocol import Coordinate, LocalModel
from updating.pooled.specimens_model import SpecimensModel
from updating.results.ledger import Entry
from updating.results.text import Z95

Vector = NDArray[np.float64]
UNITS = {"G_f": "Pa/Pa", "d_f": "s/Pa"}
_TOLD = 4.0  # variance of the logarithm of a damping ratio, above which it does not take part


@dataclass(frozen=True, eq=False, kw_only=True)
class Fitted:
    """A fit, with the model that it is of.

    Attributes
    ----------
    model : StackModel or SpecimensModel
        With the modes that take part.
    whole : StackModel, SpecimensModel or None
        With those that are held out as well; none where there are none.
    own : Explanation
        The fit.
    common : Setting
        What it shares with others.
    kept : tuple of (n_mode,) bool
        Modes that take part, by configuration.
    paired : bool
        Whether errors of frequencies are told of pairs of modes; else each measured mode is told beside the mixture of
        the model's that it is.
    classed : tuple of bool
        Whether the shapes of a configuration stand for classes; of none by default.
    """

    model: StackModel | SpecimensModel
    whole: StackModel | SpecimensModel | None
    own: Explanation
    common: Setting
    kept: tuple[NDArray[np.bool_], ...]
    paired: bool
    classed: tuple[bool, ...] = ()

    @property
    def first(self) -> StackModel:
        """The model of a stack, or of the first of them."""
        return self.model.first if isinstance(self.model, SpecimensModel) else self.model


def damped(own: Explanation) -> bool:
    """Tell whether any damping ratio took part in a fit."""
    return bool(np.any(np.diag(own.problem.damping_noise) < _TOLD))


def joint_answer(found: Fitted, labels: Sequence[str], entry: Entry, settings: FitSettings) -> JointFit:
    """Return what a fit says.

    Parameters
    ----------
    found : Fitted
        The fit.
    labels : sequence of str
        What configurations are called.
    entry : Entry
        Its line of the ledger.
    settings : FitSettings
        What was known of its parameters.
    """
    own = found.own
    parameter, covariance = parameters_of(found, labels, settings)
    middle = own.evidence.moments(found.common.priors)[0]
    return JointFit(
        effect=entry.effects,
        parameter=parameter,
        covariance=covariance,
        moved=_moved(found),
        discrepancy=Sizes(
            frequency=middle.stiffness / float(np.sqrt(2.0)),
            damping=middle.damping if damped(own) else float("nan"),
        ),
        chi_square=entry.chi_square,
        n_residual=entry.n_residual,
        configuration=_configurations(found, labels, settings),
        course=np.array(own.course),
    )


def parameters_of(
    found: Fitted, labels: Sequence[str], settings: FitSettings
) -> tuple[tuple[FittedParameter, ...], Vector]:
    """Return the parameters of a fit, and their covariance, (n_parameter, n_parameter); see `joint_answer`."""
    own = found.own
    quantities = [*_contact(found, labels, settings), *_ratios(found, settings), *_effects(found)]
    by = np.array([q.row(own) for q in quantities]).reshape(len(quantities), own.x.size)
    covariance = by @ _covariance(own) @ by.T
    std = np.sqrt(np.diag(covariance))
    return tuple(q.fitted(own, float(s), settings) for q, s in zip(quantities, std, strict=True)), covariance


@dataclass(frozen=True, eq=False)
class _Quantity:
    """A parameter as a function of the sum of some coordinates of a fit; returns its value and its derivative."""

    name: str
    unit: str
    group: str
    at: tuple[int, ...]
    of: Callable[[float], tuple[float, float]]

    def row(self, own: Explanation) -> Vector:
        """Return the derivatives by the coordinates, (n_coordinate,)."""
        found = np.zeros(own.x.size)
        found[list(self.at)] = self.of(float(own.x[list(self.at)].sum()))[1]
        return found

    def fitted(self, own: Explanation, std: float, settings: FitSettings) -> FittedParameter:
        """Return the estimate with its interval, `std` being its standard deviation."""
        at = list(self.at)
        middle = float(own.x[at].sum())
        bearing = next(
            (own.coordinates[i] for i in at if not is_pinned(own.coordinates[i])), own.coordinates[at[0]]
        )
        value, slope = self.of(middle)
        reach = Z95 * std / abs(slope)
        alone = len([i for i in at if not is_pinned(own.coordinates[i])]) == 1
        ends = np.array([middle - reach, middle + reach])
        ends = np.clip(ends, bearing.lower, bearing.upper) if alone else ends
        lower, upper = settings.bounds.get(self.name, (self.of(bearing.lower)[0], self.of(bearing.upper)[0]))
        at_bound = bool(alone and any(own.at_bound[i] and not is_pinned(own.coordinates[i]) for i in at))
        uniform = (bearing.upper - bearing.lower) / np.sqrt(12.0)
        return FittedParameter(
            name=self.name,
            unit=self.unit,
            group=self.group,
            value=value,
            std=0.0 if at_bound else std,
            interval=(self.of(float(ends[0]))[0], self.of(float(ends[1]))[0]),
            lower=lower,
            upper=upper,
            at_bound=at_bound,
            determined=bool(not at_bound and std / abs(slope) < uniform),
        )


def _exponential(origin: float) -> Callable[[float], tuple[float, float]]:
    def of(x: float) -> tuple[float, float]:
        value = origin * float(np.exp(x))
        return value, value

    return of


def _contact(found: Fitted, labels: Sequence[str], settings: FitSettings) -> list[_Quantity]:
    """Return contact stiffness and damping of all, of each stack, or of each configuration."""
    model, stack = found.model, found.first.stack
    at = {c.name: i for i, c in enumerate(found.own.coordinates)}
    told = damped(found.own)
    origin = {"G_f": stack.contact.G_f, "d_f": stack.contact.d_f or D_F_START}
    quantities = []
    for what in CONTACT if found.first.touching else ():
        if what in settings.fixed or (what == "d_f" and not told):
            continue
        scope, of = settings.scope.get(what, "specimen"), _exponential(origin[what])
        seen = dict[str, tuple[str, ...]]()
        for c, label in enumerate(labels):
            if isinstance(model, SpecimensModel):
                s, g, here = model.place[c]
                specimen, state = model.specimens[s].name, model.groups[g].model.tested[here].assembled
                parts = [what, f"{what}[{specimen}]", f"{what}[{specimen} {state}]"]
            else:
                specimen, state = stack.name, model.tested[c].assembled
                label = state if model.tested[c].state else label  # noqa: PLW2901  # of all its force levels
                parts = [what, f"{what}[{state}]"]
            wanted = parts if scope == "configuration" else [parts[0]] if scope == "all" else parts[:2]
            if scope == "specimen" and not isinstance(model, SpecimensModel):
                wanted = parts[:1]
            group = {"all": "", "specimen": specimen, "configuration": label}[scope]
            seen.setdefault(group, tuple(n for n in wanted if n in at))
        quantities += [
            _Quantity(what, UNITS[what], group, tuple(at[n] for n in names), of)
            for group, names in seen.items()
        ]
    return quantities


def _ratios(found: Fitted, settings: FitSettings) -> list[_Quantity]:
    """Return the ratios to what stack files say of which anything is said."""
    at = {c.name: i for i, c in enumerate(found.own.coordinates)}
    quantities = []
    for name in RATIOS:
        named = name in settings.free or any(
            name in given for given in (settings.priors, settings.bounds, settings.scope)
        )
        if not named or name in settings.fixed or name not in at:
            continue
        of = _exponential(settings.priors.get(name, (1.0, 0.0))[0])
        if settings.scope.get(name) == "specimen" and isinstance(found.model, SpecimensModel):
            quantities += [
                _Quantity(name, "1", own.name, (at[name], at[f"{name}[{own.name}]"]), of)
                for own in found.model.specimens
            ]
        else:
            quantities.append(_Quantity(name, "1", "", (at[name],), of))
    return quantities


def _effects(found: Fitted) -> list[_Quantity]:
    """Return the parameters of effects, of all or of single stacks."""
    quantities = []
    for i, c in enumerate(found.own.coordinates):
        if i < found.own.n_nuisance or is_pinned(c):
            continue
        name, _, group = c.name.partition("@")
        p = found.model.parameters[name]
        quantities.append(_Quantity(name, p.unit, group, (i,), lambda x, p=p: scaled(p, x)))  # type: ignore[misc]
    return quantities


def _covariance(own: Explanation) -> Vector:
    """Return the covariance of the coordinates, (n_coordinate, n_coordinate).

    Correlations are those at the likeliest size of the discrepancy, standard deviations those over all its sizes.
    """
    precision = np.array([c.std**-2.0 for c in own.coordinates]) + 1e-12
    weighed = own.problem.weighed(own.evidence.sizes)
    inverse = scaled_inverse(weighed.hessian + own.problem.curvature + np.diag(precision))
    std = np.sqrt(np.maximum(np.diag(inverse), 1e-300))
    return np.asarray(inverse / np.outer(std, std) * np.outer(own.std, own.std))


def _moved(found: Fitted) -> tuple[Moved, ...]:
    """Return every quantity that all configurations share, as stated and as fitted; none of what is fixed."""
    own = found.own
    shared = [
        i
        for i, c in enumerate(own.coordinates[: own.n_nuisance])
        if not is_pinned(c) and ("[" not in c.name or c.name.startswith("gain"))
    ]
    part = replace(
        own,
        coordinates=tuple(own.coordinates[i] for i in shared),
        x=own.x[shared],
        std=own.std[shared],
        n_nuisance=len(shared),
    )
    return moved(found.first.stack, part)


def _configurations(
    found: Fitted, labels: Sequence[str], settings: FitSettings
) -> tuple[ConfigurationFit, ...]:
    """Return each configuration beside the model, as it was stated and as it was fitted."""
    own, whole = found.own, found.whole or found.model
    stated = np.zeros(own.n_nuisance)
    nuisances = own.coordinates[: own.n_nuisance]
    before = _beside(whole, nuisances, stated)[1]
    local, after = _beside(whole, own.coordinates, own.x)
    made, others = [], _left_out(found)
    for c, (label, kept) in enumerate(zip(labels, found.kept, strict=True)):
        state, errors = whole.states[c], after[c]
        if found.whole is None:
            errors = own.errors[c]
        frequency = state.frequency * np.exp(-_told(errors, paired=found.paired))
        damping = state.damping * np.exp(-errors.damping)
        if found.whole is not None:  # what was fitted is told as it was fitted
            frequency[kept] = state.frequency[kept] * np.exp(-_told(own.errors[c], paired=found.paired))
            damping[kept] = state.damping[kept] * np.exp(-own.errors[c].damping)
        predicted = np.full(kept.size, np.nan)
        predicted[kept] = state.frequency[kept] * np.exp(-others.errors["frequency"][others.state == c])
        measured = _measured_damping(whole, c) if settings.damping else np.full(kept.size, np.nan)
        likeness = np.full(kept.size, np.nan)
        if not (found.classed and found.classed[c]):
            modal = local.modal(own.x, c)
            row, column = errors.partners
            likeness[row] = mac(state.shape, modal.rows)[row, column]
        made.append(
            ConfigurationFit(
                name=label,
                used=kept,
                measured_frequency=state.frequency,
                measured_damping=measured,
                frequency=frequency,
                damping=damping,
                frequency_left_out=predicted,
                frequency_before=state.frequency * np.exp(-_told(before[c], paired=found.paired)),
                damping_before=state.damping * np.exp(-before[c].damping),
                mac=likeness,
            )
        )
    return tuple(made)


def configurations_left_out(model: SpecimensModel, own: Explanation) -> LeftOut:
    """Return errors where configurations are left out; the contact of a stack with one is fitted to it."""
    alone, state = left_out(own, "specimen"), left_out(own, "state")
    single = [c for states in model.states_of if len(states) == 1 for c in states]
    here = np.isin(state.state, single)
    kinds: tuple[Kind, ...] = ("frequency", "damping")
    return replace(state, errors={k: np.where(here, alone.errors[k], state.errors[k]) for k in kinds})


def _left_out(found: Fitted) -> LeftOut:
    if isinstance(found.model, SpecimensModel):
        return configurations_left_out(found.model, found.own)
    return left_out(found.own, "state")


def _beside(
    model: StackModel | SpecimensModel, coordinates: Sequence[Coordinate], x: Vector
) -> tuple[LocalModel, tuple[Errors, ...]]:
    """Return the model near coordinates, and the errors of all configurations there."""
    local = model.about(coordinates, [x])
    return local, errors_at(model, local, setting(model, local, x, shares=(1.0, 0.0, 0.0)), x)


def _told(errors: Errors, *, paired: bool) -> Vector:
    return errors.paired if paired else errors.frequency


def _measured_damping(model: StackModel | SpecimensModel, c: int) -> Vector:
    """Return the damping ratios of a configuration; NaN of those that were not measured."""
    if isinstance(model, SpecimensModel):
        _, g, here = model.place[c]
        modes = model.groups[g].model.tested[here].modes
    else:
        modes = model.tested[c].modes
    return np.where(modes.damping_std < modes.damping, modes.damping, np.nan)
