"""Transfer function with a delay from a measured frequency response, orders from the data."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.errors import WhidError
from whid.fit import Estimate, Parameter, least_squares, linear_least_squares
from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats

Complexes = NDArray[np.complex128]

DELAYS = 10  # tried between none and the whole phase
SWEEPS = 5  # of Sanathanan and Koerner
RIVAL = 6.0  # BIC within which another structure is as good


class TransferFunction(NamedTuple):
    """G(s) = (1 + b₁s + … + b_m s^m)/(1 + a₁s + … + a_n s^n)·e^{−s·delay}; num and den descending, G(0) = 1."""

    num: Annotated[Floats, Quantity("1", ("zero",), error="num_std")]
    num_std: Annotated[Floats, Quantity("1", ("zero",))]
    den: Annotated[Floats, Quantity("1", ("pole",), error="den_std")]
    den_std: Annotated[Floats, Quantity("1", ("pole",))]
    delay: Annotated[float, Quantity("s", error="delay_std")]
    delay_std: Annotated[float, Quantity("s")]
    tried: Annotated[NDArray[np.intp], Quantity("1", ("candidate", "order"))]  # zeros, poles, 1 with a delay
    bic: Annotated[Floats, Quantity("1", ("candidate",))]
    estimate: Estimate  # num.1 …, den.1 … (ascending powers of s, seconds), delay

    def table(self) -> Table:
        """Return one row a coefficient."""
        e = self.estimate
        rows = tuple((name, Measured(float(v), float(s))) for name, v, s in zip(e.names, e.values, e.std, strict=True))
        notes = [f"static gain 1; χ²/dof {e.chi2:.1f}/{e.dof}; orders by BIC among {len(self.bic)} candidates"]
        notes += [f"as good within {RIVAL:g}: {'; '.join(self.rivals())}"] if self.rivals() else []
        return Table("Transfer function", ("coefficient of sᵏ", "value"), rows, tuple(notes))

    def corner(self) -> float:
        """Return the frequency, rad/s, at which |G| first falls below 1/√2; of a pure delay 1/delay."""
        slow = np.abs(np.roots(self.den)).min(initial=np.inf) if len(self.den) > 1 else 1 / max(self.delay, 1e-12)
        omega = float(slow) * np.geomspace(0.03, 100.0, 400)
        gain = np.abs(np.polyval(self.num, 1j * omega) / np.polyval(self.den, 1j * omega))
        low = np.flatnonzero(gain < np.sqrt(0.5))
        return float(omega[low[0]]) if len(low) else float(slow)

    def rivals(self) -> tuple[str, ...]:
        """Return the structures that BIC cannot tell from the best."""
        order = np.argsort(self.bic)[1:]
        return tuple(
            "{} zeros, {} poles{}".format(*self.tried[i, :2], ", a delay" if self.tried[i, 2] else "")
            for i in order
            if self.bic[i] < self.bic.min() + RIVAL
        )


def transfer_function(
    omega: Floats,
    log_gain: Floats,
    phase: Floats,
    covariance: Floats,
    samples: int,
    highest: int = 4,
    most_zeros: int = 2,
    shown: tuple[float, float] = (0.0, np.inf),
) -> TransferFunction:
    """Fit stable transfer functions of unit static gain, with and without a delay, and keep the one of least BIC.

    min rᵀ C⁻¹ r, r = log G(jω_k) − (log_gain + j·phase) in real and imaginary parts, phases apart by less than π;
    BIC = χ² + p·log(samples), poles added until two more do not lower it. Starts: Sanathanan-Koerner at delays over the
    whole phase, unstable poles mirrored. The smallest candidate has no dynamics, G = 1.
    omega (m,) rad/s; covariance (2m, 2m) of (log_gain, phase); shown: shortest and longest time constant 1/|pole|, s, that
    the records can show: a pole faster than a sample is a delay to them, one slower than the record an integrator, its gain
    unknown. Raises `WhidError`: "stage-no-model" if nothing fits stably, "stage-unseen-pole" if only such poles would fit.
    Source [Brouri2014], section 1 ("structure totally unknown"): what follows the nonparametric estimate.

    >>> omega = np.geomspace(0.2, 4, 8)
    >>> g = np.exp(-0.3j * omega) / (1 + 0.5j * omega)
    >>> found = transfer_function(omega, np.log(abs(g)), np.angle(g), 1e-6 * np.eye(16), 1000)
    >>> found.den.round(6), round(found.delay, 6)
    (array([0.5, 1. ]), 0.3)
    """
    whitener = np.linalg.inv(np.linalg.cholesky(covariance))
    problem = _Problem(omega, log_gain, phase, whitener, np.sqrt(np.diag(covariance)[: len(omega)]))
    penalty = float(np.log(samples))
    found: dict[tuple[int, int, int], Estimate] = {}
    unseen: list[float] = []
    for poles in range(highest + 1):
        if found and poles > 2 + min(found, key=lambda o: found[o].chi2 + penalty * len(found[o].values))[1]:
            break  # two more poles than the best did not help
        for zeros in range(min(poles, most_zeros) + 1):
            for delay in (0, 1):
                if zeros + poles + delay < 2 * len(omega):
                    ends = [problem.fit(start, zeros, poles) for start in problem.starts(zeros, poles, delay)]
                    ends = [e for e in ends if np.isfinite(e.chi2) and stable(e, zeros, poles)]
                    seen = [e for e in ends if _seen(e, zeros, poles, shown)]
                    if seen:
                        found[zeros, poles, delay] = min(seen, key=lambda e: e.chi2)
                    unseen += [e.chi2 + penalty * len(e.values) for e in ends] if not seen else []
    if not found:
        raise WhidError("stage-no-model", "no stable transfer function explains the frequency response")
    bic = {order: e.chi2 + penalty * len(e.values) for order, e in found.items()}
    if min(unseen, default=np.inf) < min(bic.values()) - RIVAL:
        raise WhidError(
            "stage-unseen-pole", f"the response asks for a time constant outside {shown[0]:.3g} … {shown[1]:.3g} s, which "
            "is all that the records can show"
        )  # fmt: skip
    m, n, delay = order = min(bic, key=lambda o: bic[o])
    best = found[order]
    num, den = (np.append(part[::-1], 1.0) for part in (best.values[:m], best.values[m : m + n]))
    num_std, den_std = (np.append(part[::-1], 0.0) for part in (best.std[:m], best.std[m : m + n]))
    late = (float(best.values[-1]), float(best.std[-1])) if delay else (0.0, 0.0)
    return TransferFunction(num, num_std, den, den_std, *late, np.array(list(bic)), np.array(list(bic.values())), best)


def stable(estimate: Estimate, zeros: int, poles: int) -> bool:
    """Tell whether all poles are in the left half plane, none of them at infinity."""
    den = np.append(estimate.values[zeros : zeros + poles][::-1], 1.0)
    return bool(den[0] > 0 and np.all(np.roots(den).real < 0))


def _seen(estimate: Estimate, zeros: int, poles: int, shown: tuple[float, float]) -> bool:
    """Tell whether the time constants of all poles are such as the records can show."""
    speed = np.abs(np.roots(np.append(estimate.values[zeros : zeros + poles][::-1], 1.0)))
    return bool(np.all((speed * shown[0] <= 1) & (speed * shown[1] >= 1)))


class _Problem(NamedTuple):
    omega: Floats
    log_gain: Floats
    phase: Floats
    whitener: Floats
    std: Floats  # of log_gain

    @property
    def response(self) -> Complexes:
        return np.exp(self.log_gain + 1j * self.phase)

    def starts(self, m: int, n: int, delay: int) -> Iterator[Floats]:
        """Yield coefficients, those of the best two delays where there is one."""
        if not delay:
            yield self._rational(m, n, 0.0)[1]
            return
        total = float(np.abs(np.unwrap(self.phase)).max() / self.omega[np.argmax(np.abs(np.unwrap(self.phase)))])
        tried = [(tau, *self._rational(m, n, tau)) for tau in np.linspace(0, 1.2 * total, DELAYS)]
        for tau, _, values in sorted(tried, key=lambda each: each[1])[:2]:
            yield np.append(values, tau)

    def fit(self, start: Floats, m: int, n: int) -> Estimate:
        """Descend from a start."""
        names = [f"num.{k + 1}" for k in range(m)] + [f"den.{k + 1}" for k in range(n)]
        names += ["delay"] if len(start) > m + n else []
        free = [
            Parameter(name, float(v), "s", lower=0.0 if name[0] == "d" else -np.inf)
            for name, v in zip(names, start, strict=True)
        ]
        powers = (1j * self.omega)[:, None] ** np.arange(1, max(m, n, 1) + 1)

        def residual(x: Floats) -> Floats:
            return np.asarray(self.whitener @ self._gap(x, m, n, powers))

        def tangent(x: Floats) -> Floats:
            top, bottom = 1 + powers[:, :m] @ x[:m], 1 + powers[:, :n] @ x[m : m + n]
            rates = np.hstack([powers[:, :m] / top[:, None], -powers[:, :n] / bottom[:, None]])
            if len(x) > m + n:
                rates = np.hstack([rates, -powers[:, :1]])
            return np.asarray(self.whitener @ np.concatenate([rates.real, rates.imag]))

        if not free:
            return linear_least_squares(np.empty((2 * len(self.omega), 0)), residual(start), np.ones(2 * len(self.omega)))
        with np.errstate(all="ignore"):
            return least_squares(residual, tangent, free, np.ones(2 * len(self.omega)), max_iterations=40, tolerance=1e-4)

    def _gap(self, x: Floats, m: int, n: int, powers: NDArray[Any]) -> Floats:
        model: NDArray[Any] = (1 + powers[:, :m] @ x[:m]) / (1 + powers[:, :n] @ x[m : m + n])
        if len(x) > m + n:
            model = model * np.exp(-1j * self.omega * x[-1])
        ratio = model / self.response
        return np.concatenate([np.log(np.abs(ratio)), np.angle(ratio)])

    def _rational(self, m: int, n: int, tau: float) -> tuple[float, Floats]:
        """Return the misfit and (b, a) of Σ |N − G·D|²/|D before|² with a delay taken off; poles mirrored to the left."""
        target = self.response * np.exp(1j * self.omega * tau)
        scale = float(np.exp(np.mean(np.log(self.omega))))
        power = (1j * self.omega / scale)[:, None] ** np.arange(1, max(m, n, 1) + 1)
        size = np.abs(target) * self.std
        den, values = np.ones(len(target), complex), np.zeros(m + n)
        for _ in range(SWEEPS):
            weight = 1 / (size * np.abs(den))
            design = np.hstack([power[:, :m], -target[:, None] * power[:, :n]]) * weight[:, None]
            goal = (target - 1) * weight
            values = linear_least_squares(
                np.concatenate([design.real, design.imag]), np.concatenate([goal.real, goal.imag])
            ).values if m + n else values  # fmt: skip
            den = 1 + power[:, :n] @ values[m:]
        if n:
            roots = np.roots(np.append(values[m:][::-1], 1.0))
            roots = -np.abs(roots.real) - 1e-3 * np.abs(roots) + 1j * roots.imag
            monic = np.atleast_1d(np.real(np.poly(roots)))[::-1]
            values = np.append(values[:m], np.pad(monic[1:] / monic[0], (0, n - len(roots))))
        scaled = values / scale ** np.concatenate([np.arange(1, m + 1), np.arange(1, n + 1)])
        powers = (1j * self.omega)[:, None] ** np.arange(1, max(m, n, 1) + 1)
        gap = self.whitener @ self._gap(np.append(scaled, tau), m, n, powers)
        return float(gap @ gap), scaled
