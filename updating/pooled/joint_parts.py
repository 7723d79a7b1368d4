"""Parts of the answer of a joint fit: parameters, each specimen's contact, and each configuration beside the model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la

from ema.modal.mac import mac
from lamella_shared import Booleans, Reals
from updating.diagnosis.answer import Moved, Pulled, Sizes
from updating.diagnosis.evidence import D_F_START
from updating.diagnosis.explained_model import ConfigurationFit, FittedParameter, JointFit
from updating.diagnosis.fit_settings import CONTACT, RATIOS, FitSettings, is_pinned, scaled
from updating.diagnosis.moved import moved
from updating.diagnosis.stack_model import StackModel
from updating.fitting.fit import ParameterEstimate
from updating.inference.algebra import scaled_inverse
from updating.inference.equation_error import Errors
from updating.inference.explain import Explanation, Setting, errors_at, setting
from updating.inference.left_out import Kind, LeftOut, left_out
from updating.inference.levels import PULLED
from updating.inference.protocol import Coordinate, LocalModel
from updating.inference.tree import TreeProblem
from updating.pooled.screening import Bordered
from updating.pooled.specimens_model import SpecimensModel
from updating.results.ledger import Entry
from updating.results.pooled import ContactState, Contrast, ModeAnswer
from updating.results.text import Z95

UNITS = {"G_f": "Pa/Pa", "d_f": "s/Pa"}
"""Contact parameters, and their units."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Fitted:
    """A fit, with the model that it is of.

    Attributes
    ----------
    model : StackModel or SpecimensModel
        With the modes that take part.
    whole : StackModel, SpecimensModel or None
        With those that are held out as well; none where there are none.
    fit : Explanation
        The fit.
    common : Setting
        What it shares with others.
    kept : tuple of (n_mode,) bool
        Modes that take part, by configuration.
    paired : bool
        Whether errors of frequencies are those of paired modes; else each measured mode stands beside the mixture of
        the model's modes that it resembles.
    classed : tuple of bool
        Whether the shapes of a configuration stand for classes; of none by default.
    """

    model: StackModel | SpecimensModel
    whole: StackModel | SpecimensModel | None
    fit: Explanation
    common: Setting
    kept: tuple[Booleans, ...]
    paired: bool
    classed: tuple[bool, ...] = ()

    @property
    def first(self) -> StackModel:
        """The model of a stack, or of the first of them."""
        return self.model.first if isinstance(self.model, SpecimensModel) else self.model


def damped(fit: Explanation) -> bool:
    """Return whether any damping ratio took part in a fit."""
    measured = 4.0  # variance of the logarithm of a damping ratio, above which it does not take part
    return bool(np.any(np.diag(fit.problem.damping_noise) < measured))


def joint_answer(fitted: Fitted, labels: Sequence[str], entry: Entry, settings: FitSettings) -> JointFit:
    """Return what a fit says.

    Parameters
    ----------
    fitted : Fitted
        The fit.
    labels : sequence of str
        What configurations are called.
    entry : Entry
        Its line of the ledger.
    settings : FitSettings
        What was known of its parameters.
    """
    fit = fitted.fit
    parameter, covariance = parameters_of(fitted, labels, settings)
    middle = fit.evidence.moments(fitted.common.priors)[0]
    return JointFit(
        effect=entry.effects,
        parameter=parameter,
        covariance=covariance,
        moved=_moved(fitted),
        discrepancy=Sizes(
            frequency=middle.stiffness / float(np.sqrt(2.0)), damping=middle.damping if damped(fit) else float("nan")
        ),
        chi_square=entry.chi_square,
        n_residual=entry.n_residual,
        configuration=_configurations(fitted, labels, settings),
        course=np.array(fit.course),
    )


def parameters_of(
    fitted: Fitted, labels: Sequence[str], settings: FitSettings
) -> tuple[tuple[FittedParameter, ...], Reals]:
    """Return the parameters of a fit, and their covariance, (n_parameter, n_parameter); see `joint_answer`."""
    fit = fitted.fit
    quantities = [*_contact(fitted, labels, settings), *_ratios(fitted, settings), *_effects(fitted)]
    by = np.array([q.row(fit) for q in quantities]).reshape(len(quantities), fit.x.size)
    covariance = by @ _covariance(fit) @ by.T
    std = np.sqrt(np.diag(covariance))
    return tuple(q.fitted(fit, float(s), settings) for q, s in zip(quantities, std, strict=True)), covariance


