import copy
import dataclasses
import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from whid.blocks.chain import Chain
from whid.blocks.dead_zone import DeadZone
from whid.blocks.linear import Linear
from whid.blocks.parallel import Parallel
from whid.blocks.piecewise import Piecewise
from whid.config.load import as_system, load_study, resolved, study_of
from whid.config.memory import memory
from whid.config.study import Study
from whid.config.yaml import dump, parse
from whid.disturbances.white import White
from whid.errors import Faults, WhidError
from whid.experiments.staircase import Staircase
from whid.kinds import plain

CONFIGS = Path(__file__).parents[2] / "configs"
SHIPPED = [path for path in sorted(CONFIGS.rglob("*.yaml")) if path.name != "calibration.yaml"]  # a sweep over drawn studies
GOOD = """\
name: good
plant:
  chain:
    - {kind: linear, num: [1], den: [1, 2]}
    - parallel:
        - {kind: dead_zone, low: -1, high: 1.5, fix: [low]}
        - chain:
            - {kind: linear, poles: ["-1+2j", "-1-2j"], gain: 2}
            - {parallel: [{kind: dead_zone, low: 0, high: 1e-3}, {chain: [{kind: dead_zone, low: 0, high: 1}]}]}
  noise: {kind: white, std: 0.1}
experiment:
  dt: 0.1
  parts:
    - {kind: staircase, from: -1, to: 1, step: 0.5, hold_s: 3, return: true}
    - {kind: sine, offset: 0, amplitude: 1, omega: [0.5, 1], periods: 2e1}
identify: {kind: wiener_hammerstein}
"""


def study(text=GOOD, *overrides):
    return study_of(parse(text, "f.yaml"), overrides)


def faults(text, *overrides):
    with pytest.raises(Faults) as caught:
        study(text, *overrides)
    return str(caught.value)


def test_a_tree_in_a_tree_in_a_tree():
    chain = study().plant.chain
    assert isinstance(chain[1], Parallel)
    assert chain[1].parallel[1].chain[1].parallel[1] == Chain(chain=(DeadZone(low=0.0, high=1.0),))
    assert chain[1].parallel[1].chain[0].poles == (-1 + 2j, -1 - 2j)
    assert chain[0] == Linear(num=(1.0,), den=(1.0, 2.0))


def test_names_that_python_keeps_for_itself():
    assert study().experiment[0].parts[0] == Staircase(from_=-1.0, to=1.0, step=0.5, hold_s=3.0, return_=True)


def test_one_mapping_stands_for_a_list():
    assert study().plant.noise == (White(std=0.1),)
    assert len(study().experiment) == 1


def test_whole_numbers_may_be_written_as_floats_and_floats_as_whole_numbers():
    sine = study().experiment[0].parts[1]
    assert sine.periods == 20
    assert isinstance(sine.periods, int)


