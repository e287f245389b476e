import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import click
import pytest

import whid as package
from whid.cli import Commands, main
from whid.errors import CATALOGUE, CONFIG, FAILED, Faults, WhidError

ROOT = Path(package.__file__).parent
HEAVY = {"numpy", "scipy", "control", "pydantic", "pydantic_core", "matplotlib", "rich", "h5py", "yaml"}


def test_help_imports_nothing_heavy():
    code = (
        "import sys, runpy, json; sys.argv = ['whid', '--help']\n"
        "try: runpy.run_module('whid', run_name='__main__')\n"
        "except SystemExit: print(json.dumps(sorted(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not HEAVY & set(json.loads(done.stderr.splitlines()[-1]))
    assert "check" in done.stdout


def test_every_command_has_a_line_and_an_example(whid):
    listed = whid("--help").output
    for name in main.list_commands(None):
        assert name in listed
        told = whid(name, "--help")
        assert told.exit_code == 0
        assert f"Example: whid {name}" in told.output, name


def test_version(whid):
    assert whid("--version").output == f"whid, version {package.__version__}\n"


def test_a_command_that_is_not_there(whid):
    found = whid("chekc")
    assert found.exit_code == CONFIG
    assert "No such command 'chekc'" in found.stderr
    assert "Did you mean 'check'?" in found.stderr


def end(raised, *, returned=None):
    """Run a command that raises, and return (exit code, stdout, stderr)."""
    from click.testing import CliRunner

    group = Commands("whid")

    @click.command()
    def broken():
        if raised is not None:
            raise raised
        return returned() if callable(returned) else returned

    group.add_command(broken)
    group.get_command = lambda ctx, name: broken
    found = CliRunner().invoke(group, ["broken"])
    return found.exit_code, found.stdout, found.stderr


def test_a_fault_is_a_line_and_a_remedy():
    code, out, err = end(WhidError("data-file", "no such file", "x.csv"))
    assert (code, out) == (CONFIG, "")
    assert err == f"error[data-file]: x.csv: no such file\ntry: {CATALOGUE['data-file'].remedy}\n"


def test_faults_are_a_line_each_and_a_remedy_once_a_code():
    faults = [WhidError("config-value", "a"), WhidError("config-value", "b"), WhidError("block-no-steady-state", "c")]
    code, _, err = end(Faults(faults))
    assert code == FAILED
    assert [line.partition(":")[0] for line in err.splitlines()] == [
        "error[config-value]", "error[config-value]", "error[block-no-steady-state]", "try", "try",
    ]  # fmt: skip


def test_the_exit_code_of_a_command_is_what_it_returns():
    assert [end(None, returned=value)[0] for value in (None, 0, 4, 5)] == [0, 0, 4, 5]


def test_ctrl_c():
    code, out, err = end(KeyboardInterrupt())
    assert (code, out, err.strip()) == (130, "", "interrupted")
    wrapped = RuntimeError("Error calling __set_name__ on a property")
    wrapped.__cause__ = KeyboardInterrupt()
    assert end(wrapped)[::2] == (130, "interrupted\n")


def test_a_file_that_the_system_refuses():
    code, _, err = end(PermissionError(13, "Permission denied", "/x"))
    assert code == FAILED
    assert err.startswith("error[file-access]: /x: Permission denied\n")


def test_a_bug_is_one_line_and_a_log_and_a_traceback_on_demand(monkeypatch):
    code, out, err = end(ZeroDivisionError("1/0\nmore"))
    assert (code, out) == (FAILED, "")
    assert len(err.splitlines()) == 1
    assert "ZeroDivisionError: 1/0 more: this is a bug in whid" in err
    log = Path(err.strip().rpartition(" ")[2])
    assert "Traceback" in log.read_text()
    log.unlink()
    monkeypatch.setenv("WHID_DEBUG", "1")
    assert end(ZeroDivisionError())[2] == ""  # it is raised as it is


@pytest.mark.skipif(os.name == "nt", reason="pipes end otherwise there")
def test_a_pipe_that_is_closed_early_is_quiet():
    done = subprocess.run(
        f"{sys.executable} -m whid schema | head -c 10", shell=True, capture_output=True, text=True, cwd=ROOT.parent
    )
    assert (done.stdout, done.stderr) == ('{\n  "$sche', "")


def raised_codes():
    for path in ROOT.rglob("*.py"):
        for code in re.findall(r'(?:WhidError|Failure)\(\s*"([a-z-]+)"', path.read_text("utf-8")):
            yield code, path.name


def test_every_code_that_is_raised_is_explained_and_every_explained_one_is_raised():
    raised = dict(raised_codes())
    assert set(raised) <= set(CATALOGUE), {code: where for code, where in raised.items() if code not in CATALOGUE}
    assert set(CATALOGUE) <= set(raised)


def test_an_explanation_is_whole():
    for code, (meaning, remedy, exit_code) in CATALOGUE.items():
        assert meaning.endswith("."), code
        assert remedy.endswith("."), code
        assert exit_code in (CONFIG, FAILED, 4, 5, 130), code


def test_no_code_stands_twice():
    texts = [path.read_text("utf-8") for path in (ROOT / "errors").glob("*.py")]
    found = re.findall(r'^    "([a-z-]+)": Explanation', "\n".join(texts), re.MULTILINE)
    assert len(found) == len(set(found)) == len(CATALOGUE)


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_a_scheduler_that_ends_the_job_is_an_interruption(name):
    number = getattr(signal, name)
    before = signal.signal(number, signal.SIG_DFL)
    try:
        code, _, err = end(None, returned=lambda: os.kill(os.getpid(), number))
    finally:
        signal.signal(number, before)
    assert (code, err.strip()) == (130, "interrupted")
