"""One case of the closed loop: a record with something undeclared in it, the study a user would write, and the truth.

    python -m tests.closed_loop.case 101 saturation@input --size 0.5 --into folder --truth elsewhere

The strength of an effect is solved for so that it is as visible as asked: the rms of what no refit of the declared numbers
absorbs of its change of y, over the rms of the white noise (random effects: nothing is absorbed).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from tests.closed_loop.fine import Floats
from tests.closed_loop.hidden import EFFECTS, OUTSIDE, Drawn, Hidden
from tests.closed_loop.plants import FAMILIES, ROUGH, Part
from tests.closed_loop.scene import Scene, draw_scene
from tests.closed_loop.world import Noise

CLOSE = 0.02  # of the visible size asked for; of a random one, which comes in lumps, 0.15
LUMPS = 0.15
NOISE_OFF = 0.15
TRIES = 8
LUMPY = ("dropouts", "outliers")  # whose size moves in lumps: other places, another try


class NotVisible(Exception):
    """No strength within reason makes this effect so visible on this plant."""


class Case(NamedTuple):
    """What is written: the record, the study, and what only the scoring reads."""

    name: str
    u: Floats
    y: Floats
    study: dict[str, Any]
    truth: dict[str, Any]


def draw_case(seed: int, effects: Sequence[str], size: float, *, family: str | None = None, coloured: bool = False) -> Case:
    """Return the case of a seed: `effects` hidden (kind@place[/variant]; none: a control), each visible at `size`.

    The family, where it is not given, is drawn among those in which every effect is what it is called. Raises `NotVisible`.
    """
    entries = [(EFFECTS | OUTSIDE)[name] for name in effects]
    scene = _scene(seed, entries, family, coloured)
    world, found = scene.world, []
    for number, entry in enumerate(entries):
        if entry.kind == "intersample":
            drawn = entry.draw(scene, np.random.default_rng([seed, 2, number]))
            scene, strength, seen = _quieter(scene, drawn, size)
        else:
            drawn, strength, seen = _solved(scene, entry, number, size)
        world = drawn.knob(strength)(world)
        found.append({"kind": entry.kind, "place": entry.place, "size": seen, "parameters": drawn.truth(strength)})
    noise = scene.noise.draw(len(scene.plan.u), np.random.default_rng([seed, 3]))
    y = world.measured(scene.plan, noise).astype(np.float32).astype(float)
    floor = float(np.sqrt(np.mean(noise[~scene.plan.estimation] ** 2)))
    return _case(seed, scene, entries, found, y, size, floor)


def _scene(seed: int, entries: Sequence[Hidden], family: str | None, coloured: bool) -> Scene:
    rng = np.random.default_rng([seed, 0])
    common = [f for f in FAMILIES if all(f in entry.families for entry in entries)]
    if not common or (family is not None and family not in common):
        raise NotVisible(f"{family or 'no family'} can hide {', '.join(e.name for e in entries)}")
    chosen = family or str(rng.choice(common))
    return draw_scene(seed, chosen, kinked=any(e.kind == "soft_knee" for e in entries), coloured=coloured)


def _solved(scene: Scene, entry: Hidden, number: int, size: float) -> tuple[Drawn, float, float]:
    """Return an effect's particulars, strength and size; other particulars where some cannot be so visible."""
    for attempt in range(TRIES):
        drawn = entry.draw(scene, np.random.default_rng([scene.seed, 2, number, attempt]))
        try:
            return drawn, *solve(scene, entry, drawn, size)
        except NotVisible:
            if attempt == TRIES - 1 or entry.kind not in LUMPY:
                raise
    raise AssertionError


def solve(scene: Scene, entry: Hidden, drawn: Drawn, size: float) -> tuple[float, float]:
    """Return the strength at which an effect is visible at `size`, and the size that it then has."""
    noise_seed = np.random.SeedSequence([scene.seed, 3])

    def seen(s: float) -> float:
        try:
            return scene.size(drawn.knob(s)(scene.world), random=entry.random, noise_seed=noise_seed)
        except ArithmeticError:
            return float("inf")

    low, high = drawn.least, drawn.most
    small, big = None, None
    s = float(np.sqrt(low * high)) if entry.random else min(high, low * 30)
    close = LUMPS if entry.random else CLOSE
    for _ in range(40):
        now = seen(s)
        if abs(now / size - 1) < close / 2:
            return s, now
        if now < size:
            low, small = s, now
        else:
            high, big = s, now
        if high / low < 1 + 1e-7:
            break
        if small is None or big is None:  # not bracketed yet: by power law, at most a factor 30
            if s >= drawn.most or s <= drawn.least:
                break
            factor = np.clip(size / max(now, 1e-12), 1 / 30, 30.0) * (1.1 if now < size else 0.9)
            s = float(np.clip(s * factor, drawn.least, drawn.most))
        else:
            slope = np.log(size / max(small, 1e-9)) / np.log(max(big, 1e-9) / max(small, 1e-9)) if np.isfinite(big) else 0.5
            s = float(low * (high / low) ** np.clip(slope, 0.1, 0.9))
    now = seen(s)
    if abs(now / size - 1) < close:
        return s, now
    raise NotVisible(f"{entry.name} on seed {scene.seed}: {now:.3g} of the noise at strength {s:.3g}, asked for {size:g}")


