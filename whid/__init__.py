"""whid identifies block-oriented nonlinear systems from experiments that one YAML file declares.

study.yaml ─► plant + experiment ─► simulate ─┐
                                              ├─► Record ─► method (stages) ─► Model ─► residual ─► score
          └─► data file ──────────► ingest  ──┘   (u, y, dt, parts …)
                                                        HDF5 result + summary table + plots

From Python: `whid.run("study.yaml", overrides={"seed": 2})` → Result, `whid.load("runs/…")` → Result; a result has
`records`, `stages`, `model`, `metrics`, `residuals`, `tables`, `path`. `whid.flow.trace("study.yaml")` closes the loop.
"""

from __future__ import annotations

from typing import Any

__version__ = "0.1.0"
__all__ = ["__version__", "load", "run"]


def __getattr__(name: str) -> Any:
    if name in ("run", "load"):  # imported when used: `whid --help` must not wait for scipy
        from whid import flow  # not run.py: importing such a module would replace the function `whid.run`

        return getattr(flow, name)
    raise AttributeError(f"module 'whid' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), "load", "run"])
