"""Memoryless nonlinearity at Chebyshev nodes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt

from whid.blocks.polynomial import Polynomial
from whid.errors import WhidError
from whid.long_record import LongRecord
from whid.methods._method import Explained, Method, Model, Stages
from whid.record import Record, used
from whid.residual import Misfit, Size, Thinner
from whid.signal import Floats
from whid.stages._chebyshev import Domain, evaluate, nodes, scaled
from whid.stages._curve_sums import CurveSums, Samples, curve_sums
from whid.stages._local_lines import Windows, half_widths
from whid.stages.chebyshev_fit import ChebyshevFit, fit_of
from whid.stages.curve_estimates import Choice, CurveEstimates, curve_estimates
from whid.stages.equaliser import Equaliser, equaliser, image_of
from whid.stages.lack_of_fit import lack_of_fit
from whid.stages.memory import memory_of
from whid.stages.node_plus import half_way, plus_of
from whid.stages.node_windows import node_windows, windows_of
from whid.stages.noise_colour import ROUNDING, NoiseColour, noise_colour
from whid.system import System

HEAD = 1 << 16  # samples of a record that tell the noise's colour
LAGS = 4  # earlier inputs that are tried, to see whether there is memory after all


@dataclass(frozen=True, kw_only=True)
class Memoryless(Method):
    """A nonlinearity without memory, by its values at Chebyshev nodes and by least squares.

    y = g(x) + noise,  g ≈ Σ Cⱼ Tⱼ(t) of an order K on a domain [a, b], t = (2x − a − b)/(b − a). As in the paper: a line
    through the samples near every Chebyshev node gives the output there, (7) the coefficients. Beside it global least
    squares, which no unbiased estimate beats where the order suffices, and node-plus, lines through what least squares
    leaves over, near the smallest largest error where it does not; a lack-of-fit test decides which of the two is
    reported. Any input that fills the domain will do. Source [Jeraj and Mathews].

    order          K
    domain         [a, b], input units; left out: what the data cover, min_points samples on either side left outside
    half_width     of the paper's windows, of half the domain; doubles until they hold min_points samples
    report         auto: by the test; or one of the three (least_squares: without windows, for inputs of few values)
    inverse        also the equaliser, input from output: the inverse of the reported curve, applied from Python by
                   `result.stages["equaliser"].tree(y, dt)`
    inverse_order  of the equaliser
    """

    order: Annotated[int, Ge(1)] = 7
    domain: tuple[float, float] | None = None
    half_width: Annotated[float, Gt(0)] = 0.002
    min_points: Annotated[int, Ge(3)] = 15
    report: Choice = "auto"
    inverse: bool = False
    inverse_order: Annotated[int, Ge(1)] = 21

    def __post_init__(self) -> None:
        if self.domain is not None and self.domain[0] >= self.domain[1]:
            raise WhidError("config-value", f"domain is [low, high], not {list(self.domain)}", "domain")

    def whole_records(self) -> str:
        """Return that the equaliser is found from all samples at once."""
        return "inverse: true needs all samples at once" if self.inverse else ""

    def __call__(self, records: Sequence[Record | LongRecord], model: System | None = None) -> Stages:
        """Yield windows, least squares, lack of fit, memory, node-plus, estimates, colour, equaliser; the Model last."""
        data = _Samples(records)
        domain = self.domain or data.covered(self.min_points)
        windows = near = None
        if self.report != "least_squares":
            windows = data.windows(domain, np.full(self.order + 1, self.half_width), self.min_points)
            near = data.windows(domain, half_way(self.order), self.min_points, self.order)
        sums = curve_sums(data.chunks(), self.order, domain, windows=[w for w in (windows, near) if w])
        plus = lines = None
        if windows:
            lines = windows_of(windows, domain, sums.seen, self.min_points)
            yield lines
        fit = fit_of(sums)
        yield fit
        verdict = lack_of_fit(fit)
        yield verdict
        yield memory_of(sums, fit)
        if near:
            plus = plus_of(near, fit, sums.seen, self.min_points)
            yield plus
        curve = curve_estimates(lines, plus, fit, verdict, self.report, domain)
        yield curve
        yield data.colour(curve)
        if self.inverse:
            yield self._equaliser(data, curve)
        if data.watched:
            yield _explained(curve, sums, data.watched)
        yield _model(curve, fit)

    def _equaliser(self, data: _Samples, curve: CurveEstimates) -> Equaliser:
        """Return the inverse, the paper's beside it: its windows along the output; or why there is none, ours needs none."""
        regressed, refused = None, ""
        x, y = data.whole()
        try:
            regressed = node_windows(y, x, self.inverse_order, image_of(curve), self.half_width, self.min_points)
        except WhidError as fault:
            refused = fault.message
        return equaliser(curve, x, self.inverse_order, regressed, refused)


