"""The result file under the readers that people use: xarray, NeXus, h5glance; and back into Python."""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, NamedTuple

import h5py
import numpy as np
import pytest

from tests.small_study import PLANT, small_study
from whid import flow
from whid.blocks.linear import Linear
from whid.config.load import as_system
from whid.errors import WhidError
from whid.experiments.sine import Sine
from whid.files._groups import units
from whid.files.result import read_result, write_result
from whid.fit import linear_least_squares
from whid.methods._method import Model
from whid.quantity import Measured, Quantity, Table
from whid.record import Record
from whid.result import Result
from whid.stages.levels import level_means
from whid.system import System

POLES = System(chain=(Linear(zeros=(), poles=(-1 + 2j, -1 - 2j)),))
SINE = Sine(offset=1.0, amplitude=0.5, period=100.25, periods=3, start=10, stop=400, use="selection")
METRICS = {"report.rms": 0.25, "front.gain": Measured(1.0, 0.1), "lost": float("nan")}
PRINTED = (("front.gain", 1.0, None), ("back.gain", 0.5, 0.4))
UNITS = {"input": "V", "output": "m/s"}


class Odd(NamedTuple):
    """Everything a stage may hold."""

    grid: Annotated[np.ndarray, Quantity("s", ("row", "column"), error="grid_std")]
    grid_std: Annotated[np.ndarray, Quantity("s", ("row", "column"))]
    row: Annotated[np.ndarray, Quantity("input", ("row",))]
    gain: Annotated[np.ndarray, Quantity("output/input", ("row",))]
    empty: Annotated[np.ndarray, Quantity("1", ("none", "row"))]
    names: tuple[str, ...]
    ragged: tuple[tuple[float, ...], ...]
    nested: tuple[Measured, ...]
    word: str
    yes: bool
    nothing: float | None
    square: Annotated[np.ndarray, Quantity("output²", ("row", "row"))]
    system: System


def odd() -> Odd:
    rng = np.random.default_rng(5)
    grid = rng.normal(size=(3, 2))
    return Odd(
        grid, np.abs(grid) / 10, np.arange(3.0), np.array([1 + 2j, 3, 4j]), np.empty((0, 3)), ("a", "β"),
        ((1.0,), (2.0, 3.0)), (Measured(1.0, 0.5), Measured(2.0, 0.25)), "word", True, None, np.eye(3), POLES,
    )  # fmt: skip


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("result") / "result.h5"
    rng = np.random.default_rng(1)
    levels = np.array([0.0, 1.0, 2.0])
    curve = level_means([u**2 + 0.1 * rng.normal(size=200) for u in levels], levels, np.ones(3), 0.1, 0.0)
    names = [p.name for p in PLANT.tree.parameters()]
    estimate = linear_least_squares(np.eye(len(names)), np.ones(len(names)), np.ones(len(names)), names)
    y = rng.normal(size=6000)
    y[5] = np.nan
    record = Record(
        u=np.ones(6000), y=y, dt=0.5, t0=2.0, valid=np.isfinite(y), units=UNITS, intersample="foh", initial="steady",
        parts=(SINE,), name="bench 7",
    )  # fmt: skip
    result = Result(
        name="readers", records=(record,), stages={"static_curve": curve, "odd": odd(), "model": Model(PLANT, estimate)},
        truth=PLANT, residuals=(y / 2,), metrics=METRICS,
        tables=(Table("Fit", ("on", "rms"), (("report", Measured(np.float64(0.25), 0.01)), ("rest", None)), ("a note",)),),
        provenance={"config": "name: readers\n", "seed": 3, "notes": ("one", "two"), "data": ()}, published=PRINTED,
    )  # fmt: skip
    write_result(path, result, lambda name: "output" if name.endswith("rms") else "1")
    return path


def test_everything_reads_back(written):
    result = read_result(written, as_system)
    record = result.records[0]
    assert (record.name, record.dt, record.t0, record.units) == ("bench 7", 0.5, 2.0, UNITS)
    assert (record.intersample, record.initial) == ("foh", "steady")
    assert record.parts == (SINE,)
    assert not record.valid[5]
    assert record.valid.sum() == 5999
    np.testing.assert_array_equal(result.residuals[0], record.y / 2)
    assert result.metrics["front.gain"] == Measured(1.0, 0.1)
    assert np.isnan(result.metrics["lost"])
    assert result.tables[0].rows == (("report", Measured(0.25, 0.01)), ("rest", None))
    assert result.provenance == {"config": "name: readers\n", "seed": 3, "notes": ("one", "two"), "data": ()}
    assert result.truth == result.model.system == PLANT
    assert result.published == PRINTED
    assert type(result.stages["static_curve"]).__name__ == "StaticCurve"
    assert result.stages["static_curve"].table().rows  # a whid stage is itself again
    assert result.model.estimate.names == tuple(p.name for p in PLANT.tree.parameters())


