"""What a pooled diagnosis says: which effect is the rig's, a group's, a specimen's, and how sure that is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from updating.fitting.estimate import ParameterEstimate

LevelKind = Literal["rig", "group", "specimen"]
PooledVerdict = Literal[
    "nothing missing", "identified", "one of", "partly explained", "unlike anything", "as asked"
]


@dataclass(frozen=True, kw_only=True)
class Part:
    """One term of an explanation.

    Attributes
    ----------
    effect, label : str
        Its name and what a person calls it.
    level : "rig", "group" or "specimen"
        Whose it is.
    of : str
        Which group or specimen; empty where it is all.
    specimens : tuple of str
        Those that have it.
    parameter : tuple of ParameterEstimate
        With 95 % intervals; of shifts of what a file states or of contact parameters the ratio.
    log_odds : float
        What it brings: logarithm of the odds of the explanation with it against the best without; NaN where that was
        not fitted.
    """

    effect: str
    label: str
    level: LevelKind
    of: str
    specimens: tuple[str, ...]
    parameter: tuple[ParameterEstimate, ...]
    log_odds: float


@dataclass(frozen=True, kw_only=True)
class PooledRanked:
    """One explanation.

    Attributes
    ----------
    parts : tuple of Part
        None of the base model.
    log_odds : float
        Logarithm of its posterior odds against the base model.
    probability : float
        Among all that were fitted.
    frequency_error, left_out_error : float
        Mean relative errors of frequencies over all specimens, and the same where each is predicted from the others.
    left_out_torque_error : float
        The same where the frequencies and damping ratios of a specimen at one torque are predicted from all else; NaN
        with one torque.
    """

    parts: tuple[Part, ...]
    log_odds: float
    probability: float
    frequency_error: float
    left_out_error: float
    left_out_torque_error: float


@dataclass(frozen=True, kw_only=True)
class ContactState:
    """Contact parameters of a specimen from one torque alone.

    Attributes
    ----------
    name : str
        The configuration.
    pressure : float
        Nominal contact pressure, Pa.
    G_f, d_f : ParameterEstimate, optional
        With 95 % intervals, all else as it was found; none where the torque alone tells nothing of it, such as of d_f
        where no damping was measured.
    """

    name: str
    pressure: float
    G_f: ParameterEstimate | None
    d_f: ParameterEstimate | None


@dataclass(frozen=True, kw_only=True)
class ModeAnswer:
    """A measured mode of a specimen beside the model's.

    Attributes
    ----------
    configuration : str
        At which torque.
    frequency, damping : float
        Measured, Hz and 1; the latter NaN where it was not.
    base_frequency, model_frequency : float
        Of the base model, and with what was found, Hz.
    base_damping, model_damping : float
        The same of damping ratios; NaN of one lamina, which has no damping of its own.
    """

    configuration: str
    frequency: float
    damping: float
    base_frequency: float
    model_frequency: float
    base_damping: float
    model_damping: float


@dataclass(frozen=True, kw_only=True)
class SpecimenAnswer:
    """What is said of one specimen.

    Attributes
    ----------
    name : str
        Which.
    notes : mapping of str to str
        What was noted of it.
    n_mode : int
        Measured modes that the model has, over all its configurations.
    G_f, d_f : ParameterEstimate, optional
        Its contact parameters with 95 % intervals; none where no torque of its own tells anything of it.
    base_error, error, left_out_error : float
        Mean relative errors of its frequencies: base model, best explanation, and predicted from the others.
    odd : tuple of str
        Effects that it alone has.
    states : tuple of ContactState
        Its contact at each torque.
    modes : tuple of ModeAnswer
        Its measured modes, configuration by configuration.
    """

    name: str
    notes: Mapping[str, str]
    n_mode: int
    G_f: ParameterEstimate | None
    d_f: ParameterEstimate | None
    base_error: float
    error: float
    left_out_error: float
    odd: tuple[str, ...]
    states: tuple[ContactState, ...]
    modes: tuple[ModeAnswer, ...]


@dataclass(frozen=True, kw_only=True)
class Contrast:
    """What specimens of a group have of a contact parameter over what the others have, all else as it is found.

    Attributes
    ----------
    group : str
        Such as "treatment = glued".
    parameter, label : str
        "G_f" or "d_f", and what it is called.
    ratio, lower, upper : float
        With 95 % interval, which holds the scatter from specimen to specimen.
    """

    group: str
    parameter: str
    label: str
    ratio: float
    lower: float
    upper: float


@dataclass(frozen=True, kw_only=True)
class PooledDiagnosis:
    """Answer of a pooled diagnosis.

    Attributes
    ----------
    name : str
        The campaign.
    verdict : str
        "nothing missing"; "identified"; "one of" where data cannot tell; "partly explained" where what remains is more
        than a right model leaves; "unlike anything" where specimens are not predicted better for all that; "as asked"
        of a fit of terms that somebody asks for.
    ranking : tuple of PooledRanked
        What was fitted in full: the one that leads, those that the data do not tell from it, and the others, the most
        probable first.
    left : int
        Explanations, the first of the ranking, that the data do not tell apart.
    specimens : tuple of SpecimenAnswer
        All of them.
    contrasts : tuple of Contrast
        What groups do to contact parameters.
    scales : mapping of str to float
        What the model is right to, of a `frequency` and of a `damping` ratio; the scatter of ln G_f and ln d_f from
        specimen to specimen, `stiffness` and `loss`; and the shares of the discrepancy that the `rig`, each `specimen`
        and each `state` has.
    not_visible : tuple of str
        Effects too weak to show at any plausible strength, were they the rig's.
    impossible : mapping of str to str
        Why effects of the catalogue cannot be.
    relieved, strained : tuple of str
        In words, what is known of the stacks and would have to be far off in the mean without what is found, and what
        has to be with it.
    sentences : tuple of str
        The answer in words, the first one first.
    """

    name: str
    verdict: PooledVerdict
    ranking: tuple[PooledRanked, ...]
    left: int
    specimens: tuple[SpecimenAnswer, ...]
    contrasts: tuple[Contrast, ...]
    scales: Mapping[str, float]
    not_visible: tuple[str, ...]
    impossible: Mapping[str, str]
    relieved: tuple[str, ...]
    strained: tuple[str, ...]
    sentences: tuple[str, ...]

    @property
    def best(self) -> PooledRanked:
        """The explanation that is told: the base model where nothing is missing, or nothing helps."""
        if self.verdict in ("nothing missing", "unlike anything"):
            return next(own for own in self.ranking if not own.parts)
        return self.ranking[0]
