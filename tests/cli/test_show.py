"""`whid show` prints a summary again, and names a folder that has none."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from tests.small_study import bound, small_study
from whid import flow
from whid.cli import main


@pytest.fixture(autouse=True)
def _no_pictures(monkeypatch):
    monkeypatch.setattr("whid.plots.draw", lambda run, folder: ((), ()))


def test_it_prints_what_run_printed(tmp_path):
    result = flow.run(small_study(expect=(bound("report.rms", 1e-9),)), tmp_path)
    shown = CliRunner().invoke(main, ["show", str(result.path)])
    assert shown.exit_code == 0  # showing is no judgement
    for table in result.tables:
        assert table.title in shown.stdout
    assert "breached" in shown.stdout
    assert CliRunner().invoke(main, ["show", str(result.path / "result.h5")]).stdout == shown.stdout


def test_no_run_here_is_a_usage_fault(tmp_path):
    shown = CliRunner().invoke(main, ["show", str(tmp_path)])
    assert shown.exit_code == 2
    assert "error[run-not-found]" in shown.stderr
