"""An example of every disturbance, for the contract tests."""

from whid.disturbances._disturbance import Disturbance
from whid.disturbances.ar import Ar
from whid.disturbances.dropouts import Dropouts
from whid.disturbances.jitter import Jitter
from whid.disturbances.level import Level
from whid.disturbances.outliers import Outliers
from whid.disturbances.process import Process
from whid.disturbances.rounding import Rounding
from whid.disturbances.white import White

EXAMPLES: dict[str, tuple[Disturbance, ...]] = {
    "ar": (
        Ar(coefficients=(0.9,), std=1.0),
        Ar(coefficients=(1.2, -0.6, 0.1), snr_db=20.0),
        Ar(coefficients=(-0.5,), std=2.0),
    ),
    "dropouts": (Dropouts(std=0.2, rate=0.1),),
    "jitter": (Jitter(std=0.01),),
    "level": (Level(std=0.1),),
    "outliers": (Outliers(std=0.2, rate=0.1),),
    "process": (Process(std=0.1), Process(std=0.1, bandwidth=2.0)),
    "rounding": (Rounding(std=0.1),),
    "white": (White(std=0.5), White(snr_db=40.0)),
}