@dataclass(frozen=True, eq=False)
class _Quantity:
    """A parameter as a function of the sum of some coordinates of a fit; returns its value and its derivative."""

    name: str
    unit: str
    group: str
    at: tuple[int, ...]
    of: Callable[[float], tuple[float, float]]

    def row(self, fit: Explanation) -> Reals:
        """Return the derivatives by the coordinates, (n_coordinate,)."""
        derivative = np.zeros(fit.x.size)
        derivative[list(self.at)] = self.of(float(fit.x[list(self.at)].sum()))[1]
        return derivative

    def fitted(self, fit: Explanation, std: float, settings: FitSettings) -> FittedParameter:
        """Return the estimate with its interval, `std` being its standard deviation."""
        at = list(self.at)
        middle = float(fit.x[at].sum())
        bearing = next((fit.coordinates[i] for i in at if not is_pinned(fit.coordinates[i])), fit.coordinates[at[0]])
        value, slope = self.of(middle)
        reach = Z95 * std / abs(slope)
        alone = len([i for i in at if not is_pinned(fit.coordinates[i])]) == 1
        ends = np.array([middle - reach, middle + reach])
        ends = np.clip(ends, bearing.lower, bearing.upper) if alone else ends
        lower, upper = settings.bounds.get(self.name, (self.of(bearing.lower)[0], self.of(bearing.upper)[0]))
        at_bound = bool(alone and any(fit.at_bound[i] and not is_pinned(fit.coordinates[i]) for i in at))
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


def _contact(fitted: Fitted, labels: Sequence[str], settings: FitSettings) -> list[_Quantity]:
    """Return contact stiffness and damping of all, of each stack, or of each configuration."""
    model, stack = fitted.model, fitted.first.stack
    at = {c.name: i for i, c in enumerate(fitted.fit.coordinates)}
    has_damping = damped(fitted.fit)
    origin = {"G_f": stack.contact.G_f, "d_f": stack.contact.d_f or D_F_START}
    quantities = []
    for what in CONTACT if fitted.first.touching else ():
        if what in settings.fixed or (what == "d_f" and not has_damping):
            continue
        scope, of = settings.scope.get(what, "specimen"), _exponential(origin[what])
        seen = dict[str, tuple[str, ...]]()
        for c, label in enumerate(labels):
            if isinstance(model, SpecimensModel):
                s, g, here = model.indices[c]
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
            _Quantity(what, UNITS[what], group, tuple(at[n] for n in names), of) for group, names in seen.items()
        ]
    return quantities


def _ratios(fitted: Fitted, settings: FitSettings) -> list[_Quantity]:
    """Return the ratios to what stack files say of which anything is said."""
    at = {c.name: i for i, c in enumerate(fitted.fit.coordinates)}
    quantities = []
    for name in RATIOS:
        named = name in settings.free or any(
            name in given for given in (settings.priors, settings.bounds, settings.scope)
        )
        if not named or name in settings.fixed or name not in at:
            continue
        of = _exponential(settings.priors.get(name, (1.0, 0.0))[0])
        if settings.scope.get(name) == "specimen" and isinstance(fitted.model, SpecimensModel):
            quantities += [
                _Quantity(name, "1", specimen.name, (at[name], at[f"{name}[{specimen.name}]"]), of)
                for specimen in fitted.model.specimens
            ]
        else:
            quantities.append(_Quantity(name, "1", "", (at[name],), of))
    return quantities


def _effects(fitted: Fitted) -> list[_Quantity]:
    """Return the parameters of effects, of all or of single stacks."""
    quantities = []
    for i, c in enumerate(fitted.fit.coordinates):
        if i < fitted.fit.n_nuisance or is_pinned(c):
            continue
        name, _, group = c.name.partition("@")
        p = fitted.model.parameters[name]
        quantities.append(_Quantity(name, p.unit, group, (i,), lambda x, p=p: scaled(p, x)))  # type: ignore[misc]
    return quantities


