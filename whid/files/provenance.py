"""Where numbers come from: the config's text, the data's digests, the versions, and one hash of all that decides them."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from whid import __version__

RESULTS_VERSION = 3  # bumped when the same study gives other numbers
SCHEMA_VERSION = 4  # bumped when a study or a result file is written differently


def provenance(config: str, data: Sequence[Path]) -> dict[str, Any]:
    """Return the hash of (config, data, versions that change numbers), and beside it what else one may want to know."""
    digests = tuple(sha256(path) for path in data)
    decides = json.dumps([config, digests, SCHEMA_VERSION, RESULTS_VERSION])
    return {
        "hash": hashlib.sha256(decides.encode()).hexdigest(),
        "config": config,
        "data": tuple(path.name for path in data),
        "data_sha256": digests,
        "schema_version": SCHEMA_VERSION,
        "results_version": RESULTS_VERSION,
        "whid": __version__,
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in ("numpy", "scipy", "h5py")},
    }


def sha256(path: Path) -> str:
    """Return the digest of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
