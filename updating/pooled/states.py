"""Contact of each specimen, and of each torque by that alone; what groups change; modes beside the model's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from updating.diagnosis.answer import Strained
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
"""Standard deviation of the logarithm of a parameter at a torque about that of its specimen, beforehand: so wide that
data decide, and finite where there are none, such as no damping ratio."""
_UNTOLD = 0.5  # of that, from which on data tell nothing
_RATIO_UNTOLD = np.log(
    100.0
)  # half of an interval of a ratio's logarithm, beyond which nothing is said of it


class Contacts:
    """Contact of specimens and states as an explanation has it.

    Parameters
    ----------
    model : SpecimensModel
        The model.
    own : Explanation
        The explanation.
    """

    def __init__(self, model: SpecimensModel, own: Explanation) -> None:
        assert isinstance(own.problem, TreeProblem)
        self.model, self.own, self.problem = model, own, own.problem
        precision = np.array([c.std**-2.0 for c in own.coordinates]) + 1e-12
        weighed = own.problem.weighed(own.evidence.sizes)
        self.covariance = scaled_inverse(weighed.hessian + own.problem.curvature + np.diag(precision))
        self.names = [c.name for c in own.coordinates]
        contact = model.first.stack.contact
        self.nominal = {"G_f": contact.G_f, "d_f": contact.d_f or D_F_START}

    def _parts(self, what: str, s: int) -> list[int]:
        """Return the coordinates that make a contact parameter of a specimen."""
        scopes = [self.model.scope(name) for name in self.names]
        return [i for i, own in enumerate(scopes) if own.local == what and s in own.members]

    def of_specimen(self, s: int) -> tuple[ParameterEstimate | None, ParameterEstimate | None]:
        """Return G_f and d_f of a specimen, None where no torque tells anything of it."""
        found = []
        for what in UNITS:
            at = self._parts(what, s)
            std = float(np.sqrt(max(self.covariance[np.ix_(at, at)].sum(), 0.0)))
            log = float(self.own.x[at].sum())
            told = any(self._alone(c)[1][what] < _UNTOLD * _VAGUE for c in self.model.states_of[s])
            found.append(self._estimate(what, log, std) if at and told else None)
        return found[0], found[1]

    def of_state(self, c: int) -> ContactState:
        """Return contact by the frequencies and damping ratios of one state alone, all else as it was found."""
        _, g, here = self.model.place[c]
        logs, stds = self._alone(c)
        tested = self.model.groups[g].model.tested[here]
        found = {
            what: None if stds[what] > _UNTOLD * _VAGUE else self._estimate(what, logs[what], stds[what])
            for what in UNITS
        }
        return ContactState(name=tested.assembled, pressure=tested.pressure, **found)

    def _alone(self, c: int) -> tuple[dict[str, float], dict[str, float]]:
        """Return logarithms of contact parameters by one state, and their standard deviations.

        One step of least squares from where the explanation stands.
        """
        s, g, here = self.model.place[c]
        assembled = self.model.groups[g].model.tested[here].assembled
        size, leaf = self.own.evidence.sizes, self.problem.leaves[c]
        k = leaf.touched.size
        product = leaf.information(size.stiffness)[0][: 1 + k, : 1 + k]
        damped = self.problem.of_damping(size.damping, self.problem.damping_at == c)
        logs, where = dict[str, float](), list[int]()
        for what in UNITS:
            parts = self._parts(what, s)
            state = f"{what}[{self.model.specimens[s].name} {assembled}]"
            logs[what] = float(self.own.x[parts].sum())
            if state in self.names:
                logs[what] += float(self.own.x[self.names.index(state)])
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
        value, lower, upper = (
            self.nominal[what] * np.exp(log + Z95 * std * np.array([0.0, -1.0, 1.0]))
        ).tolist()
        return ParameterEstimate(
            name=what, unit=UNITS[what], value=value, lower=lower, upper=upper, at_bound=False
        )


def contrasts_of(model: SpecimensModel, own: Explanation) -> list[Contrast]:
    """Return what groups have of contact parameters over the others, nothing being known of it beforehand."""
    if not model.first.touching:
        return []
    assert isinstance(own.problem, TreeProblem)
    names = [c.name for c in own.coordinates]
    found = []
    for level in (level for level in model.levels if level.kind == "group"):
        for what, label in CONTACT.items():
            # a term that is there already gives way to what is returned
            term = [i for i, n in enumerate(names) if n == f"{what}@{level.of}"]
            precision = np.array([c.std**-2.0 for c in own.coordinates])
            precision[term] = 1e8
            bordered = Bordered(model, own.problem, own.evidence.sizes, own.x, precision)
            value, std = bordered.free(level.members, names.index(what))
            log = value + float(own.x[term].sum())
            if Z95 * std > _RATIO_UNTOLD:
                continue
            ratio, lower, upper = np.exp(log + Z95 * std * np.array([0.0, -1.0, 1.0])).tolist()
            found.append(
                Contrast(group=level.of, parameter=what, label=label, ratio=ratio, lower=lower, upper=upper)
            )
    return found


def modes_told(
    model: SpecimensModel, base: Explanation, own: Explanation, states: Sequence[int]
) -> tuple[ModeAnswer, ...]:
    """Return the measured modes of some states beside those of two explanations."""
    told: list[ModeAnswer] = []
    for c in states:
        _, g, here = model.place[c]
        tested, modes = model.groups[g].model.tested[here], model.states[c]
        before, after = base.errors[c], own.errors[c]
        for r in range(modes.frequency.size):
            f, zeta = float(modes.frequency[r]), float(tested.modes.damping[r])
            measured = tested.modes.damping_std[r] < zeta
            told.append(
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
    return tuple(told)


def far_off(model: SpecimensModel, own: Explanation) -> tuple[Strained, ...]:
    """Return the nuisances whose mean over all specimens is far from what is known of it."""
    scopes = [model.scope(c.name) for c in own.coordinates[: own.n_nuisance]]
    found, n = [], len(model.specimens)
    for name, c in model.local.items():
        if "[" in name or not np.isfinite(c.std):
            continue
        at = [i for i, scope in enumerate(scopes) if scope.local == name]
        share = [len(scopes[i].members) / n for i in at]
        prior = float(np.sqrt(sum((p * own.coordinates[i].std) ** 2 for p, i in zip(share, at, strict=True))))
        value = float(sum(p * own.x[i] for p, i in zip(share, at, strict=True)))
        if abs(value) > PULLED * prior:
            found.append(Strained(name=name, value=value, std=prior))
    return tuple(found)
