"""What every experiment part promises: its length, its place, its repeatability; and what each one's input is."""

import dataclasses

import numpy as np
import pytest

from tests.experiments.examples import EXAMPLES
from whid.errors import WhidError
from whid.experiments._experiment import Experiment
from whid.experiments._part import Part
from whid.experiments.multisine import Multisine
from whid.experiments.noise_band import NoiseBand
from whid.experiments.square import Square
from whid.experiments.steps import Steps
from whid.kinds import plain, yaml_key

CASES = [pytest.param(p, id=f"{kind}-{k}") for kind, many in EXAMPLES.items() for k, p in enumerate(many)]
DTS = [0.1, 0.0731, 0.5]


@pytest.mark.parametrize("kind", Part.kinds())
def test_every_kind_has_an_example_and_a_summary(kind):
    assert kind in EXAMPLES, f"add an example of {kind!r} to tests/experiments/examples.py"
    assert Part.named(kind).summary()


@pytest.mark.parametrize("dt", DTS)
@pytest.mark.parametrize("part", CASES)
def test_samples_is_the_length_of_the_input(part, dt):
    for single in part.expand(dt):
        u = single.input(dt, np.random.default_rng(0))
        assert u.shape == (single.samples(dt),)
        assert u.dtype == np.float64
        assert len(u) > 0
        assert np.all(np.isfinite(u))


@pytest.mark.parametrize("part", CASES)
def test_expanded_parts_expand_to_themselves_and_keep_their_use(part):
    for single in part.expand(0.1):
        assert single.expand(0.1) == (single,)
        assert single.use == part.use


@pytest.mark.parametrize("part", CASES)
def test_a_placed_part_is_where_it_was_put(part):
    for single in part.expand(0.1):
        placed = single.placed(40, 0.1)
        assert (placed.start, placed.stop) == (40, 40 + single.samples(0.1))
        assert placed.length == placed.samples(0.1)


@pytest.mark.parametrize("part", CASES)
def test_plain_round_trips(part):
    for item in (part, *(single.placed(7, 0.1) for single in part.expand(0.1))):
        names = {yaml_key(f.name): f.name for f in dataclasses.fields(item)}
        fields = {names[k]: tuple(v) if isinstance(v, list) else v for k, v in plain(item).items() if k != "kind"}
        assert type(item)(**fields) == item


@pytest.mark.parametrize("part", CASES)
def test_the_same_generator_gives_the_same_input(part):
    for single in part.expand(0.1):
        one, two = (single.input(0.1, np.random.default_rng(4)) for _ in range(2))
        np.testing.assert_array_equal(one, two)


def test_a_plan_is_its_parts_one_after_another():
    experiment = Experiment(dt=0.1, parts=tuple(p for many in EXAMPLES.values() for p in many))
    plan = experiment.plan()
    assert [p.start for p in plan] == [0, *(p.stop for p in plan[:-1])]
    assert len(experiment.input(plan, np.random.default_rng(0))) == experiment.samples()


def test_steps_hold_within_their_range_and_stay_within_their_levels():
    u = Steps(low=-1.0, high=2.0, hold_s=(0.5, 2.0), duration_s=2000.0).input(0.1, np.random.default_rng(1))
    changes = np.flatnonzero(np.diff(u)) + 1
    holds = np.diff(changes)
    assert holds.min() >= 5
    assert holds.max() <= 20
    assert set(holds) >= {6, 12, 19}
    assert -1 <= u.min() < -0.99
    assert 1.99 < u.max() <= 2
    listed = Steps(levels=(3.0, 1.0), hold_s=0.2, duration_s=0.9).input(0.1, np.random.default_rng(1))
    assert listed.tolist() == [3, 3, 1, 1, 3, 3, 1, 1, 3]


def test_a_multisine_has_its_lines_only():
    part = Multisine(period=128, periods=2, lines=(1, 5, 9), rms=0.7, offset=1.5)
    u = part.input(0.1, np.random.default_rng(2))
    np.testing.assert_array_equal(u[:128], u[128:256])
    spectrum = np.abs(np.fft.rfft(u[:128])) / 64
    np.testing.assert_allclose(spectrum[[1, 5, 9]], 0.7 * np.sqrt(2 / 3), atol=1e-12)
    assert np.delete(spectrum, [0, 1, 5, 9]).max() < 1e-12
    assert np.mean(u[:128]) == pytest.approx(1.5)
    assert np.std(u[:128]) == pytest.approx(0.7)
    assert np.all(Multisine(period=100, periods=1, band=(0.0, 1.0), odd=True).harmonics() == np.arange(1, 50, 2))


def test_band_noise_is_in_its_band_and_of_its_size():
    part = NoiseBand(band=(0.39, 0.59), std=0.3, duration_s=5000.0)
    u = part.input(0.1, np.random.default_rng(3))
    power = np.abs(np.fft.rfft(u)) ** 2
    share = np.arange(len(power)) / (len(u) / 2)
    assert power[(share < 0.389) | (share > 0.591)].max() < 1e-18 * power.max()
    lines = np.sum((share >= 0.39) & (share <= 0.59))
    assert np.var(u) == pytest.approx(0.09, rel=4.5 / np.sqrt(lines))
    fourth = np.mean((u / 0.3) ** 4)
    assert fourth == pytest.approx(3.0, abs=0.15)  # Gaussian; a multisine would be below


def test_a_square_is_high_for_its_duty():
    u = Square(offset=1.0, amplitude=2.0, period=10, periods=3, duty=0.3).input(0.1, np.random.default_rng(0))
    np.testing.assert_array_equal(u.reshape(-1, 10), np.tile([3.0] * 3 + [-1.0] * 7, (4, 1)))


@pytest.mark.parametrize(
    "make",
    [
        lambda: Steps(hold_s=1.0, duration_s=5.0),
        lambda: Steps(low=0.0, hold_s=1.0, duration_s=5.0),
        lambda: Steps(low=0.0, high=1.0, duration_s=5.0),
        lambda: Steps(low=1.0, high=0.0, hold_s=1.0, duration_s=5.0),
        lambda: Steps(levels=(1.0,), hold_s=(2.0, 1.0), duration_s=5.0),
        lambda: Multisine(period=16, periods=1),
        lambda: Multisine(period=16, periods=1, lines=(8,)),
        lambda: Multisine(period=16, periods=1, band=(0.01, 0.02)),
        lambda: Multisine(period=16, lines=(1,)),
        lambda: NoiseBand(band=(0.5, 0.5), duration_s=1.0),
        lambda: NoiseBand(band=(0.5, 0.6)),
        lambda: NoiseBand(band=(0.5, 0.501), duration_s=1.0).input(0.1, np.random.default_rng(0)),
        lambda: Square(amplitude=1.0, period=4),
    ],
)
def test_impossible_parts_are_refused(make):
    with pytest.raises(WhidError) as fault:
        make()
    assert fault.value.code == "part-parameters"
