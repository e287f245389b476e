"""Real records: what `DATA.md` of the collection says of each is found by ingest."""

import numpy as np
import pytest

from tests.measured_data import measured
from whid.errors import WhidError
from whid.files.ingest import ingest
from whid.files.source import Columns, DataSource
from whid.operations.derivative import Derivative
from whid.operations.scale import Scale


def record(file, **options):
    return ingest(DataSource(file=file, **options), measured(file).parent)


def test_ball_and_hoop_staircase_has_41_levels():
    found = record("ball_and_hoop_staircase.csv.gz", parts="auto", units={"input": "V", "output": "V"}).record
    assert (len(found), found.dt) == (2150, 0.1)
    up, down = np.arange(11) / 10, np.arange(10)[::-1] / 10
    out = np.concatenate([up, down])
    expected = np.concatenate([out, -out[1:]])  # 0 → 1 → 0 → −1 → 0 V
    np.testing.assert_allclose([part.level for part in found.parts], expected, atol=1e-12)
    assert [part.length for part in found.parts] == [100 if abs(level) == 1 else 50 for level in expected]
    assert found.parts[-1].stop == 2150


def test_ball_and_hoop_staircase_under_a_bit_of_converter_noise():
    u = record("ball_and_hoop_staircase.csv.gz").record.u
    from whid.stages.find_parts import find_parts

    for seed in range(5):
        noisy = u + 0.005 * np.random.default_rng(seed).integers(-1, 2, len(u))
        clean, found = find_parts(u, 0.1), find_parts(noisy, 0.1)
        assert [(p.start, p.stop, p.direction) for p in found] == [(p.start, p.stop, p.direction) for p in clean]
        np.testing.assert_allclose([p.level for p in found], [p.level for p in clean], atol=0.002)


def test_ball_and_hoop_random_steps():
    found = record("ball_and_hoop_random_steps.csv.gz", parts="auto", use="report").record
    assert len(found.parts) == 163
    assert found.using("report").all()
    assert found.y.std() == pytest.approx(6.57, abs=0.005)


def test_wiener_hammerstein_benchmark():
    found = record("wh_sysid09_estimation.npz", columns=Columns(input="u", output="y"), intersample="bandlimited")
    assert len(found.record) == 100_000
    assert found.record.dt == 1 / 51200
    assert found.notes == ("sampling time from the file's fs = 51200",)


def test_positioning_system_as_an_inverse_model():
    """u = velocity, y = force gtau·vir: M dq̇/dt + Fv q̇ + Fc sign(q̇) + offset, reference values from the benchmark."""
    found = record(
        "emps_estimation.npz",
        columns=Columns(time="t", input="qm", output="vir"),
        units={"input": "m/s", "output": "N"},
        operations=(Derivative(column="input", cutoff_hz=100.0), Scale(column="output", by="gtau")),
        causal=False,
    ).record
    assert found.dt == pytest.approx(1e-3)
    v, force = found.u, found.y
    acceleration = np.gradient(v, found.dt)
    inner = slice(200, -200)
    design = np.stack([acceleration, v, np.sign(v), np.ones_like(v)], axis=1)[inner]
    mass, viscous, coulomb, offset = np.linalg.lstsq(design, force[inner], rcond=None)[0]
    assert (mass, viscous, coulomb, offset) == pytest.approx((95.11, 203.5, 20.39, -3.16), rel=0.05)


def test_cascaded_tanks():
    found = record("cascaded_tanks_estimation.npz").record
    assert (len(found), found.dt, found.y.max()) == (1024, 4.0, 10.0)


@pytest.mark.parametrize(
    ("file", "time"),
    [("ball_and_hoop_staircase.csv.gz", "time"), ("ball_and_hoop_random_steps.csv.gz", "time"),
     ("wh_sysid09_estimation.npz", None), ("cascaded_tanks_estimation.npz", None)],
)  # fmt: skip
def test_swapped_columns_of_every_open_loop_record_are_refused(file, time):
    with pytest.raises(WhidError) as fault:
        record(file, columns=Columns(time=time, input="y", output="u"))
    assert fault.value.code == "data-swapped"