def _quieter(scene: Scene, drawn: Drawn, size: float) -> tuple[Scene, float, float]:
    """Return the scene with as much noise as makes a fixed effect visible at `size`."""
    seen = scene.size(drawn.knob(1.0)(scene.world), random=False, noise_seed=np.random.SeedSequence(0))
    if seen < 1e-3:
        raise NotVisible("the input is held, whatever it does between samples")
    noise = Noise(scene.noise.std * seen / size, scene.noise.coefficients)
    again = replace(scene, noise=noise)
    return again, 1.0, again.size(drawn.knob(1.0)(again.world), random=False, noise_seed=np.random.SeedSequence(0))


def _case(
    seed: int, scene: Scene, entries: Sequence[Hidden], found: list[dict[str, Any]], y: Floats, size: float, floor: float
) -> Case:
    name = f"case-{seed}"
    rng = np.random.default_rng([seed, 4])
    truth = {
        "name": name,
        "seed": seed,
        "family": scene.plant.family,
        "size": size if entries else 0.0,
        "noise_std": scene.noise.whole,
        "innovation_std": scene.noise.std,
        "report_noise_rms": floor,
        "outside": any(entry.place == "outside" for entry in entries),
        "random": any(entry.random for entry in entries),
        "effects": [e | {"alike": list(entry.alike(scene))} for e, entry in zip(found, entries, strict=True)],
        "plant": [part.declared() for part in scene.plant.parts],
    }
    study = {
        "name": name,
        "data": {
            "file": f"{name}.npz",
            "columns": {"input": "u", "output": "y"},
            "dt": scene.dt,
            "units": {"input": "V", "output": "V"},
            "intersample": "zoh",
            "initial": "steady",
            "parts": scene.plan.parts,
        },
        "model": {"chain": [part.declared() for part in believed(scene, rng)], "noise": _noise(scene.noise, rng)},
        "identify": {"kind": "fit", "noise": "ar"} if scene.noise.coefficients else {"kind": "fit"},
        "trace": {"effects": "all"},
    }
    return Case(name, scene.plan.u, y, study, truth)


def believed(scene: Scene, rng: np.random.Generator) -> list[Part]:
    """Return the plant as a user believes it to be."""
    return [part.rough(rng, *scene.ranges[i]) for i, part in enumerate(scene.plant.parts)]


def _noise(noise: Noise, rng: np.random.Generator) -> dict[str, Any]:
    std = float(f"{noise.whole * (1 + rng.uniform(-NOISE_OFF, NOISE_OFF)):.3g}")
    if not noise.coefficients:
        return {"kind": "white", "std": std}
    a = [round(float(np.clip(x * (1 + rng.uniform(-ROUGH, ROUGH)), -0.95, 0.95)), 3) for x in noise.coefficients]
    return {"kind": "ar", "coefficients": a, "std": std}


def write(case: Case, folder: Path, truth: Path | None = None) -> Path:
    """Write record and study into a folder, the truth into another one; return the study's path."""
    folder.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(folder / f"{case.name}.npz", u=case.u.astype(np.float32), y=case.y.astype(np.float32))
    path = folder / f"{case.name}.yaml"
    path.write_text(yaml.safe_dump(case.study, sort_keys=False, default_flow_style=None, width=125))
    if truth is not None:
        if truth.resolve() == folder.resolve():
            raise ValueError("the truth has no place beside the record")
        truth.mkdir(parents=True, exist_ok=True)
        (truth / f"{case.name}.json").write_text(json.dumps(finite(case.truth), indent=1) + "\n")
    return path


def finite(value: Any) -> Any:
    """Return a value without numpy numbers, infinities as null."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not np.isfinite(value) else value


def main() -> None:
    """Write one case."""
    parser = argparse.ArgumentParser(description="Write a record with undeclared effects, its study and its truth.")
    parser.add_argument("seed", type=int, help="development below 20000; 50000 and above are held out")
    parser.add_argument("effects", nargs="*", help=f"none for a control; {', '.join([*EFFECTS, *OUTSIDE])}")
    parser.add_argument("--size", type=float, default=0.5)
    parser.add_argument("--family")
    parser.add_argument("--coloured", action="store_true", help="declared autoregressive noise instead of white")
    parser.add_argument("--into", type=Path, default=Path("runs/closed_loop"))
    parser.add_argument("--truth", type=Path, default=Path("runs/closed_loop-truth"))
    given = parser.parse_args()
    case = draw_case(given.seed, given.effects, given.size, family=given.family, coloured=given.coloured)
    print(write(case, given.into, given.truth))


if __name__ == "__main__":
    main()