def _at_likeliest(fit: Explanation) -> Reals:
    """Return the covariance of the coordinates at the likeliest size of the discrepancy."""
    precision = np.array([c.std**-2.0 for c in fit.coordinates]) + 1e-12
    weighed = fit.problem.weighed(fit.evidence.sizes)
    return scaled_inverse(weighed.hessian + fit.problem.curvature + np.diag(precision))


def _covariance(fit: Explanation) -> Reals:
    """Return the covariance of the coordinates, (n_coordinate, n_coordinate).

    Correlations are those at the likeliest size of the discrepancy, standard deviations those over all its sizes.
    """
    inverse = _at_likeliest(fit)
    std = np.sqrt(np.maximum(np.diag(inverse), 1e-300))
    return np.asarray(inverse / np.outer(std, std) * np.outer(fit.std, fit.std))


def _moved(fitted: Fitted) -> tuple[Moved, ...]:
    """Return every quantity that all configurations share, as stated and as fitted; none of what is fixed."""
    fit = fitted.fit
    shared = [
        i
        for i, c in enumerate(fit.coordinates[: fit.n_nuisance])
        if not is_pinned(c) and ("[" not in c.name or c.name.startswith("gain"))
    ]
    part = replace(
        fit,
        coordinates=tuple(fit.coordinates[i] for i in shared),
        x=fit.x[shared],
        std=fit.std[shared],
        n_nuisance=len(shared),
    )
    return moved(fitted.first.stack, part)


def _configurations(fitted: Fitted, labels: Sequence[str], settings: FitSettings) -> tuple[ConfigurationFit, ...]:
    """Return each configuration beside the model, as it was stated and as it was fitted."""
    fit, whole = fitted.fit, fitted.whole or fitted.model
    stated = np.zeros(fit.n_nuisance)
    nuisances = fit.coordinates[: fit.n_nuisance]
    before = _beside(whole, nuisances, stated)[1]
    local, after = _beside(whole, fit.coordinates, fit.x)
    made, predicted = [], _left_out(fitted)
    for c, (label, kept) in enumerate(zip(labels, fitted.kept, strict=True)):
        state, errors = whole.states[c], after[c]
        if fitted.whole is None:
            errors = fit.errors[c]
        frequency = state.frequency * np.exp(-_frequency_errors(errors, paired=fitted.paired))
        damping = state.damping * np.exp(-errors.damping)
        if fitted.whole is not None:  # modes that were fitted keep the errors of the fit
            frequency[kept] = state.frequency[kept] * np.exp(-_frequency_errors(fit.errors[c], paired=fitted.paired))
            damping[kept] = state.damping[kept] * np.exp(-fit.errors[c].damping)
        left_out_frequency = np.full(kept.size, np.nan)
        left_out_frequency[kept] = state.frequency[kept] * np.exp(-predicted.errors["frequency"][predicted.state == c])
        measured = _measured_damping(whole, c) if settings.damping else np.full(kept.size, np.nan)
        likeness = np.full(kept.size, np.nan)
        if not (fitted.classed and fitted.classed[c]):
            modal = local.modal(fit.x, c)
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
                frequency_left_out=left_out_frequency,
                frequency_before=state.frequency * np.exp(-_frequency_errors(before[c], paired=fitted.paired)),
                damping_before=state.damping * np.exp(-before[c].damping),
                mac=likeness,
            )
        )
    return tuple(made)


def configurations_left_out(model: SpecimensModel, fit: Explanation) -> LeftOut:
    """Return errors where configurations are left out; the contact of a stack with one is fitted to it."""
    alone, state = left_out(fit, "specimen"), left_out(fit, "state")
    single = [c for states in model.states_of if len(states) == 1 for c in states]
    here = np.isin(state.state, single)
    kinds: tuple[Kind, ...] = ("frequency", "damping")
    return replace(state, errors={k: np.where(here, alone.errors[k], state.errors[k]) for k in kinds})


def _left_out(fitted: Fitted) -> LeftOut:
    if isinstance(fitted.model, SpecimensModel):
        return configurations_left_out(fitted.model, fitted.fit)
    return left_out(fitted.fit, "state")


