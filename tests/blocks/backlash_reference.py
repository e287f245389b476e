"""The first-contact rule, one sample after another: what the vectorised block is held against."""

import numpy as np

TOLERANCE = 1e-12


def polynomial(coefficients, x):
    value = 0.0
    for c in reversed(coefficients):
        value = value * x + c
    return value


def side(b, w):
    return 0 if abs(b - w) <= TOLERANCE * (1 + abs(b)) else np.sign(b - w)


def first_contact(x, rising, falling):
    """The output for samples x from rest at 0: hold until the border is met, follow it to the end of the run."""
    w, last, going, on, before, out = (rising[0] + falling[0]) / 2, 0.0, 0, False, 0, []
    for v in x:
        move = np.sign(v - last)
        if move and move != going:
            going = move
            before = side(polynomial(rising if going > 0 else falling, last), w)
            on = before == 0
        if going:
            b = polynomial(rising if going > 0 else falling, v)
            on = on or side(b, w) * before <= 0
            w = b if on else w
        out.append(w)
        last = v
    return np.array(out)