class _Samples:
    """The estimation samples of all records, in chunks: without memory their order does not count."""

    def __init__(self, records: Sequence[Record | LongRecord]) -> None:
        self.records = [record for record in records if record.has("estimation")]
        if not self.records:
            raise WhidError("method-no-data", "no record has samples for estimation")
        self.watched = _watching(records)

    def chunks(self) -> Iterator[Samples]:
        """Yield input, output, and the inputs before."""
        for record in self.records:
            before: Floats | None = None
            for chunk in record.chunks():
                before = np.full(LAGS, chunk.u[0]) if before is None else before
                extended = np.concatenate([before, chunk.u])
                before = extended[len(extended) - LAGS :]
                earlier = np.ndarray((LAGS, len(chunk.u)), float, extended, (LAGS - 1) * 8, (-8, 8))  # views, made at once
                on = used(record, chunk, "estimation")
                whole = bool(on.all())
                if self.watched:
                    self.watched.add(chunk)
                yield Samples(chunk.u, chunk.y, earlier) if whole else Samples(chunk.u[on], chunk.y[on], earlier[:, on])

    def inputs(self) -> Iterator[Floats]:
        """Yield the inputs."""
        for record in self.records:
            for chunk in record.chunks(outputs=False):
                on = used(record, chunk, "estimation")
                yield chunk.u if on.all() else chunk.u[on]

    def covered(self, min_points: int) -> Domain:
        """Return the range of the inputs but for min_points on either side, so that no window at an end is one-sided."""
        count, ends = 0, np.empty(0)
        for x in self.inputs():
            count, ends = count + len(x), np.concatenate([ends, x])
            if len(ends) > 4 * (min_points + 1):
                middle = slice(min_points + 1, len(ends) - min_points - 1)
                ends.partition((min_points, len(ends) - 1 - min_points))
                ends = np.delete(ends, middle)
        if count <= 4 * min_points:
            raise WhidError("stage-too-short", f"{count} samples are too few for windows of {min_points}")
        ends.sort()
        low, high = float(ends[min_points]), float(ends[-1 - min_points])
        if low >= high:
            raise WhidError("stage-rank-one", f"nearly all samples have one input, {low:.4g}: no curve can be seen")
        return low, high

    def windows(self, domain: Domain, halves: Floats, min_points: int, order: int = -1) -> Windows:
        """Return empty windows at the nodes, wide enough; order: K where they are to sum T₀ … T_K as well."""
        centres = nodes(len(halves) - 1)
        wide = half_widths((scaled(x, domain) for x in self.inputs()), centres, halves, min_points)
        return Windows(centres, wide, order)

    def colour(self, curve: CurveEstimates) -> NoiseColour:
        """Return whether what a curve leaves over at the beginning of each record is white."""
        rests, inputs = [], []
        for record in self.records:
            u, y = _beginning(record)
            seen = np.isfinite(y) & (u >= curve.domain[0]) & (u <= curve.domain[1])
            rest = np.full(len(u), np.nan)
            rest[seen] = y[seen] - evaluate(scaled(u[seen], curve.domain), curve.coefficients)
            least = ROUNDING * float(np.abs(curve.coefficients).max())
            rests.append(rest if seen.any() and np.nanstd(rest) > least else np.zeros(len(rest)))
            inputs.append(np.where(seen, u, np.nan))
        return noise_colour(rests, inputs)

    def whole(self) -> tuple[Floats, Floats]:
        """Return all inputs and outputs; raise `WhidError("memory")` where they are too many."""
        if any(isinstance(record, LongRecord) for record in self.records):
            why = "inverse: true needs all samples at once"
            raise WhidError("memory", f"{why}; identify the curve from the long record, the equaliser from a shorter one")
        x, y, _ = zip(*self.chunks(), strict=True)
        return np.concatenate(x), np.concatenate(y)


def _watching(records: Sequence[Record | LongRecord]) -> Thinner | None:
    """Return what keeps some samples of the only record, a long one of estimation samples alone: a pass to assess is spared.

    None where the sums do not tell all of the misfit.
    """
    first, closed = records[0], any(record.has(use) for record in records for use in ("selection", "report"))
    return Thinner(first) if isinstance(first, LongRecord) and len(records) == 1 and not closed else None


def _explained(curve: CurveEstimates, sums: CurveSums, watched: Thinner) -> Explained:
    """Return what the reported curve leaves over of the record."""
    thinned, samples = watched.record(), sums.seen.samples
    size = Size(samples, samples, sums.rest(curve.coefficients), sums.outputs)
    error = thinned.y - evaluate(scaled(thinned.u, curve.domain), curve.coefficients)
    return Explained((Misfit({"estimation": size}, watched.reach, thinned, error),))


def _beginning(record: Record | LongRecord) -> tuple[Floats, Floats]:
    """Return the first HEAD inputs and outputs, NaN where the output is not for estimation."""
    u, y = np.empty(0), np.empty(0)
    for chunk in record.chunks():
        u = np.concatenate([u, chunk.u])[:HEAD]
        y = np.concatenate([y, np.where(used(record, chunk, "estimation"), chunk.y, np.nan)])[:HEAD]
        if len(u) == HEAD:
            break
    return u, y


def _model(curve: CurveEstimates, fit: ChebyshevFit) -> Model:
    """Return the reported curve as a system; χ² against the noise that more terms leave."""
    low, high = curve.domain
    block = Polynomial(coefficients=tuple(map(float, curve.coefficients)), basis="chebyshev", domain=curve.domain)
    std = np.sqrt(np.diag(curve.covariance))
    chi2 = fit.rest / fit.noise_std**2 if fit.noise_std > 0 else float("nan")
    estimate = fit.estimate._replace(values=curve.coefficients, std=std, covariance=curve.covariance, chi2=chi2)
    beyond = f"the curve below {low:.4g} and above {high:.4g}: the polynomial goes on, but nothing supports it there"
    return Model(System(chain=(block,)), estimate, "none", (beyond,))
