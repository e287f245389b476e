"""The study that `whid init` writes: configs/starter.yaml."""

from __future__ import annotations

from pathlib import Path

from whid.files.text import read_text


def starter() -> str:
    """Return the commented starter study; an installed whid has it beside this file, a checkout under configs/."""
    here = Path(__file__)
    places = (here.with_name("starter.yaml"), here.parents[2] / "configs" / "starter.yaml")
    return read_text(next((place for place in places if place.is_file()), places[0]))
