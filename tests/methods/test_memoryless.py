"""Method `memoryless`: from records to model and equaliser; measured files; refusals by name; bar B5."""

from pathlib import Path

import numpy as np
import pytest

import whid
from tests.memoryless_study import DOMAIN, TRUE, g, largest_error, record
from whid.errors import CATALOGUE, WhidError
from whid.methods.memoryless import Memoryless
from whid.predict import predict
from whid.quantity import Measured
from whid.record import Record
from whid.stages._chebyshev import evaluate

CONFIGS = Path(__file__).parents[2] / "configs" / "jeraj"


def identify(x, y, **options):
    made = Record(u=x, y=y, dt=1.0, intersample="discrete")
    return {type(stage).__name__: stage for stage in Memoryless(**{"domain": DOMAIN, **options})([made])}


def test_the_model_simulates_the_reported_curve():
    x, y, std = record(1)
    stages = identify(x, y)
    curve, model = stages["CurveEstimates"], stages["Model"]
    assert list(stages)[-1] == "Model"
    assert curve.reported == "least_squares"
    np.testing.assert_array_equal(model.system.chain[0].coefficients, curve.least_squares)
    u = np.linspace(-1, 1, 11)
    found = predict(model.system.tree, Record(u=u, y=u, dt=1.0, intersample="discrete"), "sampled")
    np.testing.assert_allclose(found, evaluate(u, curve.coefficients), atol=1e-14)
    assert np.abs((curve.least_squares - TRUE) / curve.least_squares_std).max() < 4
    np.testing.assert_allclose(curve.least_squares_std, curve.bound, rtol=0.01)
    assert model.estimate.chi2 / model.estimate.dof == pytest.approx(1, abs=0.01)
    assert curve.noise_std == pytest.approx(std, rel=0.02)


def test_too_low_an_order_reports_node_plus():
    curve = lambda x: np.tanh(4 * x)  # noqa: E731
    x, y, _ = record(2, 40.0, curve=curve)
    stages = identify(x, y)
    assert stages["CurveEstimates"].reported == "node_plus"
    assert largest_error(stages["CurveEstimates"].coefficients, curve) < 0.5 * largest_error(
        stages["CurveEstimates"].least_squares, curve
    )


def test_the_domain_is_what_the_data_cover():
    x, y, _ = record(3)
    stages = identify(10 + 4 * x, y, domain=None)
    low, high = stages["CurveEstimates"].domain
    for outside in (10 + 4 * x < low, 10 + 4 * x > high):
        assert np.sum(outside) == 15
    inner = np.linspace(8, 12, 50)
    found = stages["Model"].system.chain[0].value(inner)
    np.testing.assert_allclose(found, g((inner - 10) / 4), atol=0.01)


def test_what_is_not_estimation_is_not_used():
    x, y, _ = record(4, samples=20_000)
    valid = np.ones(len(x), bool)
    valid[100:200] = False
    spoilt = np.where(valid, y, np.nan)
    one = list(Memoryless(domain=DOMAIN)([Record(u=x, y=spoilt, dt=1.0, valid=valid)]))[-1]
    other = list(Memoryless(domain=DOMAIN)([Record(u=x[valid], y=y[valid], dt=1.0)]))[-1]
    np.testing.assert_allclose(one.estimate.values, other.estimate.values, atol=1e-13)


def clean_cascade_db(tree, curve=g):
    """Error of curve and equaliser in cascade without noise, on |x| ≤ 1 of a fresh input, re the input."""
    x = record(60_000, None)[0]
    x = x[np.abs(x) <= 1]
    back = tree(curve(x), 1.0, between="discrete")
    return 20 * np.log10(np.sqrt(np.mean((back - x) ** 2) / np.mean(x**2)))


def b5(seeds):
    found = []
    for seed in seeds:
        x, y, _ = record(seed)
        stage = identify(x, y, inverse=True)["Equaliser"]
        found.append((clean_cascade_db(stage.tree), stage.error_db, stage.regressed_error_db))
    return np.array(found)


def test_without_noise_the_equaliser_interpolates_the_inverse():
    """Against numpy's interpolation at Chebyshev nodes of an inverse found point by point."""
    from scipy.optimize import brentq

    inverse = np.vectorize(lambda y: brentq(lambda x: g(x) - y, -1.5, 1.5, xtol=1e-15))
    x, y, _ = record(5, snr_db=None)
    stage = identify(x, y, inverse=True)["Equaliser"]
    np.testing.assert_allclose(stage.coefficients, np.polynomial.chebyshev.chebinterpolate(inverse, 21), atol=1e-11)
    exact = clean_cascade_db(stage.tree)
    print(f"B5 without noise, order 21: {exact:.1f} dB")
    assert stage.error_db == pytest.approx(exact, abs=0.5)


