"""The whole-record fit of any tree and what goes with it: its bound, its band, several starts, score tests.

records ─► data_of ─► Problem(FreeNumbers) ─► gauged ─► minimise ⇄ noise ─► Refined
"""

from whid.refine._band import band
from whid.refine._bound import bound
from whid.refine._fit import Watch, refine
from whid.refine._gains import gains
from whid.refine._multistart import Starts, multistart
from whid.refine._noise import Noise
from whid.refine._past import Past, past
from whid.refine._profile import profile
from whid.refine._result import Refined

__all__ = [
    "Noise",
    "Past",
    "Refined",
    "Starts",
    "Watch",
    "band",
    "bound",
    "gains",
    "multistart",
    "past",
    "profile",
    "refine",
]
