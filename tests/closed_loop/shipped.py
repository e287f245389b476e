"""The studies in configs/closed_loop/, made once from development seeds: `python -m tests.closed_loop.shipped`.

Each is a record in which something may be hidden and the study a user would write for it. What is hidden stands in
tests/closed_loop/truth/, which only the scoring reads.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from tests.closed_loop.case import draw_case, write

HERE = Path(__file__).parent
CONFIGS = HERE.parents[1] / "configs" / "closed_loop"
TRUTH = HERE / "truth"
HEADER = """# yaml-language-server: $schema=../whid.schema.json
# A record of a rig, and what its user believes of it, roughly. Is anything missing?
#
#   whid trace configs/closed_loop/{name}.yaml
#
# (made by tests/closed_loop/shipped.py; what is really hidden stands in tests/closed_loop/truth/, for the scoring alone)
"""


class Shipped(NamedTuple):
    """What one of them is drawn from."""

    seed: int
    family: str
    effects: tuple[str, ...]
    size: float
    coloured: bool = False


STUDIES = {
    "rig_01": Shipped(9101, "wiener_hammerstein", ("dead_zone@input",), 0.5),
    "rig_02": Shipped(9102, "hammerstein", ("backlash@output",), 1.0),
    "rig_03": Shipped(9103, "wiener", ("lag@front",), 0.5),
    "rig_04": Shipped(9104, "linear", ("curve@input",), 3.0),
    "rig_05": Shipped(9105, "wiener_hammerstein", (), 0.0),
    "rig_06": Shipped(9106, "hammerstein_wiener", ("hum@output",), 0.5),
    "rig_07": Shipped(9107, "memoryless", ("gain_drift@output",), 0.5),
    "rig_08": Shipped(9108, "linear", ("amplitude_pole@outside",), 3.0),
    "rig_09": Shipped(9109, "wiener_hammerstein", ("soft_knee@nonlinearity",), 1.0),
    "rig_10": Shipped(9110, "hammerstein", ("feedback_dynamic@loop",), 1.0),
    "rig_11": Shipped(9111, "wiener", ("process_noise@noise",), 1.0),
    "rig_12": Shipped(9112, "linear", ("friction@parallel",), 0.5),
    "rig_13": Shipped(9113, "wiener_hammerstein", ("saturation@output", "hum@output"), 1.0),
    "rig_14": Shipped(9114, "wiener", ("intersample@time",), 1.0),
    "rig_15": Shipped(9115, "hammerstein", ("quantizer@output",), 1.0),
    "rig_16": Shipped(9116, "linear", ("clock_skew@time",), 1.0),
    "rig_17": Shipped(9117, "hammerstein", (), 0.0, coloured=True),
    "rig_18": Shipped(9118, "linear", ("backlash@input", "drift@output/ramp"), 1.0),
    "rig_19": Shipped(9119, "wiener_hammerstein", ("bouc_wen@outside",), 3.0),
    "rig_20": Shipped(9120, "backlash", ("offset_step@output",), 0.5),
    "rig_21": Shipped(9121, "hammerstein", ("outliers@output",), 1.0),
}


def make(name: str, folder: Path, truth: Path) -> Path:
    """Write one of them; return the study's path."""
    chosen = STUDIES[name]
    case = draw_case(chosen.seed, chosen.effects, chosen.size, family=chosen.family, coloured=chosen.coloured)
    study = {**case.study, "name": name, "data": {**case.study["data"], "file": f"{name}.npz"}}
    path = write(case._replace(name=name, study=study, truth={**case.truth, "name": name}), folder, truth)
    path.write_text(HEADER.format(name=name) + path.read_text())
    return path


if __name__ == "__main__":
    for each in STUDIES:
        print(make(each, CONFIGS, TRUTH).name)
