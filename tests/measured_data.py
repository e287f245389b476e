"""Measured records, which are not part of the project: what needs one is skipped, saying so, where they are absent."""

import os
from pathlib import Path

import pytest

from whid.config.load import load_study

ROOT = Path(__file__).parents[1]
CONFIGS = ROOT / "configs" / "measured"
DATA = Path(os.environ.get("WHID_DATA", ROOT / ".." / "shared" / "data"))


def measured(file):
    """Return the path of a file."""
    if not (DATA / file).is_file():
        pytest.skip(f"{file} is not in $WHID_DATA (nor in ../shared/data)")
    return DATA / file


def measured_study(name):
    """Return a study of `configs/measured` whose files are all there."""
    study = load_study(CONFIGS / f"{name}.yaml")
    for source in study.sources:
        measured(source.file)
    return study
