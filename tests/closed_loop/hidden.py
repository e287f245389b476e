"""What a plant may hide: every effect of the loop's table at every place, at a strength, and three the loop cannot name.

An entry of EFFECTS draws the particulars (where a jump sits, how a drift runs) once and returns a function of the strength
alone, so that a search for the strength that makes the effect so-and-so visible turns one knob.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import lfilter

from tests.closed_loop.fine import Backlash, Element, Filter, Fine, Floats, SlewLimit, Static
from tests.closed_loop.plants import KINKED, Part
from tests.closed_loop.scene import Scene
from tests.closed_loop.world import LEAD, World

Edit = Callable[[World], World]
Knob = Callable[[float], Edit]  # strength → what it does to the world


class Drawn(NamedTuple):
    """An effect with its particulars: the knob, where a search may turn it, and what the truth says at a strength."""

    knob: Knob
    least: float
    most: float
    truth: Callable[[float], dict[str, Any]]


@dataclass(frozen=True)
class Hidden:
    """One entry: its name, the families in which it is what it is called, whether it is random, how it is drawn."""

    kind: str
    place: str
    families: tuple[str, ...]
    draw: Callable[[Scene, np.random.Generator], Drawn]
    random: bool = False
    variant: str = ""
    alike: Callable[[Scene], tuple[str, ...]] = lambda scene: ()  # other places that name the very same thing

    @property
    def name(self) -> str:
        """Return kind@place, with its variant where there are several."""
        return f"{self.kind}@{self.place}" + (f"/{self.variant}" if self.variant else "")


EFFECTS: dict[str, Hidden] = {}
OUTSIDE: dict[str, Hidden] = {}

WH, H, W, HW, B, M, L = (
    "wiener_hammerstein", "hammerstein", "wiener", "hammerstein_wiener", "backlash", "memoryless", "linear",
)  # fmt: skip
EVERY = (WH, H, W, HW, B, M, L)
MOVING = (WH, H, W, HW, B, L)  # with dynamics
AHEAD = (WH, W, B, L)  # a filter between the input and the curve: a static effect at the input is no change of the curve
BEHIND = (WH, H, B, L)  # the same at the output
CURVED = (WH, H, W, M)


def hidden(kind: str, place: str, families: tuple[str, ...], *, table: dict[str, Hidden] = EFFECTS, **options: Any) -> Any:
    """Return a decorator that enters a drawing function into a table."""

    def enter(draw: Callable[[Scene, np.random.Generator], Drawn]) -> Callable[[Scene, np.random.Generator], Drawn]:
        entry = Hidden(kind, place, families, draw, **options)
        table[entry.name] = entry
        return draw

    return enter


def either_side(scene: Scene) -> tuple[str, ...]:
    """Return the other place of a linear effect where one linear block is all that is declared."""
    return ("back",) if scene.plant.family in (L, HW) else ()


def at_input(element: Element, name: str) -> Edit:
    """Return the edit that puts an element before everything else."""
    return lambda world: world.inserted(0, name, element)


def at_output(element: Element, name: str) -> Edit:
    """Return the edit that puts an element behind everything else."""
    return lambda world: world.inserted(len(world.chain), name, element)


def sensor(change: Callable[[Floats], Floats]) -> Edit:
    """Return the edit that changes the undisturbed samples."""
    return lambda world: replace(world, sensor=(*world.sensor, change))


def converter(change: Callable[[Floats], Floats]) -> Edit:
    """Return the edit that changes the noisy samples."""
    return lambda world: replace(world, converter=(*world.converter, change))


def middle(span: tuple[float, float]) -> tuple[float, float]:
    """Return the centre and the half-width of a range."""
    return (span[0] + span[1]) / 2, (span[1] - span[0]) / 2


# ---------------------------------------------------------------------------------------------------------------- input
@hidden("saturation", "input", AHEAD)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    c, r = middle(scene.ranges[0])
    sides = rng.integers(3)  # above, below, both

    def limits(s: float) -> tuple[float, float]:
        return (c - r * (1 - s) if sides else -np.inf), (c + r * (1 - s) if sides != 1 else np.inf)

    return Drawn(
        lambda s: at_input(Static(lambda u: np.clip(u, *limits(s))), "hidden"), 1e-3, 0.8,
        lambda s: {"low": limits(s)[0], "high": limits(s)[1]},
    )  # fmt: skip


@hidden("dead_zone", "input", AHEAD)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    r = middle(scene.ranges[0])[1]
    return Drawn(
        lambda s: at_input(Static(lambda u: u - np.clip(u, -s * r, s * r)), "hidden"), 1e-4, 0.6,
        lambda s: {"low": -s * r, "high": s * r},
    )  # fmt: skip


def _bent(rng: np.random.Generator) -> Callable[[Floats], Floats]:
    """Return a smooth bend on [−1, 1], of unit size."""
    sign, kind, mix = rng.choice([-1.0, 1.0]), rng.integers(3), rng.uniform(-0.5, 0.5)
    if kind == 0:
        return lambda x: sign * (x**2 + mix * x**3)
    if kind == 1:
        return lambda x: sign * (x**3 - x + mix * x**2)
    return lambda x: sign * (np.tanh(2 * (x - mix)) - x)


@hidden("curve", "input", (*AHEAD, H, HW))
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    (c, r), bend = middle(scene.ranges[0]), _bent(rng)
    return Drawn(
        lambda s: at_input(Static(lambda u: u + s * r * bend((u - c) / r)), "hidden"), 1e-4, 0.8, lambda s: {"strength": s}
    )


@hidden("slew_limit", "input", MOVING)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    r = middle(scene.ranges[0])[1]
    return Drawn(
        lambda s: at_input(SlewLimit(2 * r / (s * scene.dt)), "hidden"), 0.02, 80.0,
        lambda s: {"rate": 2 * r / (s * scene.dt)},
    )  # fmt: skip


@hidden("quantizer", "input", EVERY)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    r = middle(scene.ranges[0])[1]
    return Drawn(
        lambda s: at_input(Static(lambda u: s * r * np.floor(u / (s * r) + 0.5)), "hidden"), 1e-3, 0.4,
        lambda s: {"step": s * r},
    )  # fmt: skip


@hidden("backlash", "input", (WH, H, W, HW, M, L))
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    r = middle(scene.ranges[0])[1]
    return Drawn(lambda s: at_input(Backlash(s * r), "hidden"), 1e-4, 0.8, lambda s: {"gap": s * r})


# -------------------------------------------------------------------------------------------------------- linear blocks
def _behind(scene: Scene, place: str, make: Callable[[float], Element]) -> Knob:
    name = f"part {scene.plant.place[place]}"
    return lambda s: lambda world: world.inserted(world.at(name) + 1, "hidden", make(s))


def _lag(place: str) -> Callable[[Scene, np.random.Generator], Drawn]:
    def draw(scene: Scene, rng: np.random.Generator) -> Drawn:
        knob = _behind(scene, place, lambda s: Filter((1.0,), (s * scene.dt, 1.0)))
        return Drawn(knob, 0.05, 20.0, lambda s: {"tau": s * scene.dt})

    return draw


def _resonance(place: str) -> Callable[[Scene, np.random.Generator], Drawn]:
    def draw(scene: Scene, rng: np.random.Generator) -> Drawn:
        zeta = float(rng.uniform(0.03, 0.2))

        def pair(s: float) -> Element:
            return Filter((1.0,), ((s * scene.dt) ** 2, 2 * zeta * s * scene.dt, 1.0))

        return Drawn(_behind(scene, place, pair), 0.34, 12.0, lambda s: {"omega": 1 / (s * scene.dt), "damping": zeta})

    return draw


hidden("lag", "front", (WH, W, B, L, HW), alike=either_side)(_lag("front"))
hidden("lag", "back", (WH, H, B))(_lag("back"))
hidden("resonance", "front", (WH, W, B, L, HW), alike=either_side)(_resonance("front"))
hidden("resonance", "back", (WH, H, B))(_resonance("back"))


# --------------------------------------------------------------------------------------------------------- nonlinearity
def _added(
    scene: Scene,
    extra: Callable[[float], Callable[[Floats], Floats]],
    jumps: Callable[[float], tuple[tuple[float, float], ...]] = lambda s: (),
) -> Knob:
    k = scene.plant.place["nonlinearity"]
    part = scene.plant.parts[k]

    def knob(s: float) -> Edit:
        return lambda world: world.replaced(
            f"part {k}", Static(lambda v: part.curve(v) + extra(s)(v), (*part.jumps, *jumps(s)))
        )

    return knob


def _spot(scene: Scene, rng: np.random.Generator) -> tuple[float, float, float]:
    """Return a place within the inner range of v and away from the breakpoints, and the sizes of v and w."""
    k = scene.plant.place["nonlinearity"]
    part, (low, high) = scene.plant.parts[k], scene.ranges[k]
    known = np.array([part.numbers[b] for b in part.breaks])
    spots = [b for b in rng.uniform(low + 0.2 * (high - low), high - 0.2 * (high - low), 50)
             if not len(known) or np.abs(known - b).min() > 0.12 * (high - low)]  # fmt: skip
    w = scene.ranges[k + 1]
    return float(spots[0]), high - low, w[1] - w[0]


@hidden("jump", "nonlinearity", CURVED)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    (b, _, w), sign = _spot(scene, rng), rng.choice([-1.0, 1.0])
    return Drawn(
        _added(scene, lambda s: lambda v: np.where(v >= b, sign * s * w, 0.0), lambda s: ((b, sign * s * w),)), 1e-4, 0.8,
        lambda s: {"break": b, "jump": sign * s * w},
    )  # fmt: skip


@hidden("kink", "nonlinearity", CURVED)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    (b, v_size, w), sign = _spot(scene, rng), rng.choice([-1.0, 1.0])
    return Drawn(
        _added(scene, lambda s: lambda v: sign * s * w / v_size * np.maximum(v - b, 0.0)), 1e-3, 3.0,
        lambda s: {"break": b, "bend": sign * s * w / v_size},
    )  # fmt: skip


@hidden("soft_knee", "nonlinearity", CURVED)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    k = scene.plant.place["nonlinearity"]
    part, (low, high) = scene.plant.parts[k], scene.ranges[k]
    if part.kind not in KINKED:
        raise ValueError("a soft knee needs a corner")
    hyperbola = rng.random() < 0.5

    def rounding(s: float) -> Callable[[Floats], Floats]:
        width = s * (high - low)

        def extra(v: Floats) -> Floats:
            total = np.zeros_like(v)
            for b, bend in corners(part):
                x = (v - b) / width
                soft = (x + np.sqrt(x**2 + 1)) / 2 if hyperbola else np.logaddexp(0.0, x)
                total += bend * width * (soft - np.maximum(x, 0.0))
            return total

        return extra

    return Drawn(_added(scene, rounding), 1e-3, 0.5, lambda s: {"width": s * (high - low)})


def corners(part: Part) -> list[tuple[float, float]]:
    """Return (breakpoint, change of slope) of a curve with corners."""
    n = part.numbers
    if part.kind in ("dead_zone", "saturation"):
        first = -n[2] if part.kind == "dead_zone" else n[2]
        return [(n[0], first), (n[1], -first)]
    return [(float(b), float(bend)) for b, _, bend in np.reshape(n[2:], (-1, 3))]


# --------------------------------------------------------------------------------------------------------------- output
@hidden("saturation", "output", BEHIND)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    c, r = middle(scene.ranges[-1])
    sides, late = rng.integers(3), rng.random() < 0.5  # late: the converter clips, noise and all

    def limits(s: float) -> tuple[float, float]:
        return (c - r * (1 - s) if sides else -np.inf), (c + r * (1 - s) if sides != 1 else np.inf)

    def knob(s: float) -> Edit:
        return (converter if late else sensor)(lambda y: np.clip(y, *limits(s)))

    return Drawn(knob, 1e-3, 0.8, lambda s: {"low": limits(s)[0], "high": limits(s)[1], "rails": bool(late)})


@hidden("curve", "output", BEHIND)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    (c, r), bend = middle(scene.ranges[-1]), _bent(rng)
    return Drawn(lambda s: sensor(lambda y: y + s * r * bend((y - c) / r)), 1e-4, 0.8, lambda s: {"strength": s})


@hidden("quantizer", "output", EVERY, random=True)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    sd = scene.noise.std
    return Drawn(
        lambda s: converter(lambda y: s * sd * np.floor(y / (s * sd) + 0.5)), 0.05, 40.0, lambda s: {"step": s * sd}
    )


@hidden("backlash", "output", (WH, H, W, HW, M, L))
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    r = middle(scene.ranges[-1])[1]
    return Drawn(lambda s: at_output(Backlash(s * r), "hidden"), 1e-4, 0.8, lambda s: {"gap": s * r})


def _time(scene: Scene) -> Floats:
    return np.arange(len(scene.plan.u)) / len(scene.plan.u)


def _drift(shape: Callable[[Scene, np.random.Generator], Floats]) -> Callable[[Scene, np.random.Generator], Drawn]:
    def draw(scene: Scene, rng: np.random.Generator) -> Drawn:
        path = shape(scene, rng)
        path = scene.noise.std * path / path[scene.plan.estimation].std()
        return Drawn(lambda s: sensor(lambda y: y + s * path), 1e-3, 1e3, lambda s: {"rms": s * scene.noise.std})

    return draw


def _smooth(scene: Scene, rng: np.random.Generator) -> Floats:
    t = _time(scene)
    return np.asarray(sum(rng.standard_normal() / k * np.cos(np.pi * k * t) for k in range(1, 6)))


def _wave(scene: Scene, rng: np.random.Generator) -> Floats:
    return np.sin(2 * np.pi * (rng.uniform(1.5, 6.0) * _time(scene) + rng.random()))


hidden("drift", "output", EVERY, variant="ramp")(_drift(lambda scene, rng: rng.choice([-1.0, 1.0]) * _time(scene)))
hidden("drift", "output", EVERY, variant="smooth")(_drift(_smooth))
hidden("drift", "output", EVERY, variant="sine")(_drift(_wave))
hidden("drift", "output", EVERY, variant="random_walk")(
    _drift(lambda scene, rng: np.cumsum(rng.standard_normal(len(scene.plan.u))))
)


@hidden("gain_drift", "output", EVERY)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    path = rng.choice([-1.0, 1.0]) * _time(scene) ** rng.uniform(0.7, 1.5)
    return Drawn(lambda s: sensor(lambda y: y * (1 + s * path)), 1e-5, 1.0, lambda s: {"by_the_end": s * float(path[-1])})


def _instant(scene: Scene, rng: np.random.Generator) -> int:
    """Return a moment well inside the estimation samples."""
    return int(rng.uniform(0.2, 0.75) * scene.plan.estimation.sum())


@hidden("offset_step", "output", EVERY)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    n, sign, sd = _instant(scene, rng), rng.choice([-1.0, 1.0]), scene.noise.std

    def knob(s: float) -> Edit:
        return sensor(lambda y: y + sign * s * sd * (np.arange(len(y)) >= n))

    return Drawn(knob, 1e-2, 1e3, lambda s: {"at_s": n * scene.dt, "step": sign * s * sd})


@hidden("gain_step", "output", EVERY)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    n, sign = _instant(scene, rng), rng.choice([-1.0, 1.0])
    return Drawn(
        lambda s: sensor(lambda y: y * (1 + sign * s * (np.arange(len(y)) >= n))), 1e-5, 1.0,
        lambda s: {"at_s": n * scene.dt, "step": sign * s},
    )  # fmt: skip


@hidden("hum", "output", EVERY)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    omega, phase = rng.uniform(0.1, 0.9) * np.pi / scene.dt, rng.uniform(0, 2 * np.pi)
    third = rng.uniform(0.2, 0.4) if 3 * omega < 0.95 * np.pi / scene.dt and rng.random() < 0.5 else 0.0
    sd, t = scene.noise.std, np.arange(len(scene.plan.u)) * scene.dt
    wave = np.cos(omega * t + phase) + third * np.cos(3 * omega * t + 2 * phase)
    return Drawn(lambda s: sensor(lambda y: y + s * sd * wave), 1e-3, 1e3, lambda s: {"omega": omega, "amplitude": s * sd})


@hidden("outliers", "output", EVERY, random=True)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    n, sd = len(scene.plan.u), scene.noise.std
    order, size = rng.permutation(n), rng.choice([-1.0, 1.0], n) * rng.uniform(0.8, 1.3, n)

    def knob(s: float) -> Edit:  # more of them, then larger: s is about the rms in units of the noise
        share = float(np.clip((s / 10) ** 2, 4e-4, 6e-3))
        where = order[: max(3, round(share * n))]
        return converter(lambda y: _put(y, where, y[where] + size[where] * sd * s / np.sqrt(share)))

    return Drawn(knob, 1e-3, 1e2, lambda s: {"share": float(np.clip((s / 10) ** 2, 4e-4, 6e-3))})


def _put(y: Floats, where: np.ndarray, values: Floats) -> Floats:
    out = y.copy()
    out[where] = values
    return out


@hidden("dropouts", "output", EVERY, random=True)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    n = len(scene.plan.u)
    starts, lengths = rng.permutation(np.arange(10, n - 60, 30)), rng.integers(4, 25, n)

    def knob(s: float) -> Edit:  # s: samples frozen in all
        def frozen(y: Floats) -> Floats:
            out, left = y.copy(), max(3, round(s))
            for a, m in zip(starts.tolist(), lengths.tolist(), strict=False):
                m = min(m, left)
                out[a : a + m] = out[a - 1]
                left -= m
                if left < 3:  # two equal values in a row are no sign of anything
                    return out
            return out

        return converter(frozen)

    return Drawn(knob, 3.0, 10.0 * len(starts), lambda s: {"samples": round(s)})


# ----------------------------------------------------------------------------------------------------- loop and parallel
def _back(edit: Callable[[float], Element]) -> Knob:
    return lambda s: lambda world: replace(world, around=edit(s))


@hidden("feedback_static", "loop", (WH, H, W, HW, B, L))
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    (c, r), u = middle(scene.ranges[-1]), middle(scene.ranges[0])[1]
    sign, straight = rng.choice([-1.0, 1.0]), scene.plant.family != L and rng.random() < 0.5

    def shape(x: Floats) -> Floats:
        return x if straight else x**3

    return Drawn(
        _back(lambda s: Static(lambda y: sign * s * u * shape((y - c) / r))), 1e-4, 0.5,
        lambda s: {"gain": sign * s * u / r, "power": 1 if straight else 3},
    )  # fmt: skip


@hidden("feedback_dynamic", "loop", (WH, H, W, HW, B))
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    r, u = middle(scene.ranges[-1])[1], middle(scene.ranges[0])[1]
    sign, tau = rng.choice([-1.0, 1.0]), rng.uniform(20.0, 50.0) * scene.dt
    return Drawn(
        _back(lambda s: Filter((sign * s * u / r,), (tau, 1.0))), 1e-4, 0.5,
        lambda s: {"gain": sign * s * u / r, "tau": tau},
    )  # fmt: skip


@hidden("parallel_linear", "parallel", (WH, H, W, HW))
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    r, u = middle(scene.ranges[-1])[1], middle(scene.ranges[0])[1]
    sign, tau = (
        rng.choice([-1.0, 1.0]),
        (rng.uniform(1.0, 2.0) if rng.random() < 0.5 else rng.uniform(20.0, 40.0)) * scene.dt,
    )

    def knob(s: float) -> Edit:
        return lambda world: replace(world, beside=Filter((sign * s * r / u,), (tau, 1.0)))

    return Drawn(knob, 1e-4, 1.0, lambda s: {"gain": sign * s * r / u, "tau": tau})


@hidden("friction", "parallel", (WH, H, W, HW, L))
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    r, u = middle(scene.ranges[-1])[1], middle(scene.ranges[0])[1]
    sign, viscous = rng.choice([-1.0, 1.0]), rng.uniform(0.0, 1.0) if rng.random() < 0.5 else 0.0

    def force(s: float) -> Element:
        return Static(lambda v: sign * s * r * (np.sign(v) + viscous * v / u))

    return Drawn(
        lambda s: lambda world: replace(world, beside=force(s)), 1e-5, 1.0,
        lambda s: {"coulomb": sign * s * r, "viscous": sign * s * r * viscous / u},
    )  # fmt: skip


# ----------------------------------------------------------------------------------------------------------------- time
def _read(change: Callable[[float], Callable[[Floats], Floats]]) -> Knob:
    def knob(s: float) -> Edit:
        def edit(world: World) -> World:
            before = world.read or (lambda n: n)
            return replace(world, read=lambda n: change(s)(before(n)))

        return edit

    return knob


@hidden("delay", "time", MOVING)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    return Drawn(_read(lambda s: lambda n: n - s), 2e-3, 20.0, lambda s: {"seconds": s * scene.dt})


@hidden("clock_skew", "time", MOVING)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    sign, total = rng.choice([-1.0, 1.0]), len(scene.plan.u)
    return Drawn(_read(lambda s: lambda n: n + sign * s * n / total), 5e-3, 60.0, lambda s: {"skew": sign * s / total})


@hidden("jitter", "time", MOVING, random=True)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    draw = rng.standard_normal(len(scene.plan.u))
    return Drawn(_read(lambda s: lambda n: n + s * draw), 1e-3, 5.0, lambda s: {"std_s": s * scene.dt})


@hidden("intersample", "time", MOVING)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    """The input runs straight from sample to sample; its strength is what it is: here the knob is the noise (see case)."""
    return Drawn(lambda s: lambda world: replace(world, between="foh"), 1.0, 1.0, lambda s: {"actual": "foh"})


# ---------------------------------------------------------------------------------------------------------------- noise
def _noisy(draw: Callable[[float], Callable[[Floats], Floats]]) -> Knob:
    return lambda s: lambda world: replace(world, noise=(*world.noise, draw(s)))


@hidden("coloured_noise", "noise", EVERY, random=True)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    a, n = rng.uniform(0.8, 0.97), len(scene.plan.u)
    e = lfilter([1.0], [1.0, -a], rng.standard_normal(n + 500))[500:] * np.sqrt(1 - a**2) * scene.noise.std
    return Drawn(_noisy(lambda s: lambda x: s * e), 1e-3, 1e2, lambda s: {"pole": float(a), "std": s * scene.noise.std})


@hidden("process_noise", "noise", (WH, H, W), random=True)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    k = scene.plant.place["nonlinearity"]
    r, e = middle(scene.ranges[k])[1], rng.standard_normal(len(scene.plan.u))
    e = np.concatenate([np.zeros(LEAD), e])

    def element(s: float) -> Element:
        def added(v: Fine) -> Fine:
            held = np.repeat(s * r * e, v.factor)
            return v + v.of(held, held)

        return added

    return Drawn(
        lambda s: lambda world: world.inserted(world.at(f"part {k}"), "hidden", element(s)), 1e-5, 1.0,
        lambda s: {"std": s * r},
    )  # fmt: skip


@hidden("level_noise", "noise", EVERY, random=True)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    e, size = rng.standard_normal(len(scene.plan.u)), float(np.sqrt(np.mean(scene.output**2)))
    return Drawn(
        _noisy(lambda s: lambda x: s * scene.noise.std * e * np.abs(x) / size), 1e-3, 1e2,
        lambda s: {"std_per_output": s * scene.noise.std / size},
    )  # fmt: skip


# -------------------------------------------------------------------------------------------------- not in the library
def _in_place(scene: Scene, rng: np.random.Generator, make: Callable[[Part, float], Element]) -> Knob:
    """Return a knob that puts something in the place of one of the linear parts."""
    k = int(rng.choice([i for i, part in enumerate(scene.plant.parts) if part.kind == "linear"]))
    return lambda s: lambda world: world.replaced(f"part {k}", make(scene.plant.parts[k], s))


@hidden("amplitude_pole", "outside", (WH, H, W, L), table=OUTSIDE)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    """A lag that gets slower with the square of what it holds: τ(x) = τ·(1 + s·(x/X)²)."""

    def make(part: Part, s: float) -> Element:
        slowest = part.numbers[-2] * (1.0 if len(part.numbers) == 3 else 0.7)
        rest: Element = Filter((part.numbers[0],), part.numbers[1:])

        def pole(signal: Fine) -> Fine:
            v, h = signal.start, signal.h
            size2 = float(np.abs(v).max()) ** 2
            x, out, c = float(v[0]), np.empty(len(v)), h / slowest
            for k, target in enumerate(v.tolist()):
                out[k] = x
                x += (target - x) * (1 - np.exp(-c / (1 + s * x * x / size2)))
            return signal.of(out)

        return _quotient(rest, slowest, pole)

    return Drawn(_in_place(scene, rng, make), 1e-3, 20.0, lambda s: {"slower_by": s})


def _quotient(whole: Element, tau: float, pole: Element) -> Element:
    """Return whole, its share of one lag exchanged for another: whole + (pole − lag) behind it."""

    def run(signal: Fine) -> Fine:
        out = whole(signal)
        return out + pole(out) + Filter((1.0,), (tau, 1.0))(out).scaled(-1.0)

    return run


@hidden("self_heating", "outside", (WH, H, W, HW, M, L), table=OUTSIDE)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    """A gain that falls with a temperature, which the power of the output heats slowly."""
    tau, size2 = rng.uniform(150.0, 500.0) * scene.dt, float(np.mean(scene.output**2))

    def heated(s: float) -> Element:
        def run(signal: Fine) -> Fine:
            heat = Filter((1 / size2,), (tau, 1.0))(signal.mapped(np.square))
            factor = 1 - s * heat.start
            return signal.of(signal.start * factor, signal.end * (1 - s * heat.end))

        return run

    return Drawn(lambda s: at_output(heated(s), "hidden"), 1e-4, 0.5, lambda s: {"gain_lost": s, "tau": tau})


@hidden("bouc_wen", "outside", (WH, H, W, L), table=OUTSIDE)
def _(scene: Scene, rng: np.random.Generator) -> Drawn:
    """Hysteresis with a memory of its own: v + s·V·z, z′ = v̇/x₀·(1 − |z|·(½ + ½·sign(v̇z)))."""
    k = len(scene.plant.parts) - 1 if scene.plant.parts[-1].kind == "linear" else 1
    r = middle(scene.ranges[k])[1]
    x0 = rng.uniform(0.1, 0.3) * r

    def element(s: float) -> Element:
        def run(signal: Fine) -> Fine:
            v = np.stack([signal.start, signal.end], axis=1).ravel()
            z, out = 0.0, np.empty(len(v))
            for j, dv in enumerate(np.diff(v, prepend=v[0]).tolist()):
                if dv:
                    pieces = max(1, int(abs(dv) / (0.05 * x0)))  # a step of a held input is many small ones
                    for _ in range(pieces):
                        z += dv / (pieces * x0) * (1 - abs(z) * (0.5 + 0.5 * np.sign(dv * z)))
                out[j] = z
            total = v + s * r * out
            return signal.of(total[::2], total[1::2])

        return run

    return Drawn(
        lambda s: lambda world: world.inserted(world.at(f"part {k}"), "hidden", element(s)), 1e-4, 1.0,
        lambda s: {"strength": s, "x0": x0},
    )  # fmt: skip