def _beside(
    model: StackModel | SpecimensModel, coordinates: Sequence[Coordinate], x: Reals
) -> tuple[LocalModel, tuple[Errors, ...]]:
    """Return the model near coordinates, and the errors of all configurations there."""
    local = model.about(coordinates, [x])
    return local, errors_at(model, local, setting(model, local, x, shares=(1.0, 0.0, 0.0)), x)


def _frequency_errors(errors: Errors, *, paired: bool) -> Reals:
    return errors.paired if paired else errors.frequency


def _measured_damping(model: StackModel | SpecimensModel, c: int) -> Reals:
    """Return the damping ratios of a configuration; NaN of those that were not measured."""
    if isinstance(model, SpecimensModel):
        _, g, here = model.indices[c]
        modes = model.groups[g].model.tested[here].modes
    else:
        modes = model.tested[c].modes
    return np.where(modes.damping_std < modes.damping, modes.damping, np.nan)


_VAGUE = 2.0
"""Prior standard deviation of the logarithm of a parameter at a torque about that of its specimen: so wide that data
decide, and finite where there are none, such as no damping ratio."""
_UNDETERMINED = 0.5  # of that, from which on data determine nothing


class Contacts:
    """Contact of specimens and states as an explanation has it.

    Parameters
    ----------
    model : SpecimensModel
        The model.
    fit : Explanation
        The explanation.
    """

    def __init__(self, model: SpecimensModel, fit: Explanation) -> None:
        assert isinstance(fit.problem, TreeProblem)
        self.model, self.fit, self.problem = model, fit, fit.problem
        self.covariance = _at_likeliest(fit)
        self.names = [c.name for c in fit.coordinates]
        contact = model.first.stack.contact
        self.nominal = {"G_f": contact.G_f, "d_f": contact.d_f or D_F_START}

    def _parts(self, what: str, s: int) -> list[int]:
        """Return the coordinates that make a contact parameter of a specimen."""
        scopes = [self.model.scope(name) for name in self.names]
        return [i for i, scope in enumerate(scopes) if scope.local == what and s in scope.members]

    def of_specimen(self, s: int) -> tuple[ParameterEstimate | None, ParameterEstimate | None]:
        """Return G_f and d_f of a specimen, None where no torque determines it."""
        estimates = []
        for what in UNITS:
            at = self._parts(what, s)
            std = float(np.sqrt(max(self.covariance[np.ix_(at, at)].sum(), 0.0)))
            log = float(self.fit.x[at].sum())
            determined = any(self._alone(c)[1][what] < _UNDETERMINED * _VAGUE for c in self.model.states_of[s])
            estimates.append(self._estimate(what, log, std) if at and determined else None)
        return estimates[0], estimates[1]

    def of_state(self, c: int) -> ContactState:
        """Return contact by the frequencies and damping ratios of one state alone, all else as in the fit."""
        _, g, here = self.model.indices[c]
        logs, stds = self._alone(c)
        tested = self.model.groups[g].model.tested[here]
        estimates = {
            what: None if stds[what] > _UNDETERMINED * _VAGUE else self._estimate(what, logs[what], stds[what])
            for what in UNITS
        }
        return ContactState(name=tested.assembled, pressure=tested.pressure, **estimates)

    def _alone(self, c: int) -> tuple[dict[str, float], dict[str, float]]:
        """Return logarithms of contact parameters by one state, and their standard deviations.

        One step of least squares from where the explanation stands.
        """
        s, g, here = self.model.indices[c]
        assembled = self.model.groups[g].model.tested[here].assembled
        size, leaf = self.fit.evidence.sizes, self.problem.leaves[c]
        k = leaf.touched.size
        product = leaf.information(size.stiffness)[0][: 1 + k, : 1 + k]
        damped = self.problem.of_damping(size.damping, self.problem.damping_at == c)
        logs, where = dict[str, float](), list[int]()
        for what in UNITS:
            parts = self._parts(what, s)
            state = f"{what}[{self.model.specimens[s].name} {assembled}]"
            logs[what] = float(self.fit.x[parts].sum())
            if state in self.names:
                logs[what] += float(self.fit.x[self.names.index(state)])
            if parts:
                where.append(parts[0])
        if not where:
            return logs, dict.fromkeys(UNITS, np.inf)
        local = [1 + int(np.searchsorted(leaf.touched, i)) for i in where]
        hessian = product[np.ix_(local, local)] + damped.hessian[np.ix_(where, where)]
        hessian += _VAGUE**-2.0 * np.eye(len(where))
        step = -la.solve(hessian, product[local, 0] + damped.slope[where], assume_a="pos")
        std = np.sqrt(np.diag(la.inv(hessian)))
        return (
            {what: logs[what] + float(d) for what, d in zip(UNITS, step, strict=True)},
            dict(zip(UNITS, std.tolist(), strict=True)),
        )

    def _estimate(self, what: str, log: float, std: float) -> ParameterEstimate:
        value, lower, upper = (self.nominal[what] * np.exp(log + Z95 * std * np.array([0.0, -1.0, 1.0]))).tolist()
        return ParameterEstimate(name=what, unit=UNITS[what], value=value, lower=lower, upper=upper, at_bound=False)


