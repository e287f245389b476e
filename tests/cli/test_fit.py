"""`whid fit`: the declared model alone, cost per iteration on stderr, Ctrl-C keeps the best so far."""

import json

import pytest

from whid import flow

STUDY = """
name: small
seed: 3
plant:
  chain:
    - {kind: linear, num: [1.0], den: [0.5, 1.0]}
    - {kind: dead_zone, low: -0.4, high: 0.7}
  noise: {kind: white, std: 0.02}
experiment:
  dt: 0.05
  parts:
    - {kind: noise_band, duration_s: 40, std: 1.5, band: [0.0, 0.2]}
    - {kind: hold, level: 1.0, hold_s: 5, use: report}
model:
  chain:
    - {kind: linear, num: [1.0], den: [0.8, 1.0], fix: [num]}
    - {kind: dead_zone, low: -0.3, high: 0.5, fix: [slope]}
identify: {kind: wiener_hammerstein}
"""


@pytest.fixture(autouse=True)
def _no_pictures(monkeypatch):
    monkeypatch.setattr("whid.plots.draw", lambda run, folder: ((), ()))


@pytest.fixture
def study(tmp_path):
    (tmp_path / "study.yaml").write_text(STUDY)
    return tmp_path / "study.yaml"


def test_it_fits_the_declared_model_and_shows_the_cost(whid, study):
    done = whid("fit", study, "--json")
    assert done.exit_code == 0, done.output
    out = json.loads(done.stdout)
    model = flow.load(out["path"]).model
    free = {p.name for p in model.system.tree.parameters()}
    assert free == {"chain.0.den.0", "chain.0.den.1", "chain.1.low", "chain.1.high"}
    for name, truth in (("chain.0.den.0", 0.5), ("chain.1.high", 0.7), ("chain.1.low", -0.4)):
        std = model.estimate.std[model.estimate.names.index(name)]
        assert abs(model.estimate.value(name) - truth) < 5 * std < 0.1
    lines = [line for line in done.stderr.splitlines() if "iteration" in line]
    cost = [float(line.split()[5]) for line in lines]
    assert len(cost) >= 3
    assert cost == sorted(cost, reverse=True)
    assert out["metrics"]["report.rms"]["value"] < 0.03


def test_noise_model_and_starts(whid, study):
    done = whid("fit", study, "--noise", "ar", "--robust", "--starts", 2)
    assert done.exit_code == 0, done.output
    assert "2 of 2 agree" in done.stdout


def test_ctrl_c_keeps_the_best(whid, study, monkeypatch):
    from whid.methods.fit import Fit
    from whid.refine import refine as whole

    def stopped(system, records, **options):
        def stop(iteration, cost):
            if iteration == 2:
                raise KeyboardInterrupt

        return whole(system, records, **options | {"watch": stop})

    monkeypatch.setattr("whid.methods.fit.refine", stopped)
    done = whid("fit", study, "--out", "kept")
    assert Fit.kind == "fit"
    assert done.exit_code == 130
    (folder,) = (study.parent / "kept").iterdir()
    model = flow.load(folder).model
    assert model.estimate.why_stop == "interrupted"
    assert abs(model.estimate.value("chain.0.den.0") - 0.5) < 0.25


def test_without_a_model_it_says_so(whid, study):
    study.write_text(STUDY.partition("model:")[0] + "identify: {kind: wiener_hammerstein}\n")
    done = whid("fit", study)
    assert done.exit_code == 2
    assert "fit-no-model" in done.stderr


def test_a_known_block_is_kept_and_tied_numbers_are_one(whid, study):
    """`identify: {kind: fit}` in the config, with everything that it takes there."""
    declared = STUDY.replace("low: -0.3, high: 0.5, fix: [slope]}", "low: -0.4, high: 0.7, fix: true}\n    - LAG")
    declared = declared.replace("- LAG", "- {kind: linear, num: [1.0], den: [0.7, 1.0], fix: [num, den.1]}")
    declared = declared.replace(
        "high: 0.7}\n  noise", "high: 0.7}\n    - {kind: linear, num: [1.0], den: [0.5, 1.0]}\n  noise"
    )
    declared = declared.replace("fix: [num]}", "fix: [num, den.1]}")
    kind = "{kind: fit, tied: [[chain.0.den.0, chain.2.den.0]], noise: ar, steps: 30}"
    study.write_text(declared.replace("{kind: wiener_hammerstein}", kind))
    done = whid("run", study, "--json")
    assert done.exit_code == 0, done.output
    model = flow.load(json.loads(done.stdout)["path"]).model
    assert model.estimate.names == ("chain.0.den.0", "chain.2.den.0")
    assert model.estimate.values[0] == model.estimate.values[1] == pytest.approx(0.5, abs=5 * model.estimate.std[0])
    assert (model.system.chain[1].low, model.system.chain[1].high) == (-0.4, 0.7)
    study.write_text(declared.replace("{kind: wiener_hammerstein}", kind.replace("chain.2.den.0", "chain.9.den.0")))
    wrong = whid("run", study)
    assert wrong.exit_code != 0
    assert "chain.9.den.0" in wrong.output + wrong.stderr