CASES = [  # what replaces what, and what is said of it
    ("name: good", "name: ../x", "f.yaml:1:7: name: must be 1 to 64 letters"),
    ("name: good", "name: .hidden", "name: must be 1 to 64"),
    ("name: good", "name: good\nsed: 3", "f.yaml:2:1: sed: unknown key, did you mean seed?"),
    ("name: good", "name: good\n<whid.a.B>: 3", "f.yaml:2:1: <whid.a.B>: unknown key (allowed"),
    ("name: good\n", "", "f.yaml:1:1: name: is missing"),
    ("kind: linear, num: [1]", "kind: linaer, num: [1]", "f.yaml:4:14: plant.chain[0].kind: no kind 'linaer', did you"),
    ("{kind: linear, num", "{num", "f.yaml:4:7: plant.chain[0]: needs `kind:` (blocks: "),
    ("den: [1, 2]", "dne: [1, 2]", "plant.chain[0].dne: unknown key, did you mean den? (allowed: kind, fix, num, den"),
    ("den: [1, 2]", "den: 1", "f.yaml:4:37: plant.chain[0].den: must be a list, not 1"),
    ("den: [1, 2]", "den: [1, .inf]", "plant.chain[0].den[1]: must be a finite number"),
    ("den: [1, 2]", f"den: [1, {10**400}]", "plant.chain[0].den[1]: must be a finite number"),
    ("den: [1, 2]", "den: [1, true]", "plant.chain[0].den[1]: must be a number, not true"),
    ("den: [1, 2]", "den: [1, '2']", "plant.chain[0].den[1]: must be a number, not the text '2'"),
    ("den: [1, 2]", "den: [0, 2]", "f.yaml:4:7: plant.chain[0]: den[0] is the leading coefficient"),
    ("den: [1, 2]", "den: []", "plant.chain[0].den: needs at least 1 entry"),
    ("low: -1", "low: no", "f.yaml:6:34: plant.chain[1].parallel[0].low: must be a number, not the text 'no'"),
    ('"-1+2j"', '"-1+2k"', "poles[0]: must be a number such as -1+2j"),
    ('"-1+2j"', '"1e999"', "poles[0]: must be finite"),
    ("std: 0.1", "std: -0.1", "f.yaml:10:29: plant.noise.std: must be >= 0, not -0.1"),
    ("dt: 0.1", "dt: 0", "experiment.dt: must be > 0, not 0"),
    ("dt: 0.1", "dt:", "experiment.dt: must be a number, not empty"),
    ("dt: 0.1", "dt: 0.1\n  path: exakt", "experiment.path: must be one of exact, sampled, not the text 'exakt', did"),
    ("periods: 2e1", "periods: 2.5", "experiment.parts[1].periods: must be a whole number, not 2.5"),
    ("omega: [0.5, 1]", "omega: [0.5, -1]", "experiment.parts[1].omega[1]: must be > 0, not -1"),
    ("omega: [0.5, 1]", "omega: fast", "experiment.parts[1].omega: must be a number or a list, not the text 'fast'"),
    ("omega: [0.5, 1]", "period: 3, omega: 1", "f.yaml:15:7: experiment.parts[1]: sine needs exactly one of omega"),
    ("return: true", "return: 1", "experiment.parts[0].return: must be true or false, not 1"),
    ("step: 0.5", "step: 1e-9", "f.yaml:14:48: experiment.parts[0].step: a step of 1e-09 makes more than"),
    ("identify:", "data: {file: a.csv}\nidentify:", "f.yaml:1:1: needs exactly one of plant (with experiment), data"),
    ("plant:", "model:", "needs exactly one of plant (with experiment), data, records, not nothing"),
    ("identify:", "expect: [{metric: a}]\nidentify:", "expect[0]: a bound needs `below:`, `above:` or both"),
    ("identify:", "expect: [{metric: a, below: 1, above: 2}]\nidentify:", "nothing is above 2 and below 1"),
    ("identify:", "sweep: {mode: zip, over: {a: [1], b: [1, 2]}}\nidentify:", "sweep.over: `mode: zip` needs lists of"),
    ("identify:", "sweep: {over: {}}\nidentify:", "sweep.over: needs at least 1 entry"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "said"), CASES, ids=[new[:30] for _, new, _ in CASES])
def test_a_fault_is_told_with_its_place_and_what_is_allowed(old, new, said):
    assert old in GOOD
    assert said in faults(GOOD.replace(old, new, 1))


def test_every_fault_at_once_in_the_order_of_the_file():
    text = (
        GOOD.replace("name: good", "name: /")
        .replace("low: -1", "low: x")
        .replace("dt: 0.1", "dt: -1")
        .replace("step: 0.5", "stop: x")
    )
    lines = faults(text).splitlines()
    places = [int(line.split(":")[1]) for line in lines]
    assert places == sorted(places)
    assert len(lines) == 5  # stop is a key of every part, and step is missing


def test_an_entry_at_fault_does_not_make_its_list_too_short():
    assert "at least" not in faults(GOOD.replace("kind: staircase", "kind: x").replace("kind: sine", "kind: y"))


def test_not_a_mapping_at_all():
    for text in ("", "3", "[1, 2]", "text"):
        assert "must be a mapping" in faults(text)


def test_a_file_that_is_not_there(tmp_path):
    for path in (tmp_path / "no.yaml", tmp_path, "nul\0"):
        with pytest.raises(WhidError) as caught:
            load_study(path)
        assert caught.value.code == "config-file"


def test_a_file_that_is_no_text_or_too_long(tmp_path):
    for data in (b"\xff\xfe\x00", b"a: " + b"x" * 2_000_000):
        (tmp_path / "f.yaml").write_bytes(data)
        with pytest.raises(WhidError) as caught:
            load_study(tmp_path / "f.yaml")
        assert caught.value.code == "config-file"


