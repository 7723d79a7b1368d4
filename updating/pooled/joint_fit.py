"""Several configurations fitted at once, as a user asks for it: effects, shared parameters and priors.

Of one stack it is the fit of a diagnosis, of several that of a campaign of specimens, with the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from ema.types.arrays import single_threaded
from lamella_shared import Booleans
from model import Effect, catalogue
from updating.diagnosis.answer import Ranked
from updating.diagnosis.candidates import CandidateModel, candidate_model
from updating.diagnosis.diagnosis import beside_model, priors_of, searched
from updating.diagnosis.evidence import Tested, some_of
from updating.diagnosis.explained_model import Updated
from updating.diagnosis.fit_settings import FitSettings, coordinate_of, is_pinned, scaled
from updating.diagnosis.moved import pulled_text
from updating.diagnosis.ranking import mean_error, rank
from updating.diagnosis.slipping import AtLevel
from updating.diagnosis.stack_model import StackModel
from updating.errors import FitError
from updating.inference.decide import decide
from updating.inference.discrepancy import Sizes
from updating.inference.explain import Explanation, Setting, coordinates_of, explain
from updating.inference.left_out import Kind, LeftOut, left_out
from updating.pooled.diagnosis import estimate_of, specimens_model
from updating.pooled.joint_parts import Fitted, configurations_left_out, damped, far_off, joint_answer
from updating.pooled.search import begin, fit_terms
from updating.pooled.specimen import Group, Specimen
from updating.pooled.specimens_model import SpecimensModel
from updating.results.ledger import Entry


@single_threaded
def joint_fit(
    name: str,
    specimens: Sequence[Specimen],
    effects: Mapping[str, Effect],
    settings: FitSettings | None = None,
    *,
    labels: Sequence[str] | None = None,
    known: Mapping[str, Effect] | None = None,
    levels: Mapping[str, AtLevel] | None = None,
    executor: Executor | None = None,
    reduced: Callable[..., CandidateModel] = candidate_model,
) -> Updated:
    """Fit effects to several configurations of one stack or more: the base model, each effect alone, and all together.

    Parameters
    ----------
    name : str
        Its title.
    specimens : sequence of Specimen
        The stacks with what was identified.
    effects : mapping of str to Effect
        Those that are fitted; none fits the base model alone.
    settings : FitSettings, optional
        What is known of parameters beforehand, who shares them, and which modes are held out.
    labels : sequence of str, optional
        What configurations are called, stack by stack; by default by their names, after those of the stacks where
        names repeat.
    known : mapping of str to Effect, optional
        What else one stack may lack, beside which effects are judged as a diagnosis does it; the catalogue by default.
    levels : mapping of str to AtLevel, optional
        Which force level each configuration of one stack is, as `diagnose` takes it.
    executor, reduced
        As `diagnose` takes them.

    Raises
    ------
    FitError
        The settings name what is not there, no measured mode of a configuration resembles one of the model, or a stack
        cannot have an effect.
    PairingError
        Measured points do not lie on a stack, or are fewer than the modes.
    """
    settings = settings or FitSettings()
    if not specimens:
        raise FitError("nothing to fit: no configuration was identified")
    labels = tuple(labels or _labels(specimens))
    n_mode = [modes.frequency.size for specimen in specimens for _, _, modes in specimen.tested]
    settings.require(effects, dict(zip(labels, n_mode, strict=True)))
    moved = [replace(specimen, stack=settings.stack(specimen.stack)) for specimen in specimens]
    kept = [
        ~np.isin(np.arange(n), list(settings.hold_out.get(label, ()))) for label, n in zip(labels, n_mode, strict=True)
    ]
    request = FitRequest(tuple(effects), dict(effects), settings, tuple(kept))
    if len(moved) == 1:
        others = catalogue() if known is None else known
        fitted, ledger = _of_one(moved[0], request, others, levels, executor, reduced)
    else:
        fitted, ledger = _of_several(moved, request, executor, reduced)
    if not damped(fitted.fit):
        nan = float("nan")
        ledger = tuple(
            replace(entry, damping_error=nan, mode_damping_error=nan, configuration_damping_error=nan)
            for entry in ledger
        )
    return Updated(name=name, fit=joint_answer(fitted, labels, ledger[-1], settings), ledger=ledger)


@dataclass(frozen=True, eq=False)
class FitRequest:
    """What a user asks for: effects by name, settings, and which modes of each configuration take part."""

    names: tuple[str, ...]
    effects: dict[str, Effect]
    settings: FitSettings
    kept: tuple[Booleans, ...]

    @property
    def combinations(self) -> list[tuple[str, ...]]:
        """None of the effects, each alone, and all together."""
        alone = [(), *((name,) for name in self.names)]
        return [*alone, self.names] if len(self.names) > 1 else alone

    @property
    def held(self) -> bool:
        """Whether modes are held out."""
        return not all(mask.all() for mask in self.kept)

    def of(self, tested: Sequence[Tested]) -> tuple[Tested, ...]:
        """Return configurations with what of them takes part."""
        if not self.held and self.settings.damping:
            return tuple(tested)
        return tuple(
            replace(test, modes=some_of(test.modes, kept, damping=self.settings.damping))
            for test, kept in zip(tested, self.kept, strict=True)
        )


def _labels(specimens: Sequence[Specimen]) -> list[str]:
    names = [name for specimen in specimens for name, _, _ in specimen.tested]
    if len(set(names)) == len(names):
        return names
    return [f"{specimen.name}/{name}" for specimen in specimens for name, _, _ in specimen.tested]


def _of_one(
    specimen: Specimen,
    request: FitRequest,
    known: Mapping[str, Effect],
    levels: Mapping[str, AtLevel] | None,
    executor: Executor | None,
    reduced: Callable[..., CandidateModel],
) -> tuple[Fitted, tuple[Entry, ...]]:
    """Fit one stack as a diagnosis does it; settings of effects' parameters apply once these were found."""
    settings = request.settings
    candidates, evidence, _ = beside_model(
        specimen.stack,
        specimen.tested,
        {**known, **request.effects},
        scatter=settings.scatter,
        executor=executor,
        reduced=reduced,
        levels=levels,
    )
    _require_possible(request.names, evidence.impossible)
    used = replace(evidence, tested=request.of(evidence.tested))
    model, search, _ = searched(candidates, used, request.combinations, settings.of_base)
    decision = decide(search)
    first = decision.left[0] if decision.left else search.base
    if settings.tells(request.effects):
        informed = model.with_effects(settings.effects(request.effects), settings)
        fitted = {
            fit.terms: refit(model, informed, fit, search.setting, settings)
            for fit in (search.fitted[frozenset(names)] for names in request.combinations)
        }
        model, search = informed, replace(search, fitted={frozenset(n): fit for n, fit in fitted.items()})
    ranking = {row.effects: row for row in rank(model, search, first, tuple(search.fitted.values()))}
    ranked = [next(row for e, row in ranking.items() if set(e) == set(names)) for names in request.combinations]
    whole = StackModel(
        candidates,
        evidence.tested,
        evidence.observation,
        evidence.scatter,
        model.effects,
        start=evidence.start["G_f"],
        like=model,
        settings=model.settings,
    )
    fits = Fitted(
        model=model,
        whole=whole if request.held else None,
        fit=search.fitted[frozenset(request.names)],
        common=search.setting,
        kept=request.kept,
        paired=True,
    )
    return fits, tuple(map(entry_of, ranked))


