"""Long records: simulated or read in chunks, number for number what the whole record is."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from tests import design_p
from whid import flow
from whid.blocks.linear import Linear
from whid.blocks.polynomial import Polynomial
from whid.blocks.saturation import Saturation
from whid.config.load import load_study
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
from whid.files import csv, hdf5_table
from whid.files import ingest_long as ingest_module
from whid.files.ingest import ingest
from whid.files.ingest_long import ingest_long
from whid.files.source import Columns, DataSource
from whid.fit import linear_least_squares
from whid.long_record import LongRecord
from whid.methods.memoryless import Memoryless
from whid.methods.wiener_hammerstein import WienerHammerstein
from whid.operations.scale import Scale
from whid.record import Chunk
from whid.signal import Spread
from whid.simulate import simulate, stream
from whid.stages import _curve_sums as sums_module
from whid.stages._chebyshev import nodes, scaled
from whid.stages._curve_sums import curve_sums, one_chunk
from whid.stages._local_lines import Seen, Windows
from whid.stages.chebyshev_fit import fit_of
from whid.stages.levels import StaticCurve
from whid.stages.memory import memory_of
from whid.stages.node_plus import half_way
from whid.stages.periods import Harmonics
from whid.stages.settle import Settle
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
    band, rest = NoiseBand(band=(0.3, 0.8), std=0.4, duration_s=700), NoiseBand(std=0.4, duration_s=300, use="report")
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


ROWS = 1500


def table(tmp_path, kind, missing, edit):
    """A file of a memoryless system, and its source; edit(t, u, y) may drop rows or put NaN."""
    rng = np.random.default_rng(11)
    t, u = 5 + 0.01 * np.arange(ROWS), rng.uniform(-1, 1, ROWS)
    t, u, y = edit(t, u, u + 0.5 * u**3 + 0.01 * rng.standard_normal(ROWS))
    path = tmp_path / f"long.{kind}"
    if kind == "csv":
        rows = [",".join(f"{x:.9g}" if np.isfinite(x) else "" for x in row) for row in zip(t, u, y, strict=True)]
        path.write_text("t,u,y\n" + "\n".join(rows) + "\n")
    else:
        with h5py.File(path, "w") as file:
            file["t"], file["both"] = t, np.stack([u, y], axis=1)
    columns = (
        Columns(time="t", input="u", output="y") if kind == "csv" else Columns(time="t", input="both.0", output="both.1")
    )
    scale = (Scale(factor=2.0, column="output"),)
    return DataSource(file=str(path), columns=columns, missing=missing, operations=scale)


def rows_left_out(t, u, y):
    """Holes of four rows and of one, y missing beside one and before another, the input of both kinds."""
    y[::13], u[700:720] = np.nan, 0.25
    y[697], y[712] = np.nan, np.nan
    kept = (np.arange(ROWS) % 350 > 3) | (np.arange(ROWS) < 9)
    kept[[77, 705, 706, 1400]] = False
    return t[kept], u[kept], y[kept]


@pytest.mark.parametrize("size", [7, 640, 10**6])
@pytest.mark.parametrize(("kind", "missing"), [("csv", "mask"), ("csv", "interpolate"), ("h5", "interpolate")])
def test_a_file_in_chunks_is_the_file(tmp_path, monkeypatch, kind, missing, size):
    monkeypatch.setattr(csv, "CHUNK", size)
    monkeypatch.setattr(hdf5_table, "BLOCK", size)
    monkeypatch.setattr(ingest_module, "FIRST", 5)

    def edit(t, u, y):
        t, u, y = rows_left_out(t, u, y)
        if missing == "mask":  # a hole in the input may be masked only where it is held
            u[:] = np.repeat(u[::50], 50)[: len(u)]
            u[np.arange(len(u)) // 50 % 7 == 0] = 0.25
            keep = np.abs(np.diff(u, append=u[-1])) < 1e9
            return t[keep], np.where(np.diff(t, append=t[-1] + 0.01) > 0.011, np.roll(u, -1), u), y
        return t, u, y

    source = table(tmp_path, kind, missing, edit)
    (whole, said, _), (long, notes, _) = ingest(source, tmp_path), ingest_long(source, tmp_path)
    assert set(notes) == {*said, f"{len(whole)} samples, read in chunks"}
    assert (len(long), long.t0, long.units) == (len(whole), whole.t0, whole.units)
    assert long.dt == pytest.approx(whole.dt, rel=1e-12)
    u, y = gathered(long)
    np.testing.assert_allclose(u, whole.u, rtol=1e-13)
    np.testing.assert_allclose(y, np.where(whole.mask, whole.y, np.nan), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize(
    ("change", "code", "said"),
    [
        (lambda lines: [*lines[:1200], lines[1200][:15]], "data-cell", "long.csv:1201"),  # a file cut mid-way
        (lambda lines: [*lines[:900], lines[900].replace(",", ",x"), *lines[901:]], "data-cell", "long.csv:901"),
        (lambda lines: [*lines[:900], lines[899], *lines[901:]], "data-time-order", "long.csv:901"),
        (lambda lines: [*lines[:900], lines[900].rpartition(",")[0] + ",", *lines[901:]], "data-missing", "long.csv:901"),
        (lambda lines: [lines[0], *(line.rpartition(",")[0] + ",1.5" for line in lines[1:])], "data-dead", "output"),
    ],
)
def test_faults_of_a_file_in_chunks_name_the_row(tmp_path, monkeypatch, change, code, said):
    monkeypatch.setattr(csv, "CHUNK", 100)
    source = table(tmp_path, "csv", "error", lambda *columns: columns)
    path = tmp_path / "long.csv"
    path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")
    for read in (ingest, ingest_long):
        with pytest.raises(WhidError) as fault:
            read(source, tmp_path)
        assert fault.value.code == code
        assert said in str(fault.value)


def test_a_damaged_hdf5_file_is_named(tmp_path):
    source = table(tmp_path, "h5", "error", lambda *columns: columns)
    path = tmp_path / "long.h5"
    path.write_bytes(path.read_bytes()[:20_000])
    with pytest.raises(WhidError) as fault:
        ingest_long(source, tmp_path)
    assert fault.value.code == "data-unreadable"


STUDY = """
name: long
seed: 3
plant:
  chain: [{kind: polynomial, coefficients: [0, 0.6, 0, 0.4]}]
  noise: {kind: white, std: 0.1}
