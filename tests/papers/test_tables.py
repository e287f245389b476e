"""`whid table`: an exhibit runs on its study, is kept, and is compared with what was expected."""

import re
import shutil
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from tests.small_study import SmallStudy, bound, small_study
from whid.cli import main
from whid.config.load import load_study
from whid.config.schema import validator
from whid.errors import WhidError
from whid.files import expected
from whid.files.expected import Cells
from whid.papers import _exhibit
from whid.papers._exhibit import Exhibit, Published, Regenerated, Row
from whid.papers._monte_carlo import held, mean, rmse, share, variance
from whid.quantity import Measured
from whid.regenerate import bench_of, regenerate, with_tables
from whid.result import Check

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True, kw_only=True)
class Slopes(Exhibit):
    """The slope of the small study, over runs of half the noise."""

    def regenerate(self, bench):
        found = [run.stages["levels"].slope for run in bench.results(identify=SmallStudy(wants=False))]
        bar = held("slope", mean(found), above=0.0)
        return Regenerated("Slopes", [Row("slope", self.printed("slope"), efficient=mean(found))], bars=(bar,))


@pytest.fixture
def study(monkeypatch, tmp_path):
    """A study with a table, as `load_study` would give it."""
    given = small_study(table=(Slopes(runs=3, full_runs=5, published=(Published(quantity="slope", value=0.9),)),))
    monkeypatch.setattr("whid.regenerate.load_study", lambda path: given)
    return tmp_path / "small.yaml"


def test_rows_files_and_the_expected_table(study, tmp_path):
    found = regenerate(study, tmp_path / "runs")
    row = found.found["slopes" if "slopes" in found.found else ""].rows[0]
    assert (row.published, found.exit_code, found.drift) == (0.9, 0, None)
    assert {p.name for p in found.path.iterdir()} == {"small.expected.csv", "table.md", "config.yaml", "DONE"}
    with pytest.raises(WhidError, match=r"small\.expected\.csv") as fault:
        regenerate(study, tmp_path / "runs", check=True)
    assert (fault.value.code, fault.value.exit_code) == ("table-expected", 5)
    shutil.copy(found.path / "small.expected.csv", tmp_path)
    again = regenerate(study, tmp_path / "runs", check=True)
    assert (again.drift, again.exit_code) == ((), 0)
    assert again.path != found.path  # nothing is overwritten


@pytest.fixture(autouse=True)
def _named():
    Slopes.kind = "slopes"


def test_full_runs_are_more_of_the_same(study, tmp_path):
    (quick,), (full,) = (regenerate(study, tmp_path, full=full).found["slopes"].rows for full in (False, True))
    assert quick.efficient.value != full.efficient.value
    assert quick.efficient.std > 0


def test_run_k_draws_the_same_whatever_the_count_and_other_noise_for_another_study():
    given = small_study()
    bench = bench_of(given, Path(), Slopes(runs=2), False, lambda *_: None)
    calm = SmallStudy(wants=False)
    first = [run.records[0].y for run in bench.results(1, identify=calm)]
    both = [run.records[0].y for run in bench.results(identify=calm)]
    np.testing.assert_array_equal(first[0], both[0])
    assert np.abs(both[0] - both[1]).max() > 0.05
    other = next(bench.results(1, identify=calm, plant=replace(given.plant, noise=())))
    assert np.std(other.records[0].y - both[0]) == pytest.approx(0.05, rel=0.06)
    assert bench.rng(3).random() == bench.rng(3).random() != bench.rng(4).random()


def test_failed_runs_are_left_out_and_said():
    bench = bench_of(small_study(), Path(), Slopes(runs=2), False, lambda *_: None)

    @dataclass(frozen=True, kw_only=True)
    class Failing(Exhibit):
        def regenerate(self, bench):
            assert bench.metrics(identify=SmallStudy(fail="named")) == {}
            return Regenerated("nothing", [])

    (note,) = Failing()(bench).notes
    assert note.startswith("2 runs failed and are left out; run 0 failed: block-no-steady-state")


ROW = Cells("t", "gain", {"published": 0.98, "efficient": Measured(1.0, 0.01), "paper": None, "bound": "not observed"}, None)


@pytest.mark.parametrize(
    ("changes", "tolerance", "drifts"),
    [
        ({}, None, 0),
        ({"efficient": Measured(1.009, 0.5)}, None, 0),  # within its expected standard error
        ({"efficient": Measured(1.011, 0.01)}, None, 1),
        ({"efficient": Measured(1.011, 0.01)}, 0.02, 0),
        ({"published": 0.9805}, None, 0),
        ({"published": 0.982}, None, 1),
        ({"bound": "observed"}, None, 1),
        ({"paper": 1.0}, None, 1),
        ({"efficient": None}, None, 1),
        ({"efficient": Measured(float("nan"), 0.01)}, None, 1),
    ],
)
def test_what_counts_as_drift(tmp_path, changes, tolerance, drifts):
    wanted = ROW._replace(tolerance=tolerance)
    (tmp_path / "t.csv").write_text(expected.text([wanted]))
    read = expected.read(tmp_path / "t.csv")
    assert read == [wanted]
    assert len(list(expected.drift(read, [ROW._replace(cells=ROW.cells | changes)]))) == drifts


