"""Filter, curve, filter from noise and from a multisine: simulated plants of known structure, to their noise floor."""

from dataclasses import replace

import numpy as np
import pytest

from whid.blocks.chain import Chain
from whid.blocks.dead_zone import DeadZone
from whid.blocks.kinked import Kinked
from whid.blocks.linear import Linear
from whid.blocks.polynomial import Polynomial
from whid.blocks.saturation import Saturation
from whid.blocks.spline import Spline
from whid.blocks.table import Table
from whid.blocks.tone import Tone
from whid.errors import WhidError
from whid.experiments.multisine import Multisine
from whid.experiments.noise_band import NoiseBand
from whid.methods.parametric import Nonlinearity, Parametric
from whid.predict import predict
from whid.record import Record

DT, SAMPLES, REPORT = 0.1, 16_000, 12_000
FRONT, BACK = Linear(num=(4.0,), den=(1.0, 1.2, 4.0)), Linear(num=(9.0,), den=(1.0, 2.0, 9.0))
SOFT = Spline(inputs=(-4.0, -1.0, 0.2, 0.8, 2.0, 4.0), outputs=(-4.0, -1.0, 0.15, 0.4, 0.5, 0.52))
RELATIVE = 0.01  # noise over output


def record(chain, intersample="zoh", seed=0, tone=None, part=None):
    rng = np.random.default_rng(seed)
    u = (part or NoiseBand(band=(0.0, 0.35), std=1.0, duration_s=SAMPLES * DT)).input(DT, rng)[:SAMPLES]
    blank = Record(u=u, y=np.zeros(SAMPLES), dt=DT, intersample=intersample, initial="steady")
    y = predict(Chain(chain=chain), blank)
    std = RELATIVE * float(y.std())
    parts = (NoiseBand(start=0, stop=REPORT), NoiseBand(start=REPORT, stop=SAMPLES, use="report"))
    added = 0.0 if tone is None else tone.at(blank.time) * std
    y = y + std * rng.standard_normal(SAMPLES) + added
    return Record(u=u, y=y, dt=DT, intersample=intersample, initial="steady", parts=parts), std


def identify(found, **options):
    stages = {type(stage).__name__: stage for stage in Parametric(**options)([found.without("report")])}
    error = (predict(stages["Model"].system.tree, found) - found.y)[REPORT:]
    return stages, float(np.sqrt(np.mean(error**2)))


def within(error, std, excess=1.03):
    """The figure against the floor: the error of 4000 samples of noise is known to 1.1 %."""
    return error < std * (excess + 3 / np.sqrt(2 * (SAMPLES - REPORT)))


@pytest.mark.parametrize(
    ("chain", "orders"),
    [
        pytest.param((FRONT, SOFT, BACK), (2, 2), id="wiener-hammerstein"),
        pytest.param((FRONT, SOFT), (2, 0), id="wiener"),
        pytest.param((SOFT, BACK), (0, 2), id="hammerstein"),
    ],
)
def test_to_the_noise_floor_with_the_orders_given(chain, orders):
    found, std = record(chain)
    stages, error = identify(found, orders=orders)
    print(f"report rms over noise {error / std:.4f}")
    assert within(error, std)
    kinds = [block.kind for block in stages["Model"].system.series]
    assert kinds == ["linear" if block.kind == "linear" else "spline" for block in chain]


@pytest.mark.slow
@pytest.mark.parametrize("intersample", ["zoh", "bandlimited"])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("chain", "side"), [((FRONT, SOFT, BACK), 1), ((FRONT, SOFT), 1), ((SOFT, BACK), 0)], ids=["wh", "w", "h"]
)
def test_orders_and_structure_searched(chain, side, intersample, seed):
    found, std = record(chain, intersample, seed)
    stages, error = identify(found)
    kinds = [block.kind for block in stages["Model"].system.series]
    print(f"report rms over noise {error / std:.4f}", kinds)
    assert within(error, std, 1.05)
    assert kinds.index("spline") == side or len(kinds) == 3