@pytest.mark.parametrize(
    ("override", "get", "value"),
    [
        ("plant.noise.std=0.25", lambda s: s.plant.noise[0].std, 0.25),
        ("plant.noise[0].std=1e-3", None, None),
        ("plant.chain.0.den.1=7", lambda s: s.plant.chain[0].den[1], 7.0),
        ("plant.chain[0].den[1]=7", lambda s: s.plant.chain[0].den[1], 7.0),
        ("plant.chain[1].parallel[0].high = 9", lambda s: s.plant.chain[1].parallel[0].high, 9.0),
        ("seed=5", lambda s: s.seed, 5),
        ("experiment.parts.0.return=false", lambda s: s.experiment[0].parts[0].return_, False),
        ("plant.noise={kind: white, snr_db: 20}", lambda s: s.plant.noise[0].snr_db, 20.0),
        ("model.chain=[{kind: dead_zone, low: 0, high: 1}]", lambda s: s.model.chain[0].high, 1.0),
        ("name=other", lambda s: s.name, "other"),
    ],
)
def test_overrides(override, get, value):
    if get is None:
        with pytest.raises(Faults):
            study(GOOD, override)
        return
    assert get(study(GOOD, override)) == value


def test_an_override_enters_a_list_of_one():
    text = GOOD.replace("noise: {kind: white, std: 0.1}", "noise: [{kind: white, std: 0.1}]")
    assert study(text, "plant.noise.std=0.3").plant.noise == (White(std=0.3),)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("plant.noise.sdt=1", "--set plant.noise.sdt: unknown key, did you mean std?"),
        ("plant.noise.std=-1", "--set plant.noise.std: must be >= 0, not -1"),
        ("plant.nois.std=1", "--set plant.nois.std: plant.nois is not there, did you mean noise?"),
        ("plnt=1", "--set plnt: unknown key, did you mean plant?"),
        ("plant.chain[7].num=1", "--set plant.chain[7].num: plant.chain is a list: its entries are 0 … 1"),
        ("plant.chain.front=1", "its entries are 0 … 1"),
        ("experiment.dt.x=1", "--set experiment.dt.x: experiment.dt holds no keys"),
        ("plant.noise={kind: white, sdt: 1}", "--set plant.noise: plant.noise.sdt: unknown key"),
        ("seed", "--set seed: write it as path=value"),
        ("seed=[1", "--set seed:1:3: not YAML"),
        ("seed=!!int 3", "tags"),
        ("=1", "is not a path"),
        ("a..b=1", "is not a path"),
        ("a[x]=1", "is not a path"),
    ],
)
def test_an_override_is_checked_like_the_file(override, said):
    assert said in faults(GOOD, override)


def test_faults_of_overrides_and_of_the_file_come_together():
    said = faults(GOOD.replace("low: -1", "low: x"), "plant.noise.std=-1", "nope.x.y=1")
    assert "f.yaml:6:34" in said
    assert "--set plant.noise.std" in said
    assert "--set nope" in said


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: str(path.relative_to(CONFIGS)))
def test_a_shipped_config_loads_and_is_written_back_as_the_same_study(path):
    found = load_study(path)
    assert study_of(parse(resolved(found))) == found
    assert resolved(study_of(parse(resolved(found)))) == resolved(found)


def test_from_a_mapping_of_numpy_values():
    mapping = parse(GOOD).value
    mapping["plant"]["chain"][0]["den"] = np.array([1.0, 3.0])
    mapping["experiment"]["dt"] = np.float64(0.1)
    before = copy.deepcopy(mapping["plant"]["noise"])
    found = load_study(mapping, ["plant.noise.std=9"])
    assert found.plant.chain[0].den == (1.0, 3.0)
    assert mapping["plant"]["noise"] == before  # the caller's mapping stays as it was


def test_from_a_study_itself():
    found = load_study(study(), ["seed=4"])
    assert found == dataclasses.replace(study(), seed=4)


def test_as_system_reads_what_a_result_holds():
    plant = study().plant
    assert as_system(dump(plain(plant))) == plant
    assert as_system(plain(plant)) == plant


NUMBERS = st.floats(-1e6, 1e6).filter(lambda x: x == 0 or abs(x) > 1e-200)
STABLE = NUMBERS.filter(lambda x: x >= 0)  # a plant that runs away is refused
LEAVES = st.one_of(
    st.builds(lambda a, b: DeadZone(low=min(a, b), high=max(a, b)), NUMBERS, NUMBERS),
    st.builds(lambda n, d: Linear(num=(n,), den=(1.0, d)), NUMBERS, STABLE),
    st.builds(lambda re, im, g: Linear(poles=(complex(-re, im), complex(-re, -im)), gain=g), STABLE, NUMBERS, NUMBERS),
    st.builds(
        lambda b, c, fix: Piecewise(breaks=tuple(sorted(b)), pieces=tuple((c,) for _ in range(len(b) + 1)), fix=fix),
        st.sets(NUMBERS, max_size=3), NUMBERS, st.sampled_from([True, False, ("breaks",), ("no", "1e3")]),
    ),
)  # fmt: skip
TREES = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.lists(inner, min_size=1, max_size=3).map(lambda blocks: Chain(chain=tuple(blocks))),
        st.lists(inner, min_size=1, max_size=3).map(lambda blocks: Parallel(parallel=tuple(blocks))),
    ),
    max_leaves=8,
)


