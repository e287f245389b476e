"""What the summary says, and what it refuses to say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.small_study import EXPERIMENT, PLANT, SmallStudy, small_study
from whid import flow, summary
from whid.blocks.linear import Linear
from whid.fit import linear_least_squares
from whid.methods._method import Model
from whid.quantity import Measured
from whid.result import Check
from whid.system import System


@pytest.fixture
def result(tmp_path, monkeypatch):
    monkeypatch.setattr("whid.plots.draw", lambda run, folder: ((), ()))
    return flow.run(small_study(), tmp_path)


def table(result, title):
    return next((t for t in summary.tables(result) if t.title.startswith(title)), None)


def model_of(chain):
    system = System(chain=chain)
    free = system.tree.parameters()
    values = np.array([p.value for p in free])
    return Model(system, linear_least_squares(np.eye(len(free)), values, np.full(len(free), 50.0), [p.name for p in free]))


def truths(result, chain):
    found = table(replace(result, stages={"model": model_of(chain)}), "Model")
    return {row[0]: row[2] for row in found.rows} if "truth" in found.columns else None


def test_the_truth_stands_beside_a_model_written_over_another_common_factor(result):
    # the plant's 1/(0.2 s + 1) is 5/(s + 5): same block, other numbers
    found = truths(result, (Linear(num=(5.0,), den=(1.0, 5.0)), *PLANT.chain[1:]))
    assert found["chain.0.num.0"] == pytest.approx(5.0)
    assert found["chain.0.den.0"] == pytest.approx(1.0)
    assert found["chain.1.high"] == 0.5


def test_no_truth_beside_a_model_that_shares_the_static_gain_otherwise(result):
    assert truths(result, (Linear(num=(2.0,), den=(0.2, 1.0)), *PLANT.chain[1:])) is None


def test_no_truth_beside_another_structure_and_none_for_measured_data(result):
    assert truths(result, PLANT.chain[:2]) is None
    assert truths(replace(result, truth=None), PLANT.chain) is None


def test_no_truth_for_a_block_of_another_order(result):
    found = truths(result, (Linear(num=(1.0,), den=(0.01, 0.2, 1.0)), *PLANT.chain[1:]))
    assert found["chain.0.den.0"] is None
    assert found["chain.2.den.0"] == 0.1


def test_errors_without_a_report_part_are_called_in_sample(result):
    assert table(result, "Fit").notes == ()
    inside = {name: value for name, value in result.metrics.items() if not name.startswith("report")}
    assert table(replace(result, metrics=inside), "Fit").notes == (summary.IN_SAMPLE,)


def test_every_metric_is_somewhere(result):
    metrics = {**result.metrics, "own.metric": Measured(1.0, 0.1)}
    shown = summary.tables(replace(result, metrics=metrics))
    cells = [cell for t in shown for row in t.rows for cell in row]
    assert all(value in cells for value in metrics.values())
    assert "own.metric" in cells


def test_what_a_method_could_not_know_is_said(result):
    assert "not known: a delay" in table(result, "Model").notes


def test_the_page_says_that_a_run_is_incomplete(tmp_path, monkeypatch):
    monkeypatch.setattr("whid.plots.draw", lambda run, folder: ((), ()))
    failed = flow.run(small_study(identify=SmallStudy(fail="named")), tmp_path)
    assert "**incomplete**" in (failed.path / "summary.md").read_text()


def test_a_sampled_study_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr("whid.plots.draw", lambda run, folder: ((), ()))
    sampled = flow.run(small_study(experiment=(replace(EXPERIMENT, path="sampled"),)), tmp_path)
    assert "sampled path" in table(sampled, "Study").rows[0][1]
    assert sampled.provenance["path"] == "sampled"
    # the model is the plant: on the same path only noise is left (2620 samples: 0.06 is four standard errors)
    assert sampled.metrics["estimation.rms"] == pytest.approx(0.05, rel=0.06)


def test_headings_carry_the_units_of_the_records(result):
    assert "rms" in table(result, "Fit").columns
    measured = tuple(replace(record, units={"input": "V", "output": "l/min"}) for record in result.records)
    assert {"rms, l/min", "fit, %"} <= set(table(replace(result, records=measured), "Fit").columns)
    mixed = (*result.records, *measured)
    assert "rms" in table(replace(result, records=mixed), "Fit").columns


def test_a_bound_on_a_metric_that_is_none_names_the_nearest():
    assert summary.expected([Check("report.rsm", None, 0.1, None)], ["report.rms"]).notes == (
        "report.rsm: no metric of this run; did you mean report.rms?",
    )


def test_the_note_on_single_frequencies_names_one_that_is_there(result):
    found = table(replace(result, metrics={"front.gain@0.7": 1.0, "back.gain@1.4": 1.0}), "Metrics")
    assert found.rows == ()
    assert "`front.gain@0.7`" in found.notes[0]


def test_the_parameters_stand_in_the_order_of_the_chain(result):
    names = [row[0] for row in table(result, "Model").rows]
    assert [name.split(".")[1] for name in names] == sorted(name.split(".")[1] for name in names)


def test_a_number_that_is_held_to_fix_a_scale_is_in_the_models_table(result):
    """Without it nobody can read the gain of num/den."""
    told = model_of((Linear(num=(3.0,), den=(1.0, 2.0)),))
    fewer = linear_least_squares(np.eye(2), np.array([3.0, 1.0]), np.full(2, 50.0), ["chain.0.num.0", "chain.0.den.0"])
    found = table(replace(result, truth=None, stages={"model": told._replace(estimate=fewer)}), "Model")
    assert [row[:2] for row in found.rows if row[0] == "chain.0.den.1"] == [("chain.0.den.1", 2.0)]
    assert "held, to fix a scale: chain.0.den.1" in found.notes
