"""Pictures of a run, one file each: `NEEDS`, what must be there, and `draw(run, figure)`. The folder is the registry.

A picture whose needs are absent is not drawn; one that fails costs the run nothing but a warning.
"""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path
from typing import Any


def draw(run: Any, folder: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Draw every picture that a run has the data for; return the file names, and warnings for those that failed."""
    drawn, faults = [], []
    for name in sorted(m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_")):
        try:
            picture = importlib.import_module(f"{__name__}.{name}")
            if hasattr(picture, "NEEDS") and all(has(run, need) for need in picture.NEEDS):
                from whid.plots._style import save

                save(picture.draw, run, folder / f"{name}.png")
                drawn.append(f"{name}.png")
        except Exception as fault:  # whatever a picture dies of, the result is worth more
            faults.append(f"picture {name} not drawn: {type(fault).__name__}: {fault}")
    return tuple(drawn), tuple(faults)


def has(run: Any, need: str) -> bool:
    """Tell whether a run has a stage, its truth, residuals, linear blocks in its model, or parts of a kind ("sine").

    A sweep has `swept`, numbers that were varied, and nothing else.
    """
    if need == "swept" or not hasattr(run, "stages"):
        return need == "swept" and len(getattr(run, "swept", ())) > 0
    if need == "linear":
        return "model" in run.stages and any(hasattr(block, "gain_at") for block in run.stages["model"].system.series)
    if need in ("truth", "residuals"):
        value = getattr(run, need)
        return value is not None and len(value) > 0 if need == "residuals" else value is not None
    return need in run.stages or any(part.kind == need for record in run.records for part in record.parts)