@settings(max_examples=100, deadline=None)
@given(st.lists(TREES, min_size=1, max_size=3), st.integers(0, 2**64))
def test_any_tree_is_written_back_as_it_was(blocks, seed):
    whole = study()
    whole = dataclasses.replace(whole, seed=seed, plant=dataclasses.replace(whole.plant, chain=tuple(blocks)))
    assert study_of(parse(resolved(whole))) == whole


JUNK = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=8), st.just([]), st.just({}), st.just([[]]),
    st.just({"kind": "chain"}), st.just({"kind": []}), st.just({"kind": "sine"}), st.just({"chain": 1, "parallel": 2}),
    st.just(10**400), st.just("-1+2j"), st.sampled_from(["auto", "white", "exact"]),
)  # fmt: skip


def outcome(load, *arguments):
    """Return what was loaded or the named fault; anything else goes through."""
    try:
        return load(*arguments)
    except WhidError as error:
        return error


def places(value, path=()):
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from places(item, (*path, key))


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_a_mutated_config_is_a_study_or_a_named_fault(data):
    text = data.draw(st.sampled_from([GOOD, *(path.read_text("utf-8") for path in SHIPPED)]))
    tree = parse(text).value
    for _ in range(data.draw(st.integers(1, 3))):
        *way, last = data.draw(st.sampled_from([path for path in places(tree) if path]))
        holder = tree
        for step in way:
            holder = holder[step]
        what = data.draw(st.sampled_from(["replace", "remove", "rename"]))
        if what == "replace" or isinstance(holder, list):
            holder[last] = copy.deepcopy(data.draw(JUNK))
        else:
            value = holder.pop(last)
            if what == "rename":
                holder[data.draw(st.sampled_from(["kind", "chain", "from_", "x", last + "s"]))] = value
    found = outcome(load_study, tree)
    assert isinstance(found, (Study, WhidError))
    if isinstance(found, Study):
        assert outcome(memory, found)
        assert study_of(parse(resolved(found))) == found


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_a_mutated_text_is_a_study_or_a_named_fault(data):
    text = data.draw(st.sampled_from([GOOD, (CONFIGS / "starter.yaml").read_text("utf-8")]))
    start = data.draw(st.integers(0, len(text)))
    end = min(len(text), start + data.draw(st.integers(0, 30)))
    changed = text[:start] + data.draw(st.text(max_size=10)) + text[end:]
    assert isinstance(outcome(study, changed), (Study, WhidError))


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=200))
def test_any_bytes_are_a_named_fault(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("bytes") / "f.yaml"
    path.write_bytes(data)
    with pytest.raises(WhidError):
        load_study(path)


def test_the_schema_of_the_shipped_configs_is_fresh():
    from whid.config.schema import json_schema

    def bare(node):  # a docstring may change, the keys may not
        if isinstance(node, dict):
            return {key: bare(item) for key, item in node.items() if key != "description" or isinstance(item, dict)}
        return [bare(item) for item in node] if isinstance(node, list) else node

    stored = json.loads((CONFIGS / "whid.schema.json").read_text("utf-8"))
    assert bare(stored) == bare(json.loads(json.dumps(json_schema()))), "run: whid schema > configs/whid.schema.json"


@pytest.fixture(scope="module")
def editor():
    """What an editor does with the schema: an independent implementation of JSON Schema."""
    schema = json.loads((CONFIGS / "whid.schema.json").read_text("utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema).is_valid


def test_an_editor_finds_nothing_in_a_good_config(editor):
    assert editor(parse(GOOD).value)
    assert all(editor(parse(path.read_text("utf-8")).value) for path in SHIPPED)


def test_an_editor_marks_what_whid_refuses_by_its_form(editor):
    told_later = (
        "den: [0, 2]",
        "inf",
        "-1+2k",
        "1e999",
        "period: 3",
        "step: 1e-9",
        "data: {",
        "model:",
        "expect: [",
        "zip",
        "1000",
    )
    for old, new, said in CASES:
        if not any(word in new for word in told_later):
            assert not editor(parse(GOOD.replace(old, new, 1)).value), said


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: str(path.relative_to(CONFIGS)))
def test_a_shipped_config_names_the_schema(path):
    first = path.read_text("utf-8").partition("\n")[0]
    assert first.startswith("# yaml-language-server: $schema=")
    assert (path.parent / first.partition("=")[2]).resolve() == (CONFIGS / "whid.schema.json").resolve()
