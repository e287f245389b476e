"""A fitted cascade as a Model: discrete blocks and a static curve, oversampled where that was found."""

from __future__ import annotations

import numpy as np

from whid.blocks._block import Block
from whid.blocks.oversampled import Oversampled
from whid.blocks.tone import Tone
from whid.fit import Estimate
from whid.methods._method import Model
from whid.signal import Floats
from whid.stages._cascade import Cascade, Filter, monic_rates
from whid.stages.interference import Interference
from whid.system import System


def from_cascade(cascade: Cascade, estimate: Estimate, factor: int, dt: float, missing: tuple[str, ...]) -> Model:
    """Return the model with its covariance, the filters' coefficients in powers of z⁻¹ over den[0]."""
    blocks: list[Block] = []
    names: list[str] = []
    jacobian, at = [], 0
    for part in cascade.parts:
        inside = f"chain.{len(blocks)}." if factor == 1 else f"chain.0.chain.{len(blocks)}."
        own, rates, count = _filter(part, dt / factor) if isinstance(part, Filter) else _curve(part)
        if own is not None:
            blocks.append(own)
            names += [inside + name for name in rates]
            jacobian.append((at, np.array(list(rates.values())).reshape(len(rates), count)))
        at += count
    values = {p.name: p.value for p in _tree(blocks, factor).tree.parameters(held=True)}
    whole = np.zeros((len(names), at))
    row = 0
    for column, part_rates in jacobian:
        whole[row : row + len(part_rates), column : column + part_rates.shape[1]] = part_rates
        row += len(part_rates)
    whole = whole[:, cascade.free]
    covariance, lost = whole @ estimate.covariance @ whole.T, estimate.null_directions @ whole.T
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    mapped = estimate._replace(
        names=tuple(names), values=np.array([values[name] for name in names]), covariance=covariance,
        std=np.where(np.abs(lost).max(axis=0, initial=0.0) > 1e-6, np.inf, std), null_directions=lost,
    )  # fmt: skip
    return Model(_tree(blocks, factor), mapped, "unit_dc", missing)


def with_tone(model: Model, found: Interference) -> Model:
    """Return the model with a tone added to its output, uncorrelated with the rest."""
    chain, e, tone = model.system.chain, model.estimate, found.estimate
    block = Tone(
        omega=found.omega, cos=tuple(map(float, found.cos)), sin=tuple(map(float, found.sin)),
        harmonics=tuple(map(int, found.harmonics)),
    )  # fmt: skip
    covariance = np.zeros((len(e.values) + len(tone.values),) * 2)
    covariance[: len(e.values), : len(e.values)], covariance[len(e.values) :, len(e.values) :] = (
        e.covariance,
        tone.covariance,
    )
    estimate = e._replace(
        names=e.names + tuple(f"chain.{len(chain)}.{name}" for name in tone.names),
        values=np.append(e.values, tone.values), std=np.append(e.std, tone.std), covariance=covariance,
        rank=e.rank + tone.rank, null_directions=np.empty((0, len(covariance))), chi2=tone.chi2, dof=e.dof - tone.rank,
    )  # fmt: skip
    return model._replace(system=System(chain=(*chain, block)), estimate=estimate)


def _tree(blocks: list[Block], factor: int) -> System:
    return System(chain=tuple(blocks) if factor == 1 else (Oversampled(factor=factor, chain=tuple(blocks)),))


def _filter(h: Filter, dt: float) -> tuple[Block | None, dict[str, Floats], int]:
    """Return the block, its free numbers with their derivatives, and how many numbers the filter has."""
    count = len(h.num) + len(h.den)
    if not count:
        return None, {}, 0
    block = h.block(dt)
    names = [p.name for p in block.parameters()]
    rates = dict(zip(names, monic_rates(h), strict=True))
    return block, {name: rate for name, rate in rates.items() if name != "den.0"}, count


def _curve(curve: Block) -> tuple[Block | None, dict[str, Floats], int]:
    names = [p.name for p in curve.parameters()]
    return curve, dict(zip(names, np.eye(len(names)), strict=True)), len(names)
