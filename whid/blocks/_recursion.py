"""The recursion of a linear system over samples, from a state, or from the one that the chunk leads back to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from whid.blocks._block import PERIODIC
from whid.errors import WhidError
from whid.signal import Floats

Array = NDArray[Any]


def cascaded(phi: Array, drive: Array, start: Any) -> tuple[Array, Array]:
    """Return x (…, s, N) and the state after the last: x(n + 1) = Φ x(n) + drive(n), Φ triangular, from the last row up.

    start: (…, s), None for rest, or PERIODIC; raises `WhidError("block-no-steady-state")` where nothing returns.

    >>> cascaded(np.array([[0.5]]), np.array([[1.0, 0.0]]), PERIODIC)[0].round(4)
    array([[0.6667, 1.3333]])
    """
    from scipy.signal import lfilter

    periodic, n = _returns(phi, start), drive.shape[-1]
    x0 = np.zeros(drive.shape[:-1], phi.dtype) if periodic or start is None else start
    x, last = np.empty(drive.shape, phi.dtype), np.empty(drive.shape[:-1], phi.dtype)
    for k in range(len(phi) - 1, -1, -1):
        source = drive[..., k, :] + phi[k, k + 1 :] @ x[..., k + 1 :, :] if k < len(phi) - 1 else drive[..., k, :]
        x[..., k, :], zf = lfilter([0.0, 1.0], [1.0, -phi[k, k]], source, zi=x0[..., k, None])
        last[..., k] = zf[..., 0]
        if periodic:
            last[..., k] /= 1 - phi[k, k] ** n
            x[..., k, :] += last[..., k, None] * phi[k, k] ** np.arange(n)
    return x, last


def direct(
    num: Floats, den: Floats, to_zi: Array, phi: Array, source: Floats, start: Any, behind: Floats | float = 0.0
) -> tuple[Floats, Array]:
    """Return the output of one filter of order s, lfilter's, and the state after the last sample.

    to_zi: the map from a state to lfilter's delays; behind (…, s): what comes of the source after its end; start as above.
    """
    from scipy.signal import lfilter

    periodic = _returns(phi, start)
    x0 = np.zeros((*source.shape[:-1], len(phi))) if periodic or start is None else start
    y, zf = lfilter(num, den, source, zi=np.real(x0 @ to_zi.T))
    last = np.linalg.solve(to_zi, (zf + behind).T).T
    if periodic:
        round_trip = np.linalg.matrix_power(phi, source.shape[-1])
        last = np.linalg.solve(np.eye(len(phi)) - round_trip, last.T).T
        y, _ = lfilter(num, den, source, zi=np.real(last @ to_zi.T))
    return y, last


def _returns(phi: Array, start: Any) -> bool:
    """Tell whether the state is to be the one after the chunk; only a stable system returns."""
    periodic = isinstance(start, str) and start == PERIODIC
    if periodic and np.any(np.abs(np.diag(phi)) > 1 - 1e-13):
        raise WhidError("block-no-steady-state", "a linear block whose poles do not decay has no periodic state")
    return periodic
