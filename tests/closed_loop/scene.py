"""A case before anything is wrong: a plant, an experiment, the noise; and how much of a change a refit cannot absorb."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tests.closed_loop.fine import Floats, fine
from tests.closed_loop.plan import Plan, draw_plan
from tests.closed_loop.plants import CURVES, KINKED, Plant, draw_plant
from tests.closed_loop.world import Noise, World

STEP = 1e-4  # of finite differences, relative


@dataclass(frozen=True)
class Scene:
    """Plant, plan and noise of one seed."""

    seed: int
    plant: Plant
    plan: Plan
    noise: Noise

    @property
    def dt(self) -> float:
        """Return the sampling time."""
        return self.plan.dt

    @cached_property
    def world(self) -> World:
        """Return the plant as it is declared, with nothing wrong."""
        return World.of(self.plant)

    @cached_property
    def output(self) -> Floats:
        """Return its undisturbed output."""
        return self.world.undisturbed(self.plan)

    @cached_property
    def ranges(self) -> list[tuple[float, float]]:
        """Return the range of what goes into every part, and of the output."""
        seen = self.plant.inputs(fine(self.plan.u, self.dt))
        return [(float(s.start.min()), float(s.start.max())) for s in seen]

    @cached_property
    def absorbed(self) -> Floats:
        """Return an orthonormal basis of what a refit of the declared numbers can absorb, on the estimation samples."""
        columns = []
        for i, k in self.plant.numbers():
            size = abs(self.plant.parts[i].numbers[k]) or 1.0
            if k in self.plant.parts[i].breaks:
                size = self.ranges[i][1] - self.ranges[i][0]
            both = [World.of(self.plant.moved((i, k), sign * STEP * size)).undisturbed(self.plan) for sign in (1, -1)]
            columns.append((both[0] - both[1])[self.plan.estimation] / (2 * STEP))
        jacobian = np.stack(columns, axis=1)
        size = np.linalg.norm(jacobian, axis=0)  # 0: a jump between two values that a held signal takes
        left, s, _ = np.linalg.svd(jacobian[:, size > 0] / size[size > 0], full_matrices=False)
        return np.asarray(left[:, s > 1e-7 * s[0]])

    def left_over(self, change: Floats) -> float:
        """Return the rms of what no refit can absorb of a change of y, over that of the white noise."""
        part = change[self.plan.estimation]
        rest = part - self.absorbed @ (self.absorbed.T @ part)
        return float(np.sqrt(np.mean(rest**2))) / self.noise.std

    def size(self, world: World, *, random: bool, noise_seed: np.random.SeedSequence) -> float:
        """Return the visible size of what is wrong in a world: projected, or as it is where it is random."""
        if not random:
            return self.left_over(world.clean(self.plan) - self.output)
        e = self.noise.draw(len(self.plan.u), np.random.default_rng(noise_seed))
        change = (world.measured(self.plan, e) - self.output - e)[self.plan.estimation]
        return float(np.sqrt(np.mean(change**2))) / self.noise.std


def draw_scene(seed: int, family: str, *, kinked: bool = False, coloured: bool = False) -> Scene:
    """Return the scene of a seed; `kinked` asks for a curve with corners, `coloured` for autoregressive noise."""
    rng = np.random.default_rng([seed, 1])
    dt = float(rng.choice([0.01, 0.02, 0.05, 0.1, 0.25]))
    plan = draw_plan(rng, rng.uniform(8.0, 15.0), dt)
    curve = str(rng.choice(KINKED if kinked else CURVES))
    plant = draw_plant(rng, family, plan.low, plan.high, dt, curve)
    share, a = rng.uniform(0.008, 0.02), rng.uniform(0.4, 0.8)
    level = float(share * np.std(World.of(plant).undisturbed(plan)))
    noise = Noise(level, (float(a),)) if coloured else Noise(level)
    return Scene(seed, plant, plan, noise)
