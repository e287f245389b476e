"""The Wiener-Hammerstein benchmark of SYSID 2009, from a cold start: bars on a fifth of the record never looked at."""

from dataclasses import replace

import numpy as np
import pytest

from tests.measured_data import DATA, measured_study
from whid.experiments.noise_band import NoiseBand
from whid.files.ingest import ingest
from whid.methods.parametric import Parametric
from whid.predict import predict

REPORT = slice(80_000, 100_000)


@pytest.fixture(scope="module")
def benchmark():
    return ingest(measured_study("wh_sysid09").data, DATA).record


def fitted(method, record):
    stages = {type(stage).__name__: stage for stage in method([record.without("report")])}
    error = predict(stages["Model"].system.tree, record) - record.y
    return stages, 1e3 * float(np.sqrt(np.mean(error[REPORT] ** 2))), error


@pytest.fixture(scope="module")
def cold(benchmark):
    return fitted(measured_study("wh_sysid09").identify, benchmark)


def test_from_a_cold_start_with_only_the_orders(cold):
    stages, rmse, error = cold
    print(f"report RMSE {rmse:.4f} mV, estimation {1e3 * np.std(error[6200:80_000]):.4f} mV")
    assert rmse <= 0.235
    allocation, aliasing, tone = (stages[name] for name in ("Allocation", "BetweenSamples", "Interference"))
    assert allocation.front_poles[0] == 3
    assert aliasing.present
    assert aliasing.coefficient == pytest.approx(1.0, abs=0.15)
    assert tone.omega / (2 * np.pi) == pytest.approx(51_200 / 123, abs=0.03)
    assert tone.harmonics.tolist() == [1, 3, 5]


def test_the_curve_is_the_diodes(cold):
    """Straight up to a soft knee, nearly flat beyond it."""
    curve = cold[0]["Model"].system.series[1]
    straight, flat = curve.derivative(np.array([-1.5, -0.5])), curve.derivative(np.array([1.9]))
    assert np.ptp(straight) < 0.03 * straight.mean()
    assert 0 < flat[0] < 0.08 * straight.mean()


@pytest.mark.slow
def test_the_tone_pays_on_samples_kept_aside_for_selection(benchmark):
    """The tone is part of the model unless `interference: none`; the report samples have no say in that."""
    kept, part = slice(64_000, 80_000), NoiseBand(start=5200, stop=64_000)
    record = replace(benchmark, u=benchmark.u[:80_000], y=benchmark.y[:80_000], valid=None, parts=(part,))
    system = list(measured_study("wh_sysid09").identify([record]))[-1].system
    assert system.chain[-1].kind == "tone"
    alone = replace(system, chain=system.chain[:-1])
    rms = [1e3 * float(np.std((predict(s.tree, record) - record.y)[kept])) for s in (alone, system)]
    print(f"selection RMSE {rms[0]:.4f} mV without the tone, {rms[1]:.4f} mV with it")
    assert rms[1] < rms[0]
    assert np.sqrt(rms[0] ** 2 - rms[1] ** 2) == pytest.approx(0.05, abs=0.01)  # .068 / √2 and its harmonics


@pytest.mark.slow
def test_with_the_orders_searched_too(benchmark):
    stages, rmse, _ = fitted(Parametric(), benchmark)
    print(f"report RMSE {rmse:.4f} mV, {len(stages['LinearFit'].poles)} poles")
    assert rmse <= 0.235


@pytest.mark.slow
def test_random_segments_of_a_fifth(benchmark):
    starts = np.random.default_rng(2009).integers(5200, 60_000, 20)
    found = []
    for start in starts:
        part = NoiseBand(start=int(start), stop=int(start) + 20_000)
        report = NoiseBand(start=80_000, stop=100_000, use="report")
        record = type(benchmark)(**{**vars(benchmark), "parts": (part, report)})
        found.append(fitted(measured_study("wh_sysid09").identify, record)[1])
    print("report RMSE, mV:", np.round(found, 4))
    assert max(found) <= 0.30