def test_a_strangers_stage_reads_back_as_a_namespace_with_the_same_names(written):
    found, original = read_result(written, as_system).stages["odd"], odd()
    assert isinstance(found, SimpleNamespace)
    for name in ("grid", "grid_std", "row", "gain", "empty", "square"):
        np.testing.assert_array_equal(getattr(found, name), getattr(original, name))
    for name in ("names", "nested", "word", "yes", "system"):
        assert getattr(found, name) == getattr(original, name)
    assert [list(row) for row in found.ragged] == [[1.0], [2.0, 3.0]]
    assert not hasattr(found, "nothing")


def datasets(file: h5py.File) -> list[h5py.Dataset]:
    found: list[h5py.Dataset] = []
    file.visititems(lambda _, item: found.append(item) if isinstance(item, h5py.Dataset) else None)
    return found


def test_every_number_has_units_and_every_axis_a_scale(written):
    with h5py.File(written) as file:
        assert len(datasets(file)) > 60
        for item in datasets(file):
            if item.dtype.kind in "iuf" and item.attrs.get("dtype") != "bool":
                assert item.attrs["units"], item.name
            if not item.is_scale:
                assert all(len(dim) for dim in item.dims), item.name
        assert not [item.name for item in datasets(file) if "put" in str(item.attrs.get("units", ""))]
        curve = file["stages/static_curve"]
        assert curve["mean"].attrs["units"] == curve["mean_errors"].attrs["units"] == "m/s"
        assert curve["level"].attrs["units"] == "V"
        assert file["stages/odd/gain"].attrs["units"] == "(m/s)/V"
        assert file["stages/odd/square"].attrs["units"] == "(m/s)²"
        assert file["metrics/report.rms"].attrs["units"] == "m/s"
        assert file["records/bench_7/y"].compression == "gzip"


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ("output/input", "(m/s)/V"),
        ("output", "m/s"),
        ("input", "V"),
        ("rad/s", "rad/s"),
        ("1", "1"),
        ("output*s", "(m/s)*s"),
    ],
)
def test_units_are_composed(unit, expected):
    assert units(unit, UNITS) == expected


def test_xarray_opens_every_group(written):
    import xarray

    with warnings.catch_warnings(), h5py.File(written) as file:
        warnings.simplefilter("error")
        groups: list[str] = []
        file.visititems(lambda name, item: groups.append(name) if isinstance(item, h5py.Group) else None)
        for group in groups:
            with xarray.open_dataset(written, engine="h5netcdf", group=group) as data:
                data.load()
    curve = xarray.open_dataset(written, engine="h5netcdf", group="stages/static_curve")
    assert curve["mean"].dims == ("level",)
    np.testing.assert_array_equal(curve["mean"].sel(level=2.0), curve["mean"][2])
    assert curve["mean_errors"].attrs["units"] == "m/s"
    found = xarray.open_dataset(written, engine="h5netcdf", group="stages/odd")
    assert found["gain"].values[0] == 1 + 2j
    assert found["grid"].dims == ("row", "column")
    assert found["square"].dims == ("row", "row_2")
    record = xarray.open_dataset(written, engine="h5netcdf", group="records/bench_7")
    assert record["valid"].dtype == bool
    assert float(record["time"][-1]) == 2.0 + 0.5 * 5999


def test_nexus_knows_what_to_plot(written):
    with np.printoptions():  # its import changes how numpy prints, which doctests would notice
        from nexusformat.nexus import nxload

    root = nxload(str(written))
    plotted = root.plottable_data
    assert plotted.nxpath == "/stages/static_curve"
    assert plotted.nxsignal.nxname == "mean"
    assert plotted.nxaxes[0].nxname == "level"
    assert plotted.nxerrors.nxname == "mean_errors"
    assert root["records"].plottable_data.nxsignal.nxname == "y"


def test_h5glance_lists_it(written):
    command = [sys.executable, "-m", "h5glance", str(written)]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    for name in ("static_curve", "mean_errors", "bench_7", "provenance"):
        assert name in listed


@pytest.mark.parametrize("content", [b"", b"not hdf5", None])
def test_a_file_that_is_no_result_is_named(tmp_path, content):
    path = tmp_path / "result.h5"
    if content is None:
        with h5py.File(path, "w") as file:
            file["stages"] = 1.0
    else:
        path.write_bytes(content)
    with pytest.raises(WhidError, match=r"result\.h5") as fault:
        read_result(path, as_system)
    assert fault.value.code == "result-unreadable"


def test_a_run_writes_the_default_plot(tmp_path, monkeypatch):
    monkeypatch.setattr("whid.plots.draw", lambda run, folder: ((), ()))
    result = flow.run(small_study(), tmp_path)
    with h5py.File(result.path / "result.h5") as file:
        assert file.attrs["default"] == "stages"
        assert file["stages"].attrs["default"] == "levels"
        assert file["stages/levels"].attrs["title"] == "Mean output of every hold."
