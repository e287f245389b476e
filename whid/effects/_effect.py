"""What every effect is: cheap evidence in a residual, and the edit of the model that adds it."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

from whid.kinds import Kind
from whid.methods._method import Model
from whid.record import Record
from whid.residual import Residual

Place = Literal["input", "front", "back", "nonlinearity", "output", "loop", "parallel", "time", "noise"]


class Evidence(NamedTuple):
    """How much of a residual an effect explains, before any refit.

    statistic  log-likelihood gained, nats, its own parameters and the values searched already paid for
    p          chance of that much without the effect
    where      in words, where in the record it lives
    """

    statistic: float
    p: float
    where: str


@dataclass(frozen=True, kw_only=True)
class Effect(Kind):
    """A candidate: something that the model lacks, at a place. "Nothing" always competes with it.

    `places` lists where an effect of this kind may sit; `place` is where this one does.
    """

    family: ClassVar[str] = "whid.effects"
    places: ClassVar[tuple[Place, ...]] = ()
    place: Place

    @abstractmethod
    def evidence(self, residuals: Sequence[Residual]) -> Evidence:
        """Return the evidence in the residuals of all records; cheap: one simulation or none, no refit."""

    @abstractmethod
    def extend(self, model: Model, records: Sequence[Record]) -> Model:
        """Return the model with the effect added, an edit of its tree or of its disturbances, and fitted to the records."""
