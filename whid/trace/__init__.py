"""The closed loop: residual → missing effect → refined model → error before and after.

records ─► base fit ─► residual report ─► screen every effect by score ─► refit the best few ─► add ─► again
                                                                                └─► verdict (frozen) ─► report data, once

A verdict is about the whole. What is added first must gain what chance does once in a thousand records; what comes after
ten nats and a thirtieth of what came before it. A residual that still answers to the input with a tenth of its excess left,
or three and more effects of which the first explains less than half, is `unattributed` with leads.

Screening runs on samples where nothing acts within one, loops are fitted on samples first.

An effect is one file in `whid/effects`: edits of the model's tree with start values. A test of the residual is one file in
`whid/diagnostics`. This folder owns the loop between them.
"""

from whid.trace._loop import trace
from whid.trace._options import Trace
from whid.trace._report import Ranking, ResidualReport
from whid.trace._verdict import Errors, Found, Step, Verdict, as_object

__all__ = ["Errors", "Found", "Ranking", "ResidualReport", "Step", "Trace", "Verdict", "as_object", "trace"]
