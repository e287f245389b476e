"""Coulomb friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from whid.blocks._block import Free
from whid.blocks._static import Static
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Coulomb(Static):
    """Dry friction: a force of constant size against the direction of motion.

    w = force·sign(v) + offset, sign(0) = 0

          w
          ├─────── offset + force
    ──────●──────► v
    ──────┤        offset − force

    force and offset in output units; v a velocity. At rest it gives the offset: sticking is not modelled.
    Source [Janot2019], the friction model of the positioning system.

    >>> Coulomb(force=20.0, offset=-3.0)([-0.1, 0.0, 0.2], dt=1.0)
    array([-23.,  -3.,  17.])
    """

    force: Annotated[float, Free("output")]
    offset: Annotated[float, Free("output")] = 0.0

    def value(self, v: Floats) -> Floats:
        """Return the friction force."""
        return np.asarray(self.force * np.sign(v) + self.offset)

    def derivative(self, v: Floats) -> Floats:
        """Return 0."""
        return np.zeros(np.shape(v))

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return the derivative of w with respect to force or offset."""
        return np.array(np.sign(v)) if name == "force" else np.ones(np.shape(v))

    def breakpoints(self) -> Floats:
        """Return 0: the jump."""
        return np.zeros(1)

    def jumps(self) -> Floats:
        """Return twice the force."""
        return np.array([2 * self.force])
