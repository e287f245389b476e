"""What a config's `trace:` section holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Le

from whid.effects._effect import Effect
from whid.errors import WhidError


@dataclass(frozen=True, kw_only=True)
class Trace:
    """Which effects compete, and how often one may be added.

    effects  all, or names: a kind (`saturation`: at every place) or a kind at a place (`saturation@output`)
    exclude  names that do not compete
    rounds   at most so many effects are added, one after another

    Raises `WhidError("trace-effect")` for a name that is none.
    """

    effects: Literal["all"] | tuple[str, ...] = "all"
    exclude: tuple[str, ...] = ()
    rounds: Annotated[int, Ge(1), Le(4)] = 4

    def __post_init__(self) -> None:
        for name in (*(() if self.effects == "all" else self.effects), *self.exclude):
            _check(name)

    def every(self) -> tuple[Effect, ...]:
        """Return the effects that compete, one a place.

        >>> [f"{e.kind}@{e.place}" for e in Trace(effects=("saturation",), exclude=("saturation@input",)).every()]
        ['saturation@output']
        """
        chosen = Effect.kinds() if self.effects == "all" else self.effects
        found = [effect for name in chosen for effect in _named(name)]
        dropped = {f"{e.kind}@{e.place}" for name in self.exclude for e in _named(name)}
        return tuple(e for e in dict.fromkeys(found) if f"{e.kind}@{e.place}" not in dropped)


def _named(name: str) -> list[Effect]:
    kind, _, place = name.partition("@")
    cls = Effect.named(kind)
    return [cls(place=each) for each in cls.places if place in ("", each)]


def _check(name: str) -> None:
    kind, at, place = name.partition("@")
    places = Effect.named(kind).places
    if at and place not in places:
        raise WhidError("trace-effect", f"{kind} can be at {', '.join(places)}, not at {place!r}")