def test_rows_that_come_or_go_are_drift():
    assert len(list(expected.drift([ROW], []))) == len(list(expected.drift([], [ROW]))) == 1


def test_something_else_is_not_taken_for_an_expected_table(tmp_path):
    (tmp_path / "t.csv").write_text("a,b\n1,2\n")
    with pytest.raises(WhidError) as fault:
        expected.read(tmp_path / "t.csv")
    assert fault.value.code == "table-expected"


def test_a_bar_holds_when_the_interval_reaches_it():
    assert held("m", Measured(1.1, 0.06), below=1.0).verdict == "pass"
    assert held("m", Measured(1.1, 0.04), below=1.0).verdict == "breached"
    assert held("m", Measured(0.89, 0.01), above=0.9, below=1.1).verdict == "pass"
    assert held("m", Measured(0.87, 0.01), above=0.9, below=1.1).verdict == "breached"
    assert held("m", Measured(float("nan"), 0.1), below=1.0).verdict == "breached"
    assert held("m", Measured(0.5, 0.1), below=1.0) == Check("m", 0.5, 1.0, None)


def test_standard_errors_of_monte_carlo_figures_are_those_of_their_scatter():
    draws = np.random.default_rng(40).standard_normal((2000, 25))  # 2000 tables of 25 runs
    for figure, centre in ((mean, 0.0), (rmse, 1.0), (variance, 1.0)):
        many = np.array([figure(row) for row in draws])
        # the scatter of 2000 figures is known to 1.6 %, the mean error of their errors to less; 25 runs are a bit skew
        assert many[:, 1].mean() == pytest.approx(many[:, 0].std(), rel=0.06), figure
        assert many[:, 0].mean() == pytest.approx(centre, abs=0.02), figure
    assert share(0, 100).std > 0.005
    assert mean([1.0, np.nan, 3.0]).value == 2.0


def test_every_config_with_a_table_has_its_expected_table_and_they_are_found():
    found = with_tables(ROOT / "configs")
    assert ROOT / "configs" / "brouri2019" / "table-4-1.yaml" in found
    for config in found:
        rows = expected.read(expected.beside(config))
        assert {row.table for row in rows} == {exhibit.kind for exhibit in load_study(config).table}, config


def test_the_keys_of_a_table_are_checked_like_all_others():
    given = {"name": "a", "data": {"file": "x.csv"}, "identify": {"kind": "wiener_hammerstein"}}
    with pytest.raises(WhidError, match="runs"):
        load_study(given | {"table": {"kind": "brouri2019_table_4_1", "runs": 0}})
    with pytest.raises(WhidError, match="brouri2019_table_4_1"):
        load_study(given | {"table": {"kind": "brouri2019_table_41"}})


def test_listing_the_tables_draws_nothing():
    code = "import sys; from whid.config.schema import validator; validator(); print('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "False"
    assert validator()
    assert _exhibit.Exhibit.kinds()


def test_the_command_says_what_drifted_and_exits_4(study, tmp_path, monkeypatch):
    from click.testing import CliRunner

    def whid(*words):
        return CliRunner().invoke(main, ["table", str(study), "--out", str(tmp_path / "runs"), *words])

    done = whid()
    assert done.exit_code == 0
    assert re.search(r"slope +0\.9 +\d\.\d+ ± ", done.stdout)
    (written,) = (tmp_path / "runs").glob("*/small.expected.csv")
    (tmp_path / "small.expected.csv").write_text(written.read_text().replace("slope,0.9", "slope,0.7"))
    checked = whid("--check")
    assert checked.exit_code == 4
    assert "slope, published: expected 0.7, now 0.9" in checked.stderr
    assert whid("--full", "--check").exit_code == 2


def test_a_study_without_a_table_is_refused(tmp_path):
    with pytest.raises(WhidError) as fault:
        regenerate(ROOT / "configs" / "starter.yaml", tmp_path)
    assert fault.value.code == "table-none"
    with pytest.raises(WhidError):
        with_tables(tmp_path)


def test_compare_with_paper_prints_both_estimates_in_any_study(tmp_path, monkeypatch):
    monkeypatch.setattr("whid.plots.draw", lambda run, folder: ((), ()))
    from tests.small_study import Levels
    from whid import flow

    monkeypatch.setattr(
        Levels, "metrics", lambda self: {"paper.slope": Measured(0.8, 0.2), "slope": Measured(0.9, 0.1)}, raising=False
    )
    titles = [t.title for t in flow.run(small_study(), tmp_path).tables]
    assert "The paper's method and the efficient one" not in titles
    result = flow.run(small_study(compare_with_paper=True, expect=(bound("slope", 2.0),)), tmp_path)
    table = next(t for t in result.tables if t.title.startswith("The paper's"))
    assert table.columns == ("quantity", "paper's method, ours", "efficient, ours")
    assert table.rows == (("slope", Measured(0.8, 0.2), Measured(0.9, 0.1)),)
    assert flow.load(result.path).published == ()
