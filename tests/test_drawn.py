"""Drawn statistics are those of records: line by line, in distribution, and in what a sweep reports."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from scipy import stats

from tests import design_p
from tests.test_sweep import STUDY
from whid import drawn
from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.cli import main
from whid.config.load import load_study
from whid.disturbances.ar import Ar
from whid.disturbances.process import Process
from whid.disturbances.white import White
from whid.experiments._experiment import Experiment
from whid.experiments.sine import Sine
from whid.experiments.staircase import Staircase
from whid.flow import records_needed
from whid.methods._statistics import OfRecords
from whid.simulate import simulate
from whid.stages.periods import harmonics
from whid.sweep import load, sweep
from whid.system import System

STD, SETTLE = 0.05, 3.0
PLANT = System(
    chain=(
        Linear(num=(1.0,), den=(0.3, 1.0)),
        Piecewise(breaks=(0.5,), pieces=((0.0,), (0.0, 0.0, 1.0))),
        Linear(num=(1.0,), den=(0.4, 1.0)),
    ),
    noise=(White(std=STD),),
)
PLAN = Experiment(  # 3 periods: errors of neighbouring harmonics share lines; 25 samples a period: no line at half the rate
    dt=0.1,
    parts=(
        Staircase(from_=-1.0, to=1.5, step=0.5, hold_s=10.0),
        Sine(offset=2.0, amplitude=0.8, samples_per_period=(50.0, 25.0), periods=3),
    ),
)
COUNT, SEED = 250, 81_000
SIMPLE = STUDY.replace("whole_record: false", "whole_record: false, settle_s: 3")


@pytest.mark.parametrize("samples", [50, 25, 36])
@pytest.mark.parametrize("periods", [2, 3, 20])
@pytest.mark.parametrize("ar", [(), (0.7,)])
def test_lines_and_the_rest_are_all_that_harmonics_read(samples, periods, ar):
    rng = np.random.default_rng(81_900)
    sine = Sine(offset=2.0, amplitude=0.8, samples_per_period=float(samples), periods=periods, lead_periods=2)
    plan = replace(PLAN, parts=(sine,))
    record = simulate(PLANT, plan, rng)
    drive = next(drawn.drives(record, SETTLE))
    spectrum = drawn.Spectrum.of(record.y, drive, 20)
    window = record.y[drive.skip * samples :][: spectrum.window.length]
    lines = np.fft.rfft(window)
    other = np.arange(len(lines)) % spectrum.window.periods != 0
    other[spectrum.lines] = False
    found = spectrum.read(lines[spectrum.lines], np.sum(np.abs(lines[other]) ** 2), np.array(ar))
    wanted = harmonics(record.y[drive.part], samples, drive.skip, min(20, drive.highest), np.array(ar))
    for name, one, other_one in zip(found._fields, found, wanted, strict=True):
        assert np.allclose(one, other_one, rtol=1e-12, atol=1e-14), name


def numbers(seen):
    """Return everything that the stages read, in a row."""
    curve = seen.curves(SETTLE)[PLAN.dt]
    row = [*curve.mean, *curve.mean_std, curve.noise_std, curve.long_run_variance]
    for sine in seen.sines(SETTLE, 9, {PLAN.dt: np.empty(0)}):
        h = sine.harmonics
        row += [*h.value.real, *h.value.imag[1:], *h.value_std, *h.own_std, h.noise_std]
    return np.array(row)


def test_what_is_drawn_has_the_distribution_of_what_is_measured():
    """KS of every number and of products of neighbours, which tell what is shared; p against the number of tests."""
    plans = drawn.plans(PLANT, [PLAN])
    seeds = np.random.SeedSequence(SEED).spawn(COUNT)
    ours = np.array([numbers(drawn.Drawn(plans, [STD], [seed])) for seed in seeds])
    x, rng = plans[0].record, np.random.default_rng(SEED + 1)
    theirs = [numbers(OfRecords([replace(x, y=x.y + STD * rng.standard_normal(len(x)))])) for _ in range(COUNT)]
    theirs = np.array(theirs)
    moving = theirs.std(axis=0) > 0
    ours, theirs = ours[:, moving], theirs[:, moving]
    centre, spread = theirs.mean(axis=0), theirs.std(axis=0)
    ours, theirs = (ours - centre) / spread, (theirs - centre) / spread
    pairs = [(ours, theirs), (ours[:, 1:] * ours[:, :-1], theirs[:, 1:] * theirs[:, :-1])]
    p = np.concatenate([stats.ks_2samp(a, b).pvalue for a, b in pairs])
    assert len(p) > 150
    assert p.min() > 0.01 / len(p), p.min()


def test_a_draw_says_the_same_when_asked_again():
    one = drawn.Drawn(drawn.plans(PLANT, [PLAN]), [STD], [np.random.SeedSequence(SEED)])
    assert np.array_equal(numbers(one), numbers(one))
    assert one.samples == 600 + 4 * 75
    assert not one.records[0].using("estimation").any()


def test_without_noise_the_undisturbed_statistics_come_out():
    plan = drawn.plans(PLANT, [PLAN])
    silent = drawn.Drawn(plan, [0.0], [np.random.SeedSequence(1)])
    assert np.allclose(numbers(silent), numbers(OfRecords([plan[0].record])), rtol=1e-9, atol=1e-12)


def needed(*overrides, noise=None, text=SIMPLE):
    import yaml

    study = load_study(yaml.safe_load(text), overrides)
    return records_needed(replace(study, plant=replace(study.plant, noise=noise)) if noise is not None else study)


@pytest.mark.parametrize(
    ("overrides", "noise", "why"),
    [
        ([], None, ""),
        (["identify={kind: wiener_hammerstein, whole_record: false}"], None, "settle_s"),
        (["identify={kind: wiener_hammerstein, settle_s: 3}"], None, "whole_record: false"),
        (["identify={kind: parametric}"], None, "`parametric` reads every sample"),
        (["expect=[{metric: estimation.rms, below: 1}]"], None, "estimation.rms"),
        (["experiment.adaptive={}"], None, "`adaptive:`"),
        (["experiment.parts.1.use=report"], None, "report"),
        (["experiment.parts.1={kind: sine, offset: 2, amplitude: 0.8, omega: 0.63, periods: 8}"], None, "whole number"),
        (["experiment.parts.1={kind: multisine, period: 64, periods: 3, rms: 1, lines: [1, 2]}"], None, "multisine"),
        (["plant.noise.std=300"], None, "stand out"),
        (["trace={}"], None, "closed loop"),
        ([], (Ar(std=0.1, coefficients=(0.5,)),), "`ar` at the output"),
        ([], (Process(std=0.1),), "`process` ahead of the nonlinearity"),
        ([], (White(std=0.1), Ar(std=0.1, coefficients=(0.5,))), "`ar`"),
        ([], (), "nothing to draw"),
    ],
)
def test_what_needs_records_says_why(overrides, noise, why):
    found = needed(*overrides, noise=noise)
    assert (why in found) if why else not found


def test_a_sweep_says_which_was_used_and_full_records_forces_the_other(tmp_path):
    import yaml

    study = yaml.safe_load(SIMPLE) | {"sweep": {"over": {"plant.noise.std": [0.05]}, "repeats": 1}}
    fast = sweep(study, tmp_path / "a")
    assert set(fast.records) == {""}
    assert "drawn statistics" in fast.table().notes[0]
    assert "estimation.rms" not in fast.values
    again = sweep(study, tmp_path / "a")
    assert again.reused
    assert again.table().notes == fast.table().notes
    path = tmp_path / "study.yaml"
    path.write_text(yaml.safe_dump(study))
    told = CliRunner().invoke(main, ["sweep", str(path), "--out", str(tmp_path / "a"), "--full-records", "--json"])
    full = load(json.loads(told.stdout)["path"])
    assert not json.loads(told.stdout)["reused"]
    assert full.table().notes == ("records: full, because asked for",)
    assert "estimation.rms" in full.values
    mixed = sweep(study, tmp_path / "b", ["sweep.over={plant.noise.kind: [white], plant.noise.std: [0.01, 300]}"])
    assert [bool(why) for why in mixed.records] == [False, True]
    assert "(1 of 2 cells)" in mixed.table().notes[0]


@pytest.mark.slow
def test_every_metric_and_its_error_on_design_p(tmp_path):
    """300 repeats of Table 4.1's plan each way: KS of every metric and standard error."""
    both = [
        sweep("configs/brouri2019/noise-sweep.yaml", tmp_path, ["sweep.over={plant.noise.std: [0.5]}", "seed=81500", *more])
        for more in (["sweep.repeats=300"], ["sweep.repeats=300", "sweep.full_records=true"])
    ]
    assert design_p.STD == 0.5
    p = {}
    for name in both[0].values:
        for what in ("values", "std"):
            a, b = (getattr(found, what)[name][0] for found in both)
            if np.isfinite(a).all() and np.isfinite(b).all():
                p[name, what] = stats.ks_2samp(a, b).pvalue
    print(f"{len(p)} numbers, least p {min(p.values()):.3g}, median {np.median(list(p.values())):.3g}")
    assert len(p) > 40
    assert min(p.values()) > 0.01 / len(p)
