"""Joint rational fit: f, front and back as transfer functions at once, orders from the data."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import lru_cache, partial
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.errors import WhidError
from whid.fit import NEAR, Estimate
from whid.quantity import Measured, Quantity, Table
from whid.stages._chain_fit import ChainFit, RationalResponse, frequencies
from whid.stages._responses import Responses, StaticPart, response_metrics

Floats = NDArray[np.float64]
Orders = tuple[int, int, int, int]  # zeros and poles of front, zeros and poles of back
Start = tuple[Floats, ...]  # their coefficients, b and a of front, b and a of back
RIVAL = 6.0  # of BIC: what is less behind the best is named beside it
QUICK = 30  # iterations of a start: those that reach the minimum take a dozen
NONE = 1e-9  # of the largest coefficient: a pole at infinity


class Rational(NamedTuple):
    """Transfer functions of unit static gain and their responses at the measured frequencies.

    num and den descending in s, den[-1] = num[-1] = 1. bic = χ² + p·log(samples), smaller is better.
    """

    front_num: Annotated[Floats, Quantity(dims=("front_zero",), error="front_num_std")]
    front_num_std: Annotated[Floats, Quantity(dims=("front_zero",))]
    front_den: Annotated[Floats, Quantity(dims=("front_pole",), error="front_den_std")]
    front_den_std: Annotated[Floats, Quantity(dims=("front_pole",))]
    back_num: Annotated[Floats, Quantity(dims=("back_zero",), error="back_num_std")]
    back_num_std: Annotated[Floats, Quantity(dims=("back_zero",))]
    back_den: Annotated[Floats, Quantity(dims=("back_pole",), error="back_den_std")]
    back_den_std: Annotated[Floats, Quantity(dims=("back_pole",))]
    front_omega: Annotated[Floats, Quantity("rad/s", dims=("front_omega",))]
    front_gain: Annotated[Floats, Quantity(dims=("front_omega",), error="front_gain_std")]
    front_gain_std: Annotated[Floats, Quantity(dims=("front_omega",))]
    front_phase: Annotated[Floats, Quantity("rad", dims=("front_omega",), error="front_phase_std")]
    front_phase_std: Annotated[Floats, Quantity("rad", dims=("front_omega",))]
    back_omega: Annotated[Floats, Quantity("rad/s", dims=("back_omega",))]
    back_gain: Annotated[Floats, Quantity(dims=("back_omega",), error="back_gain_std")]
    back_gain_std: Annotated[Floats, Quantity(dims=("back_omega",))]
    back_phase: Annotated[Floats, Quantity("rad", dims=("back_omega",), error="back_phase_std")]
    back_phase_std: Annotated[Floats, Quantity("rad", dims=("back_omega",))]
    phase_covariance: Annotated[Floats, Quantity("rad**2", dims=("phase", "phase"))]  # front, then back
    tried: Annotated[NDArray[np.intp], Quantity(dims=("candidate", "order"))]
    bic: Annotated[Floats, Quantity(dims=("candidate",))]
    rival: Annotated[NDArray[np.intp], Quantity(dims=("rival", "order"))]  # orders that BIC cannot tell from the best
    rival_numbers: Annotated[Floats, Quantity(dims=("rival", "number"))]  # b and a of front, b and a of back, then NaN
    reference: Annotated[float, Quantity("rad/s")]
    starts: int  # of the chosen orders, and how many of them ended in the same, best minimum
    agreeing: int
    estimate: Estimate
    product: bool = False  # all poles stand in front: the sines tell front·back only

    def table(self) -> Table:
        """Return the transfer functions."""
        rows = []
        for block in ("front", "back"):
            for part in ("num", "den"):
                values, errors = getattr(self, f"{block}_{part}"), getattr(self, f"{block}_{part}_std")
                for power, (v, s) in enumerate(zip(values[::-1], errors[::-1], strict=True)):
                    if power:
                        name = "front·back" if self.product else block
                        rows.append((f"{name} {part}", f"s^{power}", Measured(float(v), float(s))))
        e = self.estimate
        fit = f"χ²/dof {e.chi2:.1f}/{e.dof}; static gains are 1; {self.agreeing} of {self.starts} starts agree"
        notes = [fit, f"orders by BIC among {len(self.bic)} candidates"]
        notes += [f"as good within 6 (zeros/poles of front, of back): {'; '.join(self.rivals())}"] if self.rivals() else []
        notes += [] if e.why_stop == "converged" else [f"not converged: {e.why_stop}"]
        notes += [] if self.explained else ["χ² is more than noise makes: see what is missing"]
        return Table("Joint rational fit", ("polynomial", "power", "coefficient"), tuple(rows), tuple(notes))

    @property
    def explained(self) -> bool:
        """Tell whether χ² is what noise makes (p > 1e-4; its errors have some 32 degrees of freedom themselves)."""
        from scipy.special import chdtrc

        e = self.estimate
        return e.dof <= 0 or bool(chdtrc(e.dof, e.chi2 * (1 - 2 / 32)) > 1e-4)

    def rivals(self) -> tuple[str, ...]:
        """Return the orders (zeros/poles of front, of back) that BIC cannot tell from the best: less than 6 behind."""
        order = np.argsort(self.bic)[: 1 + len(self.rival)]
        return tuple("{}/{}, {}/{} (+{:.1f})".format(*self.tried[i], self.bic[i] - self.bic[order[0]]) for i in order[1:])

    def alternatives(self) -> Iterator[tuple[Floats, Floats, Floats, Floats]]:
        """Yield num and den of front, num and den of back, descending, of every rival, the nearest first."""
        for orders, numbers in zip(self.rival, self.rival_numbers, strict=True):
            parts = np.split(numbers[: orders.sum()], np.cumsum(orders)[:-1])
            front_num, front_den, back_num, back_den = (np.append(part[::-1], 1.0) for part in parts)
            yield front_num, front_den, back_num, back_den

    def metrics(self) -> dict[str, Measured]:
        """Return gains and phases by name, `front.gain@0.02`; `product.gain@0.02` where they are not told apart."""
        found = {name.partition(".")[2]: value for name, value in response_metrics("rational", self).items()}
        if self.product:
            return {name.replace("front", "product"): value for name, value in found.items() if name.startswith("front")}
        return found


def rational(
    static: StaticPart,
    responses: Responses,
    samples: int,
    orders: Orders | None = None,
    highest: int = 3,
    free_breaks: tuple[int, ...] = (),
    back: bool = True,
) -> Rational:
    """Fit unit-gain transfer functions in front of and behind f to levels and complex harmonics.

    Same criterion as `joint`, with G(s) = (1 + b₁s + …)/(1 + a₁s + …). Without `orders` poles and zeros are added one or
    two at a time, each from several starts, as long as χ² + p·log(samples) falls. The model fixes the gauge of the phases.
    back=False: all dynamics in front (inside one affine piece only the product is identifiable). free_breaks: the breaks of
    the part that the sines cross and so locate.
    Raises `WhidError("stage-no-model")` when no orders give stable blocks.
    Source [Brouri2019], section 4, last paragraph ("transfer functions … can easily be determined").
    """
    reference = float(np.exp(np.mean(np.log(responses.omega))))
    search = _Search(static, responses, reference, float(np.log(samples)), free_breaks)
    if orders is not None:
        orders = orders if back else (orders[0] + orders[2], orders[1] + orders[3], 0, 0)
    best = search.best_of(orders, search.first_starts(orders)) if orders else search.climb((highest, highest if back else 0))
    if not np.isfinite(best.bic):
        raise WhidError("stage-no-model", "no stable transfer functions explain the harmonics of the sines")
    ends = [end.chi2 for end in search.race([best.orders], search.first_starts)]
    best = search.seen[best.orders]
    problem, estimate = search.finished(best)
    agreeing = sum(end < estimate.chi2 + 0.01 for end in ends)
    return _result(best.orders, problem, estimate, search, len(ends), agreeing)._replace(product=not back)


class _Fitted(NamedTuple):
    """Where a start ended; bic infinite without stable blocks."""

    orders: Orders
    theta: Floats  # f, its breaks, then b and a of front, b and a of back
    chi2: float
    bic: float

    @property
    def coefficients(self) -> list[Floats]:
        """Return b and a of front, b and a of back."""
        return np.split(self.theta[len(self.theta) - sum(self.orders) :], np.cumsum(self.orders)[:-1])


class _Search:
    """Order search with warm starts."""

    def __init__(
        self, static: StaticPart, responses: Responses, reference: float, penalty: float, free_breaks: tuple[int, ...]
    ) -> None:
        self.static, self.responses, self.reference = static, responses, reference
        self.penalty, self.free_breaks = penalty, free_breaks
        self.omegas = frequencies(responses)
        self.ends: dict[tuple[Orders, bytes], _Fitted] = {}  # by orders and start: what was raced before is known
        self.seen: dict[Orders, _Fitted] = {}  # the best of what counts

    def climb(self, highest: tuple[int, int]) -> _Fitted:
        """Grow from the best of one and two poles in each block, one with a zero, or shrink, while a neighbour is better."""
        first = [(0, n, 0, j) for n in (1, 2) for j in (1, 2) if n <= highest[0] and j <= highest[1]]
        first += [(1, 2, 0, 1), (0, 1, 1, 2)] if min(highest) > 1 else []
        first = first or [(0, n, 0, 0) for n in (1, 2) if n <= highest[0]]
        self.race(first, self.first_starts)
        best = min((self.best_of(o, self.first_starts(o)) for o in first), key=lambda f: f.bic)
        if not np.isfinite(best.bic):  # a pole went to infinity: a block without dynamics
            fewer: list[Orders] = [(0, 1, 0, 0), (0, 0, 0, 1)] if highest[1] else []
            best = min([self.best_of(o, self.first_starts(o)) for o in fewer], key=lambda f: f.bic, default=best)
        while True:
            near = [o for o in _neighbours(best.orders, highest) if o not in self.seen and self._may_rival(best, o)]
            for wider in (True, False):  # fewer numbers only where no more help: they never explain more
                tried = [o for o in near if (sum(o) > sum(best.orders)) is wider]
                self.race(tried, partial(self.grown, best))
                winner = min((self.best_of(o, self.grown(best, o)) for o in tried), key=lambda f: f.bic, default=best)
                if winner.bic < best.bic:
                    best = winner
                    break
            else:
                return best

    def _may_rival(self, best: _Fitted, orders: Orders) -> bool:
        """Tell whether a fit of these orders could come near the best: even χ² = 0 leaves the penalty of its numbers."""
        more = sum(orders) - sum(best.orders)
        return not self.penalty * more > best.chi2 + RIVAL

    def first_starts(self, orders: Orders) -> Iterator[Start]:
        """Yield (b, a) of front and back: real poles, spread about the measured band, on either side of each other.

        Then with a resonance in the band, in front or behind: no descent finds one from real poles when it is sharp.
        """
        yield from _first_starts(float(self.omegas[0].max()) / self.reference, orders)

    def grown(self, base: _Fitted, orders: Orders) -> Iterator[Start]:
        """Yield starts from a neighbour: added poles beyond the band, zeros at infinity; or without its fastest root."""
        parts = base.coefficients
        for factor in (1.0, 4.0, 16.0):
            fast = factor * float(self.omegas[1].max()) / self.reference
            start = []
            for have, want, is_den in zip(parts, orders, (False, True, False, True), strict=True):
                polynomial = _slowest(np.concatenate([[1.0], have]), want)
                for _ in range(want - len(have)):
                    polynomial = np.convolve(polynomial, [1.0, 1 / fast]) if is_den else np.append(polynomial, 0.0)
                start.append(polynomial[1:])
            yield tuple(start)
        yield from self.first_starts(orders) if sum(orders) <= 4 else ()

    def best_of(self, orders: Orders, starts: Iterable[Start]) -> _Fitted:
        """Fit from every start; remember the best of these orders."""
        ends = self.race([orders], lambda _: starts)
        best = min(ends, key=lambda end: end.bic)
        if orders not in self.seen or best.bic < self.seen[orders].bic:
            self.seen[orders] = best
        return self.seen[orders]

    def race(self, orders: Iterable[Orders], starts: Callable[[Orders], Iterable[Start]]) -> list[_Fitted]:
        """Fit several orders from several starts, side by side, and return where they ended.

        All are the widest of them with some of its numbers held at zero.
        """
        entered = {(each, np.concatenate(start).tobytes()): start for each in orders for start in starts(each)}
        if new := {key: start for key, start in entered.items() if key not in self.ends}:
            widest = np.max([each for each, _ in new], axis=0)
            problem = self.problem([np.zeros(count) for count in widest])
            begun = np.array([p.value for p in problem.parameters()])
            skip, edges = len(begun) - widest.sum(), np.cumsum(widest)[:-1]
            theta, moving = np.tile(begun, (len(new), 1)), np.ones((len(new), len(begun)), bool)
            for row, free, start in zip(theta[:, skip:], moving[:, skip:], new.values(), strict=True):
                for values, flags, part in zip(np.split(row, edges), np.split(free, edges), start, strict=True):
                    values[: len(part)], flags[len(part) :] = part, False
            found = problem.race(theta, moving, QUICK)
            for key, row, own, chi2 in zip(new, found.theta, moving, found.chi2, strict=True):
                self.ends[key] = self._fitted(key[0], row[own], float(chi2))
        return [self.ends[key] for key in entered]

    def _fitted(self, orders: Orders, theta: Floats, chi2: float) -> _Fitted:
        """Return where a start ended; unstable, or with a pole at infinity, counts as no model."""
        fitted = _Fitted(orders, theta, chi2, chi2 + self.penalty * len(theta))
        stable = np.isfinite(chi2) and all(_stable(a) for a in fitted.coefficients[1::2])
        return fitted if stable else fitted._replace(bic=np.inf)

    def problem(self, coefficients: Sequence[Floats]) -> ChainFit:
        """Return the fit of f and transfer functions, from b and a of front, b and a of back."""
        b_front, a_front, b_back, a_back = coefficients
        return ChainFit(
            self.responses, self.static,
            RationalResponse(self.omegas[0], b_front, a_front, self.reference, "front"),
            RationalResponse(self.omegas[1], b_back, a_back, self.reference, "back"), self.free_breaks,
        )  # fmt: skip

    def finished(self, fitted: _Fitted) -> tuple[ChainFit, Estimate]:
        """Fit once more from where a start ended, to the very minimum."""
        problem = self.problem(fitted.coefficients)
        return problem, problem.solve(10 * QUICK, fitted.theta, NEAR)


@lru_cache
def _first_starts(top: float, orders: Orders) -> tuple[Start, ...]:
    """Return the first starts below a highest frequency: the same in every repeat of an experiment."""
    m, n, k, j = orders
    spread = ((1.0, 2.0 * top), (1.0, 8.0 * top), (4.0, 4.0 * top), (0.25, 4.0 * top))
    found = [(_poles(centre * ratio**0.5, n), _poles(centre / ratio**0.5, j)) for ratio, centre in spread]
    for speed in (0.5 * top, 1.2 * top):
        found += [(_resonant(speed, n), _poles(4.0 * top, j))] if n > 1 else []
        found += [(_poles(4.0 * top, n), _resonant(speed, j))] if j > 1 else []
    return tuple((np.zeros(m), front, np.zeros(k), back) for front, back in found)


def _neighbours(orders: Orders, highest: tuple[int, int]) -> Iterator[Orders]:
    m, n, k, j = orders
    single = [(0, 1, 0, 0), (0, 0, 0, 1), (1, 0, 0, 0), (0, 0, 1, 0), (1, 1, 0, 0), (0, 0, 1, 1)]
    steps = [(0, 1, 0, 1), *single, *[(-a, -b, -c, -d) for a, b, c, d in single]]
    for more in steps:
        new = (m + more[0], n + more[1], k + more[2], j + more[3])
        if (
            min(new) >= 0
            and new[0] < max(new[1], 1)
            and new[2] < max(new[3], 1)
            and new[1] <= highest[0]
            and new[3] <= highest[1]
        ):
            yield new


def _slowest(polynomial: Floats, degree: int) -> Floats:
    """Return 1 + a₁p + … without its fastest roots, to that degree."""
    if len(polynomial) <= degree + 1:
        return polynomial
    roots = np.roots(polynomial[::-1])
    if len(roots) <= degree:
        return polynomial
    kept = roots[np.argsort(np.abs(roots))][:degree]
    return np.asarray(np.polynomial.polynomial.polyfromroots(kept) / np.prod(-kept), complex).real


def _poles(speed: float, count: int) -> Floats:
    """Return a₁ … a_n of real poles spread by factors of 2 about a speed."""
    polynomial = np.ones(1)
    for k in range(count):
        polynomial = np.convolve(polynomial, [1.0, 1 / (speed * 2.0 ** (k - (count - 1) / 2))])
    return polynomial[1:]


def _resonant(speed: float, count: int) -> Floats:
    """Return a₁ … a_n of a lightly damped pair (ζ = .2), the other poles real and faster."""
    return np.asarray(np.convolve([1.0, 0.4 / speed, speed**-2.0], np.append(1.0, _poles(4.0 * speed, count - 2)))[1:])


def _stable(a: Floats) -> bool:
    """Tell whether 1 + a₁p + … + aₙpⁿ has n roots, not at infinity, all in the left half plane."""
    if not len(a):
        return True
    if not abs(a[-1]) > NONE * np.abs(a).max():
        return False
    if len(a) < 4:  # Hurwitz: all coefficients positive, and of a cubic a₁a₂ > a₃
        return bool(a.min() > 0 and (len(a) < 3 or a[0] * a[1] > a[2]))
    return bool(np.all(np.roots(np.concatenate([a[::-1], [1.0]])).real < 0))


def _result(orders: Orders, problem: ChainFit, estimate: Estimate, search: _Search, starts: int, agreeing: int) -> Rational:
    m, n, k, j = orders
    skip = len(estimate.values) - (m + n + k + j)
    theta, std = estimate.values[skip:], estimate.std[skip:]
    unit = search.reference ** -np.concatenate([np.arange(1, count + 1) for count in orders])
    values, errors = (np.split(x * unit, np.cumsum([m, n, k])) for x in (theta, std))
    tops = [(np.append(v[::-1], 1.0), np.append(s[::-1], 0.0)) for v, s in zip(values, errors, strict=True)]
    front, d_front = problem.front(theta[: m + n])
    back, d_back = problem.back(theta[m + n :])
    zeta = np.zeros((len(front) + len(back), m + n + k + j), complex)
    zeta[: len(front), : m + n], zeta[len(front) :, m + n :] = d_front, d_back
    covariance = estimate.covariance[skip:, skip:]
    log_gain = np.sqrt(np.einsum("fi,ij,fj->f", zeta.real, covariance, zeta.real))
    phases = zeta.imag @ covariance @ zeta.imag.T
    g, phase_std, split = np.concatenate([front, back]), np.sqrt(np.diag(phases)), len(front)
    phase = np.concatenate([_phase(problem.front, theta[: m + n]), _phase(problem.back, theta[m + n :])])
    order = sorted(search.seen)
    bic = np.array([search.seen[o].bic for o in order])
    rivals = [order[i] for i in np.argsort(bic)[1:] if bic[i] < bic.min() + RIVAL]
    numbers = np.full((len(rivals), max([0, *map(sum, rivals)])), np.nan)
    for row, other in zip(numbers, rivals, strict=True):
        power = np.concatenate([np.arange(1, count + 1) for count in other])
        row[: sum(other)] = np.concatenate(search.seen[other].coefficients) * search.reference**-power
    return Rational(
        *tops[0], *tops[1], *tops[2], *tops[3],
        search.omegas[0], abs(g[:split]), abs(g[:split]) * log_gain[:split], phase[:split], phase_std[:split],
        search.omegas[1], abs(g[split:]), abs(g[split:]) * log_gain[split:], phase[split:], phase_std[split:],
        phases, np.array(order), bic, np.array(rivals, np.intp).reshape(-1, 4), numbers, search.reference,
        starts, agreeing, estimate,
    )  # fmt: skip


def _phase(response: object, theta: Floats) -> Floats:
    """Return the phase that is continuous from 0 at ω = 0, by summing the angles of the factors."""
    assert isinstance(response, RationalResponse)
    m = len(response.numerator)
    p = 1j * response.omega / response.reference

    def angle(coefficients: Floats) -> Floats:
        roots = np.roots(np.concatenate([coefficients[::-1], [1.0]]))
        return np.sum([np.angle(1 - p / r) for r in roots], axis=0) if len(roots) else np.zeros(len(p))

    return np.asarray(angle(theta[:m]) - angle(theta[m:]))
