"""Plants drawn from a seed: what a user's rig might be, and how the user would write it down, roughly.

A plant is a row of parts; a part knows its numbers, what it does to a fine signal, and the YAML block that declares it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tests.closed_loop.fine import Backlash, Element, Filter, Fine, Floats, Static

ROUGH = 0.20  # start values are up to this much wrong, of their own size
MOVED = 0.03  # breakpoints up to this much of the range of what goes in
FAMILIES = ("wiener_hammerstein", "hammerstein", "wiener", "hammerstein_wiener", "backlash", "memoryless", "linear")
CURVES = ("kink", "two_kinks", "jump", "dead_zone", "saturation", "polynomial")
KINKED = ("kink", "two_kinks", "dead_zone", "saturation")


@dataclass(frozen=True)
class Part:
    """One declared block."""

    numbers: tuple[float, ...]
    kind: str  # linear: (gain, denominator …, 1); the kinds of curve; backlash: (gap,)

    def element(self) -> Element:
        """Return what it does."""
        if self.kind == "linear":
            return Filter((self.numbers[0],), self.numbers[1:])
        if self.kind == "backlash":
            return Backlash(self.numbers[0])
        return Static(self.curve, self.jumps)

    @property
    def jumps(self) -> tuple[tuple[float, float], ...]:
        """Return (breakpoint, height) of the jumps of a static part."""
        rows = np.reshape(self.numbers[2:], (-1, 3)) if self.kind == "jump" else np.empty((0, 3))
        return tuple((float(b), float(height)) for b, height, _ in rows)

    def curve(self, v: Floats) -> Floats:
        """Return f(v) of a static part."""
        n = self.numbers
        if self.kind == "polynomial":
            return np.polynomial.polynomial.polyval(v, n)
        if self.kind == "dead_zone":
            return n[2] * (v - np.clip(v, n[0], n[1]))
        if self.kind == "saturation":
            return n[2] * np.clip(v, n[0], n[1])
        out = n[0] + n[1] * v  # broken line: constant, slope, then (break, jump, change of slope) each
        for b, jump, bend in np.reshape(n[2:], (-1, 3)):
            out = out + np.where(v >= b, jump + bend * (v - b), 0.0)
        return out

    @property
    def breaks(self) -> tuple[int, ...]:
        """Return which numbers are breakpoints."""
        if self.kind in ("dead_zone", "saturation"):
            return (0, 1)
        return tuple(range(2, len(self.numbers), 3)) if self.kind in ("kink", "two_kinks", "jump") else ()

    @property
    def free(self) -> tuple[int, ...]:
        """Return which numbers a refit may move: a kink stays a kink, the last of a denominator is a matter of scale."""
        every = range(len(self.numbers))
        if self.kind == "linear":
            return tuple(every[:-1])
        return tuple(k for k in every if not (self.kind in ("kink", "two_kinks") and k >= 2 and k % 3 == 0))

    def rough(self, rng: np.random.Generator, low: float, high: float) -> Part:
        """Return the part as a user believes it to be; [low, high] is the range of what goes in."""
        numbers = [x * (1 + rng.uniform(-ROUGH, ROUGH)) for x in self.numbers]
        for k in self.breaks:
            numbers[k] = self.numbers[k] + rng.uniform(-MOVED, MOVED) * (high - low)
        if self.kind == "linear":
            numbers[-1] = self.numbers[-1]
        return replace(self, numbers=tuple(float(f"{x:.4g}") for x in numbers))

    def declared(self) -> dict[str, Any]:
        """Return the YAML block."""
        n = list(self.numbers)
        if self.kind == "linear":
            return {"kind": "linear", "num": [n[0]], "den": n[1:]}
        if self.kind == "polynomial":
            return {"kind": "polynomial", "coefficients": n}
        if self.kind in ("dead_zone", "saturation"):
            return {"kind": self.kind, "low": n[0], "high": n[1], "slope": n[2]}
        if self.kind == "backlash":
            return {"kind": "backlash", "gap": n[0]}
        pieces, breaks = [[n[0], n[1]]], []
        for b, jump, bend in np.reshape(n[2:], (-1, 3)).tolist():
            c, s = pieces[-1]
            breaks.append(b)
            pieces.append([c + jump - bend * b, s + bend])
        return {"kind": "piecewise", "breaks": breaks, "pieces": pieces}


@dataclass(frozen=True)
class Plant:
    """A row of parts; `place` names the index of the declared front, curve and back where there is one."""

    family: str
    parts: tuple[Part, ...]
    place: dict[str, int]

    def elements(self) -> tuple[Element, ...]:
        """Return what the parts do, in order."""
        return tuple(part.element() for part in self.parts)

    def inputs(self, u: Fine) -> list[Fine]:
        """Return what goes into every part, and what comes out at the end."""
        seen = [u]
        for element in self.elements():
            seen.append(element(seen[-1]))
        return seen

    def numbers(self) -> list[tuple[int, int]]:
        """Return (part, number) of everything a refit may move."""
        return [(i, k) for i, part in enumerate(self.parts) for k in part.free]

    def moved(self, where: tuple[int, int], by: float) -> Plant:
        """Return the plant with one number changed."""
        i, k = where
        n = list(self.parts[i].numbers)
        n[k] += by
        return replace(self, parts=(*self.parts[:i], replace(self.parts[i], numbers=tuple(n)), *self.parts[i + 1 :]))


def draw_plant(rng: np.random.Generator, family: str, low: float, high: float, dt: float, curve: str) -> Plant:
    """Return a plant of a family for an input in [low, high]; `curve` is the kind of its hard nonlinearity."""
    slow = rng.permutation([rng.uniform(3.0, 6.0), rng.uniform(8.0, 15.0)])
    parts: list[Part] = []
    place: dict[str, int] = {}

    def linear(name: str) -> None:
        nonlocal low, high
        gain = float(rng.uniform(0.6, 1.8))
        parts.append(draw_linear(rng, gain, float(slow[len(parts) % 2]) * dt))
        place[name] = len(parts) - 1
        low, high = gain * low, gain * high

    def static(name: str, kind: str) -> None:
        nonlocal low, high
        parts.append(draw_curve(rng, kind, low, high))
        place.setdefault(name, len(parts) - 1)
        values = parts[-1].curve(np.linspace(low, high, 201))
        low, high = float(values.min()), float(values.max())

    if family in ("wiener_hammerstein", "wiener", "backlash", "linear"):
        linear("front")
    if family == "backlash":
        gap = rng.uniform(0.08, 0.2) * (high - low)
        parts.append(Part((float(gap),), "backlash"))
        place["nonlinearity"] = 1
    elif family != "linear":
        static("nonlinearity", curve)
    if family in ("wiener_hammerstein", "hammerstein", "backlash"):
        linear("back")
    if family == "hammerstein_wiener":
        linear("front")
        static("second", "polynomial")
    return Plant(family, tuple(parts), place)


def draw_linear(rng: np.random.Generator, gain: float, tau: float) -> Part:
    """Return a first- or second-order low-pass whose slowest time constant is tau."""
    if rng.random() < 0.5:
        return Part((gain, tau, 1.0), "linear")
    zeta = float(rng.uniform(0.5, 0.9))
    wn = 1 / (tau * zeta)
    return Part((gain, 1 / wn**2, 2 * zeta / wn, 1.0), "linear")


def draw_curve(rng: np.random.Generator, kind: str, low: float, high: float) -> Part:
    """Return a static nonlinearity whose breakpoints lie well inside [low, high]."""
    width = high - low
    at = np.sort(low + width * (np.array([0.3, 0.7]) + rng.uniform(-0.12, 0.12, 2)))
    slope = rng.uniform(0.6, 1.6)
    if kind == "polynomial":
        middle, half = (low + high) / 2, width / 2
        x = np.polynomial.Polynomial([-middle / half, 1 / half])
        cubic = slope * half * (x + rng.uniform(-0.3, 0.3) * x**2 + rng.uniform(0.1, 0.3) * x**3)
        return Part(tuple(cubic.coef.tolist()), kind)
    if kind in ("dead_zone", "saturation"):
        return Part((float(at[0]), float(at[1]), float(slope)), kind)
    bends = rng.choice([-1, 1]) * np.array([1, -1]) * rng.uniform(0.5, 1.2, 2) * slope
    constant = float(rng.uniform(-0.3, 0.3) * width)
    rows = [(float(b), 0.0, float(d)) for b, d in zip(at, bends, strict=True)][: 2 if kind == "two_kinks" else 1]
    if kind == "jump":
        rows = [
            (
                float(at[rng.integers(2)]),
                float(rng.choice([-1, 1]) * rng.uniform(0.1, 0.25) * width * slope),
                float(bends[0]),
            )
        ]
    return Part((constant, float(slope), *(x for row in rows for x in row)), kind)
