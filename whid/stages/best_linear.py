"""Best linear approximation: the frequency response that explains most of an output, with what it leaves over."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.errors import WhidError
from whid.quantity import Quantity, Table
from whid.signal import Floats

Complexes = NDArray[np.complex128]
SHORT = 8192  # samples below which windows would be too short to tell slow poles
HALF = 7  # lines on either side of a local polynomial
ENOUGH = 40  # lines
OVERLAP = 1 + 2 / 36  # variance of an average of half-overlapping Hann windows, over that of as many separate ones


class BestLinear(NamedTuple):
    """Frequency response with standard error (noise and nonlinear distortion together), at the excited lines.

    noise is the part of std that changes from period to period (only several realisations of a multisine tell it, NaN
    otherwise); the rest is nonlinear distortion.
    """

    omega: Annotated[Floats, Quantity("rad/s", ("omega",))]
    response: Annotated[Complexes, Quantity("output/input", ("omega",), error="std")]
    std: Annotated[Floats, Quantity("output/input", ("omega",))]
    noise: Annotated[Floats, Quantity("output/input", ("omega",))]
    coherence: Annotated[Floats, Quantity("1", ("omega",))]
    averages: int
    dt: Annotated[float, Quantity("s")]

    def table(self) -> Table:
        """Return the band and what is linear in it."""
        low, high = self.omega[[0, -1]] / (2 * np.pi)
        gain, std = np.abs(self.response).max(), np.median(self.std)
        row = (
            len(self.omega), float(f"{low:.4g}"), float(f"{high:.4g}"), self.averages, float(f"{gain:.4g}"),
            float(f"{std:.3g}"), float(f"{np.median(self.coherence):.4g}"),
        )  # fmt: skip
        columns = ("lines", "from Hz", "to Hz", "averages", "largest gain", "median std", "median coherence")
        told = f"of the median std {np.median(self.noise):.3g} is noise, the rest nonlinear distortion"
        return Table("Best linear approximation", columns, (row,), (told,) if np.isfinite(self.noise).all() else ())


def best_linear(
    stretches: Sequence[tuple[Floats, Floats]], dt: float, window: int = 2048, faintest: float = 1e-3
) -> BestLinear:
    """Return the response by Welch's cross-spectrum, standard errors from the coherence.

    G = S_yu/S_uu, std² = |G|²(1 − γ²)/(2γ²·averages), γ² = |S_yu|²/(S_uu·S_yy): Hann windows, half overlapping. Lines
    where S_uu < faintest·max are left out, and the two lowest (mean and trend).

    stretches: (u, y) without gaps; window in samples, halved until there are eight. Raises `WhidError("stage-too-short")`.
    Source [Bendat and Piersol 2010, Random Data], eq. (9.90); [Pintelon and Schoukens 2012], section 3.4.

    >>> rng = np.random.default_rng(0)
    >>> u = rng.normal(size=20000)
    >>> found = best_linear([(u, 2 * u + 0.1 * rng.normal(size=20000))], 1.0, 256)
    >>> bool(np.mean(np.abs(found.response - 2) ** 2 / (2 * found.std**2)) < 1.2)
    True
    """
    while window > 64 and _count(stretches, window) < 8:
        window //= 2
    count = _count(stretches, window)
    if count < 3:
        raise WhidError("stage-too-short", f"no three windows of {window} samples fit into the estimation parts")
    suu, syy, suy = np.zeros(window // 2 + 1), np.zeros(window // 2 + 1), np.zeros(window // 2 + 1, complex)
    taper = np.hanning(window + 1)[:-1]
    for u, y in stretches:
        for start in range(0, len(u) - window + 1, window // 2):
            a, b = (np.fft.rfft(taper * (x[start : start + window] - x[start : start + window].mean())) for x in (u, y))
            suu, syy, suy = suu + np.abs(a) ** 2, syy + np.abs(b) ** 2, suy + np.conj(a) * b
    line = np.arange(window // 2 + 1)
    keep = (line >= 2) & (line < window // 2) & (suu > faintest * suu.max())
    response, averages = suy[keep] / suu[keep], count / OVERLAP
    coherence = np.clip(np.abs(suy[keep]) ** 2 / np.maximum(suu * syy, 1e-300)[keep], 1e-12, 1 - 1e-12)
    std = np.abs(response) * np.sqrt((1 - coherence) / (2 * coherence * averages))
    omega = 2 * np.pi * line[keep] / (window * dt)
    return BestLinear(omega, response, std, np.full(len(omega), np.nan), coherence, count, dt)


def local_polynomial(u: Floats, y: Floats, dt: float, faintest: float = 1e-3) -> BestLinear:
    """Return the response of one short stretch: near each line G and the leakage are parabolas in the frequency.

    Y(k + r) = (g₀ + g₁r + g₂r²)·U(k + r) + t₀ + t₁r + t₂r² + noise, |r| ≤ 7, at every fourth line; std from the residual, as
    if lines that share neighbours did not. Source [Pintelon and Schoukens 2012], section 7.2.2.

    >>> rng = np.random.default_rng(0)
    >>> u = rng.normal(size=600)
    >>> found = local_polynomial(u, 2 * u + 0.1 * rng.normal(size=600), 1.0)
    >>> bool(np.mean(np.abs(found.response - 2) ** 2 / (2 * found.std**2)) < 2)
    True
    """
    a, b = np.fft.rfft(u - u.mean()), np.fft.rfft(y - y.mean())
    strength = np.abs(a) ** 2
    if np.sum(strength[1:-1:4] > faintest * strength.max()) < ENOUGH and faintest > 1e-12:
        return local_polynomial(u, y, dt, faintest / 10)  # a staircase: strong at a few lines, still known at many
    lines, response, std, share = [], [], [], []
    for k in range(1, len(a) - 1, 4):
        near = np.arange(max(1, k - HALF), min(len(a) - 1, k + HALF + 1))
        if len(near) <= 8 or strength[near].mean() < faintest * strength.max():
            continue
        r = (near - k)[:, None] ** np.arange(3) / HALF ** np.arange(3)
        design = np.hstack([r * a[near, None], r])
        g, *_ = np.linalg.lstsq(design, b[near], rcond=None)
        left = b[near] - design @ g
        variance = float(np.sum(np.abs(left) ** 2)) / (len(near) - 6) * np.linalg.pinv(design.conj().T @ design)[0, 0].real
        lines.append(k)
        response.append(g[0])
        std.append(np.sqrt(variance / 2))
        share.append(1 - float(np.sum(np.abs(left) ** 2)) / max(float(np.sum(np.abs(b[near]) ** 2)), 1e-300))
    if len(lines) < 4:
        raise WhidError("stage-too-short", "too few excited frequency lines in the estimation parts")
    omega = 2 * np.pi * np.array(lines) / (len(u) * dt)
    floor = 1e-3 * float(np.median(std)) + 1e-300
    return BestLinear(
        omega, np.array(response), np.maximum(std, floor), np.full(len(lines), np.nan), np.array(share), 1, dt
    )  # fmt: skip


def realisations(periods: Sequence[tuple[Floats, Floats]], dt: float, faintest: float = 1e-3) -> BestLinear:
    """Return the response by the robust method: noise from the scatter of periods, distortion from that of realisations.

    G_r = mean over periods Y/U; G = mean G_r, std² = var(G_r)/R of either part; noise² the share of it that the scatter from
    period to period explains, the rest is nonlinear distortion. Excited lines only.

    periods: (u, y) of each realisation, (P, N) each, settled, one N. Source [Pintelon and Schoukens 2012], section 4.3.1.
    """
    spectra = [(np.fft.rfft(u.mean(axis=0)), np.fft.rfft(y, axis=1)) for u, y in periods]
    strength = np.mean([np.abs(u) ** 2 for u, _ in spectra], axis=0)
    keep = strength > faintest * strength[1:].max()
    keep[0] = False
    each = np.array([y.mean(axis=0)[keep] / u[keep] for u, y in spectra])
    jitter = np.array([np.var(y[:, keep], axis=0, ddof=1) / len(y) / np.abs(u[keep]) ** 2 for u, y in spectra])
    count, response = len(each), each.mean(axis=0)
    scatter = np.mean(np.abs(each - response) ** 2, axis=0) * count / (count - 1)
    std, noise = np.sqrt(scatter / (2 * count)), np.sqrt(jitter.mean(axis=0) / (2 * count))
    omega = 2 * np.pi * np.flatnonzero(keep) / (periods[0][0].shape[1] * dt)
    explained = np.abs(response) ** 2 / (np.abs(response) ** 2 + scatter)
    return BestLinear(omega, response, _smooth(std), noise, explained, count, dt)


def _smooth(std: Floats) -> Floats:
    """Average variances over neighbouring lines: those of a few realisations scatter too much to weigh with."""
    kernel = np.ones(min(9, len(std) | 1))
    return np.asarray(np.sqrt(np.convolve(std**2, kernel, "same") / np.convolve(np.ones(len(std)), kernel, "same")))


def _count(stretches: Sequence[tuple[Floats, Floats]], window: int) -> int:
    return sum(max(0, (len(u) - window) // (window // 2) + 1) for u, _ in stretches)
