"""From file to record: what is right comes through unchanged, what is wrong is named with its row."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from whid.blocks.dead_zone import DeadZone
from whid.blocks.linear import Linear
from whid.disturbances.white import White
from whid.errors import CATALOGUE, WhidError
from whid.experiments._experiment import Experiment
from whid.experiments.hold import Hold
from whid.experiments.sine import Sine
from whid.experiments.staircase import Staircase
from whid.files.ingest import ingest
from whid.files.source import Columns, DataSource
from whid.operations.crop import Crop
from whid.operations.decimate import Decimate
from whid.operations.lag import Lag
from whid.operations.resample import Resample
from whid.operations.scale import Scale
from whid.record import Record
from whid.simulate import simulate
from whid.system import System

PLANT = System(
    chain=(Linear(num=(1.0,), den=(2.0, 1.0)), DeadZone(low=-0.3, high=0.3), Linear(num=(1.0,), den=(1.0, 1.0))),
    noise=(White(std=0.01),),
)


def bench(n=400, seed=0, dt=0.1):
    """Steps through a first-order lag: times, input, output."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, n // 20), 20)
    y = Linear(num=(1.0,), den=(0.5, 1.0))(u, dt) + 1e-3 * rng.standard_normal(n)
    return dt * np.arange(n), u, y


def written(path, t, u, y, names="t,u,y"):
    text = "\n".join(f"{a!r},{b!r},{c!r}" for a, b, c in zip(t.tolist(), u.tolist(), y.tolist(), strict=True))
    (path / "a.csv").write_text(f"{names}\n{text}\n")
    return path


def record(path, file="a.csv", **options):
    return ingest(DataSource(file=file, **options), path)


def refused(path, code, match, file="a.csv", **options):
    with pytest.raises(WhidError, match=match) as fault:
        record(path, file, **options)
    assert fault.value.code == code
    assert fault.value.code in CATALOGUE
    assert file in fault.value.where


def test_a_simulated_record_comes_back_with_its_parts(tmp_path):
    parts = (
        Staircase(from_=-1.0, to=1.5, step=0.25, hold_s=12.0, return_=True),
        Sine(offset=0.75, amplitude=0.5, samples_per_period=(200.25, 90.0), periods=10),
    )
    truth = simulate(PLANT, Experiment(dt=0.1, parts=parts), np.random.default_rng(1))
    found = record(written(tmp_path, truth.time, truth.u, truth.y), parts="auto", initial="rest").record
    np.testing.assert_array_equal(found.u, truth.u)
    np.testing.assert_array_equal(found.y, truth.y)
    assert (found.dt, found.t0, found.initial, found.intersample) == (0.1, 0.0, "rest", "zoh")
    assert len(found.parts) == len(truth.parts) == 23
    for a, b in zip(truth.parts, found.parts, strict=True):
        assert (a.kind, a.start, a.stop, a.use) == (b.kind, b.start, b.stop, b.use)
        if isinstance(a, Hold):
            assert (b.level, b.direction) == (pytest.approx(a.level, abs=1e-12), a.direction)
        else:
            assert b.period == pytest.approx(a.period, rel=1e-6)
            assert (b.offset, b.amplitude, b.phase) == pytest.approx((a.offset, a.amplitude, a.phase), abs=1e-9)
            assert (b.periods, b.lead_periods) == (a.periods, a.lead_periods)


def test_hash_notes_and_guesses(tmp_path):
    t, u, y = bench()
    found = record(written(tmp_path, t, u, y, names="Time [s],u [V],y [m/s]"))
    assert found.sha256 == hashlib.sha256((tmp_path / "a.csv").read_bytes()).hexdigest()
    assert found.record.units == {"input": "V", "output": "m/s"}
    assert found.notes == ("columns guessed: time = Time, input = u, output = y",)
    assert (found.record.use, record(tmp_path, use="report").record.using("report").sum()) == ("estimation", 400)


