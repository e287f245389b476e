"""What staircase and sines leave open, in words."""

from __future__ import annotations

from collections.abc import Sequence

from whid.methods._sines import ChainData, Sine
from whid.record import Record
from whid.stages.lags import Lags
from whid.stages.rational import Rational
from whid.stages.settle import Settle


def left_out(
    records: Sequence[Record], settles: Sequence[Settle], sines: Sequence[Sine], heard: Sequence[Sine]
) -> tuple[str, ...]:
    """Return what of the data could not be used, or not as the errors assume."""
    said = []
    if drifting := [settle for settle in settles if not settle.reached]:
        said.append(f"the levels had not settled: {max(drifting, key=lambda settle: settle.bias).drift()}")
    if short := sum(len(list(record.select("sine"))) for record in records) - len(sines):
        said.append(f"{short} sine{'s' * (short > 1)} left out: fewer than two periods after the settling time")
    if silent := len(sines) - len(heard):
        said.append(f"{silent} sine{'s' * (silent > 1)} left out: nothing of it stands out of the noise")
    return tuple(said)


def of_sines(left: bool, data: ChainData, fit: Rational) -> tuple[str, ...]:
    """Return what harmonics and their joint fit leave open."""
    missing = []
    if left:
        missing.append(
            "a sine has harmonics above the degree of its piece: it left the piece; all its harmonics were fitted"
        )
    if len(data.opened):
        where = ", ".join(f"{b:.4g}" for b in data.opened)
        missing.append(f"the levels show a kink about {where}, but the sines that cross it show a jump there")
    if not fit.explained:
        missing.append(
            f"levels and harmonics together are not explained by f, front and back as found: χ²/dof "
            f"{fit.estimate.reduced_chi2:.3g}; the standard errors do not hold"
        )
    if fit.estimate.why_stop != "converged" or fit.agreeing < 2:
        missing.append(
            f"the joint fit may not have found its best minimum: {fit.estimate.why_stop}, {fit.agreeing} of "
            f"{fit.starts} starts agree"
        )
    if fit.rivals():
        missing.append(
            f"orders are uncertain; zeros/poles of front, of back within 6 of the best BIC: {'; '.join(fit.rivals())}"
        )
    return tuple(missing)


def of_steps(found: Lags) -> tuple[str, ...]:
    """Return what the transitions between levels leave open."""
    missing = [
        "no sines that move the output beyond noise: the frequency responses of front and back are those of one lag, "
        "not measured ones"
    ]
    if not found.decided:
        missing.append("level transitions cannot tell a lag in front of f from one behind it: sines on a curved piece can")
    return tuple(missing)
