"""How good a model is: its error on each use of the data, and against the truth where a plant was simulated."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from whid.blocks._static import Static
from whid.blocks.delay import Delay
from whid.blocks.linear import Linear
from whid.long_record import LongRecord
from whid.methods._method import Model
from whid.quantity import Measured
from whid.record import Record
from whid.residual import Misfit
from whid.signal import Floats, rms
from whid.stages.identifiability import distinct
from whid.system import System

Metrics = dict[str, float | Measured]
ACROSS = 401  # inputs at which two curves are compared
OF_SAMPLES = ("estimation.", "selection.", "report.")  # metrics of residuals begin with it
MISFIT = 3.0  # χ²/dof: errors understated by √3 and more, at any number of degrees of freedom that matters


def score(
    model: Model, records: Sequence[Record | LongRecord], misfits: Sequence[Misfit], truth: System | None = None
) -> Metrics:
    """Return every metric by name.

    {use}.rms, .nrmse, .fit          for use in estimation, selection, report; nrmse = rms/std(y), fit = 100(1 − nrmse)
    {front|back}.{gain|phase}.error.max   largest error at the frequencies that the sines reached, static gain 1;
                                     linear.… of front·back, where the model claims no more than that, or of what stands
                                     between two nonlinear blocks
    nonlinearity.error.{max,rms}     of the static curve at the levels held, over the span of the true one there; of systems
                                     without memory across the model's domain, or the inputs
    """
    metrics: Metrics = {}
    for use in ("estimation", "selection", "report"):
        sizes = [misfit.sizes[use] for misfit in misfits if use in misfit.sizes]
        if sizes:
            known = sum(size.errors for size in sizes)
            error = float(np.sqrt(sum(size.square for size in sizes) / known)) if known else float("nan")
            output = sum(size.output.squares for size in sizes) / sum(size.samples for size in sizes)
            nrmse = error / float(np.sqrt(output)) if output > 0 else float("nan")
            metrics |= {f"{use}.rms": error, f"{use}.nrmse": nrmse, f"{use}.fit": 100 * (1 - nrmse)}
    reach = min(misfit.reach[0] for misfit in misfits), max(misfit.reach[1] for misfit in misfits)
    return metrics | (dict(_against(model.system, records, reach, truth)) if truth else {})


def doubts(model: Model, metrics: Metrics) -> Iterator[str]:
    """Yield what speaks against a model: data that it does not explain, no better than a constant, no minimum."""
    estimate, nrmse = model.estimate, metrics.get("estimation.nrmse", 0.0)
    if estimate.dof > 0 and estimate.chi2 > MISFIT * estimate.dof:
        yield (
            f"the model does not explain what it was fitted to: χ²/dof {estimate.chi2 / estimate.dof:.3g}, so its standard "
            "errors are too small"
        )
    if isinstance(nrmse, float) and nrmse >= 1:
        yield f"the model explains the output no better than a constant does (nrmse {nrmse:.3g})"
    if estimate.why_stop == "iteration limit":
        yield "the fit stopped at its iteration limit: its numbers may not be those of a minimum"


def units(metric: str) -> str:
    """Return the unit of a metric."""
    if metric.endswith(".rms"):
        return "output" if metric.count(".") == 1 or metric.startswith("verdict.") else "1"
    return "rad" if ".phase" in metric else "%" if metric.endswith(".fit") else "1"


def linear_gain(system: System, side: str, omega: Floats) -> NDArray[np.complex128]:
    """Return G(jω)/G(0) of the linear blocks before the first (front) or after the last (back) nonlinear one."""
    chain = system.series if side == "front" else system.series[::-1]
    product, static = np.ones(len(omega), complex), 1.0 + 0j
    for block in chain:
        if not isinstance(block, Linear):
            break
        gain = block.gain_at(np.append(omega, 0.0))
        product, static = product * gain[:-1], static * complex(gain[-1])
    return np.asarray(product / static)


def true_value(system: System, metric: str) -> float:
    """Return what a metric of a single frequency, `front.gain@0.02` or `stepwise.back.phase@0.1`, is of a system; else NaN.

    >>> lag = System(chain=(Linear(num=(2.0,), den=(1.0, 1.0)),))
    >>> round(true_value(lag, "joint.front.gain@1"), 4), true_value(lag, "report.rms")
    (0.7071, nan)
    """
    return true_values(system, [metric])[0]


def true_values(system: System, metrics: Sequence[str]) -> list[float]:
    """Return the same of many metrics, each block asked once."""
    found = [re.fullmatch(r"(?:\w+\.)?(front|back)\.(gain|phase)@(.+)", metric) for metric in metrics]
    values = [float("nan")] * len(metrics)
    for side in ("front", "back"):
        here = [k for k, match in enumerate(found) if match and match[1] == side]
        gains = linear_gain(system, side, np.array([float(found[k][3]) for k in here]))  # type: ignore[index]
        for k, g in zip(here, gains, strict=True):
            values[k] = float(abs(g) if found[k][2] == "gain" else np.angle(g))  # type: ignore[index]
    return values


def _split(system: System) -> bool:
    """Tell whether both sides of the nonlinearity are dynamic."""
    return all(_dynamic(system, side) for side in ("front", "back"))


def _dynamic(system: System, side: str) -> bool:
    return bool(np.ptp(np.abs(linear_gain(system, side, np.array([0.0, 1e-3, 1.0, 1e3])))) > 0)


def linear_response(system: System, omega: Floats) -> NDArray[np.complex128]:
    """Return G(jω)/G(0) of all linear blocks and delays in series."""
    product, static = np.ones(len(omega), complex), 1.0 + 0j
    for block in system.series:
        if isinstance(block, (Linear, Delay)):
            gain = block.gain_at(np.append(omega, 0.0))
            product, static = product * gain[:-1], static * complex(gain[-1])
    return np.asarray(product / static)


def _held(system: System, levels: Floats, dt: float) -> Floats:
    """Return the steady output at every level: all at once where the chain is linear and static blocks with a gain."""
    x = levels
    for block in system.chain:
        gain = float(block.gain_at(np.zeros(1))[0].real) if isinstance(block, Linear) else 1.0
        if not isinstance(block, (Linear, Static)) or not np.isfinite(gain):
            return np.array([system.tree.steady(float(u), dt)[0] for u in levels])
        x = block.value(x) if isinstance(block, Static) else gain * x
    return x


def _without_memory(system: System, reach: tuple[float, float], truth: System) -> Floats:
    """Return inputs across the domain of a polynomial, or those that there were, where neither system has memory."""
    if not all(isinstance(block, Static) for s in (system, truth) for block in s.series):
        return np.empty(0)
    domain = getattr(system.series[0], "domain", None)
    low, high = domain or reach
    return np.linspace(low, high, ACROSS)


def _against(
    system: System, records: Sequence[Record | LongRecord], reach: tuple[float, float], truth: System
) -> Iterator[tuple[str, float]]:
    sines = [(part.radians(r.dt), part) for r in records for part in r.parts if part.kind == "sine"]  # type: ignore[attr-defined]
    fundamentals = distinct(np.array([w for w, _ in sines]))
    reached = {"front": fundamentals, "back": distinct(np.concatenate([fundamentals, 2 * fundamentals]))}
    if not _dynamic(truth, "front") and not _dynamic(truth, "back"):  # nonlinear first and last
        if len(fundamentals):
            g, h = (linear_response(s, fundamentals) for s in (system, truth))
            yield "linear.gain.error.max", float(np.abs(np.abs(g) - np.abs(h)).max())
            yield "linear.phase.error.max", float(np.abs(np.angle(g / h)).max())
        reached = {}
    if _split(truth) and not _split(system):  # all dynamics on one side: only their product was claimed
        g, h = (linear_gain(s, "front", fundamentals) * linear_gain(s, "back", fundamentals) for s in (system, truth))
        if len(fundamentals):
            yield "linear.gain.error.max", float(np.abs(np.abs(g) - np.abs(h)).max())
            yield "linear.phase.error.max", float(np.abs(np.angle(g / h)).max())
        reached = {}
    for side, omega in reached.items():
        if len(omega):
            expected = linear_gain(truth, side, omega)
            ratio = linear_gain(system, side, omega) / expected
            true = np.abs(expected)
            yield f"{side}.gain.error.max", float(np.abs(np.abs(ratio) * true - true).max())
            yield f"{side}.phase.error.max", float(np.abs(np.angle(ratio)).max())
    levels = np.unique([part.level for r in records for part in r.parts if part.kind == "hold"])  # type: ignore[attr-defined]
    if not len(levels):
        levels = _without_memory(system, reach, truth)
    if len(levels):
        dt = records[0].dt
        ours, true = (_held(s, levels, dt) for s in (system, truth))
        span = float(np.ptp(true)) or 1.0
        yield "nonlinearity.error.max", float(np.abs(ours - true).max() / span)
        yield "nonlinearity.error.rms", rms(ours - true) / span
