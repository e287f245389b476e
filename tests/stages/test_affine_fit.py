"""The joint problem of levels and harmonics: its tangents, and that it finds what made the data."""

from itertools import pairwise

import numpy as np
import pytest

from tests.brouri2014 import F2, H2, response
from whid.stages._affine_fit import Affine, AffineFit, Levels, Tones, real_roots
from whid.stages.input_pieces import Choice, input_pieces
from whid.stages.taylor import taylor


def problem():
    rng = np.random.default_rng(0)
    levels = Levels(np.linspace(-2, 2, 20), rng.normal(size=20), np.ones(20), np.repeat([0, 1, 2, 1], 5))
    tones = Tones(
        np.array([1.0, 2.0, 1.0]), np.array([0.1, 0.2, -1.0]), np.array([0.3, 0.4j, 0.2 + 0.1j]),
        rng.normal(size=(3, 4)) + 1j * rng.normal(size=(3, 4)), np.ones((3, 4)), np.array([1, 1, 0]),
    )  # fmt: skip
    pieces = {0: Affine(-1.0, 0.3, -0.7, False), 1: Affine(0.0, 0, 1, False), 2: Affine(2.0, 1.4, 0, True)}
    return AffineFit(levels, tones, np.array([0.1, 1, 0.3, 0.2]), pieces, 1, {1.0: 0.5 - 0.2j, 2.0: 0.3 - 0.6j})


def test_tangents_are_differences():
    fit = problem()
    theta = np.array([p.value for p in fit.parameters])
    tangent = fit.linearised(theta)[1]
    steps = 1e-6 * np.eye(len(theta))
    numeric = np.column_stack([(fit.linearised(theta + d)[0] - fit.linearised(theta - d)[0]) / 2e-6 for d in steps])
    assert np.abs(numeric - tangent).max() < 1e-8
    assert [p.name for p in fit.parameters][4:8] == ["h.0.value", "h.0.slope", "h.2.value", "g.0.log_gain"]


def noise_free(std=1e-4):
    """Levels and settled harmonics of A2 from formulas, in the scaling of the plant; errors as if σ were std."""
    edges = np.array([-3.0, *H2.breaks, 3.0])
    level = np.concatenate([np.linspace(a + 0.02, b - 0.02, 10) for a, b in pairwise(edges)])
    piece = np.searchsorted(H2.breaks, level)
    levels = Levels(level, F2.value(1.2 * H2.value(level)), np.full(len(level), std), piece)
    sines = [(w, 0.995, 0.4, 3) for w in (0.3, 0.6, 1.2, 2.4)] + [(0.3, -1.15, 0.6, 1), (0.3, 1.9, 0.4, 4)]
    turn = np.exp(2j * np.pi * np.arange(64) / 64)
    values = []
    for w, offset, amplitude, number in sines:
        x = 1.2 * H2.value(np.array([offset]))[0] + (response("A2", w) * H2.pieces[number][1] * amplitude * turn).real
        spectrum = np.fft.rfft(F2.value(x))[:4] / 32
        spectrum[0] /= 2
        values.append(spectrum)
    omega, offset, amplitude, on = (np.array(c) for c in zip(*sines, strict=True))
    tones = Tones(omega, offset, amplitude.astype(complex), np.array(values), np.full((6, 4), std), on)
    return levels, tones, np.column_stack([edges[1:-1] - 0.02, edges[1:-1] + 0.02])


def test_every_piece_of_a2_is_found_from_one():
    """Jumps, a falling piece, a piece over both turns of f: exact where the data are."""
    levels, tones, borders = noise_free()
    here, own = levels.piece == 3, tones.of(tones.piece == 3)
    phases = [np.array([np.angle(response("A2", w))]) for w in own.omega]
    series, fit = taylor(Levels(*(each[here] for each in levels)), own, 3, phases)
    true = response("A2", own.omega) / 1.2
    assert np.abs(series.gain * np.exp(1j * series.phase) - true).max() < 1e-6
    pieces, _ = input_pieces(fit, Choice(levels, tones, np.array([True, False, True, False, False, True]), borders))
    middle = H2.value(np.array([pieces.centre[3]]))[0]
    assert pieces.slope == pytest.approx([0, 0.8, 0, 1, -0.5, 0], abs=1e-6)
    assert pieces.value == pytest.approx(H2.value(pieces.centre) - middle, abs=1e-6)
    assert pieces.jump.all()
    assert pieces.resolved.all()
    assert not len(pieces.ambiguous)
    assert "slope 1" in pieces.table().notes[0]


def test_two_roots_leave_a_flat_piece_ambiguous_and_a_forced_value_decides():
    """f = x³ − x has three x for one level; with jumps on both sides nothing else tells them apart."""
    c = np.array([0.0, -1.0, 0.0, 1.0])
    flat, line = np.linspace(-0.5, 0.45, 8), np.linspace(0.5, 1.7, 12)
    y = np.append(np.full(8, 0.1), np.polynomial.polynomial.polyval(line, c))
    levels = Levels(np.append(flat, line), y, np.full(20, 1e-3), np.repeat([0, 1], [8, 12]))
    g, turn = 0.6 - 0.3j, np.exp(2j * np.pi * np.arange(64) / 64)
    value = np.fft.rfft(np.polynomial.polynomial.polyval(1.1 + (0.4 * g * turn).real, c))[:4] / 32
    value[0] /= 2
    tones = Tones(np.array([1.0]), np.array([1.1]), np.array([0.4 + 0j]), value[None], np.full((1, 4), 1e-3), np.array([1]))
    right = levels.piece == 1
    _, fit = taylor(Levels(*(each[right] for each in levels)), tones, 3, [np.array([np.angle(g)])])
    choice = Choice(levels, tones, np.array([True, False]), np.array([[0.45, 0.5]]))
    pieces, _ = input_pieces(fit, choice)
    assert pieces.ambiguous.tolist() == [0]
    found = np.sort(np.append(pieces.rivals[0][np.isfinite(pieces.rivals[0])], pieces.value[0])) + 1.1
    assert found == pytest.approx(real_roots(c - np.array([0.1, 0, 0, 0])), abs=1e-3)
    assert any("square wave" in said for said in pieces.unknown())
    decided, _ = input_pieces(fit, choice, {0: (float(found[0]) - 1.1, 0.0)})
    assert decided.value[0] == pytest.approx(found[0] - 1.1, abs=1e-3)
    assert not len(decided.ambiguous)
