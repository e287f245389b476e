"""What counts as right, equivalent, wrong, abstained, missed."""

import pytest

from tests.closed_loop.score import interval, score


def truth(*effects, outside=False, alike=()):
    hidden = [dict(zip(("kind", "place"), e.split("@"), strict=True)) | {"alike": list(alike)} for e in effects]
    return {"effects": hidden, "outside": outside, "report_noise_rms": 2.0}


def answer(verdict, *effects, equivalent=()):
    named = [dict(zip(("kind", "place"), e.split("@"), strict=True)) for e in effects]
    others = [e.split("@") for e in equivalent]
    return {"verdict": verdict, "effects": named, "equivalent": others, "after": {"rms": 3.0}, "seconds": 1.5}


LAG, BOTH = truth("lag@front"), truth("lag@front", "hum@output")
CASES = [
    (truth(), answer("nothing missing"), "right"),
    (truth(), answer("unattributed"), "wrong"),
    (truth(), answer("explained", "hum@output"), "wrong"),
    (LAG, answer("explained", "lag@front"), "right"),
    (LAG, answer("explained", "lag@back"), "wrong"),
    (truth("lag@front", alike=("back",)), answer("explained", "lag@back"), "right"),
    (LAG, answer("explained", "lag@front", "hum@output"), "wrong"),
    (LAG, answer("ambiguous", "delay@time", equivalent=["lag@front"]), "equivalent"),
    (LAG, answer("ambiguous", "lag@front", equivalent=["delay@time", "lag@back"]), "equivalent"),
    (LAG, answer("ambiguous", "lag@front", equivalent=["delay@time", "lag@back", "resonance@front"]), "abstained"),
    (LAG, answer("ambiguous", "delay@time", equivalent=["lag@back"]), "wrong"),
    (LAG, answer("unattributed"), "abstained"),
    (LAG, answer("nothing missing"), "missed"),
    (LAG, None, "failed"),
    (truth("lag@front", "hum@output"), answer("explained", "hum@output", "lag@front"), "right"),
    (truth("lag@front", "hum@output"), answer("explained", "hum@output"), "wrong"),
    (
        truth("lag@front", "hum@output"),
        answer("ambiguous", "hum@output", "delay@time", equivalent=["lag@front"]),
        "equivalent",
    ),
    (truth("bouc_wen@outside", outside=True), answer("unattributed"), "right"),
    (truth("bouc_wen@outside", outside=True), answer("explained", "backlash@input"), "wrong"),
    (truth("bouc_wen@outside", outside=True), answer("nothing missing"), "missed"),
]


@pytest.mark.parametrize(("hidden", "said", "outcome"), CASES)
def test_outcome(hidden, said, outcome):
    assert score(hidden, said).outcome == outcome


def test_the_after_error_is_over_the_noise_that_is_there():
    found = score(LAG, answer("explained", "lag@front"))
    assert (found.over, found.seconds, found.said) == (1.5, 1.5, "lag@front")


def test_interval_is_clopper_pearson():
    """0 of n: the upper end solves (1 − p)ⁿ = 0.025."""
    assert interval(0, 30) == (0.0, pytest.approx(1 - 0.025 ** (1 / 30)))
    assert interval(30, 30)[1] == 1.0
