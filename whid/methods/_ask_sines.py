"""Sines that a method asks for: at frequencies that connect the phases, and across a break between affine pieces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from whid.experiments import sine as planned
from whid.methods._method import Wanted
from whid.methods._sines import ChainData, Sine, is_affine
from whid.signal import Floats
from whid.stages._inner_harmonics import inner_harmonics
from whid.stages.connecting import connecting
from whid.stages.identifiability import identifiability
from whid.stages.rational import Rational
from whid.stages.segmentation import Segmentation

FEWEST = 16  # samples a period of the highest sine asked for


def ask_connecting(
    sines: Sequence[Sine], dt: float, data: ChainData, fit: Rational, pieces: Segmentation, settle: float
) -> Wanted | None:
    """Ask for the frequencies that a chain lacks, where the phases fall into groups that nothing connects.

    Each like the sine next to it in frequency, and as many samples of it. Predicted: std/|H₂| of the phases of their second
    harmonics, |H₂| = |A₂(f, U|G_front(jω)|) G_back(2jω)| by the fit, std that of the sine next to it with its own number of
    samples, root mean square: no unbiased estimate from that sine alone is better. Source [PAPERS A, build 5].
    """
    responses = data.responses
    report = identifiability(responses.omega, [[k for k in ks if k] for ks in responses.orders])
    missing = connecting(responses.omega, max(data.static.degrees), 2 * np.pi / (FEWEST * dt))
    if report.nullity < 2 or is_affine(data.static) or not len(missing):
        return None
    like = [min(sines, key=lambda s: abs(np.log(s.omega / w))) for w in missing]
    plan = tuple(_sine(s, w, dt, settle) for s, w in zip(like, missing, strict=True))
    front = np.abs(_gain(fit.front_num, fit.front_den, missing))
    back = np.abs(_gain(fit.back_num, fit.back_den, 2 * missing))
    made = np.array([_second(pieces, one, g) for one, g in zip(plan, front, strict=True)]) * back
    std = np.array([_std(s, one) for s, one in zip(like, plan, strict=True)])
    predicted = float(np.sqrt(np.mean((std / np.maximum(made, 1e-300)) ** 2)))
    groups = "; ".join(", ".join(f"{w:.4g}" for w in group) for group in report.groups)
    reason = f"the phases fall apart into {len(report.groups)} groups ({groups} rad/s), each with a delay of its own"
    return Wanted(plan, reason, predicted, "the phase of the second harmonics, rad")


def ask_crossing(
    sines: Sequence[Sine], dt: float, data: ChainData, pieces: Segmentation, reach: tuple[float, float], settle: float
) -> Wanted | None:
    """Ask for the same sines about the nearest break, where all of them stay on one affine piece.

    Inside it only front·back is identifiable; across a break the harmonics are A_k(U|G_front|)·G_back(jkω), and the mean
    tells |G_front|. About the break itself, so that every sine crosses it however little of it the front block lets
    through; not larger than the levels reach. Source [PAPERS A, build 6].
    """
    if not is_affine(data.static) or not len(pieces.breaks):
        return None
    plan = []
    for like in sines:
        at = float(pieces.breaks[np.argmin(np.abs(pieces.breaks - like.offset))])
        amplitude = min(abs(like.phasor), at - reach[0], reach[1] - at)
        plan.append(replace(_sine(like, like.omega, dt, settle), offset=at, amplitude=float(f"{amplitude:.3g}")))
    std = [_std(like, one) for like, one in zip(sines, plan, strict=True)]
    where = ", ".join(f"{at:.4g}" for at in sorted({one.offset for one in plan}))
    reason = f"inside one affine piece only the product front·back shows: the same sines about the break at {where}"
    return Wanted(tuple(plan), reason, float(np.sqrt(np.mean(np.square(std)))), "a part of their harmonics, output")


def _sine(like: Sine, omega: float, dt: float, settle: float) -> planned.Sine:
    """Return a sine with as many samples as another, after the periods that settling takes."""
    period = 2 * np.pi / (omega * dt)
    whole = float(round(period)) if abs(period - round(period)) < 1e-6 * period else float(period)
    periods = int(np.ceil(like.harmonics.periods * like.harmonics.period / period - 1e-9))
    amplitude, lead = float(f"{abs(like.phasor):.3g}"), int(np.ceil(settle / (period * dt)))
    return planned.Sine(offset=like.offset, amplitude=amplitude, period=whole, periods=periods, lead_periods=lead)


def _second(pieces: Segmentation, sine: planned.Sine, gain: float) -> float:
    """Return |A₂| of f for a sine behind a gain."""
    at, size = np.array([sine.offset]), np.array([sine.amplitude * gain])
    return float(np.abs(inner_harmonics(pieces.breaks, np.nan_to_num(pieces.coefficients), at, size, 2).value[0, 2]))


def _std(like: Sine, sine: planned.Sine) -> float:
    """Return the standard error of a part of the second harmonic: that of a sine measured, for the samples there will be."""
    samples = float(sine.periods or 0) * float(sine.period or 0.0)
    return float(like.harmonics.value_std[2] * np.sqrt(like.harmonics.periods * like.harmonics.period / samples))


def _gain(num: Floats, den: Floats, omega: Floats) -> Floats:
    s = 1j * np.asarray(omega)
    return np.asarray(np.polyval(num, s) / np.polyval(den, s))
