"""Holds and periodic parts read chunk by chunk: the numbers of whole ones, and where blocks come in their statistics."""

import numpy as np
import pytest
from scipy.stats import chi2

from whid.stages._hold_sums import HoldSums
from whid.stages._period_blocks import PeriodBlocks
from whid.stages.levels import curve_of, level_means
from whid.stages.periods import harmonics
from whid.stages.settle import cuts_of, settle_of, settle_time, used_of

LENGTHS = (400, 431, 90, 517, 400)


def fed(reader, y, size):
    for k in range(0, len(y), size):
        reader.add(y[k : k + size])
    return reader


def holds(missing):
    """Settling holds under coloured noise, one too short to count."""
    rng, found = np.random.default_rng(21), []
    for k, n in enumerate(LENGTHS):
        noise = np.convolve(rng.standard_normal(n + 60), 0.7 ** np.arange(60), "valid")[:n]
        y = k + 0.1 * noise * (1 + (k == 3)) + 5 * np.exp(-np.arange(n) / 20)
        y[rng.random(n) < missing] = np.nan
        found.append(y)
    return found


def same(found, expected):
    assert type(found) is type(expected)
    for name, one in expected._asdict().items():
        np.testing.assert_allclose(getattr(found, name), one, rtol=1e-9, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("size", [1, 7, 1000])
@pytest.mark.parametrize("missing", [0.0, 0.1])
def test_holds_in_chunks(size, missing):
    ys, lengths = holds(missing), np.array(LENGTHS)
    used = used_of(lengths)
    cuts = cuts_of(lengths[used])
    places = [cuts.places(h) for h in range(len(used))]
    read = [fed(HoldSums(lengths[k], at, lengths[k] // 2, 10**6), ys[k], size) for k, at in zip(used, places, strict=True)]
    scale = max(reader.largest for reader in read)
    same(settle_of([r.cumulated() for r in read], [r.head() for r in read], scale, 0.1), settle_time(ys, 0.1))
    level, direction = np.arange(5.0), np.ones(5)
    read = [fed(HoldSums(len(y), np.empty(0, int), 137, 10**6), y, size) for y in ys]
    same(curve_of([r.held() for r in read], level, direction, 13.7), level_means(ys, level, direction, 0.1, 13.7))


def test_the_mean_of_a_hold_is_that_of_all_samples_the_noise_that_of_the_first():
    rng = np.random.default_rng(22)
    ys = [k + 0.1 * rng.standard_normal(20_000) for k in range(3)]
    read = [fed(HoldSums(len(y), np.empty(0, int), 100, 4000), y, 777) for y in ys]
    found, whole = (
        curve_of([r.held() for r in read], np.arange(3.0), np.ones(3), 1.0),
        level_means(ys, np.arange(3.0), np.ones(3), 0.01, 1.0),
    )
    np.testing.assert_allclose(found.mean, whole.mean, rtol=1e-12)
    np.testing.assert_array_equal(found.samples, whole.samples)
    low, high = np.sqrt(chi2.ppf([5e-4, 1 - 5e-4], 12_000) / 12_000)
    assert low < found.noise_std / 0.1 < high
    np.testing.assert_allclose(found.mean_std, found.noise_std / np.sqrt(19_900), rtol=1e-6)


def periodic(rng, period, length, noise=0.2):
    n = np.arange(length)
    wave = 1 + np.cos(2 * np.pi * n / period - 0.5) + 0.3 * np.cos(6 * np.pi * n / period + 1)
    return wave + noise * rng.standard_normal(length)


@pytest.mark.parametrize("period", [50, 50.3])
@pytest.mark.parametrize("missing", [0.0, 0.05])
@pytest.mark.parametrize("size", [7, 10**6])
def test_a_part_of_one_block_is_the_whole(period, missing, size):
    rng = np.random.default_rng(23)
    y = periodic(rng, period, round(21.4 * period))
    y[rng.random(len(y)) < missing] = np.nan
    found = fed(PeriodBlocks(len(y), period, 2, 6), y, size).harmonics(np.array([0.3]))
    same(found, harmonics(y, period, 2, 6, np.array([0.3])))


@pytest.mark.parametrize("period", [50, 50.3])
def test_a_part_of_many_blocks(period):
    """Nothing missing and a whole period: the same harmonics; their errors within what as many lines allow, and as it is."""
    rng, errors = np.random.default_rng(24), []
    for _ in range(20):
        y = periodic(rng, period, round(203 * period))
        found = fed(PeriodBlocks(len(y), period, 2, 6, block=1000), y, 613).harmonics()
        whole = harmonics(y, period, 2, 6)
        assert (found.periods, len(found.value)) == (whole.periods, len(whole.value))
        tolerance = 1e-12 if period == 50 else 0.3 * whole.value_std[0]
        np.testing.assert_allclose(found.value, whole.value, rtol=0, atol=tolerance)
        low, high = np.sqrt(chi2.ppf([1e-5, 1 - 1e-5], 2 * found.own_lines) / (2 * found.own_lines))
        true = 0.2 * np.sqrt(2 / (201 * period))
        assert np.all((found.own_std[1:] / true > low) & (found.own_std[1:] / true < high))
        errors.append((found.value - [1, np.exp(-0.5j), 0, 0.3 * np.exp(1j), 0, 0, 0])[1:] / found.value_std[1:])
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 2 * np.size(errors))
    assert low < np.sum(np.abs(errors) ** 2) < high