def _of_several(
    specimens: Sequence[Specimen],
    request: FitRequest,
    executor: Executor | None,
    reduced: Callable[..., CandidateModel],
) -> tuple[Fitted, tuple[Entry, ...]]:
    """Fit several stacks as a campaign of specimens, each effect with one value for the rig or one for each stack."""
    fits = fit_several(specimens, request, request.combinations, executor=executor, reduced=reduced)
    sizes = fits[-1].fit.evidence.sizes
    return fits[-1], tuple(
        entry_of_several(names, fit, sizes) for names, fit in zip(request.combinations, fits, strict=True)
    )


def fit_several(
    specimens: Sequence[Specimen],
    request: FitRequest,
    combinations: Sequence[Sequence[str]],
    *,
    executor: Executor | None = None,
    reduced: Callable[..., CandidateModel] = candidate_model,
) -> list[Fitted]:
    """Fit some of the effects together to several stacks, each combination of them.

    Parameters
    ----------
    specimens : sequence of Specimen
        Two stacks or more.
    request : FitRequest
        What is fitted.
    combinations : sequence of sequence of str
        Names of effects that are fitted together.
    executor, reduced
        As in `joint_fit`.

    Raises
    ------
    FitError
        No measured mode of a configuration resembles one of the model, or a stack cannot have an effect.
    """
    settings = request.settings
    whole, impossible = specimens_model(
        specimens,
        request.effects,
        scatter=settings.scatter,
        executor=executor,
        reduced=reduced,
        settings=settings.of_base,
    )
    _require_possible(request.names, impossible)
    base_fit = begin(_with_modes(whole, request), priors_of(settings.scatter))
    fits = []
    for names in combinations:
        terms = [
            term
            for n in names
            for term in ([f"{n}@{s.name}" for s in specimens] if settings.apart(request.effects[n]) else [n])
        ]
        pooled = fit_terms(base_fit, terms)
        model, fit = pooled.model, pooled.search.chosen
        if settings.tells({n: request.effects[n] for n in names}):
            informed = _with_effects(model, settings.effects(request.effects), settings)
            fit, model = refit(model, informed, fit, pooled.search.setting, settings), informed
        fits.append(
            Fitted(
                model=model,
                whole=_with_effects(whole, model.first.effects, model.first.settings) if request.held else None,
                fit=fit,
                common=pooled.search.setting,
                kept=request.kept,
                paired=False,
                classed=tuple(specimen.classed for specimen in specimens for _ in specimen.tested),
            )
        )
    return fits


