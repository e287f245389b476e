"""Progress: quiet where nobody watches, alive on a terminal, and never on stdout."""

from __future__ import annotations

import io
import sys

from whid.cli import _steps
from whid.cli._steps import Steps


def test_a_short_run_in_a_pipe_says_nothing(capsys):
    with Steps() as steps:
        steps("levels", 0.1)
    assert capsys.readouterr() == ("", "")


def test_a_long_run_in_a_pipe_says_a_line_now_and_then(capsys, monkeypatch):
    monkeypatch.setattr(_steps, "SPARSE", 0.0)
    with Steps() as steps:
        steps("levels", 6.0)
    out, err = capsys.readouterr()
    assert out == ""
    assert "levels" in err
    assert err.count("\n") == 1


def test_a_terminal_sees_every_step(monkeypatch, capsys):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with Steps() as steps:
        steps("period [averages]", 0.25)  # brackets are not markup
    assert "period [averages]  0.25 s" in terminal.getvalue()
    assert capsys.readouterr().out == ""
