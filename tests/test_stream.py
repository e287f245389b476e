"""Long records: simulated or read in chunks, number for number what the whole record is."""

from dataclasses import replace

import numpy as np
import pytest

from whid.blocks.linear import Linear
from whid.blocks.polynomial import Polynomial
from whid.blocks.saturation import Saturation
from whid.disturbances.ar import Ar
from whid.disturbances.jitter import Jitter
from whid.disturbances.level import Level
from whid.disturbances.outliers import Outliers
from whid.disturbances.process import Process
from whid.disturbances.rounding import Rounding
from whid.disturbances.white import White
from whid.errors import WhidError
from whid.experiments._experiment import Experiment
from whid.experiments.hold import Hold
from whid.experiments.multisine import Multisine
from whid.experiments.noise_band import NoiseBand
from whid.experiments.sine import Sine
from whid.experiments.square import Square
from whid.experiments.steps import Steps
from whid.fit import linear_least_squares
from whid.long_record import LongRecord
from whid.methods.memoryless import Memoryless
from whid.record import Chunk
from whid.simulate import simulate, stream
from whid.stages._curve_sums import curve_sums, one_chunk
from whid.stages.chebyshev_fit import fit_of
from whid.system import System

LAG = Linear(num=(1.0,), den=(0.5, 1.0))
CHAIN = (LAG, Saturation(low=-0.4, high=0.6), LAG)
PARTS = (
    Hold(level=0.3, hold_s=900.0),
    Sine(offset=0.2, amplitude=0.7, period=211.3, periods=60),
    Multisine(period=5003, periods=6, band=(0.0, 0.3)),
    Square(amplitude=0.5, period=77, periods=50),
    Steps(low=-1.0, high=1.0, hold_s=(0.5, 30.0), duration_s=1500.0),
    NoiseBand(duration_s=700.0),
)
NOISES = {
    "none": (),
    "white, ar, level, outliers, rounding": (
        White(std=0.1), Ar(coefficients=(0.5, 0.2), std=0.1), Level(std=0.01), Outliers(std=0.1), Rounding(std=0.1),
    ),
    "process": (Process(std=0.1, bandwidth=1.0), White(std=0.1)),
}  # fmt: skip


def gathered(record):
    chunks = list(record.chunks())
    assert [c.start for c in chunks] == np.cumsum([0, *(len(c.u) for c in chunks)])[:-1].tolist()
    return np.concatenate([c.u for c in chunks]), np.concatenate([c.y for c in chunks])


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize(("intersample", "initial"), [("zoh", "rest"), ("foh", "steady"), ("discrete", "steady")])
def test_simulated_in_chunks_bit_for_bit(noise, intersample, initial):
    plant = System(chain=CHAIN, noise=NOISES[noise])
    experiment = Experiment(dt=0.1, parts=PARTS, intersample=intersample, initial=initial)
    whole = simulate(plant, experiment, np.random.default_rng(7))
    long = stream(plant, experiment, np.random.default_rng(7))
    assert len(long) == len(whole)
    for _ in range(2):  # a second reading is the first
        for found, expected in zip(gathered(long), (whole.u, whole.y), strict=True):
            np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(np.concatenate([c.u for c in long.chunks(outputs=False)]), whole.u)


def test_a_noise_given_as_an_snr():
    plant = System(chain=CHAIN, noise=(White(snr_db=20.0),))
    experiment = Experiment(dt=0.1, parts=PARTS)
    whole, long = (make(plant, experiment, np.random.default_rng(8)) for make in (simulate, stream))
    np.testing.assert_allclose(gathered(long)[1], whole.y, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(
    ("noise", "intersample", "said"),
    [(Jitter(std=0.1), "zoh", "jitter"), (White(std=0.1), "bandlimited", "band-limited"),
     (Process(snr_db=9.0), "zoh", "needs std")],
)  # fmt: skip
def test_what_acts_on_a_whole_record_is_refused(noise, intersample, said):
    plant = System(chain=CHAIN, noise=(noise,))
    with pytest.raises(WhidError, match=said) as fault:
        stream(plant, Experiment(dt=0.1, parts=PARTS, intersample=intersample), np.random.default_rng(7))
    assert fault.value.code == "memory"


def cut(record, size):
    """The same record in chunks of a size."""

    def read(outputs=True):
        y = np.where(record.mask, record.y, np.nan)
        yield from (Chunk(k, record.u[k : k + size], y[k : k + size]) for k in range(0, len(record), size))

    return LongRecord(
        len(record), read, record.dt, record.t0, record.units, record.intersample, record.initial, record.parts,
        record.name, record.use,
    )  # fmt: skip


@pytest.fixture(scope="module")
def memoryless_record():
    """Two thirds for estimation, some outputs missing."""
    band, rest = NoiseBand(band=(0.3, 0.8), std=0.4, duration_s=1000), NoiseBand(std=0.4, duration_s=500, use="report")
    experiment = Experiment(dt=1.0, parts=(band, rest))
    plant = System(chain=(Polynomial(coefficients=(0.1, 1.0, 0.3, -0.2)),), noise=(White(std=0.05),))
    record = simulate(plant, experiment, np.random.default_rng(9))
    valid = np.arange(len(record)) % 11 > 0
    return replace(record, y=np.where(valid, record.y, np.nan), valid=valid).without("report")


@pytest.mark.parametrize(("size", "domain"), [(1, None), (7, None), (7, (-0.9, 0.7)), (5000, (-0.9, 0.7))])
def test_a_memoryless_curve_from_chunks_of_any_size(memoryless_record, size, domain):
    method = Memoryless(order=4, domain=domain)
    pairs = zip(method([memoryless_record]), method([cut(memoryless_record, size)]), strict=True)
    for whole, chunked in pairs:
        assert type(whole) is type(chunked)
        for name, one in whole._asdict().items():
            if isinstance(one, (float, int, np.ndarray)):
                np.testing.assert_allclose(getattr(chunked, name), one, rtol=1e-8, atol=1e-12, err_msg=name)


def test_sums_cancel_nothing():
    """Against the design itself, where the output is a million times its noise and the samples are many chunks."""
    rng = np.random.default_rng(10)
    x, y = rng.uniform(-1, 1, 150_000), np.empty(0)
    y = 1e3 * x**3 + 1e-3 * rng.standard_normal(len(x))
    chunks = [chunk for k in range(0, len(x), 9999) for chunk in one_chunk(x[k : k + 9999], y[k : k + 9999])]
    fit = fit_of(curve_sums(chunks, 3, (-1.0, 1.0)))
    direct = linear_least_squares(np.polynomial.chebyshev.chebvander(x, 3), y)
    np.testing.assert_allclose(fit.coefficients, direct.values, rtol=0, atol=1e-9)
    np.testing.assert_allclose(fit.rest, direct.chi2, rtol=1e-9)
    np.testing.assert_allclose(fit.estimate.covariance, direct.covariance, rtol=1e-9, atol=1e-24)
