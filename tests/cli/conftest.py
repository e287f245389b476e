import pytest
from click.testing import CliRunner

from whid.cli import main


@pytest.fixture
def whid(tmp_path, monkeypatch):
    """Run a command line as a user would, in an empty folder: whid("check", "study.yaml") → result."""
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(main, [str(argument) for argument in arguments])
