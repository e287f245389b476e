"""Figures 1.3 and 4.1-4.6 of [Brouri2019] as `whid table` makes them."""

from pathlib import Path

import numpy as np
import pytest

from whid.blocks.piecewise import Piecewise
from whid.config.load import load_study
from whid.papers.brouri2019_figure_1_3 import GIBBS, decomposed
from whid.quantity import Measured
from whid.regenerate import bench_of

CONFIG = Path(__file__).parents[2] / "configs" / "brouri2019" / "figures.yaml"


def made(number):
    study = load_study(CONFIG)
    exhibit = next(one for one in study.table if one.kind == f"brouri2019_figure_{number}")
    found = exhibit(bench_of(study, CONFIG.parent, exhibit, False, lambda *_: None))
    return found, {row.quantity: row for row in found.rows}


def drawn(found, tmp_path):
    from whid.plots._style import save

    save(lambda _, figure: found.draw(figure), None, tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 10_000


def near(cell, true, sigma=4.5):
    assert isinstance(cell, Measured)
    assert abs(cell.value - true) < sigma * cell.std


def test_a_series_of_a_sign_is_the_one_in_the_books():
    """sign v = (4/π) Σ (−1)^m T_{2m+1}(v)/(2m + 1)."""
    sign = Piecewise(breaks=(0.0,), pieces=((-1.0,), (1.0,)))
    expected = np.zeros(22)
    m = np.arange(11)
    expected[1::2] = 4 / np.pi * (-1.0) ** m / (2 * m + 1)
    np.testing.assert_allclose(decomposed(sign, 21, (-1.0, 1.0)), expected, atol=1e-13)


def test_a_polynomial_is_its_own_series():
    f = Piecewise(breaks=(0.5,), pieces=((1.0, -2.0, 3.0), (1.0, -2.0, 3.0)))
    own = np.polynomial.Polynomial([1.0, -2.0, 3.0]).convert(kind=np.polynomial.Chebyshev, domain=[-1.0, 4.0])
    np.testing.assert_allclose(decomposed(f, 5, (-1.0, 4.0)), np.pad(own.coef, (0, 3)), atol=1e-12)


def test_figure_1_3_rings_by_the_constant_of_gibbs(tmp_path):
    found, rows = made("1_3")
    assert rows["overshoot over the jump at -0.8, degree 320"].paper == pytest.approx(GIBBS, rel=0.02)
    rms = [row.paper for name, row in rows.items() if name.startswith("rms")]
    assert rms[-1] / rms[-3] == pytest.approx(0.5, rel=0.05)  # 1/√degree
    drawn(found, tmp_path)


def test_figure_4_4_and_the_cubic(tmp_path):
    found, rows = made("4_4")
    assert [bar.verdict for bar in found.bars] == ["pass"]
    for k, printed in enumerate((-24.8, 0.02, 31.24, -0.003)):
        row = rows[f"c{k} of (4.2a)"]
        assert row.published == printed
        near(row.paper, row.bound)
        if k < 3:
            near(row.efficient, row.bound)
            assert row.efficient.std < 0.2 * row.paper.std
    drawn(found, tmp_path)


def test_figure_4_6(tmp_path):
    found, rows = made("4_6")
    near(rows["mean"].paper, rows["mean"].bound)
    for k in (1, 2):
        near(rows[f"amplitude of harmonic {k}"].paper, rows[f"amplitude of harmonic {k}"].bound)
    assert rows["amplitude of harmonic 3"].bound == 0
    near(rows["mean square of estimate minus x, over noise variance/periods"].paper, 1)
    drawn(found, tmp_path)


@pytest.mark.slow
def test_figures_4_1_and_4_3(tmp_path):
    found, rows = made("4_1")
    for name, row in rows.items():
        if row.bound:
            near(row.efficient, row.bound)
        else:
            assert (name, row.efficient) == ("jump at break 1", "none: a kink")
    drawn(found, tmp_path)
    found, rows = made("4_3")
    assert rows["levels of the control sequence"].paper == 16
    near(rows["noise, std"].paper, 0.5)
    near(rows["chi-square of the estimates of x, a level"].paper, 1)
    drawn(found, tmp_path)