def test_time_units(tmp_path):
    t, u, y = bench()
    written(tmp_path, 1000 * t, u, y)
    assert record(tmp_path, units={"time": "ms"}).record.dt == 0.1
    refused(tmp_path, "data-time-unit", "column is in ms", columns=Columns(time="t"), dt=0.1)
    written(tmp_path, 1000 * t, u, y, names="t [ms],u,y")
    assert record(tmp_path).record.dt == 0.1
    refused(tmp_path, "data-time-unit", "in ms, the config", units={"time": "s"})
    refused(tmp_path, "data-time-unit", "no unit of time", units={"time": "fortnight"})
    written(tmp_path, 1000 * t, u, y, names="t_ms,u,y")
    assert record(tmp_path).record.dt == 0.1
    written(tmp_path, np.arange(400.0), u, y)
    assert "if that is not in s" in " ".join(record(tmp_path).notes)
    refused(tmp_path, "data-time-step", "dt says 0.7 s", columns=Columns(time="t"), dt=0.7)


def test_jitter(tmp_path):
    t, u, y = bench()
    shaken = t + 0.004 * 0.1 * np.random.default_rng(1).uniform(-1, 1, 400)
    found = record(written(tmp_path, shaken, u, y))
    assert found.record.dt == pytest.approx(0.1, rel=1e-4)
    assert "jitter" in " ".join(found.notes)
    shaken = t + 0.05 * 0.1 * np.random.default_rng(1).uniform(-1, 1, 400)
    refused(written(tmp_path, shaken, u, y), "data-time-step", r"a\.csv:\d+: the step")
    resampled = record(tmp_path, operations=(Resample(input="hold"),)).record
    assert resampled.dt == pytest.approx(0.1, rel=0.01)


def test_time_that_does_not_increase_names_its_row(tmp_path):
    t, u, y = bench()
    t[[200, 201]] = t[[201, 200]]
    refused(written(tmp_path, t, u, y), "data-time-order", r"a\.csv:203: time goes from 20\.1 to 20")
    assert record(tmp_path, columns=Columns(input="u", output="y"), dt=0.1).record.dt == 0.1


def test_missing_outputs(tmp_path):
    t, u, y = bench()
    y[100:110] = np.nan
    refused(written(tmp_path, t, u, y), "data-missing", r"a\.csv:102: the output is missing here and at 9 more")
    masked = record(tmp_path, missing="mask").record
    assert np.flatnonzero(~masked.mask).tolist() == list(range(100, 110))
    assert np.isnan(masked.y[100:110]).all()
    filled = record(tmp_path, missing="interpolate")
    np.testing.assert_allclose(filled.record.y[99:111], np.linspace(y[99], y[110], 12))
    assert filled.record.valid is None
    assert "10 outputs of 400 missing: interpolated" in filled.notes


def test_missing_inputs_are_filled_only_where_the_input_is_held(tmp_path):
    t, u, y = bench()
    u[105] = np.nan  # inside a level
    np.testing.assert_array_equal(record(written(tmp_path, t, u, y), missing="mask").record.u, bench()[1])
    u[120] = np.nan  # at a step
    refused(written(tmp_path, t, u, y), "data-missing", r"a\.csv:122: the input is missing", missing="mask")
    assert record(tmp_path, missing="interpolate").record.u[120] == bench()[1][119]


def test_rows_left_out(tmp_path):
    t, u, y = bench()
    kept = np.ones(400, bool)
    kept[103:107] = False
    refused(written(tmp_path, t[kept], u[kept], y[kept]), "data-missing", r"a\.csv:104")
    found = record(tmp_path, missing="mask").record
    assert len(found) == 400
    np.testing.assert_array_equal(found.mask, kept)
    np.testing.assert_array_equal(found.u, u)


@pytest.mark.parametrize(("column", "name"), [(1, "input"), (2, "output")])
def test_dead_columns(tmp_path, column, name):
    columns = list(bench())
    columns[column] = np.full(400, 0.3)
    refused(written(tmp_path, *columns), "data-dead", f"the {name} is 0.3 from the first row to the last")


@pytest.mark.parametrize("seed", range(5))
def test_swapped_columns(tmp_path, seed):
    t, u, y = bench(seed=seed)
    written(tmp_path, t, u, y)
    record(tmp_path)
    refused(tmp_path, "data-swapped", r"a\.csv:\d+: the output", columns=Columns(time="t", input="y", output="u"))
    swapped = record(tmp_path, columns=Columns(time="t", input="y", output="u"), causal=False)
    np.testing.assert_array_equal(swapped.record.u, y)


