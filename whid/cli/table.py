"""Make tables and figures of the papers anew, and compare them with what was expected."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from whid.regenerate import Tables


@click.command()
@click.argument("configs", nargs=-1, metavar="CONFIG…", type=click.Path(path_type=Path))
@click.option("--all", "everything", is_flag=True, help="Every config with a `table:` below the given folders, or configs.")
@click.option("--full", is_flag=True, help="With the bars' own counts: minutes to hours.")
@click.option("--check", is_flag=True, help="Compare with the .expected.csv beside each config.")
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("runs"), show_default=True, help="Where the folders go."
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of tables.")
def command(configs: tuple[Path, ...], everything: bool, full: bool, check: bool, out: Path, as_json: bool) -> int:
    """Make the tables and figures of CONFIG anew: text here; Markdown, CSV and pictures in a folder.

    Exit code 4 where a bar is breached or, with --check, a number is not as expected.

    Example: whid table configs/brouri2019/table-4-1.yaml; whid table --all --check
    """
    from whid.errors import WhidError
    from whid.regenerate import regenerate, with_tables

    if everything == bool(configs) and not everything:
        raise click.UsageError("give a CONFIG, or --all")
    if full and check:
        raise click.UsageError("--check compares the quick counts: leave --full out")
    paths = [path for root in configs or (Path("configs"),) for path in with_tables(root)] if everything else list(configs)
    codes, objects = [0], []
    for path in paths:
        try:
            found = regenerate(path, out, full=full, check=check, watch=_progress)
        except WhidError as fault:  # the other tables are still wanted
            if len(paths) == 1:
                raise
            click.echo(f"error[{fault.code}]: {fault}\ntry: {fault.remedy}", err=True)
            codes.append(fault.exit_code)
            continue
        codes.append(found.exit_code)
        objects.append(_object(path, found))
        if not as_json:
            _print(found)
    if as_json:
        from whid.cli._print import print_json

        print_json(objects)
    return max(codes, key=[0, 5, 4, 2, 3].index)


def _print(found: Tables) -> None:
    from whid.cli._print import print_tables
    from whid.regenerate import bars

    print_tables(*(one.table() for one in found.found.values()), *((bars(found.bars),) if found.bars else ()))
    print(f"\n{found.path}\n  {'  '.join(found.files)}")
    if found.drift is not None:
        print("as expected" if not found.drift else f"{len(found.drift)} numbers are not as expected")
    for line in (*found.warnings, *(found.drift or ())):
        click.echo(line, err=True)
    print()


def _object(path: Path, found: Tables) -> dict[str, Any]:
    return {
        "config": str(path),
        "path": str(found.path),
        "files": found.files,
        "tables": [one.table() for one in found.found.values()],
        "bars": [bar._asdict() | {"verdict": bar.verdict} for bar in found.bars],
        "drift": found.drift,
        "warnings": found.warnings,
        "exit_code": found.exit_code,
    }


def _progress(kind: str, done: int, of: int) -> None:
    if sys.stderr.isatty() and of > 1:
        print(f"\r{kind} {done}/{of}", end="\n" if done == of else "", file=sys.stderr, flush=True)
    elif of > 1 and 10 * done // of > 10 * (done - 1) // of:
        print(f"{kind} {done}/{of}", file=sys.stderr, flush=True)
