"""Write a commented starter study."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("path", type=click.Path(path_type=Path), default=Path("study.yaml"))
def command(path: Path) -> None:
    """Write a commented starter study to PATH, and beside it the schema that editors use; nothing is overwritten.

    Example: whid init study.yaml && whid run study.yaml
    """
    import json

    from whid.config.schema import json_schema
    from whid.config.starter import starter
    from whid.files.text import write_new

    write_new(path, starter())
    schema = path.parent / "whid.schema.json"
    if not schema.exists():
        write_new(schema, json.dumps(json_schema(), indent=2, ensure_ascii=False) + "\n")
    click.echo(f"{path} is written. Next: whid check {path}, then whid run {path}")
