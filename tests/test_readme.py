"""The README's example is run as it stands: every `$ whid …` line, against the output printed below it."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"```console\n\$ (whid .+)\n((?:.*\n)*?)```", README)
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[+-]?\d+)?")


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    """What a reader has: the configs; results go to a `runs` of their own."""
    folder = tmp_path_factory.mktemp("readme")
    shutil.copytree(ROOT / "configs", folder / "configs")
    return folder


def alike(printed, line):
    """Compare words exactly and numbers to 2 % (a library's rounding); … stands for the rest of a line."""
    if printed.endswith("…"):
        printed = printed[:-1].rstrip(" ,")
        return alike_words(printed, " ".join(line.split()[: len(printed.split())]).rstrip(","))
    return alike_words(printed, line)


def alike_words(printed, line):
    words = [re.sub(r"─+", "─", re.sub(r"\s+", " ", NUMBER.sub("#", text))).strip() for text in (printed, line)]
    numbers = [[float(x) for x in NUMBER.findall(text)] for text in (printed, line)]
    return words[0] == words[1] and numbers[0] == pytest.approx(numbers[1], rel=0.02, abs=1e-3)


@pytest.mark.parametrize(("command", "output"), BLOCKS, ids=[command.split()[1] for command, _ in BLOCKS])
def test_console_block(command, output, clone):
    words = [sys.executable, "-m", *shlex.split(command)]
    run = subprocess.run(words, cwd=clone, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    lines = iter(run.stdout.splitlines())
    for printed in output.splitlines():
        if printed != "…":
            assert any(alike(printed, line) for line in lines), f"not in the output, in this order: {printed}"


def test_there_are_console_blocks_for_the_whole_way():
    assert [command.split()[1] for command, _ in BLOCKS] == ["ingest", "check", "run"]


def test_the_yaml_of_the_readme_is_the_shipped_study():
    from whid.config.load import load_study

    block = re.search(r"```yaml\n(.*?)```", README, re.DOTALL)
    folder = ROOT / "configs" / "example"
    printed = folder / "never-written.yaml"
    from whid.config.load import study_of
    from whid.config.yaml import parse

    assert study_of(parse(block[1], str(printed))) == load_study(folder / "bench.yaml")


def test_python_block(clone, monkeypatch, capsys):
    monkeypatch.chdir(clone)
    exec(re.search(r"```python\n(.*?)```", README, re.DOTALL)[1], {})
    assert "report" not in capsys.readouterr().err


def test_links_and_pictures_exist():
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert (ROOT / target).exists(), target