def _require_possible(names: Sequence[str], impossible: Mapping[str, str]) -> None:
    why = [impossible[name] for name in names if name in impossible]
    if why:
        raise FitError("; ".join(why))


def _with_modes(model: SpecimensModel, request: FitRequest) -> SpecimensModel:
    """Return the model of specimens with the modes that take part."""
    if not request.held and request.settings.damping:
        return model
    groups = []
    for g, group in enumerate(model.groups):
        kept = {c: request.kept[i] for i, (_, index, c) in enumerate(model.indices) if index == g}
        part = FitRequest(request.names, request.effects, request.settings, tuple(kept[c] for c in range(len(kept))))
        groups.append(replace(group, model=group.model.of_tests(part.of(group.model.tested), group.model.observation)))
    return model.with_groups(groups)


def _with_effects(model: SpecimensModel, effects: Mapping[str, Effect], settings: FitSettings) -> SpecimensModel:
    """Return the model of specimens with effects whose parameters have settings."""
    groups: list[Group] = [replace(group, model=group.model.with_effects(effects, settings)) for group in model.groups]
    return model.with_groups(groups)


def refit(
    model: StackModel | SpecimensModel,
    informed: StackModel | SpecimensModel,
    fit: Explanation,
    common: Setting,
    settings: FitSettings,
) -> Explanation:
    """Fit an explanation again, with the settings of its effects' parameters.

    Parameters
    ----------
    model, informed
        The model without and with these settings.
    fit : Explanation
        The fit without.
    common : Setting
        What fits share.
    settings : FitSettings
        What is known of the parameters.
    """
    if not fit.terms:
        return fit
    terms = [informed.terms[name] for name in fit.terms]
    coordinates = coordinates_of(informed, terms)
    have = {c.name: float(x) for c, x in zip(fit.coordinates, fit.x, strict=True)}
    starts = [np.array([have[c.name] for c in coordinates])]
    for i, c in enumerate(coordinates[fit.n_nuisance :], fit.n_nuisance):
        local = c.name.partition("@")[0]
        value = scaled(model.parameters[local], have[c.name])[0]
        p = informed.parameters[local]
        starts[0][i] = coordinate_of(p, float(np.clip(value, p.lower, p.upper)))
    if settings.start:
        begins = [c.name.partition("@")[0] in settings.start for c in coordinates]
        starts.append(np.where(begins, [c.starts[0] for c in coordinates], starts[0]))
    common = replace(common, apart=fit.apart)
    fits = [explain(informed, terms, common, x, sizes=fit.evidence.sizes) for x in starts]
    return max(fits, key=lambda fit: fit.log_evidence)


def entry_of(ranked: Ranked) -> Entry:
    """Return the line of the ledger of an explanation of one stack."""
    return Entry(
        effects=ranked.effects,
        error=ranked.frequency_error,
        mode_error=ranked.left_out_error,
        configuration_error=ranked.left_out_configuration_error,
        damping_error=ranked.damping_error,
        mode_damping_error=ranked.left_out_damping_error,
        configuration_damping_error=ranked.left_out_configuration_damping_error,
        chi_square=ranked.misfit,
        n_residual=ranked.n_residual,
        shared=ranked.parameter,
        pulled=tuple(pulled_text(ranked.pulled)),
    )


def entry_of_several(names: Sequence[str], fitted: Fitted, sizes: Sizes) -> Entry:
    """Return the line of the ledger of a fit of several stacks, `sizes` of the discrepancy being those of another."""
    model, fit = fitted.model, fitted.fit
    assert isinstance(model, SpecimensModel)
    frequency = np.concatenate([e.frequency for e in fit.errors])
    damping = np.concatenate([e.damping for e in fit.errors])
    modes, configurations = left_out(fit), configurations_left_out(model, fit)
    held = np.isfinite([c.std for c in fit.coordinates])
    return Entry(
        effects=tuple(names),
        error=mean_error(frequency),
        mode_error=_mean(modes, "frequency"),
        configuration_error=_mean(configurations, "frequency"),
        damping_error=mean_error(damping[np.isfinite(damping)]),
        mode_damping_error=_mean(modes, "damping"),
        configuration_damping_error=_mean(configurations, "damping"),
        chi_square=fit.problem.weighed(sizes).misfit + float(np.sum(fit.pulls[held] ** 2)),
        n_residual=frequency.size * fit.errors[0].value.shape[1] + fit.problem.damping.size,
        shared=tuple(estimate_of(model, fit, c.name) for c in fit.coordinates[fit.n_nuisance :] if not is_pinned(c)),
        pulled=tuple(pulled_text(far_off(model, fit))),
    )


def _mean(predicted: LeftOut, kind: Kind) -> float:
    errors = np.abs(predicted.errors[kind])
    return float(np.nanmean(errors)) if np.isfinite(errors).any() else float("nan")
