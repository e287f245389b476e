"""How likely noise is that came through a linear block with a size of its own at every sample, or walks: a Kalman filter."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.blocks.linear import Linear
from whid.signal import Floats

REACH = np.geomspace(1 / 30, 30, 9)  # of a first guess of the ratio


class Through(NamedTuple):
    """σ² of the white noise beside it, that of the noise ahead, its standard error, nats over white noise alone."""

    base: float
    share: float
    share_std: float
    nats: float


def through(error: Floats, use: NDArray[np.bool_], slope: Floats, block: Linear, dt: float, guess: float) -> Through:
    """Return the likeliest e = G(slope·w) + white, w ~ N(0, share) held between samples [Kalman 1960].

    error, slope (N,), use (N,) where the error counts; guess: of share/base. For a ratio the best σ² is the mean of ν²/S;
    the ratio by a grid and a parabola through its top. G must not answer at once (D = 0).

    >>> rng = np.random.default_rng(0)
    >>> w, on = rng.standard_normal(4000), np.ones(4000, bool)
    >>> slope = np.where(np.arange(4000) % 200 < 100, 1.0, 0.1)
    >>> lag = Linear(num=(1.0,), den=(5.0, 1.0))
    >>> e = lag(slope * w, 1.0, "zoh") + 0.2 * rng.standard_normal(4000)
    >>> found = through(e, on, slope, lag, 1.0, 10.0)
    >>> abs(found.share - 1.0) < 4 * found.share_std, abs(found.base - 0.04) < 0.005
    (True, True)
    """
    from scipy.linalg import expm, solve_discrete_lyapunov

    a, b, c, _ = block.state_space()
    s = len(b)
    both = expm(np.block([[a, b[:, None]], [np.zeros((1, s + 1))]]) * dt)
    phi, gamma = both[:s, :s], both[:s, s]
    settled = solve_discrete_lyapunov(phi, np.outer(gamma, gamma)) * np.mean(slope**2)
    return _likeliest(error, use, slope**2, (phi, gamma, c), settled, guess * REACH)


def walking(error: Floats, use: NDArray[np.bool_], guess: float) -> Through:
    """Return the likeliest e = walk + white, the walk's steps N(0, share), wherever it began.

    >>> rng = np.random.default_rng(0)
    >>> e = np.cumsum(0.02 * rng.standard_normal(4000)) + rng.standard_normal(4000)
    >>> found = walking(e, np.ones(4000, bool), 1e-3)
    >>> abs(found.share - 0.02**2) < 4 * found.share_std, found.nats > 50
    (True, True)
    """
    one = np.ones(1)
    return _likeliest(error, use, np.ones(len(error)), (one[None], one, one), np.eye(1) * len(error), guess * REACH)


def _likeliest(
    error: Floats, use: NDArray[np.bool_], size: Floats, system: tuple[Floats, Floats, Floats], start: Floats, ratios: Floats
) -> Through:
    phi, gamma, c = system
    drive = np.outer(gamma, gamma) * ratios[:, None, None]
    x, p = np.zeros((len(ratios), len(c))), start * ratios[:, None, None]
    squares, logs = np.zeros(len(ratios)), np.zeros(len(ratios))
    for e, on, now in zip(error.tolist(), use.tolist(), size.tolist(), strict=True):
        if on:
            pc = p @ c
            spread = pc @ c + 1.0
            off = e - x @ c
            squares += off**2 / spread
            logs += np.log(spread)
            gain = pc / spread[:, None]
            x = x + gain * off[:, None]
            p = p - gain[:, :, None] * pc[:, None, :]
        x = x @ phi.T
        p = phi @ p @ phi.T + now * drive
    n = int(use.sum())
    nats = -n / 2 * np.log(squares / n) - logs / 2 + n / 2 * np.log(np.mean(error[use] ** 2))
    k = int(np.clip(np.argmax(nats), 1, len(ratios) - 2))
    low, here, high = nats[k - 1 : k + 2]
    step, bend = float(np.log(REACH[1] / REACH[0])), low - 2 * here + high
    move = float(np.clip((low - high) / (2 * bend), -1, 1)) if bend < 0 else 0.0
    base = float(np.interp(move, [-1, 0, 1], squares[k - 1 : k + 2] / n))
    share = float(ratios[k] * np.exp(step * move)) * base
    std = step / np.sqrt(-bend) if bend < 0 else np.inf  # of log share
    return Through(base, share, share * float(std), float(here - bend * move**2 / 2))
