import dataclasses
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from whid.blocks.dead_zone import DeadZone
from whid.config.load import load_study, study_of
from whid.config.memory import SAMPLE, START, allow, memory, size
from whid.config.overview import overview
from whid.config.starter import starter
from whid.config.study import Bound, Study, Sweep
from whid.config.yaml import parse
from whid.errors import WhidError

SIMULATED = parse("""
name: s
plant: {chain: [{kind: dead_zone, low: -1, high: 1}], noise: {kind: white, std: 0.1}}
experiment: {dt: 0.1, parts: [{kind: hold, level: 1, hold_s: 100}]}
identify: {kind: wiener_hammerstein}
""").value
MEASURED = {"name": "m", "data": {"file": "r.csv"}, "identify": {"kind": "wiener_hammerstein"}}


def test_a_study_is_made_in_python_as_in_yaml():
    found = load_study(SIMULATED)
    made = Study(name="s", plant=found.plant, experiment=found.experiment, identify=found.identify)
    assert made == found
    assert found.plant.chain == (DeadZone(low=-1.0, high=1.0),)


def test_several_experiments_and_several_records():
    two = [SIMULATED["experiment"] | {"name": name} for name in ("a", "b")]
    assert [e.name for e in load_study(SIMULATED | {"experiment": two}).experiment] == ["a", "b"]
    with pytest.raises(WhidError, match="two records are named 'record'"):
        load_study(SIMULATED | {"experiment": [SIMULATED["experiment"]] * 2})
    records = [{"file": "a.csv", "name": "a"}, {"file": "b.csv", "name": "b"}]
    found = load_study({"name": "m", "records": records, "identify": MEASURED["identify"]})
    assert [source.file for source in found.sources] == ["a.csv", "b.csv"]


def test_only_one_source_of_records():
    for extra in ({"data": {"file": "a.csv"}}, {"records": [{"file": "a.csv"}]}):
        with pytest.raises(WhidError, match="exactly one of"):
            load_study(SIMULATED | extra)
    with pytest.raises(WhidError, match="experiment: plant and experiment go together"):
        load_study({key: value for key, value in SIMULATED.items() if key != "experiment"})


def test_bounds_and_sweeps():
    assert Bound(metric="report.rms", below=1.0).above is None
    assert Sweep(over={"plant.noise.std": [0.1, 0.2]}, repeats=3).mode == "grid"
    for wrong in (lambda: Bound(metric="a"), lambda: Sweep(over={"a": [1], "b": [1, 2]}, mode="zip")):
        with pytest.raises(WhidError):
            wrong()


def test_memory_grows_with_the_samples():
    assert memory(load_study(SIMULATED)) == START + 1000 * SAMPLE
    assert memory(load_study(SIMULATED, ["experiment.parts[0].hold_s=1e9"])) > 1e10 * SAMPLE


