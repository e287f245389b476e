"""Print the JSON Schema of a config, for editors."""

from __future__ import annotations

import click


@click.command()
def command() -> None:
    """Print the JSON Schema of a config; editors use it to complete keys and to mark faults while you type.

    The first line of a config names it: # yaml-language-server: $schema=whid.schema.json

    Example: whid schema > whid.schema.json
    """
    from whid.cli._print import print_json
    from whid.config.schema import json_schema

    print_json(json_schema())
