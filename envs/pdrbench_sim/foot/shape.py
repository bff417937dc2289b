"""How a foot swings: mean, growth with length and variation of strides, learned from recorded ones."""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray, read_only

SHAPE_FILE: Final = Path(__file__).with_name("shape.json")
NUM_KNOTS: Final = 97  # of a stride from mid-stance to mid-stance: cycles up to 40 Hz
CHANNELS: Final = ("along", "side_m", "up_m", "pitch_rad", "roll_rad", "yaw_rad")
TOE_LOW, TOE_HIGH = 0.43, 0.76  # phases of the largest and the smallest pitch, as learned strides are stretched


@dataclass(frozen=True, slots=True)
class GaitShape:
    """Strides of one gait over their phase, from mid-stance to mid-stance.

    Channels are `CHANNELS`: the fraction of the way; to the left of the straight line and above it; pitch (toe down
    positive), roll, and yaw beyond what the stride turns by.
    """

    length_m: float  # of the stride for which `mean` holds
    length_range_m: tuple[float, float]  # of the strides that were learned from; beyond it the shape stays as it is
    mean: FloatArray  # (NUM_KNOTS, 6)
    slope: FloatArray  # (NUM_KNOTS, 6) growth with the length of the stride, per metre
    modes: FloatArray  # (M, NUM_KNOTS, 6) what varies from stride to stride, one standard deviation each

    def at(self, length_m: FloatArray) -> FloatArray:
        """(S, NUM_KNOTS, 6) mean strides of lengths (S,)."""
        off = np.clip(length_m, *self.length_range_m) - self.length_m
        return np.asarray(self.mean + off[:, None, None] * self.slope)

    def with_slow_roll(self, cycles: int) -> GaitShape:
        """The same with roll and yaw that vary at most `cycles` times a stride; unchanged for 0."""
        if not cycles:
            return self
        smooth, level = self.smoothed(cycles), np.array([True, True, True, True, False, False])
        mean, slope, modes = (
            read_only(np.where(level, fast, slow))
            for fast, slow in ((self.mean, smooth.mean), (self.slope, smooth.slope), (self.modes, smooth.modes))
        )
        return replace(self, mean=mean, slope=slope, modes=modes)

    def smoothed(self, cycles: int) -> GaitShape:
        """The same without what varies faster than `cycles` times a stride, as the heel strike does."""
        ramp = np.zeros((NUM_KNOTS, len(CHANNELS)))
        ramp[:, 0] = np.linspace(0, 1, NUM_KNOTS)

        def smooth(values: FloatArray) -> FloatArray:
            spectrum = np.fft.rfft(values[..., :-1, :], axis=-2)
            spectrum[..., cycles + 1 :, :] = 0
            kept = np.fft.irfft(spectrum, NUM_KNOTS - 1, axis=-2)
            return read_only(np.concatenate([kept, kept[..., :1, :]], axis=-2))

        along = replace(self, mean=smooth(self.mean - ramp), slope=smooth(self.slope), modes=smooth(self.modes))
        return replace(along, mean=read_only(along.mean - along.mean[0] * [1, 1, 1, 0, 0, 1] + ramp))


@functools.cache
def gait_shape(gait: str) -> GaitShape:
    """The shape of "walk" or "run"."""
    content = json.loads(SHAPE_FILE.read_text(encoding="utf-8"))[gait]
    low, high = content["length_range_m"]
    arrays = {name: read_only(np.array(content[name])) for name in ("mean", "slope", "modes")}
    return GaitShape(length_m=content["length_m"], length_range_m=(low, high), **arrays)