def test_a_relay_output_is_not_taken_for_a_command(tmp_path):
    rng = np.random.default_rng(1)
    u = np.convolve(rng.standard_normal(1050), 0.9 ** np.arange(50), "valid")[:1000]
    y = np.sign(Linear(num=(1.0,), den=(0.5, 1.0))(u, 0.1))
    assert len(record(written(tmp_path, 0.1 * np.arange(1000), u, y)).record) == 1000


def test_absurd_numbers(tmp_path):
    t, u, y = bench()
    y[7] = 1e300
    refused(written(tmp_path, t, u, y), "data-range", r"a\.csv:9: the output is 1e\+300")


def test_a_stuck_sensor_is_noted(tmp_path):
    t, u, y = bench()
    y[250:] = y[249]
    assert "a.csv:251" in " ".join(record(written(tmp_path, t, u, y)).notes)


def test_lengths(tmp_path):
    t, u, y = bench()
    refused(written(tmp_path, t[:10], u[:10], y[:10]), "data-length", "10 samples, at least 16")
    np.savez(tmp_path / "a.npz", u=u, y=y[:-1], fs=10.0)
    refused(tmp_path, "data-length", "u 400, y 399", file="a.npz")


def test_columns(tmp_path):
    t, u, y = bench()
    written(tmp_path, t, u, y, names="zeit,stellwert,messwert")
    refused(tmp_path, "data-column", "which column is the input")
    refused(tmp_path, "data-column", "did you mean 'stellwert'", columns=Columns(input="stelwert", output=2))
    refused(tmp_path, "data-column", "different", columns=Columns(input=1, output=1))
    written(tmp_path, t, u, y, names="one,two,three")
    refused(tmp_path, "data-column", "give dt", columns=Columns(input=1, output=2))


def test_operations_are_done_in_order_and_noted(tmp_path):
    t, u, y = bench(n=2000)
    np.savez(tmp_path / "a.npz", t=t, u=u, y=y, gain=3.0)
    operations = (Crop(start=100), Scale(by="gain", column="output"), Lag(column="output", samples=-2), Decimate(factor=2))
    found = record(tmp_path, "a.npz", operations=operations)
    assert len(found.record) == 949
    assert (found.record.dt, found.record.t0) == (pytest.approx(0.2), pytest.approx(10.0))
    assert [note for note in found.notes if note.startswith("operation")] == [
        "operation crop: start 100",
        "operation scale: column output, by gain",
        "operation lag: column output, samples -2",
        "operation decimate: factor 2",
    ]
    refused(tmp_path, "data-scalar", "scalars are gain", "a.npz", operations=(Scale(by="gtau"),))
    refused(tmp_path, "data-operation", "put resample before", "a.npz", operations=(Decimate(factor=2), Resample()))


def test_declared_parts_are_placed_and_checked(tmp_path):
    t, u, y = bench()
    written(tmp_path, t, u, y)
    parts = (Hold(start=40, stop=60, level=1.0), Staircase(from_=0.0, to=1.0, step=0.5, hold_s=2.0))
    found = record(tmp_path, parts=parts).record.parts
    assert [(part.start, part.stop) for part in found] == [(40, 60), (60, 80), (80, 100), (100, 120)]
    refused(
        tmp_path,
        "data-parts",
        r"parts\[0\] \(hold\) covers samples 390 … 410",
        parts=(Hold(start=390, stop=410, level=0.0),),
    )


def test_ten_columns_only_two_are_read(tmp_path):
    rows = "\n".join(",".join(["words" if k == 5 else str(k * n % 7 + 0.1 * k) for k in range(10)]) for n in range(100))
    (tmp_path / "a.csv").write_text(",".join("abcdefghij") + "\n" + rows)
    found = record(tmp_path, columns=Columns(input="b", output="d"), dt=1.0, causal=False).record
    assert isinstance(found, Record)


NUMBERS = st.one_of(
    st.floats(-1e6, 1e6), st.sampled_from([0.0, 1.0, 1e-300, 1e300, float("nan"), float("inf")]), st.floats()
)
quiet = settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))
CELLS = st.one_of(
    st.floats().map(repr), st.sampled_from(["", "NaN", "x", "1,5", '"', "#", "1e999", "-", "0"]), st.text(max_size=5)
)