experiment:
  dt: 0.01
  parts:
    - {kind: multisine, period: 5003, periods: 20, band: [0, 0.9], rms: 0.4}
    - {kind: multisine, period: 5003, periods: 6, band: [0, 0.9], rms: 0.4, use: report}
identify: {kind: memoryless, order: 3, domain: [-1, 1], half_width: 0.02}
"""


def test_a_run_in_chunks_is_the_run(tmp_path, monkeypatch):
    """The same metrics, stages and pictures; what is kept of the record is thinned, and read back."""
    config = tmp_path / "long.yaml"
    config.write_text(STUDY)
    monkeypatch.setattr("whid.config.memory.SAMPLE", 10_000)  # as if it were long
    study = load_study(config)
    whole = flow.execute(study, tmp_path, np.random.SeedSequence(study.seed))
    long = flow.run(config, tmp_path / "long", max_memory=4e8)
    assert whole.error is None
    assert long.error is None
    assert long.pictures == ("memoryless_curve.png", "residual.png")
    assert list(long.stages) == list(whole.stages)
    for name, value in whole.metrics.items():
        np.testing.assert_allclose(long.metrics[name], value, rtol=1e-9, err_msg=name)
    assert (len(whole.records[0]), len(long.records[0])) == (140_084, 70_042)
    assert "140084 samples in chunks, every 2th kept" in str(long.tables[0])
    again = flow.load(long.path)
    np.testing.assert_array_equal(again.records[0].u, whole.records[0].u[::2])


def test_a_long_record_without_report_parts_is_read_once(tmp_path, monkeypatch):
    """What the sums tell of the residual is what a pass of its own would find, some samples outside the domain."""
    config = tmp_path / "long.yaml"
    config.write_text("\n".join(line for line in STUDY.splitlines() if "use: report" not in line))
    monkeypatch.setattr("whid.config.memory.SAMPLE", 10_000)  # as if it were long
    reads, read = [], LongRecord.chunks
    monkeypatch.setattr(LongRecord, "chunks", lambda self, outputs=True: reads.append(outputs) or read(self, outputs))
    study = load_study(config)
    whole = flow.execute(study, tmp_path, np.random.SeedSequence(study.seed))
    long = flow.run(study, tmp_path / "long", max_memory=4e8)
    assert long.error is None
    assert list(long.stages) == list(whole.stages)
    assert reads.count(True) == 3  # all of it once; the beginning for the noise's colour and for what is between samples
    for name, value in whole.metrics.items():
        np.testing.assert_allclose(long.metrics[name], value, rtol=1e-9, err_msg=name)
    np.testing.assert_allclose(long.residuals[0], whole.residuals[0][:: long.records[0].every], rtol=0, atol=1e-12)


@pytest.mark.parametrize("order", [1, 3, 8])
@pytest.mark.parametrize("domain", [(-1.0, 1.0), (-0.9, 0.7)])
def test_sums_of_cells_are_those_of_terms(monkeypatch, order, domain):
    """Beyond a million samples a cell's power series stands for the terms: all sums, windows and what lies outside."""
    rng = np.random.default_rng(12)
    x, noise = np.append(rng.uniform(-1.2, 1.2, 150_000), domain), 0.1 * rng.standard_normal(150_002)
    earlier = np.stack([np.roll(x, 1), np.roll(x, 2)])
    chunks = one_chunk(x, 100 + np.cos(3 * x) + noise, earlier)

    def found():
        windows = Windows(nodes(order), half_way(order), order)
        return curve_sums(chunks, order, domain, windows=[windows]), windows

    monkeypatch.setattr(sums_module, "TESTED", 10**9)
    exact, _ = found()
    monkeypatch.setattr(sums_module, "TESTED", 100_000)
    cells, windows = found()
    assert cells.tested.samples < cells.left.samples == exact.left.samples == exact.tested.samples
    samples = exact.left.samples
    asked, of_all = (memory_of(sums, fit_of(sums)) for sums in (cells, exact))
    assert f"asked of {cells.tested.samples} of {samples} samples" in asked.table().notes[1]
    assert len(of_all.table().notes) == 1
    np.testing.assert_allclose(cells.left.sums, exact.left.sums, rtol=0, atol=1e-11 * samples)
    np.testing.assert_allclose(
        cells.left.products, exact.left.products, rtol=0, atol=1e-10 * exact.left.square**0.5 * samples**0.5
    )
    np.testing.assert_allclose(cells.left.square, exact.left.square, rtol=1e-9)
    np.testing.assert_allclose(cells.outputs, Spread.of(chunks[0].y), rtol=1e-9)
    one, other = (fit_of(sums) for sums in (exact, cells))
    np.testing.assert_allclose(other.coefficients, one.coefficients, rtol=0, atol=1e-7 * one.bound.min())
    t = scaled(x, domain)
    direct = Windows.filled(t, chunks[0].y, nodes(order), half_way(order), 15, order)
    seen = Seen.of(t)
    for line, expected in zip(windows.lines(domain, seen, 15), direct.lines(domain, seen, 15), strict=True):
        for name, value in expected._asdict().items():
            np.testing.assert_allclose(getattr(line, name), value, rtol=1e-8, atol=1e-9, err_msg=name)
    rest = chunks[0].y - np.polynomial.chebyshev.chebval(t, one.coefficients)
    np.testing.assert_allclose(cells.rest(one.coefficients), rest @ rest, rtol=1e-9)


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["identify={kind: parametric}"], "parametric needs whole records in memory"),
        (["identify.inverse=true"], "inverse: true"),
        (["experiment.parts[0]={kind: noise_band, duration_s: 4e4}"], "drawn at once"),
    ],
)
def test_what_needs_whole_records_is_refused_before_it_starts(tmp_path, monkeypatch, overrides, said):
    config = tmp_path / "long.yaml"
    config.write_text(STUDY)
    monkeypatch.setattr("whid.config.memory.SAMPLE", 10_000)  # as if it were long
    with pytest.raises(WhidError, match=said) as fault:
        flow.run(config, tmp_path / "long", overrides, max_memory=4e8)
    assert fault.value.code == "memory"


@pytest.mark.parametrize("settle_s", [None, 60.0])
def test_levels_and_harmonics_from_chunks(settle_s):
    """The staged method: number for number down to the fits, in two passes, in one where the settling time is declared."""
    whole = design_p.record(5)
    long, reads = cut(whole, 1000), []

    def counted(outputs=True):
        reads.append(outputs)
        return long.read(outputs)

    method = WienerHammerstein(whole_record=False, settle_s=settle_s, orders=(2, 2))
    pairs = list(zip(method([whole]), method([replace(long, read=counted)]), strict=True))
    assert len(reads) == (1 if settle_s else 2)
    for one, other in pairs:
        assert type(one) is type(other)
        if isinstance(one, (Settle, StaticCurve, Harmonics)):
            for name, value in one._asdict().items():
                np.testing.assert_allclose(getattr(other, name), value, rtol=1e-9, atol=1e-11, err_msg=name)
    one, other = pairs[-1]
    np.testing.assert_allclose(other.estimate.values, one.estimate.values, rtol=0, atol=1e-3 * one.estimate.std.min())
