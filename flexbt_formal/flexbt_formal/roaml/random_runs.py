# SPDX-License-Identifier: BSD-3-Clause
"""How many random runs are enough, and between which bounds a probability is after them."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

_FIRST_LOOK: Final = 100
_BETWEEN_LOOKS: Final = 0.6
"""Random runs up to a look, as a part of those up to the next one."""
_HALVINGS: Final = 60


class Bounds(NamedTuple):
    """The part ``value`` of runs that were good, and between what the probability is."""

    value: float
    low: float
    high: float

    @property
    def error(self) -> float:
        """How far the probability can be from the value: near 0 and 1 that is one end of the bounds."""
        return max(self.high - self.value, self.value - self.low)


def looks(error: float, confidence: float) -> dict[int, float]:
    """After how many runs it is looked whether the bounds are within ``error``, and with which doubt each time.

    All doubt together is what ``confidence`` leaves. Half of it is that of the last look, after which the bounds are
    that near whatever the probability: ln(2/δ) / 2ε² runs (Okamoto 1958).
    """
    half = (1.0 - confidence) / 2.0
    last = math.ceil(math.log(2.0 / half) / (2.0 * error**2))
    before = [last]
    while before[-1] > _FIRST_LOOK:
        before.append(max(math.ceil(before[-1] * _BETWEEN_LOOKS), _FIRST_LOOK))
    doubt = half / max(len(before) - 1, 1)
    return dict.fromkeys(reversed(before[1:]), doubt) | {last: half}


def bounds_of(good: int, undecided: int, done: int, doubt: float) -> Bounds:
    """The bounds of the probability: outside of them so many good ones of all had less than the doubt.

    By the relative entropy of what was seen to what may be, which is to be below ln(2/δ) / n on each side (Chernoff
    1952; Hoeffding 1963, Theorem 1). Near 0 and 1 that is much tighter than Okamoto's bound, and nowhere wider.
    """
    most = math.log(2.0 / doubt) / done
    value = good / done
    return Bounds(value, 1.0 - _above(1.0 - value, most), _above((good + undecided) / done, most))


def _above(seen: float, most: float) -> float:
    """The greatest probability, from ``seen`` on, whose relative entropy is not above ``most``."""
    low, high = seen, 1.0
    for _ in range(_HALVINGS):
        tried = (low + high) / 2.0
        entropy = seen * math.log(seen / tried) if seen > 0.0 else 0.0
        if seen < 1.0:
            entropy += (1.0 - seen) * math.log((1.0 - seen) / (1.0 - tried)) if tried < 1.0 else math.inf
        low, high = (tried, high) if entropy <= most else (low, tried)
    return high