def never_a_traceback(folder: Path, file: str, **options):
    try:
        found = ingest(DataSource(file=file, **options), folder)
    except WhidError as fault:
        named = fault.code in CATALOGUE and bool(fault.where)
    else:
        named = True
        assert np.isfinite(found.record.u).all()
        assert np.isfinite(found.record.y[found.record.mask]).all()
        assert found.record.dt > 0
    assert named


@quiet
@given(st.binary(max_size=400), st.sampled_from(["a.csv", "a.csv.gz", "a.npz", "a.mat", "a.h5", "a.txt"]))
def test_arbitrary_bytes(tmp_path, content, name):
    (tmp_path / name).write_bytes(content)
    never_a_traceback(tmp_path, name, dt=0.1)


@quiet
@given(
    st.lists(st.lists(CELLS, min_size=1, max_size=4), min_size=1, max_size=40),
    st.sampled_from([",", ";", "\t", " "]),
    st.sampled_from(["error", "mask", "interpolate"]),
    st.booleans(),
)
def test_arbitrary_tables(tmp_path, rows, delimiter, missing, timed):
    (tmp_path / "a.csv").write_text("\n".join(delimiter.join(row) for row in rows), encoding="utf-8", errors="replace")
    options = {} if timed else {"dt": 0.1}
    never_a_traceback(tmp_path, "a.csv", missing=missing, parts="auto", **options)