def test_the_equaliser_undoes_the_curve():
    (ours, predicted, regressed), *_ = b5([20_000])
    print(f"B5 one run: clean cascade {ours:.1f} dB, predicted {predicted:.1f} dB, as in the paper {regressed:.1f} dB")
    assert ours == pytest.approx(predicted, abs=6)
    assert ours < regressed - 10


@pytest.mark.slow
def test_b5():
    found = b5(range(53_000, 53_050))
    ours, predicted, regressed = 10 * np.log10(np.mean(10 ** (found / 10), axis=0))
    print(f"B5 50 runs: clean cascade {ours:.2f} dB (worst {found[:, 0].max():.2f}), predicted {predicted:.2f}, ", end="")
    print(f"input regressed on noisy output {regressed:.2f}")
    assert ours <= -58


def test_the_equaliser_is_clamped():
    x, y, _ = record(6)
    tree = identify(x, y, inverse=True)["Equaliser"].tree
    out = tree(np.array([-50.0, 50.0]), 1.0, between="discrete")
    np.testing.assert_allclose(out, [-1, 1], atol=0.02)


def test_an_equaliser_of_a_falling_curve():
    x, y, _ = record(7)
    tree = identify(x, -y, inverse=True)["Equaliser"].tree
    assert clean_cascade_db(tree, lambda x: -g(x)) < -45


def uniform(low, high, samples=5000):
    return np.random.default_rng(8).uniform(low, high, samples)


@pytest.mark.parametrize(
    ("x", "curve", "options", "code", "said"),
    [
        (uniform(-0.5, 1.0), g, {}, "stage-one-sided", "on one side"),
        (uniform(-0.5, 1.0), g, {"report": "least_squares"}, "stage-one-sided", "try that domain"),
        (np.repeat(np.linspace(-1, 1, 12), 60), g, {}, "stage-rank-one", "have one input"),
        (np.repeat([-1.0, 1.0], 60), g, {"report": "least_squares"}, "stage-rank-one", "rank 2"),
        (np.repeat([-1.0, 1.0], 60), g, {"domain": None, "report": "least_squares"}, "stage-rank-one", "rank 2"),
        (np.full(100, 0.3), g, {"domain": None}, "stage-rank-one", "one input"),
        (uniform(-0.99, 0.99), g, {"inverse": True}, "stage-extrapolates", "try domain: "),
        (uniform(-1.1, 1.1), np.abs, {"inverse": True}, "stage-not-invertible", "turns at"),
        (uniform(-1.1, 1.1, 30), g, {}, "stage-too-short", "too few"),
        (uniform(-1.1, 1.1, 30), g, {"domain": None}, "stage-too-short", "too few"),
        (np.empty(0), g, {}, "method-no-data", "no record"),
    ],
)
def test_refusals(x, curve, options, code, said):
    y = curve(x) + 0.001 * np.random.default_rng(9).standard_normal(len(x))
    with pytest.raises(WhidError, match=said) as fault:
        identify(x, y, **options)
    assert fault.value.code == code
    assert CATALOGUE[code].remedy


def test_the_domain_in_the_message_works():
    """What a refusal suggests is accepted."""
    x = uniform(-1.1, 1.1)
    y = (x - 0.2) ** 2 + 0.001 * np.random.default_rng(9).standard_normal(len(x))
    with pytest.raises(WhidError) as fault:
        identify(x, y, inverse=True)
    low, high = fault.value.message.partition("domain: [")[2].rstrip("]").split(",")
    assert (float(low), float(high)) == (-1.0, pytest.approx(0.2, abs=0.01))
    identify(x, y, inverse=True, domain=(float(low), float(high) - 0.01))


