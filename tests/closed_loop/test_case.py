"""The generator: as visible as asked, the same again from the same seed, nothing of the truth where whid can read it."""

import json

import numpy as np
import pytest
import yaml

from tests.closed_loop.case import LUMPS, NotVisible, draw_case, write
from tests.closed_loop.hidden import EFFECTS, OUTSIDE
from tests.closed_loop.plants import FAMILIES
from tests.closed_loop.scene import draw_scene
from tests.closed_loop.world import World


def ingested(folder, case):
    from whid.config.load import load_study
    from whid.files.ingest import ingest

    study = load_study(write(case, folder))
    return study, ingest(study.data, folder).record


def test_the_same_seed_is_the_same_case():
    one, two, other = (draw_case(seed, ["hum@output"], 0.5, family="memoryless") for seed in (11, 11, 12))
    assert (one.y == two.y).all()
    assert one.study == two.study
    assert one.truth == two.truth
    assert one.study["model"] != other.study["model"]


def test_an_effect_changes_neither_plant_nor_noise_nor_study():
    control, case = draw_case(21, [], 0, family="linear"), draw_case(21, ["offset_step@output"], 0.5, family="linear")
    change = case.y - control.y
    step = case.truth["effects"][0]["parameters"]
    at = round(step["at_s"] / case.study["data"]["dt"])
    assert change[:at] == pytest.approx(0.0, abs=1e-12)
    assert change[at:] == pytest.approx(step["step"], abs=1e-5)
    assert control.study == case.study


@pytest.mark.parametrize("size", [0.1, 0.5, 3.0])
def test_visible_size_by_hand(size):
    """Memoryless polynomial: what a refit absorbs is spanned by the powers of u, and an offset step is the rest."""
    seed = next(s for s in range(100) if draw_scene(s, "memoryless").plant.parts[0].kind == "polynomial")
    case = draw_case(seed, ["offset_step@output"], size, family="memoryless")
    scene = draw_scene(seed, "memoryless")
    step = case.truth["effects"][0]["parameters"]
    change = step["step"] * (np.arange(len(case.u)) >= round(step["at_s"] / scene.dt))
    powers, use = np.vander(case.u / np.abs(case.u).max(), 4), scene.plan.estimation
    rest = change[use] - powers[use] @ np.linalg.lstsq(powers[use], change[use], rcond=None)[0]
    assert np.sqrt(np.mean(rest**2)) / scene.noise.std == pytest.approx(size, rel=0.02)


def test_a_random_effect_is_as_large_as_asked():
    case, control = (draw_case(31, e, 0.5, family="linear") for e in (["coloured_noise@noise"], []))
    change = (case.y - control.y)[draw_scene(31, "linear").plan.estimation]
    assert np.sqrt(np.mean(change**2)) / control.truth["noise_std"] == pytest.approx(0.5, rel=LUMPS)


def test_what_a_refit_absorbs_is_invisible():
    scene = draw_scene(41, "wiener_hammerstein")
    moved = World.of(scene.plant.moved(scene.plant.numbers()[1], 1e-4)).undisturbed(scene.plan) - scene.output
    assert scene.left_over(moved) < 0.01 * np.sqrt(np.mean(moved**2)) / scene.noise.std