# VmHWM is of this program alone; ru_maxrss would keep the peak of the process that started it
PEAK = """
import re, sys, whid
whid.run(sys.argv[1], out=sys.argv[2], overrides=["experiment.parts[1].periods=9520"])
print(int(re.search(r"VmHWM:\\s+(\\d+) kB", open("/proc/self/status").read())[1]) * 1024)
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the peak is read from /proc")
def test_memory_is_above_the_measured_peak_and_not_far(tmp_path):
    starter = Path(__file__).parents[2] / "configs" / "starter.yaml"
    done = subprocess.run([sys.executable, "-c", PEAK, starter, tmp_path], capture_output=True, text=True, check=True)
    peak, estimate = int(done.stdout), memory(load_study(starter, ["experiment.parts[1].periods=9520"]))
    print(f"2e6 samples: peak {peak / 1e6:.0f} MB, estimate {estimate / 1e6:.0f} MB")
    assert peak < estimate < 2 * peak


def test_memory_of_what_cannot_be_counted_is_more_than_any():
    sine = "{kind: sine, offset: 0, amplitude: 1, samples_per_period: 1e308, periods: 100}"
    assert memory(load_study(SIMULATED, [f"experiment.parts[0]={sine}"])) == sys.maxsize


def test_memory_of_a_data_file(tmp_path):
    np.savetxt(tmp_path / "r.csv", np.zeros((1000, 3)), delimiter=",")
    on_disk = (tmp_path / "r.csv").stat().st_size
    assert memory(load_study(MEASURED), tmp_path) == START + 6 * on_disk
    assert memory(load_study(MEASURED), tmp_path / "elsewhere") == START


def test_memory_of_a_packed_file(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file.create_dataset("u", data=np.zeros((200_000, 2)), compression="gzip")
    assert memory(load_study(MEASURED, ["data.file=r.h5"]), tmp_path) == START + 200_000 * SAMPLE


def test_a_study_beyond_its_memory_is_refused_with_the_figure():
    longer = "experiment.parts[0].hold_s=1e7"
    study = load_study(SIMULATED, [longer, "identify={kind: parametric}"])
    with pytest.raises(WhidError, match=r"needs about 9\.2 GB, 4 GB are allowed; parametric needs whole records") as caught:
        allow(study, size("4GB"))
    assert caught.value.code == "memory"
    assert not allow(study, size("20GB"))
    assert allow(load_study(SIMULATED, [longer]), size("4GB"))  # levels and harmonics come in chunks


@pytest.mark.parametrize(("text", "count"), [("4GB", 4e9), ("4g", 4e9), ("0.5 MB", 5e5), ("1e9", 1e9), ("12", 12)])
def test_sizes(text, count):
    assert size(text) == count


@pytest.mark.parametrize("text", ["", "GB", "4XB", "-4GB", "4..GB", "many"])
def test_no_sizes(text):
    with pytest.raises(WhidError, match="such as 4GB"):
        size(text)


def test_the_overview_has_a_row_a_section():
    rows = dict(overview(load_study(SIMULATED | {"expect": [{"metric": "report.rms", "below": 1}]})).rows)
    assert rows["plant"] == "u → dead_zone(low -1, high 1) → y, noise white(std 0.1)"
    assert rows["record"] == "1000 samples of 0.1 s, 100 s in all"
    assert rows["expect"] == "metric report.rms, below 1"
    assert dict(overview(load_study(MEASURED)).rows)["record"] == "file r.csv"


def test_the_starter_is_a_study_of_a_moment():
    study = load_study(parse(starter()).value)
    assert sum(e.samples() for e in study.experiment) < 20_000
    assert dataclasses.replace(study, name="other").name == "other"


@pytest.mark.parametrize(
    ("block", "told"),
    [
        ("{kind: linear, num: [1], den: [1, -1]}", "the pole 1 makes"),
        ("{kind: linear, num: [1], den: [1, -0.2, 4]}", r"the pole 0\.1[+-]"),
        ("{kind: linear, num: [1], den: [1, -1.2], dt: 0.1}", "the pole 1.2 makes"),
    ],
)
def test_a_plant_that_runs_away_is_refused_where_it_stands(block, told):
    text = f"""
name: s
plant:
  chain: [{{kind: dead_zone, low: -1, high: 1}}, {block}]
experiment: {{dt: 0.1, parts: [{{kind: hold, level: 1, hold_s: 100}}]}}
identify: {{kind: wiener_hammerstein}}
"""
    with pytest.raises(WhidError, match=rf"s.yaml:4:\d+: plant.chain\[1\]: unstable: {told}"):
        study_of(parse(text, "s.yaml"))
    inside = text.replace(block, "{kind: feedback, forward: " + block + ", back: {kind: linear, num: [9], den: [1]}}")
    for stable in (inside, text.replace("-1]}", "0]}").replace("-0.2", "0.2").replace("-1.2", "-0.2")):
        study_of(parse(stable, "s.yaml"))


def test_a_sine_needs_more_than_two_samples_a_period():
    for given, told in (
        ("samples_per_period: [20, 2]", "2 samples a period"),
        ("omega: 40", "omega must lie below π/dt = 31.42"),
    ):
        text = "{kind: sine, offset: 0, amplitude: 1, periods: 3, " + given + "}"
        parts = [*SIMULATED["experiment"]["parts"], parse(text).value]
        with pytest.raises(WhidError, match=rf"experiment.parts\[1\]: .*{told}"):
            load_study(SIMULATED | {"experiment": {"dt": 0.1, "parts": parts}})


def test_overrides_in_python_are_a_mapping_too():
    found = load_study(SIMULATED, {"seed": 7, "plant.noise": [], "plant.chain[0].low": np.float64(-2.0)})
    assert (found.seed, found.plant.noise, found.plant.chain[0].low) == (7, (), -2.0)
    assert load_study(SIMULATED, "seed=8").seed == 8


def test_the_text_of_a_config_is_no_path():
    with pytest.raises(WhidError, match=r"^name: s …: this is the text of a config, not the path"):
        load_study("name: s\nidentify: {kind: fit}\n")