def test_a_system_with_memory_is_doubted(tmp_path):
    """A first-order lag behind the curve; the same without the lag is not doubted."""
    plain = {"kind": "polynomial", "coefficients": [0, 1, 0, 0.3]}
    for chain, doubted in (([plain, {"kind": "linear", "num": [2.0], "den": [1, 2]}], True), ([plain], False)):
        result = whid.run(
            {
                "name": "memory",
                "plant": {"chain": chain, "noise": {"kind": "white", "snr_db": 30}},
                "experiment": {"dt": 0.1, "parts": [{"kind": "noise_band", "std": 0.4, "duration_s": 600}]},
                "identify": {"kind": "memoryless", "order": 5},
            },
            out=tmp_path,
        )
        assert result.exit_code == 0
        assert any("earlier inputs" in warning for warning in result.warnings) == doubted


def test_a_staircase_by_least_squares():
    x = np.repeat(np.linspace(-1, 1, 15), 60)
    y = g(x) + 0.01 * np.random.default_rng(10).standard_normal(len(x))
    stages = identify(x, y, report="least_squares")
    assert "NodeWindows" not in stages
    assert largest_error(stages["CurveEstimates"].coefficients) < 0.02
    assert stages["CurveEstimates"].table().columns == ("coefficient", "least squares", "bound")
    assert "paper.C0" not in stages["CurveEstimates"].metrics()


def test_table_1_as_a_user_runs_it(tmp_path):
    result = whid.run(CONFIGS / "table-1.yaml", out=tmp_path)
    assert result.exit_code == 0
    for j, true in enumerate(TRUE):
        for name in (f"C{j}", f"paper.C{j}"):
            metric = result.metrics[name]
            assert isinstance(metric, Measured)
            assert abs(metric.value - true) < 4.5 * metric.std
    model = next(table for table in result.tables if table.title == "Model")
    np.testing.assert_allclose([row[2] for row in sorted(model.rows)], TRUE, atol=1e-12)
    assert "memoryless_curve.png" in result.pictures
    assert "frequency_response.png" not in result.pictures
    again = whid.load(result.path)
    np.testing.assert_array_equal(
        again.stages["curve_estimates"].least_squares, result.stages["curve_estimates"].least_squares
    )


def test_the_equaliser_as_a_user_runs_it(tmp_path):
    result = whid.run(CONFIGS / "equaliser.yaml", out=tmp_path)
    assert result.exit_code == 0
    again = whid.load(result.path).stages["equaliser"]
    assert again.tree == result.stages["equaliser"].tree
    assert clean_cascade_db(again.tree) < -45


def test_from_a_measured_file(tmp_path):
    """A CSV of a slow triangle and a diode-like curve: no design, an offset domain, the equaliser with it."""
    t = np.arange(6000)
    x = 2 + 1.5 * np.abs((t / 500) % 2 - 1) + 0.01 * np.random.default_rng(11).standard_normal(len(t))
    y = np.log1p(x) + 0.002 * np.random.default_rng(12).standard_normal(len(t))
    rows = "\n".join(f"{a},{b:.9g},{c:.9g}" for a, b, c in zip(t, x, y, strict=True))
    (tmp_path / "diode.csv").write_text("t,u,y\n" + rows + "\n")
    (tmp_path / "study.yaml").write_text(
        "name: diode\n"
        "data: {file: diode.csv, columns: {time: t, input: u, output: y}, units: {input: V, output: mA}}\n"
        "identify: {kind: memoryless, order: 5, inverse: true, inverse_order: 9}\n"
    )
    result = whid.run(tmp_path / "study.yaml", out=tmp_path / "runs")
    assert result.exit_code == 0
    v = np.linspace(2.05, 3.45, 30)
    np.testing.assert_allclose(result.model.system.tree(v, 1.0, between="discrete"), np.log1p(v), atol=1e-3)
    back = result.stages["equaliser"].tree(np.log1p(v), 1.0, between="discrete")
    np.testing.assert_allclose(back, v, atol=5e-3)


def test_coloured_noise_is_warned_of():
    """White input: the colour is named, and that it does not touch these errors; an input as slow as the noise: it does."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(90_001)
    noise = 0.05 * lfilter([1.0], [1.0, -0.9], rng.normal(size=20_000))
    fast, slow = rng.uniform(-1, 1, 20_000), np.sin(np.cumsum(0.05 * rng.normal(size=20_000)))
    assert identify(fast, g(fast) + 0.1 * rng.normal(size=20_000))["NoiseColour"].doubts() == ()
    first, second = (identify(x, g(x) + noise)["NoiseColour"] for x in (fast, slow))
    assert first.doubts()[0].startswith("coloured noise")
    assert first.factor == pytest.approx(1, abs=0.15)
    assert second.factor > 3
