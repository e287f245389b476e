"""What every block promises, held against every kind in the folder."""

import dataclasses

import numpy as np
import pytest

from tests.blocks.examples import CLOCKED, DT, EXAMPLES, LAG
from whid.blocks._block import STEADY, Block
from whid.blocks.chain import Chain
from whid.kinds import plain, yaml_key
from whid.signal import held

ALL = ("discrete", "zoh", "foh", "bandlimited")
COURSES = ("discrete", "zoh", "foh", pytest.param("bandlimited", marks=pytest.mark.slow))
CASES = [pytest.param(block, id=f"{kind}-{k}") for kind, blocks in EXAMPLES.items() for k, block in enumerate(blocks)]
IN_PIECES = [case for case in CASES if not case.values[0].looks_ahead()]  # the rest get a record whole, see predict.chunks
UNCLOCKED = [case for case in CASES if case.values[0].kind not in CLOCKED]
SAMPLES = 30


def length(block: Block) -> int:
    if block.kind != "feedback":
        return SAMPLES
    return 6 if block.solve == "continuous" else 14  # a loop goes sample by sample, or round and round until it closes


def wave(seed: int, course: str, samples: int = SAMPLES, t0: float = 0.0, order: int = 8):
    rng = np.random.default_rng(seed)
    t = DT * np.arange(samples)
    values = sum(a * np.cos(w * t + p) for a, w, p in rng.uniform((0.2, 0.3, 0), (0.8, 4.0, 6.0), (4, 3)))
    return held(values, DT, course, t0, order)


def around(block: Block, course: str) -> Block:
    """The block seen through a lag, so that what it does between samples counts; a discrete block keeps to samples."""
    return block if course == "discrete" else Chain(chain=(LAG, block, LAG))


def order(block: Block) -> int:
    return max(8, block.panel_order(DT))


def near(actual, desired, tolerance):
    np.testing.assert_allclose(actual, desired, rtol=0, atol=tolerance * max(1.0, np.abs(desired).max(initial=0.0)))


def assert_derivative(tangent, function, size=1.0):
    """Five-point differences: a coarse step for rounding, a fine one where a switching moves fast with the parameter."""
    for h in (1e-5, 1e-4, 1e-6, 1e-7):
        x = h * max(size, 0.1)
        difference = (8 * (function(x) - function(-x)) - (function(2 * x) - function(-2 * x))) / (12 * x)
        if np.abs(difference - tangent).max() <= 1e-7 * max(1.0, np.abs(tangent).max()):
            return
    near(tangent, difference, 1e-7)


@pytest.mark.parametrize("kind", Block.kinds())
def test_every_kind_has_an_example_and_a_summary(kind):
    assert kind in EXAMPLES, f"add an example of {kind!r} to tests/blocks/examples.py"
    assert all(block.kind == kind for block in EXAMPLES[kind])
    assert Block.named(kind).summary()


@pytest.mark.parametrize("course", ALL)
@pytest.mark.parametrize("block", IN_PIECES)
def test_chunks_make_no_difference(block, course):
    tree, u = around(block, course), wave(1, course, length(block), order=order(block))
    whole, _ = tree.step(u)
    state, parts = None, []
    for part in (slice(0, 7), slice(7, 8), slice(8, 8), slice(8, None)):
        out, state = tree.step(u[part], state)
        parts.append(out.values)
    near(np.concatenate(parts), whole.values, 1e-12)


@pytest.mark.parametrize("course", COURSES)
@pytest.mark.parametrize("block", IN_PIECES)
def test_tangents_in_chunks_make_no_difference(block, course):
    tree, u, seed = (
        around(block, course),
        wave(1, course, length(block), order=order(block)),
        wave(2, course, length(block), order=order(block)),
    )
    names = [p.name for p in tree.parameters(held=True)]
    whole = tree.tangent(u, [seed], names)
    near(whole.signal.values, tree.step(u)[0].values, 1e-12)
    state, parts = None, []
    for part in (slice(0, 7), slice(7, 8), slice(8, None)):
        out = tree.tangent(u[part], [seed[part]], names, state)
        state = out.state
        parts.append([s.values for s in out.tangents])
    near(np.concatenate(parts, axis=1), np.array([s.values for s in whole.tangents]), 1e-10)


@pytest.mark.parametrize("block", CASES)
@pytest.mark.parametrize(
    ("bare", "course"),
    [
        (True, "discrete"),
        (True, "zoh"),
        (False, "zoh"),
        (False, "foh"),
        pytest.param(False, "bandlimited", marks=pytest.mark.slow),
    ],
)
def test_tangents_are_finite_differences(block, bare, course):
    tree = block if bare else around(block, course)
    u, seeds = (
        wave(1, course, length(block), order=order(block)),
        [wave(k, course, length(block), order=order(block)) for k in (2, 3)],
    )
    parameters = tree.parameters(held=True)
    out = tree.tangent(u, seeds, [p.name for p in parameters])
    for seed, tangent in zip(seeds, out.tangents, strict=False):
        assert_derivative(
            tangent.values,
            lambda x, seed=seed: tree.step(held(u.values + x * seed.values, DT, course, order=u.order))[0].values,
        )
    for p, tangent in zip(parameters, out.tangents[len(seeds) :], strict=True):
        assert_derivative(
            tangent.values, lambda x, p=p: tree.with_parameters({p.name: p.value + x}).step(u)[0].values, abs(p.value)
        )


