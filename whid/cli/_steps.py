"""Progress on stderr: one living line on a terminal, a line every few seconds elsewhere."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any, Self

SPARSE = 5.0  # seconds between lines where nobody watches


class Steps:
    """Called with every finished step and its seconds."""

    def __init__(self, quiet: bool = False) -> None:
        self.quiet = quiet
        self.started = self.shown = time.perf_counter()
        self.live: Any = None

    def __enter__(self) -> Self:
        if sys.stderr.isatty() and not self.quiet:
            from rich.console import Console

            self.live = Console(stderr=True).status("starting …")
            self.live.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None) -> None:
        if self.live:
            self.live.stop()

    @property
    def seconds(self) -> float:
        """Return the seconds since the start."""
        return time.perf_counter() - self.started

    def __call__(self, step: str, seconds: float) -> None:
        """Show a finished step."""
        if self.live:
            self.live.console.print(f"  {step}  {seconds:.2f} s", style="dim", highlight=False, markup=False)
            self.live.update(f"after {step} …")
        elif time.perf_counter() - self.shown > SPARSE and not self.quiet:
            self.shown = time.perf_counter()
            print(f"{self.seconds:6.1f} s  {step}", file=sys.stderr, flush=True)
