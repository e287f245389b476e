"""What a code of a fault stands for."""

from typing import NamedTuple

CONFIG, FAILED, NOT_MEASURED = 2, 3, 5


class Explanation(NamedTuple):
    """What a code means, what to try, and the exit code of a command that stops on it."""

    meaning: str
    remedy: str
    exit_code: int
