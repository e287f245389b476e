"""What a study's `data:` holds: which file, which columns, what is done to them, and what is believed about them."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Ge, Gt, MinLen

from whid.errors import WhidError
from whid.experiments._part import Part, Use
from whid.operations._operation import Operation
from whid.record import Initial, Intersample

Column = str | Annotated[int, Ge(0)]
Role = Literal["time", "input", "output"]


@dataclass(frozen=True, kw_only=True)
class Columns:
    """The columns of a file by name or 0-based number; those not given are guessed from the file's names."""

    time: Column | None = None
    input: Column | None = None
    output: Column | None = None


@dataclass(frozen=True, kw_only=True)
class DataSource:
    """A measured record in a file.

    file        relative to the config, then to $WHID_DATA (default ../shared/data)
    columns     time (or dt, or rate_hz), input, output
    units       of time (s unless the file says otherwise), input and output
    operations  applied in order, before parts are looked for; parts count samples after them
    intersample what the input does between samples: zoh, foh, bandlimited, discrete
    initial     the state before the first sample: steady (at u[0]), rest or free; left out, it is steady where u is at rest
                for its first samples, else free
    missing     what to do with missing samples: error, mask (y only: a fit skips them), interpolate
    causal      false: the output need not follow the input (an inverse model); the swap check is left out
    parts       what happens when, by samples; or auto: constant levels and sines found in u
    use         of parts found by auto, and of the whole record when it has no parts: estimation, selection, report
    delimiter, decimal, header_lines   of a text file; found from the file unless given
    """

    file: Annotated[str, MinLen(1)]
    columns: Columns = Columns()
    dt: Annotated[float, Gt(0)] | None = None
    rate_hz: Annotated[float, Gt(0)] | None = None
    units: dict[Role, str] = field(default_factory=dict)
    operations: tuple[Operation, ...] = ()
    intersample: Intersample = "zoh"
    initial: Initial | None = None
    missing: Literal["error", "mask", "interpolate"] = "error"
    causal: bool = True
    parts: tuple[Part, ...] | Literal["auto"] = ()
    use: Use = "estimation"
    name: str = "record"
    delimiter: Literal[",", ";", "tab", "space"] | None = None
    decimal: Literal[".", ","] | None = None
    header_lines: Annotated[int, Ge(0)] | None = None


def locate(file: str, base: Path) -> Path:
    """Return the path of a data file: absolute, beside the config, or under $WHID_DATA (default ../shared/data).

    Raises `WhidError("data-file")` where there is none.
    """
    data = Path(os.environ.get("WHID_DATA", "../shared/data"))
    places = [base / file, data / file]  # an absolute `file` wins over what it is joined to
    for place in places:
        if place.is_file():
            return place
    looked = f"no such file; looked for {' and '.join(dict.fromkeys(map(str, places)))}"
    folder = places[0].parent
    there = [item.name for item in folder.iterdir() if item.is_file()] if folder.is_dir() else []
    near = get_close_matches(places[0].name, there, n=1)
    raise WhidError("data-file", looked + (f"; did you mean {near[0]}?" if near else ""), file)
