"""configs/brouri2019/table-4-1.yaml as a user runs it."""

from pathlib import Path

import numpy as np
import pytest

import whid
from tests.design_p import back, front
from whid.quantity import Measured

CONFIG = Path(__file__).parents[2] / "configs" / "brouri2019" / "table-4-1.yaml"


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return whid.run(CONFIG, out=tmp_path_factory.mktemp("runs"))


def test_the_printed_seed_is_within_four_standard_errors(result):
    for name, measured in result.metrics.items():
        block, _, rest = name.partition(".")
        if block in ("front", "back") and "@" in rest:
            quantity, _, omega = rest.partition("@")
            g = (front if block == "front" else back)(float(omega))
            true = abs(g) if quantity == "gain" else np.angle(g)
            assert isinstance(measured, Measured)
            assert abs(measured.value - true) < 4 * measured.std, (name, measured, true)
    assert result.exit_code == 0


def test_published_and_ours_stand_side_by_side(result):
    table = next(t for t in result.tables if t.title.startswith("The paper's method"))
    assert table.columns == ("quantity", "published truth", "published", "paper's method, ours", "efficient, ours")
    rows = {row[0]: row[1:] for row in table.rows}
    assert len(rows) == 18
    assert rows["front.gain@0.02"][:2] == (0.97, 0.98)
    assert isinstance(rows["front.gain@0.02"][2], Measured)
    assert rows["back.gain@0.18"][3] == rows["back.phase@0.18"][3] == "not observed"
    assert any("0.18 rad/s" in note and "no harmonic 3" in note for note in table.notes)
    assert "### The paper's method and the efficient one" in (result.path / "summary.md").read_text()


def test_rounded_truth_of_the_paper_agrees_but_for_its_misprint(result):
    """The printed truth is ours to half a unit of its last digit, but for |Gi(j0.02)|, .979 printed as .97."""
    table = next(t for t in result.tables if t.title.startswith("The paper's method"))
    off = []
    for name, printed, *_ in table.rows:
        block, quantity, omega = name.replace("@", ".", 1).split(".", 2)
        g = (front if block == "front" else back)(float(omega))
        if abs((abs(g) if quantity == "gain" else np.angle(g)) - printed) > 0.0101:
            off.append(name)
    assert off == []
    assert abs(abs(front(0.02)) - 0.979) < 5e-4


def test_both_estimators_are_in_the_file(result):
    import h5py

    with h5py.File(result.path / "result.h5") as file:
        found = set()
        file.visit(lambda name: found.add(name.rpartition("/")[2]))
    assert {"stepwise", "joint", "rational", "identifiability"} <= found
