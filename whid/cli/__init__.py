"""The `whid` command: one file a command, found by listing this folder; the only folder that talks to a terminal.

`check.py` holds `command`, the click command `check`; the first line of its docstring is its line in `whid --help`.
A command returns nothing (exit 0) or its exit code, and raises `WhidError` for everything that is the user's to mend.
"""

from __future__ import annotations

import ast
import importlib
import os
import pkgutil
import signal
import sys
import threading
import warnings
from pathlib import Path
from typing import Any, NoReturn

import click

from whid import __version__
from whid.errors import CONFIG, FAILED, Faults, WhidError

INTERRUPTED = 130


class Commands(click.Group):
    """A command table that imports a command only when it is called, and turns every fault into lines and a code."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the files that are commands."""
        return sorted(m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_"))

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Import one command."""
        if name not in self.list_commands(ctx):
            return None
        command: click.Command = importlib.import_module(f"whid.cli.{name}").command
        return command

    def resolve_command(self, ctx: click.Context, args: list[str]) -> tuple[str | None, click.Command | None, list[str]]:
        """Find a command; a fault names the nearest one."""
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            import difflib

            near = difflib.get_close_matches(args[0], self.list_commands(ctx), n=1)
            hint = f" Did you mean {near[0]!r}?" if near and "Did you mean" not in error.message else ""
            raise click.UsageError(error.message + hint, ctx) from None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands by their docstrings' first lines, read without importing them."""
        rows = [(name, _summary(name)) for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl(rows)

    def main(self, *args: Any, **extra: Any) -> NoReturn:
        """Run a command line and exit: the one place where faults become stderr lines and an exit code."""
        if not os.environ.get("WHID_DEBUG"):
            warnings.simplefilter("ignore")  # what numbers do on the way is said in whid's own words, or is of no interest
        for stream in (sys.stdout, sys.stderr):
            if hasattr(stream, "reconfigure"):
                stream.reconfigure(errors="replace")  # a terminal that has no ± must not end a run
        _heed_endings()
        try:
            code = super().main(*args, **extra | {"standalone_mode": False})
        except WhidError as error:
            code = _report(error)
        except click.Abort:  # Ctrl-C
            click.echo("interrupted", err=True)
            code = INTERRUPTED
        except click.ClickException as error:
            error.show()
            code = CONFIG
        except OSError as error:
            code = _report(WhidError("file-access", error.strerror or str(error), str(error.filename or "")))
        except Exception as error:
            if isinstance(error.__cause__, KeyboardInterrupt):  # while a class was made: Python 3.11 wraps it
                click.echo("interrupted", err=True)
                code = INTERRUPTED
            elif os.environ.get("WHID_DEBUG"):
                raise
            else:
                code = _bug(error)
        sys.exit(code if isinstance(code, int) else 0)


def _heed_endings() -> None:
    """Make the end that a job's scheduler or a closed terminal orders an interruption, which keeps what was finished."""
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # no SIGHUP on Windows
        if number and threading.current_thread() is threading.main_thread() and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, signal.default_int_handler)


def _summary(name: str) -> str:
    tree = ast.parse((Path(__path__[0]) / f"{name}.py").read_text(encoding="utf-8"))
    return (ast.get_docstring(tree) or "").partition("\n")[0].rstrip(".")


def _report(error: WhidError) -> int:
    """Print each fault, then what to try, once a code; return the exit code."""
    faults = error.faults if isinstance(error, Faults) else (error,)
    for fault in faults:
        click.echo(f"error[{fault.code}]: {fault}", err=True)
    for remedy in dict.fromkeys(fault.remedy for fault in faults):
        click.echo(f"try: {remedy}", err=True)
    return max(fault.exit_code for fault in faults)


def _bug(error: Exception) -> int:
    """Keep the traceback in a file, print one line."""
    import tempfile
    import traceback

    with tempfile.NamedTemporaryFile("w", prefix="whid-", suffix=".log", delete=False, encoding="utf-8") as log:
        traceback.print_exception(error, file=log)
    what = " ".join(str(error).split())[:200]
    click.echo(f"error[bug]: {type(error).__name__}: {what}: this is a bug in whid; the details are in {log.name}", err=True)
    return FAILED


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="whid")
def main() -> None:
    """Identify block-oriented nonlinear systems from a YAML study: simulated plants or measured data.

    Example: whid init study.yaml && whid run study.yaml
    """