@quiet
@given(st.lists(NUMBERS, min_size=48, max_size=150), st.sampled_from(["error", "mask", "interpolate"]))
def test_arbitrary_numbers(tmp_path, values, missing):
    t = np.arange(len(values) // 2) * 0.1
    np.savez(tmp_path / "a.npz", t=t, u=values[: len(t)], y=values[len(t) : 2 * len(t)])
    for operations in ((), (Resample(),), (Decimate(factor=2),)):
        never_a_traceback(tmp_path, "a.npz", missing=missing, parts="auto", operations=operations)


@pytest.mark.slow
def test_ten_million_rows(tmp_path):
    import resource
    import time

    rng = np.random.default_rng(0)
    block = "".join(f"{u:.6f},{y:.6f}\n" for u, y in rng.standard_normal((100_000, 2)))
    with (tmp_path / "a.csv").open("w") as file:
        file.write("u,y\n")
        for _ in range(100):
            file.write(block)
    start = time.perf_counter()
    found = record(tmp_path, rate_hz=1000.0)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(f"1e7 rows: {time.perf_counter() - start:.1f} s, peak {peak:.2f} GB")
    assert len(found.record) == 10**7
    assert peak < 2.0


def test_an_output_that_stands_still_like_a_command_is_noted(tmp_path):
    # a staircase, then a sine: no arrow of time in either, but a plant's noisy output never repeats a number
    t = 0.05 * np.arange(3000)
    u = np.concatenate([np.repeat(np.arange(6.0), 250), 2.5 + np.cos(2 * np.pi * np.arange(1500) / 100)])
    y = Linear(num=(1.0,), den=(0.5, 1.0))(u, 0.05) + 0.01 * np.random.default_rng(6).standard_normal(3000)
    written(tmp_path, t, u, y)
    assert not any("swapped" in note for note in record(tmp_path).notes)
    assert any("swapped?" in note for note in record(tmp_path, columns=Columns(time="t", input="y", output="u")).notes)


def test_times_of_a_calendar_and_of_a_day(tmp_path):
    rows = "".join(f"2024-03-05T10:{k // 600:02d}:{k / 10 % 60:06.3f},{k % 7},{k % 7 + k % 3}\n" for k in range(900))
    (tmp_path / "iso.csv").write_text("timestamp,u,y\n" + rows)
    found = ingest(DataSource(file="iso.csv", causal=False), tmp_path)
    assert (found.record.dt, found.record.t0) == (0.1, 1709632800.0)
    assert not [note for note in found.notes if "jitter" in note]
    (tmp_path / "day.csv").write_text("time,u,y\n" + rows.replace("2024-03-05T", ""))
    day = ingest(DataSource(file="day.csv", causal=False), tmp_path).record
    assert (day.dt, day.t0) == (0.1, 36000.0)


@pytest.mark.parametrize(
    ("first", "asked"),
    [("2024-03-05T10:00:{:02d}", False), ("10:00:{:02d}", False), ("17096328{:02d}", False), ("{}", True)],
)
def test_whole_seconds_of_a_calendar_are_not_asked_for_their_unit(tmp_path, first, asked):
    rows = "".join(f"{first.format(k)},{k % 7},{k % 7 + k % 3}\n" for k in range(60))
    (tmp_path / "s.csv").write_text("time,u,y\n" + rows)
    notes = ingest(DataSource(file="s.csv", causal=False), tmp_path).notes
    assert any("units: {time: ms}" in note for note in notes) is asked


def test_dates_are_in_seconds_whatever_the_config_says(tmp_path):
    rows = "".join(f"10:00:{k:02d},{k % 7},{k % 7 + k % 3}\n" for k in range(60))
    (tmp_path / "s.csv").write_text("time,u,y\n" + rows)
    with pytest.raises(WhidError, match="time is in s, the config says ms"):
        ingest(DataSource(file="s.csv", causal=False, units={"time": "ms"}), tmp_path)


def test_marks_of_overload_and_of_missing_samples(tmp_path):
    u, y = np.arange(200) // 20 % 5, np.repeat(np.arange(10) % 5, 20) + np.arange(200) % 3 / 10
    for mark in (9.9e37, -999.0):
        y[110] = mark
        (tmp_path / "m.csv").write_text(
            "t,u,y\n" + "".join(f"{k},{a},{b!r}\n" for k, (a, b) in enumerate(zip(u, y.tolist(), strict=True)))
        )
        source = DataSource(file="m.csv", causal=False)
        if mark > 0:
            with pytest.raises(WhidError, match=r"m.csv:112: the output is 9.9e\+37 here: an overload mark") as fault:
                ingest(source, tmp_path)
            assert fault.value.code == "data-range"
        else:
            assert any(
                "the output is -999 at m.csv:112, the rest within 0 …" in note for note in ingest(source, tmp_path).notes
            )


@pytest.mark.parametrize(
    ("heading", "told"),
    [
        ("Zeit,Ventil,Fluss", "perhaps time=Zeit,input=Ventil,output=Fluss"),
        ("t,a,b,c", "The file has t, a, b, c$"),
        ("y", "The file has y; an input and an output are needed"),
    ],
)
def test_what_to_choose_columns_from(tmp_path, heading, told):
    count = heading.count(",") + 1
    (tmp_path / "c.csv").write_text("\n".join([heading, *(",".join([str(k)] * count) for k in range(20))]))
    with pytest.raises(WhidError, match=told):
        ingest(DataSource(file="c.csv"), tmp_path)


def test_two_columns_without_headings_are_input_and_output(tmp_path):
    (tmp_path / "adc.csv").write_text("\n".join(f"{k % 5},{k % 5 + k % 2}" for k in range(40)))
    assert ingest(DataSource(file="adc.csv", dt=0.1, causal=False), tmp_path).record.u[1] == 1
    with pytest.raises(WhidError, match="no time column among 0, 1; give dt:"):
        ingest(DataSource(file="adc.csv"), tmp_path)


@pytest.mark.parametrize(
    ("u", "parts", "initial"),
    [
        (np.random.default_rng(31).standard_normal(200), (), "free"),
        (np.concatenate([np.zeros(20), np.random.default_rng(32).standard_normal(200)]), (), "steady"),
        (np.cos(np.arange(200) * 2 * np.pi / 20), "auto", "free"),
        (np.repeat([0.0, 1.0, 3.0, 2.0], 50), "auto", "steady"),
    ],
)
def test_a_record_that_moves_from_its_first_sample_on_begins_in_a_state_that_nobody_knows(tmp_path, u, parts, initial):
    time, y = np.arange(len(u)) * 0.1, np.random.default_rng(33).standard_normal(len(u))
    assert record(written(tmp_path, time, u, y), parts=parts).record.initial == initial
    assert record(written(tmp_path, time, u, y), parts=parts, initial="rest").record.initial == "rest"
