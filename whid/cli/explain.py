"""Explain an error code: what it means, what to try."""

from __future__ import annotations

import difflib

import click

from whid.errors import CATALOGUE

EXIT_CODES = (
    (0, "done"),
    (1, "differs"),
    (2, "the config or the command line is at fault"),
    (3, "failed, or incomplete; what was finished is kept"),
    (4, "a bound of `expect:` is breached"),
    (5, "a metric of `expect:` was not measured"),
    (130, "interrupted; what was finished is kept"),
)


@click.command()
@click.argument("code", required=False)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def command(code: str | None, as_json: bool) -> None:
    """Explain an error CODE, as printed in error[CODE]; without one, list them all and the exit codes.

    Example: whid explain config-unknown
    """
    from whid.cli._print import print_json, print_tables
    from whid.quantity import Table

    if code is not None and code not in CATALOGUE:
        near = difflib.get_close_matches(code, CATALOGUE, n=1)
        raise click.BadParameter(f"there is no {code!r}{f', did you mean {near[0]}?' if near else ''}")
    chosen = CATALOGUE if code is None else {code: CATALOGUE[code]}
    rows = tuple((name, e.meaning, e.remedy, e.exit_code) for name, e in sorted(chosen.items()))
    tables = [Table("Errors" if code is None else "", ("code", "meaning", "try", "exit"), rows)]
    if code is None:
        tables.append(Table("Exit codes", ("exit", "meaning"), EXIT_CODES))
    if as_json:
        print_json(tables)
    elif code is None:
        print_tables(*tables)
    else:
        click.echo(f"{CATALOGUE[code].meaning}\ntry: {CATALOGUE[code].remedy}\nexit code: {CATALOGUE[code].exit_code}")