def short_record(chain, samples, seed, relative):
    """A short record to fit, and 4000 samples more to judge by."""
    rng, count = np.random.default_rng(seed), samples + SAMPLES - REPORT
    u = NoiseBand(band=(0.0, 0.35), std=1.0, duration_s=count * DT).input(DT, rng)
    blank = Record(u=u, y=np.zeros(count), dt=DT, initial="steady")
    y = predict(Chain(chain=chain), blank)
    std = relative * float(y.std())
    parts = (NoiseBand(start=0, stop=samples), NoiseBand(start=samples, stop=count, use="report"))
    return replace(blank, y=y + std * rng.standard_normal(count), parts=parts), std


def check_short(chain, samples, seed, relative, excess):
    """Some twenty numbers from so few samples: their own errors leave 2 %, and a curve that ends where they do some more."""
    found, std = short_record(chain, samples, seed, relative)
    system = list(Parametric()([found.without("report")]))[-1].system
    error = float(np.sqrt(np.mean((predict(system.tree, found) - found.y)[samples:] ** 2)))
    print(f"{samples} samples, noise {relative}: report rms over noise {error / std:.4f}", [b.kind for b in system.series])
    assert within(error, std, excess)


def test_a_short_record_without_orders_is_not_overfitted():
    check_short((FRONT, SOFT), 600, 10_001, 0.2, 1.12)


@pytest.mark.slow
@pytest.mark.parametrize("relative", [0.02, 0.2])
@pytest.mark.parametrize("samples", [600, 1000])
@pytest.mark.parametrize("seed", [*range(50_100, 50_103), *range(110_100, 110_103)])
@pytest.mark.parametrize("chain", [(FRONT, SOFT, BACK), (FRONT, SOFT), (SOFT, BACK)], ids=["wh", "w", "h"])
def test_short_records_without_orders(chain, samples, seed, relative):
    check_short(chain, samples, seed, relative, 1.12)


def test_band_limited_input_is_oversampled_where_the_curve_is_hard():
    found, std = record((FRONT, Saturation(low=-0.8, high=0.5), BACK), "bandlimited")
    _, error = identify(found, orders=(2, 2))
    slow, slow_error = identify(found, orders=(2, 2), oversampling=1)
    print(f"report rms over noise {error / std:.4f}, at the record's rate {slow_error / std:.4f}")
    assert within(error, std, 1.05)
    assert error < slow_error
    assert slow["Model"].system.chain[0].kind == "linear"


def test_a_multisine_will_do():
    part = Multisine(period=2000, periods=8, lead_periods=0, band=(0.0, 0.3), rms=1.0)
    found, std = record((FRONT, SOFT, BACK), part=part)
    _, error = identify(found, orders=(2, 2))
    assert within(error, std)


def test_several_multisines_tell_noise_from_distortion():
    parts = [Multisine(period=1000, periods=2, lead_periods=1, band=(0.0, 0.35)) for _ in range(5)]
    rng = np.random.default_rng(7)
    u = np.concatenate([part.input(DT, rng) for part in parts])
    placed = tuple(part.placed(3000 * k, DT) for k, part in enumerate(parts))
    blank = Record(u=u, y=np.zeros(len(u)), dt=DT, initial="steady", parts=placed)
    y = predict(Chain(chain=(FRONT, SOFT, BACK)), blank)
    std = RELATIVE * float(y.std())
    found = Record(**{**vars(blank), "y": y + std * rng.standard_normal(len(u))})
    stages = {type(stage).__name__: stage for stage in Parametric(orders=(2, 2))([found])}
    assert stages["BestLinear"].averages == 5
    assert np.median(stages["BestLinear"].noise / stages["BestLinear"].std) < 0.5
    assert stages["Descent"].rms[-1] < 1.03 * std


