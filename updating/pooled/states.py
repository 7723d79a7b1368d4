"""Contact of each specimen, and of each torque by that alone; what groups change; modes beside the model's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from updating.diagnosis.answer import Pulled
from updating.diagnosis.evidence import D_F_START
from updating.fitting.fit import ParameterEstimate
from updating.inference.algebra import scaled_inverse
from updating.inference.explain import Explanation
from updating.inference.levels import PULLED
from updating.inference.tree import TreeProblem
from updating.pooled.scoped import CONTACT
from updating.pooled.screening import Bordered
from updating.pooled.specimens_model import SpecimensModel
from updating.results.pooled import ContactState, Contrast, ModeAnswer
from updating.results.text import Z95

Vector = NDArray[np.float64]

UNITS = {"G_f": "1", "d_f": "s/Pa"}
"""Contact parameters of a specimen, and their units."""
_VAGUE = 2.0
"""Prior standard deviation of the logarithm of a parameter at a torque about that of its specimen: so wide that data
decide, and finite where there are none, such as no damping ratio."""
_UNDETERMINED = 0.5  # of that, from which on data determine nothing
_RATIO_UNDETERMINED = np.log(100.0)  # half of an interval of a ratio's logarithm, beyond which nothing is said of it


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
        precision = np.array([c.std**-2.0 for c in fit.coordinates]) + 1e-12
        weighed = fit.problem.weighed(fit.evidence.sizes)
        self.covariance = scaled_inverse(weighed.hessian + fit.problem.curvature + np.diag(precision))
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
        _, g, here = self.model.place[c]
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
        s, g, here = self.model.place[c]
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
            if Z95 * std > _RATIO_UNDETERMINED:
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
        _, g, here = model.place[c]
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
