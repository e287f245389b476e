"""The page and the picture of a calibration: outcomes against size, effect by effect, with binomial intervals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from tests.closed_loop.score import OUTCOMES, interval


class Rowlike(Protocol):
    """What a row of the calibration has to have."""

    group: str
    hidden: str
    size: float
    outcome: str
    said: str
    over: float
    seconds: float
    random: bool


def counts(rows: Iterable[Rowlike]) -> dict[str, int]:
    """Return how often each outcome occurred; cells whose effect no plant can show do not count."""
    found = Counter(row.outcome for row in rows)
    return {outcome: found[outcome] for outcome in OUTCOMES}


def share(hits: int, of: int) -> str:
    """Return a share with its interval, in per cent."""
    if not of:
        return "none"
    low, high = interval(hits, of)
    return f"{hits}/{of} = {100 * hits / of:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"


def page(rows: Sequence[Rowlike], title: str) -> str:
    """Return the whole page."""
    lines = [f"# {title}", ""]
    shown = [row for row in rows if row.outcome != "not visible"]
    controls = [row for row in shown if row.group == "control"]
    if controls:
        false = sum(row.outcome != "right" for row in controls)
        lines += [f"False alarms on records with nothing hidden: {share(false, len(controls))}", ""]
    for group, words in (("one", "One hidden effect"), ("two", "Two hidden effects"), ("outside", "Outside the library")):
        some = [row for row in shown if row.group == group]
        if some:
            lines += [f"## {words}", "", *_matrix(some), ""]
    one = [row for row in shown if row.group == "one"]
    if one:
        lines += ["## Effect by effect", "", *_by_effect(one), ""]
        lines += ["## After-error over the noise, right answers, deterministic effects", "", *_after(one), ""]
    mistakes = [row for row in shown if row.outcome not in ("right", "equivalent")]
    if mistakes:
        lines += ["## Said instead", "", "| hidden | size | said | outcome | times |", "|---|---|---|---|---|"]
        told = Counter((row.hidden or "nothing", row.size, row.said, row.outcome) for row in mistakes)
        lines += [f"| {h} | {s:g} | {said} | {o} | {n} |" for (h, s, said, o), n in sorted(told.items())]
    seconds = np.array([row.seconds for row in shown if np.isfinite(row.seconds)])
    if len(seconds):
        lines += ["", f"Seconds a record: median {np.median(seconds):.1f}, 95th percentile {np.percentile(seconds, 95):.1f}"]
    gone = sum(row.outcome == "not visible" for row in rows)
    if gone:
        lines += ["", f"{gone} cells left out: none of their plants can show the effect at the size"]
    return "\n".join(lines) + "\n"


def _matrix(rows: Sequence[Rowlike]) -> list[str]:
    lines = ["| size | " + " | ".join(OUTCOMES) + " | right, 95 % interval | right or equivalent |"]
    lines.append("|---" * (len(OUTCOMES) + 3) + "|")
    for size in sorted({row.size for row in rows}):
        found = counts(row for row in rows if row.size == size)
        of = sum(found.values())
        both = found["right"] + found["equivalent"]
        numbers = " | ".join(str(n) for n in found.values())
        lines.append(f"| {size:g} | {numbers} | {share(found['right'], of)} | {share(both, of)} |")
    return lines


def _by_effect(rows: Sequence[Rowlike]) -> list[str]:
    sizes = sorted({row.size for row in rows})
    lines = ["| effect | " + " | ".join(f"{size:g}" for size in sizes) + " |", "|---" * (len(sizes) + 1) + "|"]
    for name in dict.fromkeys(row.hidden for row in rows):
        cells = []
        for size in sizes:
            found = counts(row for row in rows if row.hidden == name and row.size == size)
            cells.append(f"{found['right']} + {found['equivalent']} of {sum(found.values())}")
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return [*lines, "", "right + equivalent"]


def _after(rows: Sequence[Rowlike]) -> list[str]:
    lines = ["| size | median | 95th percentile | n |", "|---|---|---|---|"]
    for size in sorted({row.size for row in rows}):
        over = [r.over for r in rows if r.size == size and r.outcome in ("right", "equivalent") and not r.random]
        over = [x for x in over if np.isfinite(x)]
        if over:
            lines.append(f"| {size:g} | {np.median(over):.4f} | {np.percentile(over, 95):.4f} | {len(over)} |")
    return lines


def picture(rows: Sequence[Rowlike], path: Path, title: str) -> None:
    """Draw the confusion matrix: hidden against said, one panel a size, shares of a row as shades, counts as numbers."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    shown = [row for row in rows if row.outcome != "not visible" and row.group in ("control", "one", "outside")]
    sizes = sorted({row.size for row in shown if row.group == "one"})
    if not sizes:
        return
    hidden = list(
        dict.fromkeys(_truth(row) for row in sorted(shown, key=lambda r: ("one", "outside", "control").index(r.group)))
    )
    said = [*dict.fromkeys(name for name in hidden if "@outside" not in name and name != "nothing")]
    said += ["other", "several", "unattributed", "nothing"]
    figure, axes = plt.subplots(
        1, len(sizes), figsize=(2.5 + 4.6 * len(sizes), 2.2 + 0.19 * len(hidden)), sharey=True, squeeze=False
    )
    for ax, size in zip(axes[0], sizes, strict=True):
        table = np.zeros((len(hidden), len(said)))
        for row in shown:
            if row.size == size or row.group == "control":
                table[hidden.index(_truth(row)), said.index(_column(row, said))] += 1
        total = np.maximum(table.sum(axis=1, keepdims=True), 1)
        ax.imshow(np.where(table > 0, table / total, np.nan), cmap="Blues", vmin=0, vmax=1, aspect="auto")
        for i, j in np.argwhere(table > 0):
            ink = "white" if table[i, j] > 0.6 * total[i, 0] else "black"
            ax.text(j, i, int(table[i, j]), ha="center", va="center", fontsize=5.5, color=ink)
        ax.set_xticks(range(len(said)), said, rotation=90, fontsize=6)
        ax.set_yticks(range(len(hidden)), hidden, fontsize=6)
        ax.set_xticks(np.arange(-0.5, len(said)), minor=True)
        ax.set_yticks(np.arange(-0.5, len(hidden)), minor=True)
        ax.grid(which="minor", color="0.9", linewidth=0.4)
        ax.tick_params(which="both", length=0)
        ax.set_title(f"visible at {size:g} × the noise", fontsize=8)
    axes[0][0].set_ylabel("hidden", fontsize=8)
    figure.supxlabel("said", fontsize=8)
    figure.suptitle(title, fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=130)
    plt.close(figure)


def _truth(row: Rowlike) -> str:
    return row.hidden.partition("/")[0] or "nothing"


def _column(row: Rowlike, said: Sequence[str]) -> str:
    if row.outcome == "right" and row.group == "one":
        return _truth(row)
    told = {"nothing missing": "nothing", "": "other"}.get(row.said, row.said)
    return told if told in said else "several" if "+" in told else "other"