def test_a_tone_in_the_residual_joins_the_model():
    tone = Tone(omega=2.345, cos=(0.5, 0.2), sin=(-0.3, 0.1), harmonics=(1, 3))
    found, std = record((FRONT, SOFT, BACK), tone=tone)
    stages, error = identify(found, orders=(2, 2))
    assert within(error, std)
    block = stages["Model"].system.chain[-1]
    assert block.harmonics == (1, 3)
    z = (block.omega - tone.omega) / stages["Interference"].omega_std
    assert abs(z) < 4
    np.testing.assert_allclose(np.array(block.cos) / std, tone.cos, atol=5 * np.sqrt(2 / REPORT))
    _, alone = identify(found, orders=(2, 2), interference="none")
    assert alone == pytest.approx(std * np.sqrt(1 + 0.195), rel=0.05)


def test_no_tone_is_claimed_in_noise():
    found, _ = record((FRONT, SOFT), seed=3)
    stages, _ = identify(found, orders=(2, 0))
    assert not stages["Interference"].found


SINE = Spline(inputs=(-4.0, -2.0, 0.0, 2.0, 4.0), outputs=(-1.3, -1.1, 0.0, 1.1, 1.3))
THIRD = Linear(num=(2.0, 4.0), den=(1.0, 2.2, 5.2, 4.0))
BETWEEN = {  # curve, filter, curve; straight where few samples go
    "soft-sine": (SOFT, FRONT, SINE),
    "clip-sine": (Saturation(low=-1.0, high=0.8, knee=0.3), FRONT, SINE),
    "dead-clip": (DeadZone(low=-0.4, high=0.5, knee=0.3), THIRD, Saturation(low=-0.5, high=0.7, knee=0.4)),
    "square-bend": (
        Polynomial(coefficients=(0.0, 0.5, 0.5)),
        FRONT,
        Spline(inputs=(-2.0, 0.0, 1.0, 3.0, 8.0), outputs=(-2.0, 0.0, 0.8, 1.2, 1.5)),
    ),
}


def test_a_filter_between_two_curves():
    found, std = record(BETWEEN["clip-sine"], "discrete")
    stages, error = identify(found, structure="hammerstein_wiener", orders=(2,))
    print(f"report rms over noise {error / std:.4f}")
    assert within(error, std)
    f, h, g = stages["Model"].system.series
    assert [f.kind, h.kind, g.kind] == ["spline", "linear", "spline"]
    assert f.value(np.zeros(1))[0] == pytest.approx(0.0, abs=1e-9)
    estimate = stages["Model"].estimate
    assert np.sum(estimate.std[: len(f.outputs)] == 0) == 2  # the gauge: two of f's points are held
    assert np.all(estimate.std[len(f.outputs) :] > 0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [*range(50_000, 50_003), *range(110_000, 110_003)])
@pytest.mark.parametrize(
    "chain", [*BETWEEN.values(), (FRONT, SOFT, BACK), (FRONT, SOFT), (SOFT, THIRD)], ids=[*BETWEEN, "wh", "w", "h"]
)
def test_the_structure_is_found(chain, seed):
    found, std = record(chain, seed=seed)
    stages, error = identify(found)
    compared, names = stages["Structures"], [block.kind for block in stages["Model"].system.series]
    print(f"report rms over noise {error / std:.4f}", names, compared.structure, np.round(compared.rms / std, 3))
    assert within(error, std, 1.05)
    assert names == ["linear" if block.kind == "linear" else "spline" for block in chain]  # after poles were taken out


