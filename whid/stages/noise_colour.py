"""Whether the noise is white, as the standard errors of a method assume."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from whid.quantity import Table
from whid.signal import Floats

LAGS = 20  # that are tested
FARTHEST = 400  # lag up to which correlations are summed
SIGNIFICANCE = 1e-4  # a warning needs more than the odd per cent
ROUNDING = 1e-9  # of the output's range: as small as noise-free data get


class NoiseColour(NamedTuple):
    """Noise colour: whether neighbouring samples of what a fit leaves over know of each other (Ljung and Box)."""

    statistic: float  # χ²(lags)
    lags: int
    p: float
    correlation: float  # of neighbouring samples
    factor: float  # by which the standard error of what varies slowly is larger than white noise makes it
    white: bool

    def table(self) -> Table:
        """Return one row and the verdict."""
        row = (float(f"{self.statistic:.4g}"), self.lags, float(f"{self.p:.3g}"), float(f"{self.correlation:.3g}"))
        verdict = "white, as the standard errors assume" if self.white else self._found
        verdict = verdict if self.lags else "nothing is left over to test"
        return Table("Colour of the noise", ("χ²", "lags", "p", "neighbours correlate by"), (row,), (verdict,))

    def doubts(self) -> tuple[str, ...]:
        """Return the warning of standard errors that do not hold."""
        if self.white:
            return ()
        better = "`whid fit` with `identify: {kind: fit, noise: ar}` from the model found has errors that allow for it"
        return (f"coloured noise, or a drift or misfit that looks like it: {self._found}; {better}",)

    @property
    def _found(self) -> str:
        how = "small" if self.factor > 1 else "large"
        return (
            f"neighbouring samples of what is left over correlate by {self.correlation:.2g} (p = {self.p:.2g}), and the "
            f"standard errors assume white noise: they are too {how}, by about {max(self.factor, 1 / self.factor):.2g}"
        )


def noise_colour(residuals: Sequence[Floats], regressors: Sequence[Floats] = (), lost: Sequence[float] = ()) -> NoiseColour:
    """Test whether residuals are white: Q = N(N + 2) Σ ρ_k²/(N − k) ~ χ²(lags), ρ_k pooled over stretches of one scale each.

    residuals: one (N_i,) a stretch, NaN where missing; a quarter of the longest holds 5 lags or there is no test. regressors
    is what the errors of the estimate hang on, sample by sample, r_k its correlations; without it something slow, r_k = 1.
    factor² = 1 + 2 Σ ρ_k r_k, summed while |ρ_k| > 2/√N. lost: the share of each stretch's samples that the fit took.

    >>> rng = np.random.default_rng(3)
    >>> white = rng.normal(size=5000)
    >>> noise_colour([white]).white
    True
    >>> from scipy.signal import lfilter
    >>> found = noise_colour([lfilter([1.0], [1.0, -0.6], white)])
    >>> found.white, round(found.correlation, 1), round(found.factor)  # √((1 + .6)/(1 − .6)) = 2
    (False, 0.6, 2)
    """
    from scipy.special import chdtrc

    longest = max(map(len, residuals), default=0)
    lags = min(LAGS, longest // 4)
    count = sum(
        np.isfinite(e).sum() * (1 - share) for e, share in zip(residuals, lost or [0.0] * len(residuals), strict=True)
    )
    scaled = [_scaled(e) for e in residuals]
    if lags < 5 or count <= lags or not any(e.any() for e in scaled):
        return NoiseColour(0.0, 0, 1.0, 0.0, 1.0, True)
    rho = _correlations(scaled, min(FARTHEST, longest // 4))
    order = np.arange(1, lags + 1)
    statistic = float(count * (count + 2) * np.sum(rho[:lags] ** 2 / (count - order)))
    p = float(chdtrc(lags, statistic))
    weak = np.abs(rho) < 2 / np.sqrt(count)
    reach = int(np.argmax(weak)) if weak.any() else len(rho)
    along = (
        _correlations([_scaled(r - np.nanmean(r)) for r in regressors], len(rho)) if len(regressors) else np.ones(len(rho))
    )
    square = 1 + 2 * float(np.sum((rho * along)[:reach]))
    white = p >= SIGNIFICANCE
    factor = float(np.sqrt(max(square, 1e-4)))
    return NoiseColour(statistic, lags, p, float(rho[0]), 1.0 if white else factor, white)


def _scaled(e: Floats) -> Floats:
    """Return a stretch with 0 where it is missing, over its standard deviation."""
    filled = np.where(np.isfinite(e), e, 0.0)
    size = float(np.sqrt(np.mean(filled**2))) if len(e) else 0.0
    return np.asarray(filled / size) if size > 0 else filled


def _correlations(stretches: Sequence[Floats], count: int) -> Floats:
    """Return the correlations at lags 1 … count, products of all stretches over their squares."""
    from scipy.fft import irfft, next_fast_len, rfft

    total = np.zeros(count + 1)
    for e in stretches:
        size = next_fast_len(len(e) + count + 1, real=True)
        found = irfft(np.abs(rfft(e, size)) ** 2, size)[: count + 1]
        total[: len(found)] += found
    return np.asarray(total[1:] / total[0])
