"""Memoryless nonlinearity at Chebyshev nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt

from whid.blocks.polynomial import Polynomial
from whid.errors import WhidError
from whid.methods._method import Method, Model, Stages
from whid.record import Record
from whid.signal import Floats
from whid.stages._chebyshev import Domain
from whid.stages.chebyshev_fit import ChebyshevFit, chebyshev_fit
from whid.stages.curve_estimates import Choice, CurveEstimates, curve_estimates
from whid.stages.equaliser import equaliser, image_of
from whid.stages.lack_of_fit import lack_of_fit
from whid.stages.memory import lagged, memory
from whid.stages.node_plus import node_plus
from whid.stages.node_windows import NodeWindows, node_windows
from whid.system import System

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

    def __call__(self, records: Sequence[Record], model: System | None = None) -> Stages:
        """Yield node windows, least squares, lack of fit, memory, node-plus, estimates, equaliser; the Model last."""
        x, y = _samples(records)
        domain = self.domain or _covered(x, self.min_points)
        windows = plus = None
        if self.report != "least_squares":
            windows = node_windows(x, y, self.order, domain, self.half_width, self.min_points)
            yield windows
        fit = chebyshev_fit(x, y, self.order, domain)
        yield fit
        verdict = lack_of_fit(fit)
        yield verdict
        yield memory(x, y, _earlier(records), fit)
        if self.report != "least_squares":
            plus = node_plus(x, y, fit, self.min_points)
            yield plus
        curve = curve_estimates(windows, plus, fit, verdict, self.report, domain)
        yield curve
        if self.inverse:
            regressed, refused = self._regressed(x, y, image_of(curve))
            yield equaliser(curve, x, self.inverse_order, regressed, refused)
        yield _model(curve, fit)

    def _regressed(self, x: Floats, y: Floats, image: Domain) -> tuple[NodeWindows | None, str]:
        """Return the paper's equaliser, its windows along the output; or why there is none: ours does not need it."""
        try:
            return node_windows(y, x, self.inverse_order, image, self.half_width, self.min_points), ""
        except WhidError as fault:
            return None, fault.message


def _samples(records: Sequence[Record]) -> tuple[Floats, Floats]:
    """Return the input and output of all estimation samples: without memory their order does not count."""
    used = [record.using("estimation") for record in records]
    x, y = (
        np.concatenate([getattr(record, name)[on] for record, on in zip(records, used, strict=True)] or [np.empty(0)])
        for name in ("u", "y")
    )
    if not len(x):
        raise WhidError("method-no-data", "no record has samples for estimation")
    return x, y


def _earlier(records: Sequence[Record]) -> Floats:
    """Return the inputs before those of `_samples`, (LAGS, N)."""
    rows = [np.stack(list(lagged(record.u, LAGS)))[:, record.using("estimation")] for record in records]
    return np.concatenate(rows, axis=1)


def _covered(x: Floats, min_points: int) -> Domain:
    """Return the range of the samples but for min_points on either side, so that no window at an end is one-sided."""
    if len(x) <= 4 * min_points:
        raise WhidError("stage-too-short", f"{len(x)} samples are too few for windows of {min_points}")
    ordered = np.partition(x, [min_points, len(x) - 1 - min_points])
    low, high = float(ordered[min_points]), float(ordered[-1 - min_points])
    if low >= high:
        raise WhidError("stage-rank-one", f"nearly all samples have one input, {low:.4g}: no curve can be seen")
    return low, high


def _model(curve: CurveEstimates, fit: ChebyshevFit) -> Model:
    """Return the reported curve as a system; χ² against the noise that more terms leave."""
    low, high = curve.domain
    block = Polynomial(coefficients=tuple(map(float, curve.coefficients)), basis="chebyshev", domain=curve.domain)
    std = np.sqrt(np.diag(curve.covariance))
    chi2 = fit.rest / fit.noise_std**2 if fit.noise_std > 0 else float("nan")
    estimate = fit.estimate._replace(values=curve.coefficients, std=std, covariance=curve.covariance, chi2=chi2)
    beyond = f"the curve below {low:.4g} and above {high:.4g}: the polynomial goes on, but nothing supports it there"
    return Model(System(chain=(block,)), estimate, "none", (beyond,))
