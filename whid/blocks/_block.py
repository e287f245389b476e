"""What every block is: fields, state, step, tangent, steady state."""

from __future__ import annotations

import dataclasses
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple, Self, get_type_hints

import numpy as np

from whid.fit import Parameter
from whid.kinds import Kind
from whid.signal import Floats, Signal

State = Any  # what a block carries from one chunk to the next; before the first None (rest), STEADY or PERIODIC
STEADY = "steady"  # the state that the first value of the incoming signal would have held for ever
PERIODIC = "periodic"  # the state that the chunk, one period, leads back to; chains of linear and static blocks know it


@dataclass(frozen=True)
class Free:
    """Marks a field that a fit may change: its unit and its bounds."""

    units: str = "1"  # "input", "output", "s", "rad/s", "1", or any unit string
    lower: float = -np.inf
    upper: float = np.inf


Number = Annotated[float, Free()]


def each(state: State, count: int) -> list[State]:
    """Return the states of several blocks: one each, or the same start (rest, STEADY) for all.

    >>> each(None, 2), each([1.0, 2.0], 2)
    ([None, None], [1.0, 2.0])
    """
    return state if isinstance(state, list) else [state] * count


class Tangents(NamedTuple):
    """What `Block.tangent` returns: the output, its derivatives, and the state to go on from."""

    signal: Signal
    tangents: Sequence[Signal]  # one a seed, then one a name in `wrt`
    state: State


@dataclass(frozen=True, kw_only=True)
class Block(Kind):
    """A block of a plant or model: signal in, signal out.

    `step` carries the state across chunks, so a record may stream; `tangent` gives the derivative of the output with
    respect to the input (along seed signals) and to free scalars of the block, on the same path, sampled or exact.
    """

    family: ClassVar[str] = "whid.blocks"
    whole: ClassVar[bool] = False  # it looks ahead: a record must come in one piece
    fix: bool | tuple[str, ...] = False  # true: hold every number in a fit; a list: these fields (den) or numbers (den.1)

    @abstractmethod
    def step(self, signal: Signal, state: State = None) -> tuple[Signal, State]:
        """Return the output over this chunk and the state to go on from (None: from rest)."""

    @abstractmethod
    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Return the output and its derivatives along the seeds, then with respect to the named free scalars."""

    @abstractmethod
    def steady(self, level: float, dt: float) -> tuple[float, State]:
        """Return the output level and the state after a constant input has been there for ever.

        Raises `WhidError("block-no-steady-state")` where there is none.
        """

    def __call__(self, u: Floats, dt: float, between: Any = "zoh", t0: float = 0.0) -> Floats:
        """Return the output samples for input samples, from rest (a convenience for the shell and for tests)."""
        return self.step(Signal(np.asarray(u, float), dt, t0, between, self.panel_order(dt)))[0].values

    def panel_order(self, dt: float) -> int:
        """Return how many nodes an interval needs for the exact path: more when the block is fast against dt."""
        return max([4, *(block.panel_order(dt) for block in self.children())])

    def looks_ahead(self) -> bool:
        """Tell whether a record must come in one piece, for this block or one inside it."""
        return self.whole or any(block.looks_ahead() for block in self.children())

    def children(self) -> tuple[Block, ...]:
        """Return the blocks inside this one, in the order of their fields."""
        return tuple(block for _, block in self.named_children())

    def parameters(self, held: bool = False) -> tuple[Parameter, ...]:
        """Return the free scalars, by path; those under `fix:` only when `held` is asked for.

        >>> from whid.blocks.dead_zone import DeadZone
        >>> [p.name for p in DeadZone(low=-1.0, high=2.0, fix=("low",)).parameters()]
        ['high', 'slope']
        """
        found = []
        for name, value, free in self._free_fields():
            if held or not (self.fix is True or (self.fix and {name, name.partition(".")[0]} & set(self.fix))):
                found.append(Parameter(name, value, free.units, free.lower, free.upper))
        for path, block in self.named_children():
            if held or self.fix is not True:
                found += [p._replace(name=f"{path}.{p.name}") for p in block.parameters(held)]
        return tuple(found)

    def with_parameters(self, values: dict[str, float]) -> Self:
        """Return the block with some free scalars changed, each named by its path as in `parameters`."""
        changes: dict[str, Any] = {head: _changed(getattr(self, head), inner) for head, inner in _by_head(values).items()}
        return dataclasses.replace(self, **changes)

    def _free_fields(self) -> Iterator[tuple[str, float, Free]]:
        for name, free in _markers(type(self)).items():
            yield from _flatten(name, getattr(self, name), free)

    def named_children(self) -> Iterator[tuple[str, Block]]:
        """Yield the blocks inside this one with the beginning of their parameters' names, `chain.0`."""
        for name in _holders(type(self)):
            value = getattr(self, name)
            if isinstance(value, Block):
                yield name, value
            elif isinstance(value, tuple):
                yield from ((f"{name}.{i}", item) for i, item in enumerate(value) if isinstance(item, Block))


def _by_head(values: dict[str, float]) -> dict[str, dict[str, float]]:
    found: dict[str, dict[str, float]] = {}
    for name, value in values.items():
        head, _, rest = name.partition(".")
        found.setdefault(head, {})[rest] = value
    return found


def _changed(value: Any, numbers: dict[str, float]) -> Any:
    if isinstance(value, Block):
        return value.with_parameters(numbers)
    if "" in numbers:
        return numbers[""]
    items = list(value)
    for place, inner in _by_head(numbers).items():
        items[int(place)] = _changed(items[int(place)], inner)
    return tuple(items)


def _flatten(name: str, value: Any, free: Free) -> Iterator[tuple[str, float, Free]]:
    if isinstance(value, tuple):
        for i, item in enumerate(value):
            yield from _flatten(f"{name}.{i}", item, free)
    elif value is not None:
        yield name, float(value), free


def _markers(cls: type, _cache: dict[type, dict[str, Free]] = {}) -> dict[str, Free]:  # noqa: B006 (a cache)
    if cls not in _cache:
        hints = get_type_hints(cls, include_extras=True)
        found = {f.name: _find(hints[f.name]) for f in dataclasses.fields(cls)}
        _cache[cls] = {name: free for name, free in found.items() if free is not None}
    return _cache[cls]


def _holders(cls: type, _cache: dict[type, tuple[str, ...]] = {}) -> tuple[str, ...]:  # noqa: B006 (a cache)
    """Return the fields that blocks may stand in, by their types: trees are walked for every model that is tried."""

    def held(hint: Any) -> bool:
        return (isinstance(hint, type) and issubclass(hint, Block)) or any(map(held, getattr(hint, "__args__", ())))

    if cls not in _cache:
        hints = get_type_hints(cls)
        _cache[cls] = tuple(field.name for field in dataclasses.fields(cls) if held(hints[field.name]))
    return _cache[cls]


def _find(hint: Any) -> Free | None:
    """Find the `Free` marker in a type hint, however deep: `tuple[tuple[Number, ...], ...] | None`."""
    marked = [item for item in getattr(hint, "__metadata__", ()) if isinstance(item, Free)]
    inner = [found for argument in getattr(hint, "__args__", ()) if (found := _find(argument)) is not None]
    return next(iter(marked + inner), None)
