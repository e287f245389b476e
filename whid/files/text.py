"""Small text files: configs in, configs out."""

from __future__ import annotations

from pathlib import Path

from whid.errors import WhidError

DATA = (".csv", ".tsv", ".gz", ".npz", ".mat", ".h5", ".hdf5", ".xlsx")
LIMIT = 1_000_000  # bytes; a config is written by people, data belong in data files


def read_text(path: str | Path) -> str:
    """Return a UTF-8 text file; raise `WhidError("config-file")` if it cannot be read, is no text, or is too long."""
    where = str(path)
    if "\n" in where:
        message = "this is the text of a config, not the path of one: give a mapping, `yaml.safe_load(text)`, or a file"
        raise WhidError("config-file", message, where.strip().partition("\n")[0][:40] + " …")
    if Path(path).suffix.lower() in DATA:
        raise WhidError(
            "config-file", f"a data file, no config: `whid ingest {path}` shows it, with a study to start from", where
        )
    try:
        with Path(path).open("rb") as file:
            data = file.read(LIMIT + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise WhidError("config-file", getattr(error, "strerror", None) or str(error), where) from None
    if len(data) > LIMIT:
        raise WhidError("config-file", f"longer than {LIMIT // 1_000_000} MB: this is not a config", where)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise WhidError("config-file", f"not UTF-8 text (byte {error.start})", where) from None


def write_new(path: str | Path, text: str) -> None:
    """Write a file that does not exist yet; raise `WhidError("file-exists")` rather than overwrite one."""
    try:
        with Path(path).open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise WhidError("file-exists", "exists already and is never overwritten", str(path)) from None