def test_the_noise_is_the_declared_one():
    for coloured in (False, True):
        scene, case = draw_scene(51, "linear", coloured=coloured), draw_case(51, [], 0, family="linear", coloured=coloured)
        e = case.y - scene.output
        assert e.std() == pytest.approx(case.truth["noise_std"], rel=0.1 if coloured else 0.03)
        declared = case.study["model"]["noise"]
        assert declared["std"] == pytest.approx(case.truth["noise_std"], rel=0.16)
        if coloured:
            assert np.corrcoef(e[1:], e[:-1])[0, 1] == pytest.approx(scene.noise.coefficients[0], abs=0.03)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_user_could_have_written_it(family, tmp_path):
    """It loads; its start values are as rough as they may be and no rougher; the truth is not in the folder."""
    seed = 60 + FAMILIES.index(family)
    case = draw_case(seed, [], 0, family=family)
    study, record = ingested(tmp_path, case)
    assert (record.u == case.u).all()
    assert (record.y == case.y).all()
    assert sum(part.length for part in record.parts) == len(record)
    assert record.using("report").sum() == 2000
    scene = draw_scene(seed, family)
    for i, (block, part) in enumerate(zip(study.model.chain, scene.plant.parts, strict=True)):
        assert block.kind == part.declared()["kind"]
        low, high = scene.ranges[i]
        believed = case.study["model"]["chain"][i]
        for key in ("low", "high"):
            if key in believed:
                assert abs(believed[key] - part.declared()[key]) <= 0.0301 * (high - low)
        for b, true in zip(believed.get("breaks", []), part.declared().get("breaks", []), strict=True):
            assert abs(b - true) <= 0.0301 * (high - low)
        for key in ("num", "den", "coefficients"):
            assert believed.get(key, []) == pytest.approx(part.declared().get(key, []), rel=0.201)
    assert {file.name for file in tmp_path.iterdir()} == {f"case-{seed}.yaml", f"case-{seed}.npz"}
    with np.load(tmp_path / f"case-{seed}.npz") as file:
        assert set(file.files) == {"u", "y"}


def test_study_and_record_say_nothing_of_what_is_hidden(tmp_path):
    case = draw_case(71, ["backlash@input"], 0.5, family="linear")
    text = write(case, tmp_path / "seen", tmp_path / "truth").read_text()
    assert "backlash" not in text
    assert "input: " in text
    assert "hidden" not in text
    study = yaml.safe_load(text)
    assert set(study) == {"name", "data", "model", "identify", "trace"}
    truth = json.loads((tmp_path / "truth" / "case-71.json").read_text())
    assert [(e["kind"], e["place"]) for e in truth["effects"]] == [("backlash", "input")]
    with pytest.raises(ValueError, match="no place beside"):
        write(case, tmp_path / "seen", tmp_path / "seen")


@pytest.mark.parametrize("family", FAMILIES)
def test_two_simulators_that_share_no_code_agree(family, tmp_path):
    """The true numbers in whid's tree give the generator's undisturbed output, far below the noise."""
    from dataclasses import replace

    from whid.config.load import load_study
    from whid.files.ingest import ingest
    from whid.predict import predict

    seed = 80 + FAMILIES.index(family)
    case, scene = draw_case(seed, [], 0, family=family), draw_scene(seed, family)
    study = case.study | {"model": {"chain": case.truth["plant"]}}
    loaded = load_study(write(case._replace(study=study), tmp_path))
    record = replace(ingest(loaded.data, tmp_path).record, valid=None)
    error = predict(loaded.model.tree, record) - scene.output
    assert np.sqrt(np.mean(error**2)) < 0.01 * scene.noise.std


def test_the_table_is_covered():
    assert len(EFFECTS) >= 35
    assert len({(e.kind, e.place) for e in EFFECTS.values()}) >= 30
    assert len(OUTSIDE) == 3
    with pytest.raises(NotVisible):
        draw_case(1, ["jump@nonlinearity"], 0.5, family="linear")


def test_two_effects_at_once():
    case = draw_case(91, ["curve@input", "hum@output"], 1.0, family="linear")
    assert [e["kind"] for e in case.truth["effects"]] == ["curve", "hum"]
    assert [e["size"] for e in case.truth["effects"]] == pytest.approx([1.0, 1.0], rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*EFFECTS, *OUTSIDE])
def test_every_effect_is_as_visible_as_asked(name):
    """At each size, on three plants; where some plant cannot show it, on most."""
    for size in (0.1, 0.5, 3.0):
        found = []
        for seed in range(1000, 1003):
            try:
                found += [e["size"] for e in draw_case(seed, [name], size).truth["effects"]]
            except NotVisible as fault:
                print(fault)
        assert len(found) >= 1
        assert found == pytest.approx([size] * len(found), rel=LUMPS)