@pytest.mark.parametrize(
    ("curve", "form", "kinds"),
    [
        (Saturation(low=-0.8, high=0.5, slope=0.9, knee=0.4), Nonlinearity(kind="saturation"), ["saturation", "polynomial"]),
        (DeadZone(low=-0.4, high=0.7, slope=1.2, knee=0.3), Nonlinearity(kind="dead_zone"), ["dead_zone", "polynomial"]),
        (
            Kinked(coefficients=(0.1, 1.0, 0.05), breaks=(0.3,), kinks=((-0.6, 0.1),)),
            Nonlinearity(kind="piecewise", knots=1),
            ["kinked"],
        ),
        (
            Table(inputs=(-4.0, -0.5, 0.8, 4.0), outputs=(-3.0, -0.7, 0.4, 1.0), knee=0.4),
            Nonlinearity(kind="hinges", knots=4, soft=True),
            ["table"],
        ),
    ],
    ids=lambda item: getattr(item, "kind", None) if not isinstance(item, list) else "",
)
def test_forms_of_the_curve(curve, form, kinds):
    """Down to the noise, and corners, kinks and knees where they are: within five standard errors."""
    found, std = record((FRONT, curve, BACK), "discrete", seed=2)
    stages, error = identify(found, orders=(2, 2), nonlinearity=form)
    print(f"report rms over noise {error / std:.4f}")
    assert within(error, std)
    fitted = [block for block in stages["Model"].system.series if block.kind != "linear"]
    assert [block.kind for block in fitted] == kinds
    estimate = stages["Model"].estimate
    for name in ("low", "high", "knee", "breaks.0", "inputs.1", "inputs.2"):
        true = {p.name: p.value for p in curve.parameters()}.get(name)
        if true is not None:
            place = estimate.names.index(f"chain.1.{name}")
            assert abs(estimate.values[place] - true) < 5 * estimate.std[place], name


def test_selection_parts_judge_between_structures():
    found, std = record((FRONT, SOFT))
    parts = (NoiseBand(start=0, stop=8000), NoiseBand(start=8000, stop=REPORT, use="selection"), found.parts[1])
    stages, error = identify(Record(**{**vars(found), "parts": parts}), orders=(2,))
    compared = stages["Structures"]
    assert np.isfinite(compared.selection).all()
    assert compared.structure[compared.chosen] == "wiener, 2 · f"
    assert {name.partition(",")[0] for name in compared.structure} >= {"wiener", "hammerstein-wiener"}
    assert within(error, std)


@pytest.mark.parametrize(
    "make",
    [lambda: Parametric(structure="hammerstein_wiener", orders=(2, 2)), lambda: Nonlinearity(kind="spline", knots=2)],
)
def test_impossible_options_are_refused(make):
    with pytest.raises(WhidError) as fault:
        make()
    assert fault.value.code == "block-parameters"


def test_hinges_with_free_knots():
    found, std = record((FRONT, Saturation(low=-0.8, high=0.5)), "discrete", seed=1)
    stages, error = identify(found, orders=(2, 0), nonlinearity=Nonlinearity(kind="hinges", knots=4))
    curve = stages["Model"].system.series[1]
    assert curve.kind == "table"
    np.testing.assert_allclose(curve.inputs[1:3], (-0.8, 0.5), atol=0.02)
    assert within(error, std)


def test_the_model_does_not_depend_on_what_is_kept_aside():
    found, _ = record((FRONT, SOFT))
    changed = found.y.copy()
    changed[REPORT:] = 7.0
    one, _ = identify(found, orders=(2, 0))
    other, _ = identify(Record(**{**vars(found), "y": changed}), orders=(2, 0))
    assert one["Model"].system == other["Model"].system


def test_records_of_two_rates_are_refused():
    found, _ = record((FRONT, SOFT))
    other = Record(**{**vars(found), "dt": 0.2, "name": "other"})
    with pytest.raises(WhidError, match="sampling times"):
        list(Parametric()([found, other]))


def test_no_estimation_samples_are_refused():
    found, _ = record((FRONT, SOFT))
    with pytest.raises(WhidError, match="estimation"):
        list(Parametric()([Record(**{**vars(found), "parts": (), "use": "report"})]))