@pytest.mark.parametrize("course", COURSES)
@pytest.mark.parametrize("block", UNCLOCKED)
def test_absolute_time_makes_no_difference(block, course):
    tree = around(block, course)
    now, later = (tree.step(wave(1, course, length(block), t0, order=order(block)))[0] for t0 in (0.0, 1234.5))
    near(later.values, now.values, 1e-15)
    assert later.t0 == 1234.5


@pytest.mark.parametrize("course", COURSES)
@pytest.mark.parametrize("block", CASES)
def test_the_input_is_unchanged(block, course):
    u, seed = wave(1, course, length(block), order=order(block)), wave(2, course, length(block), order=order(block))
    before = [u.values.copy(), u.panels.values.copy(), seed.values.copy(), seed.panels.values.copy()]
    for array in (u.values, seed.values):
        array.flags.writeable = False
    out, _ = block.step(u)
    _ = out.panels
    for tangent in block.tangent(u, [seed], [p.name for p in block.parameters(held=True)]).tangents:
        _ = tangent.panels
    after = [u.values, u.panels.values, seed.values, seed.panels.values]
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))


@pytest.mark.parametrize("course", ["discrete", "zoh"])
@pytest.mark.parametrize("level", [-1.3, 0.0, 1.9])
@pytest.mark.parametrize("block", UNCLOCKED)
def test_steady_is_the_end_of_a_long_hold(block, level, course):
    final, state = block.steady(level, DT)
    hold = held(np.full(400, level), DT, course, order=order(block))
    near(block.step(hold)[0].values[-1], final, 1e-9)
    near(block.step(hold[:50], state)[0].values, np.full(50, final), 1e-9)


@pytest.mark.parametrize("course", ["discrete", "zoh"])
@pytest.mark.parametrize("block", CASES)
def test_tangents_from_a_steady_start(block, course):
    """The start itself moves with the input and with every number: all of it against finite differences."""
    u, seed = (wave(k, course, 8, order=order(block)) for k in (1, 2))
    names = [p.name for p in block.parameters(held=True)]
    out = block.tangent(u, [seed], names, STEADY).tangents
    near(block.step(u, STEADY)[0].values, block.step(u, block.steady(float(u.values[0]), DT)[1])[0].values, 1e-11)

    def steadily(tree, values):
        return tree.step(held(values, DT, course, order=u.order), tree.steady(float(values[0]), DT)[1])[0].values

    assert_derivative(out[0].values, lambda x: steadily(block, u.values + x * seed.values))
    for p, tangent in zip(block.parameters(held=True), out[1:], strict=True):
        moved = lambda x, p=p: steadily(block.with_parameters({p.name: p.value + x}), u.values)  # noqa: E731
        assert_derivative(tangent.values, moved, abs(p.value))


@pytest.mark.parametrize("block", CASES)
def test_parameters_round_trip(block):
    parameters = block.parameters(held=True)
    assert block.with_parameters({p.name: p.value for p in parameters}) == block
    for p in parameters:
        value = p.value + 0.01
        changed = block.with_parameters({p.name: value})
        assert {q.name: q.value for q in changed.parameters(held=True)} == {
            q.name: value if q.name == p.name else q.value for q in parameters
        }
    assert dataclasses.replace(block, fix=True).parameters() == ()


def rebuilt(value):
    """What a configuration makes of a plain value, without its checks."""
    if isinstance(value, list):
        return tuple(rebuilt(item) for item in value)
    if not isinstance(value, dict):
        return complex(value) if isinstance(value, str) and value.endswith("j") else value
    cls = Block.named(value.get("kind") or next(key for key in value if key in ("chain", "parallel")))
    fields = {yaml_key(f.name): f.name for f in dataclasses.fields(cls)}
    return cls(**{fields[key]: rebuilt(item) for key, item in value.items() if key != "kind"})


@pytest.mark.parametrize("block", CASES)
def test_plain_round_trips(block):
    assert rebuilt(plain(block)) == block


@pytest.mark.parametrize("course", COURSES)
@pytest.mark.parametrize("samples", [0, 1, 2])
@pytest.mark.parametrize("block", CASES)
def test_short_records(block, course, samples):
    u = wave(1, course, samples, order=order(block))
    out, _ = block.step(u)
    assert out.values.shape == (samples,)
    assert out.panels.values.shape[1] == samples
    assert np.all(np.isfinite(out.values))
    names = [p.name for p in block.parameters(held=True)]
    assert all(t.values.shape == (samples,) for t in block.tangent(u, [u], names).tangents)
