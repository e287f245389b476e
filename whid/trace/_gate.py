"""Is anything left to explain: tests whose false-alarm rate is known, together."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from whid.diagnostics.answering import answering
from whid.diagnostics.repeating import repeating
from whid.effects._candidate import CHANCE
from whid.effects._look import Look
from whid.trace._floor import repeats


class Test(NamedTuple):
    """One test of a residual."""

    name: str
    statistic: float
    p: float
    where: str


class Gate(NamedTuple):
    """All tests, and the chance of the smallest p if nothing were left."""

    tests: tuple[Test, ...]
    p: float
    threshold: float = CHANCE

    @property
    def words(self) -> str:
        """Return where what is left lives."""
        telling = [t for t in sorted(self.tests, key=lambda t: t.p) if t.p < 0.01]
        return "; ".join(f"{t.name}: {t.where}" for t in telling[:3]) or "no test says where it lives"


def gate(look: Look) -> Gate:
    """Return the tests of a look's residual."""
    tests = tuple(_tests(look))
    p = min(1.0, len(tests) * min((t.p for t in tests), default=1.0))
    return Gate(tests, p)


def _tests(look: Look) -> Iterator[Test]:
    records = [r for r in look.records]
    full = [r.y - p for r, p in zip(records, look.predicted, strict=True)]
    for k, found in enumerate(repeats(records, full), 1):
        if len(found.values) < 2:
            continue
        result = repeating(found.values)
        strongest = result.lines[np.argsort(-result.ratio)[:3]].astype(int)
        kind = "odd" if result.share_odd > 0.8 else "even" if result.share_odd < 0.2 else "odd and even"
        where = f"repeats with the excitation, on {kind} harmonics, most at {', '.join(map(str, strongest))}"
        yield Test(f"harmonics of part {k}", result.statistic, result.p, where)
    for k, (record, error, use) in enumerate(zip(records, look.errors, look.use, strict=True)):
        signals = {"u": np.asarray(record.u, float), "ŷ": look.predicted[k]}
        change = np.diff(record.u, prepend=record.u[:1])
        answer = answering(error, use, signals | {"the change of u": change}, look.sensitivity(k))
        yield Test(f"answer to the input, {record.name}", answer.statistic, answer.p, f"follows {answer.strongest}")