def contrasts_of(model: SpecimensModel, fit: Explanation) -> list[Contrast]:
    """Return the ratios of contact parameters of groups to those of the others, without priors on them."""
    ratio_undetermined = np.log(100.0)  # half of an interval of a ratio's logarithm, beyond which nothing is said of it
    if not model.first.touching:
        return []
    assert isinstance(fit.problem, TreeProblem)
    names = [c.name for c in fit.coordinates]
    contrasts = []
    for level in (level for level in model.levels if level.kind == "group"):
        for what, label in CONTACT.items():
            # a term that is there already gives way to what is returned
            term = [i for i, n in enumerate(names) if n == f"{what}@{level.of}"]
            precision = np.array([c.std**-2.0 for c in fit.coordinates])
            precision[term] = 1e8
            bordered = Bordered(model, fit.problem, fit.evidence.sizes, fit.x, precision)
            value, std = bordered.free(level.members, names.index(what))
            log = value + float(fit.x[term].sum())
            if Z95 * std > ratio_undetermined:
                continue
            ratio, lower, upper = np.exp(log + Z95 * std * np.array([0.0, -1.0, 1.0])).tolist()
            contrasts.append(
                Contrast(group=level.of, parameter=what, label=label, ratio=ratio, lower=lower, upper=upper)
            )
    return contrasts


def mode_answers(
    model: SpecimensModel, base: Explanation, fit: Explanation, states: Sequence[int]
) -> tuple[ModeAnswer, ...]:
    """Return the measured modes of some states beside those of two explanations."""
    answers: list[ModeAnswer] = []
    for c in states:
        _, g, here = model.indices[c]
        tested, modes = model.groups[g].model.tested[here], model.states[c]
        before, after = base.errors[c], fit.errors[c]
        for r in range(modes.frequency.size):
            f, zeta = float(modes.frequency[r]), float(tested.modes.damping[r])
            measured = tested.modes.damping_std[r] < zeta
            answers.append(
                ModeAnswer(
                    configuration=tested.assembled,
                    frequency=f,
                    damping=zeta if measured else float("nan"),
                    base_frequency=float(f * np.exp(-before.frequency[r])),
                    model_frequency=float(f * np.exp(-after.frequency[r])),
                    base_damping=float(zeta * np.exp(-before.damping[r])),
                    model_damping=float(zeta * np.exp(-after.damping[r])),
                )
            )
    return tuple(answers)


def far_off(model: SpecimensModel, fit: Explanation) -> tuple[Pulled, ...]:
    """Return the nuisances whose mean over all specimens is far from what is known of it."""
    scopes = [model.scope(c.name) for c in fit.coordinates[: fit.n_nuisance]]
    pulled, n = [], len(model.specimens)
    for name, c in model.local.items():
        if "[" in name or not np.isfinite(c.std):
            continue
        at = [i for i, scope in enumerate(scopes) if scope.local == name]
        share = [len(scopes[i].members) / n for i in at]
        prior = float(np.sqrt(sum((p * fit.coordinates[i].std) ** 2 for p, i in zip(share, at, strict=True))))
        value = float(sum(p * fit.x[i] for p, i in zip(share, at, strict=True)))
        if abs(value) > PULLED * prior:
            pulled.append(Pulled(name=name, value=value, std=prior))
    return tuple(pulled)
