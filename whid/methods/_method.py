"""What every method is: frozen options, called with records, yielding each stage's result and at last the Model."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from whid.experiments._part import Part
from whid.fit import Estimate
from whid.kinds import Kind
from whid.record import Record
from whid.residual import Misfit
from whid.system import System

if TYPE_CHECKING:
    from whid.methods._statistics import Statistics


class Wanted(NamedTuple):
    """An experiment a method asks for, and what it predicts: the standard error `of` something, in that one's unit.

    The runner performs it on a simulated plant, as far as `adaptive:` allows, and sends the Record back; otherwise it sends
    None, the method finishes with what it has, and `whid next` writes the plan for the rig.
    """

    plan: tuple[Part, ...]
    reason: str
    predicted_se: float
    of: str = ""


class Answered(NamedTuple):
    """What the experiment asked for last has told, in a few words for the list of experiments."""

    text: str


class Model(NamedTuple):
    """The end of every method: a system that simulates, the estimate behind its numbers, what could not be known.

    estimate names parameters by their path in the system's tree, `chain.0.den.1`.
    """

    system: System
    estimate: Estimate
    normalisation: str = "none"
    missing: tuple[str, ...] = ()


class Explained(NamedTuple):
    """What the model leaves over of every record, of a method that has seen it already: it spares another pass."""

    misfits: tuple[Misfit, ...]


Stages = Generator[Any, Record | None, None]  # stage results (NamedTuples), Wanted, Answered, Explained; the Model last


@dataclass(frozen=True, kw_only=True)
class Method(Kind):
    """A staged identification. It sees Records (and the declared model), never a plant, a config or a file."""

    family: ClassVar[str] = "whid.methods"

    def whole_records(self) -> str:
        """Return why records must be in memory whole; "" where they may be `LongRecord`s too."""
        return f"{self.kind} needs whole records in memory"

    @abstractmethod
    def __call__(self, records: Sequence[Record], model: System | None = None) -> Stages:
        """Yield each stage's result in the paper's order, the Model last."""

    def staged(self, seen: Statistics, model: System | None = None) -> Stages:
        """Yield the same stages from statistics alone, where `wants_samples` says that they suffice."""
        raise NotImplementedError

    def wants_samples(self, samples: int) -> str:
        """Return why levels and harmonics of so many samples do not suffice, "" where they do."""
        return f"`{self.kind}` reads every sample"

    def reads(self) -> tuple[float, int]:
        """Return the settling time, s, that is left out of them, and the highest harmonic that is looked at."""
        raise NotImplementedError
