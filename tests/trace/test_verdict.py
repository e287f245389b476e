"""What a verdict warns of."""

import numpy as np
import pytest

from whid.trace import Errors, Found, Verdict

ERRORS = Errors(1.0, 0.9, 1.1, 0.1, 90.0, 1.0)


@pytest.mark.parametrize(("points", "on", "told"), [(4, "report", True), (2, "report", False), (4, "estimation", False)])
def test_a_course_through_points_does_not_predict_report_data(points, on, told):
    levels = {f"levels.{k}": float(k) for k in range(points)}
    drift = Found("drift", "output", levels, levels)
    verdict = Verdict(
        "explained", "explained", (drift,), (), (), on, ERRORS, ERRORS, 1.0, "measured", 0.0, 0.5, (), np.nan
    )  # fmt: skip
    said = [note for note in verdict.table().notes if "predicts nothing" in note]
    assert bool(said) is bool(verdict.doubts()) is told
