"""The closed loop on measured records, declared with an effect left out that is known to be there (bar T9)."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from tests.measured_data import CONFIGS, measured_study
from whid.cli import main
from whid.files.ingest import ingest
from whid.predict import predict
from whid.refine import refine


def study(name):
    return measured_study(f"{name}_trace")


def declared(name, path="exact"):
    """Return the declared model, fitted, with the records and its rms on report data."""
    found = study(name)
    records = [ingest(source, CONFIGS).record for source in found.sources]
    fitted = refine(found.model, [record.without("report") for record in records], path=path)
    kept = [record for record in records if record.using("report").any()][-1]
    error = (predict(fitted.system.tree, kept, path) - kept.y)[kept.using("report")]
    return fitted, float((error**2).mean() ** 0.5)


def trace(name, tmp_path):
    study(name)
    told = CliRunner().invoke(main, ["trace", str(CONFIGS / f"{name}_trace.yaml"), "--json", "--out", str(tmp_path)])
    assert told.exit_code == 0, told.stderr
    answer = json.loads(told.stdout)
    print(answer["sentence"])
    for step in answer["steps"]:
        print(f"  {step['added']}: {step['rms']:.5g}")
    return answer


def names(answer):
    return [f"{effect['kind']}@{effect['place']}" for effect in answer["effects"]]


def test_ball_and_hoop_declared_linear_is_as_far_off_as_published():
    _, rms = declared("ball_and_hoop")
    assert rms == pytest.approx(0.92, abs=0.02)


def test_positioning_system_declared_as_a_mass():
    fitted, rms = declared("emps", "sampled")
    assert dict(zip(fitted.estimate.names, fitted.estimate.values, strict=True))["chain.1.num.0"] == pytest.approx(
        95.11, rel=0.02
    )
    assert float(fitted.rms[0]) == pytest.approx(37.6, abs=0.5)
    assert rms > 30


def test_cascaded_tanks_declared_linear():
    fitted, _ = declared("cascaded_tanks")
    assert 0.4 < float(fitted.rms[0]) < 0.5


@pytest.mark.slow
def test_wiener_hammerstein_benchmark_declared_with_a_hard_clip():
    _, rms = declared("wh_sysid09", "sampled")
    assert 1e3 * rms == pytest.approx(2.25, abs=0.08)


@pytest.mark.slow
def test_t9_ball_and_hoop(tmp_path):
    answer = trace("ball_and_hoop", tmp_path)
    assert names(answer)[:1] == ["curve@input"]
    assert answer["after"]["rms"] <= 0.31


@pytest.fixture(scope="module")
def benchmark_traced(tmp_path_factory):
    return trace("wh_sysid09", tmp_path_factory.mktemp("wh_sysid09"))


@pytest.mark.slow
def test_t9_wiener_hammerstein_benchmark(benchmark_traced):
    found = names(benchmark_traced)
    assert found == ["soft_knee@nonlinearity", "intersample@time", "hum@output"]
    numbers = benchmark_traced["effects"][2]["parameters"]
    assert numbers["omega"] / (2 * np.pi) == pytest.approx(416.26, abs=0.05)


@pytest.mark.slow
@pytest.mark.xfail(strict=True, reason="not reached: 0.287, 0.245 and 0.240 mV on the last fifth, 3 to 5 % above the bars")
def test_t9_wiener_hammerstein_benchmark_errors(benchmark_traced):
    reached = [1e3 * step["rms"] for step in benchmark_traced["steps"][1:4]]
    assert all(rms <= bar for rms, bar in zip(reached, (0.28, 0.235, 0.23), strict=True))


@pytest.mark.slow
def test_t9_positioning_system(tmp_path):
    answer = trace("emps", tmp_path)
    assert names(answer) == ["friction@parallel"] * len(answer["effects"])
    found = {name.rsplit(".", 1)[-1]: v for effect in answer["effects"] for name, v in effect["parameters"].items()}
    reference = {"coefficient": 203.5, "force": 20.39, "level": -3.16}
    assert found == pytest.approx(reference, rel=0.02)
    # in order of gain: by plain least squares Coulomb friction alone leaves less than viscous friction alone
    assert list(found) == in_order_of_gain()
    assert [step["added"].partition(": ")[2] for step in answer["steps"]] == ["", "Coulomb", "viscous", "offset"]


def in_order_of_gain():
    """Return the terms of friction by what each leaves over beside the mass, the best first, in numpy alone."""
    (source,) = study("emps").sources
    record = ingest(source, CONFIGS).record
    here, u = record.using("estimation"), record.u
    terms = {"coefficient": u, "force": np.sign(u), "level": np.ones(len(u))}
    chosen = [500 * (u - np.append(u[[0, 0]], u[:-2]))]
    names = []
    while len(names) < 3:
        left = {}
        for name in terms.keys() - names:
            columns = np.stack([*chosen, terms[name]], axis=1)[here]
            left[name] = np.linalg.lstsq(columns, record.y[here], rcond=None)[1][0]
        names.append(min(left, key=left.get))
        chosen.append(terms[names[-1]])
    return names


@pytest.mark.slow
def test_t9_cascaded_tanks(tmp_path):
    answer = trace("cascaded_tanks", tmp_path)
    assert names(answer)[:1] == ["saturation@output"]
    (high,) = (v for name, v in answer["effects"][0]["parameters"].items() if name.endswith("high"))
    assert high == pytest.approx(10.0, abs=0.01)
