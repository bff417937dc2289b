"""Where on a shoe a unit sits, and what of the motion of the instep reaches that place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray

_FLAT: Final = (
    0.1  # phase from mid-stance for which a sole lies flat: [R] 8 to 31 % of a gait cycle, of its 60 % stance
)
_LIFTED: Final = 0.2  # phase at which the sole moves as the rest of the foot: [R] before the heel strikes, toes leave


class FootSiteError(PdrbenchError):
    """A place that is not on a shoe."""


@dataclass(frozen=True, slots=True)
class FootSite:
    """A place on a shoe.

    While a foot bears the body its ankle rolls over it, the arch sinks and turns, and upper and straps give way: a unit
    on the instep moves with them. The sole below lies on the floor.
    """

    # From the instep, where strides were recorded: ahead, to the left, up.
    lever_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    planted: float = 0.0  # fraction of the instep's motion in mid-stance that does not reach the place

    def __post_init__(self) -> None:
        if not 0 <= self.planted <= 1:
            raise FootSiteError(f"planted is a fraction: 0 moves as the instep, 1 not at all; got {self.planted:g}")


INSTEP: Final = FootSite()
# Under the instep: at 1.4 m/s units so placed see 55 m/s2 (sources.md 1.2: 53 at the speed of the loops, whose unit was
# in the sole), some 4 more if 0.08 m further behind, in the heel. That a tenth of the motion is left is ours.
SOLE: Final = FootSite(lever_m=(0.0, 0.0, -0.06), planted=0.9)


def plant(shape: FloatArray, rolled: FloatArray, phase: FloatArray, site: FootSite) -> None:
    """Stills a foot in mid-stance, in place: strides (S, N, 6) of `foot_shape.CHANNELS` and metres (S, N) rolled."""
    if not site.planted:
        return
    weight = site.planted * still_fraction(phase)
    rest = np.repeat(shape[:, :1], len(phase), axis=1)
    rest[:, :, 0] = phase > 0.5
    shape += weight[:, None] * (rest - shape)
    rolled *= 1 - weight


def still_fraction(phase: FloatArray) -> FloatArray:
    """(N,) 1 while a sole lies flat, 0 while it swings, smooth to the second derivative between."""
    off = np.abs(np.where(phase < 0.5, phase, phase - 1))
    x = np.clip((_LIFTED - off) / (_LIFTED - _FLAT), 0, 1)
    return np.asarray(x**3 * (x * (6 * x - 15) + 10))
