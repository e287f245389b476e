"""What a run asked for and nobody measured, as YAML to take to the rig."""

from __future__ import annotations

from whid.config.yaml import dump
from whid.errors import WhidError
from whid.result import Result


def next_plan(result: Result) -> str:
    """Return the experiments that a run asked for in vain: what goes under `experiment:` of a study, reasons in comments.

    The parts are in the words of every config, so they can be simulated as they are; run on a rig and appended to the
    records, they are declared (or found by `parts: auto`) like all others. Raises `WhidError("next-nothing")` where
    nothing was asked for that was not performed.
    """
    wanted = [asked for asked in result.asked if asked.refused]
    if not wanted:
        why = "it asked for nothing" if not result.asked else "everything it asked for was performed"
        raise WhidError("next-nothing", f"this run needs no experiment that its method could name: {why}", result.name)
    dt = result.records[0].dt
    seconds = sum(asked.samples for asked in wanted) * dt
    parts = sum(len(asked.plan) for asked in wanted)
    lines = [f"# what {result.name} asked for: {parts} part{'s' * (parts > 1)}, {seconds:.6g} s in all"]
    lines += ["experiment:", f"  dt: {dt!r}", f"  intersample: {result.records[0].intersample}", "  parts:"]
    for number, asked in enumerate(wanted, 1):
        of = f" of {asked.of}" if asked.of else ""
        lines += [f"    # {number}. {asked.reason}", f"    #    predicted standard error{of}: {asked.predicted_se:.3g}"]
        for part in asked.plan:
            lines += [f"    {line}" for line in dump([part]).splitlines()]
    return "\n".join(lines) + "\n"
