"""What an answer needs of a model beyond the inference: names, units, and what a fit moved."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from model import Effect, Parameter
from updating.diagnosis.answer_parts import Moved
from updating.inference.explain import Explanation
from updating.inference.protocol import Model


class Explained(Model, Protocol):
    """A model whose explanations are reported: a stack, or matrices of another program."""

    @property
    def effects(self) -> Mapping[str, Effect]:
        """Candidates for what is missing, by name."""

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """Parameters of all of them, by name."""

    @property
    def hypotheses(self) -> Mapping[str, Mapping[str, float]]:
        """What may have been stated or measured wrongly: of each, the nuisances whose prior it widens."""

    @property
    def labels(self) -> Mapping[str, str]:
        """Plain name of each effect and hypothesis."""

    def unit(self, nuisance: str) -> str:
        """Return the unit of a nuisance: m of places, 1/s of a decay, 1 where it is the logarithm of a ratio."""

    def moved(self, explanation: Explanation) -> tuple[Moved, ...]:
        """Return every quantity that all fits may move, as stated and as an explanation was fitted with it."""
