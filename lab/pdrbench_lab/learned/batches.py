"""Batches of windows: level, turned by the phone's yaw, and with what phones do wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from torch import Tensor

from pdrbench_baselines.learned.signals import GRAVITY_MPS2, HORIZON, WINDOW
from pdrbench_lab.learned.data import OWN, SOURCES, Windows

REAL: Final = tuple(SOURCES.index(name) for name in ("mall", "museum", "retail", OWN))
STANDS_M: Final = 0.1  # in a second; below it the person stands, sways or shuffles
_MIRROR: Final = (-1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0, 1.0)  # x to -x: rates are axial vectors


@dataclass(frozen=True, slots=True)
class Augmentation:
    """Changes of windows in training: standard deviations and fractions, ours unless a line says otherwise.

    Errors come on top of those of the simulated phones.
    """

    accel_scale: float = 0.01
    accel_bias_mps2: float = 0.05
    accel_noise_mps2: float = 0.05
    gyro_scale: float = 0.01
    gyro_bias_radps: float = 0.01
    gyro_noise_radps: float = 0.01
    tilt_rad: float = math.radians(0.8)  # sources.md 1.5, of the reported attitude
    slow_fraction: float = 0.25  # of the windows are as from a phone of half the rate
    mirrored_fraction: float = 0.5  # of simulated ones: left and right of a person are alike
    anonymous_fraction: float = 0.15  # the height of the person is not given


AUGMENTATION: Final = Augmentation()
UNCHANGED: Final = Augmentation(
    accel_scale=0.0,
    accel_bias_mps2=0.0,
    accel_noise_mps2=0.0,
    gyro_scale=0.0,
    gyro_bias_radps=0.0,
    gyro_noise_radps=0.0,
    tilt_rad=0.0,
    slow_fraction=0.0,
    mirrored_fraction=0.0,
    anonymous_fraction=0.0,
)


@dataclass(frozen=True, slots=True)
class Batch:
    """B windows and what they should give.

    Attributes:
        window: (B, channels, samples).
        height_m: (B,).
        move_m: (B, 2) in the frame of each window.
        stands: (B,) 0 or 1.
        yaw_rad: (B,) of that frame.
        number: (B,) of each window in its set.
    """

    window: Tensor
    height_m: Tensor
    move_m: Tensor
    stands: Tensor
    yaw_rad: Tensor
    number: Tensor


class Feed:
    """Windows of a set in batches.

    Attributes:
        number: (N,) of each window in the set, in the order in which batches count them.
    """

    def __init__(self, windows: Windows) -> None:
        rows = np.concatenate([windows.accel, windows.gyro, windows.up, windows.twist], axis=1)
        # Each a second after the one before. With another order a seed would draw other windows.
        phase = (windows.end - windows.begin) % HORIZON
        self.number = torch.from_numpy(np.lexsort((windows.end, phase, windows.walk)))
        self._rows = torch.from_numpy(rows)
        self._end, self._begin = (torch.from_numpy(one) for one in (windows.end, windows.begin))
        self._move_m, self._height_m = (torch.from_numpy(one) for one in (windows.move_m, windows.height_m))
        self._is_real = torch.from_numpy(np.isin(windows.source, REAL))

    def __len__(self) -> int:
        return len(self.number)

    def batch(self, which: Tensor, rng: torch.Generator | None = None, how: Augmentation = AUGMENTATION) -> Batch:
        """Windows (B,) by their place in `number`; with a generator they are augmented."""
        number = self.number[which]
        at = self._end[number][:, None] + torch.arange(-WINDOW, 0)
        is_there = at >= self._begin[number][:, None]
        rows = self._rows[at.clamp(min=0)] * is_there[:, :, None]
        yaw_rad = torch.atan2(rows[:, :, 10].sum(dim=1), rows[:, :, 9].sum(dim=1))
        window = rows[:, :, :9].transpose(1, 2).contiguous()
        for first in (0, 3):
            window[:, first : first + 2] = _turned(window[:, first : first + 2], -yaw_rad[:, None])
        move_m = _turned(self._move_m[number].T.unsqueeze(0), -yaw_rad)[0].T
        height_m = self._height_m[number]
        stands = (move_m.norm(dim=1) < STANDS_M).to(window.dtype)
        if rng is not None:
            window, move_m, height_m = _changed(window, move_m, height_m, self._is_real[number], rng, how)
            window = window * is_there[:, None, :]
        return Batch(window, height_m, move_m, stands, yaw_rad, number)

    def in_order(self, how: Augmentation | None = None, size: int = 512) -> Iterator[Batch]:
        """All of them, as they were recorded, or changed in the same way every time."""
        rng = None if how is None else torch.Generator().manual_seed(0)
        for which in torch.split(torch.arange(len(self)), size):
            yield self.batch(which, rng, how or UNCHANGED)


def _changed(
    window: Tensor, move_m: Tensor, height_m: Tensor, is_real: Tensor, rng: torch.Generator, how: Augmentation
) -> tuple[Tensor, Tensor, Tensor]:
    """Windows, displacements and heights as of phones with errors that are drawn.

    Args:
        window, move_m, height_m: Of B windows.
        is_real: (B,) recorded walks are not mirrored: a declination of the compass would be, too.
        rng: Draws them.
        how: How much.
    """
    count = len(is_real)
    slow, mirrored, anonymous = (torch.rand(count, generator=rng) for _ in range(3))
    normal = torch.randn((count, 12), generator=rng)
    noise = torch.randn((count, 6, WINDOW), generator=rng)
    is_mirrored = (mirrored < how.mirrored_fraction) & ~is_real
    sign = torch.where(is_mirrored[:, None], torch.tensor(_MIRROR), torch.ones(9))
    factor, shift = torch.ones((count, 9)), torch.zeros((count, 9))
    factor[:, 0:3] += how.accel_scale * normal[:, 0:3]
    factor[:, 3:6] += how.gyro_scale * normal[:, 3:6]
    shift[:, 0:3] = how.accel_bias_mps2 * normal[:, 6:9]
    shift[:, 0:2] += GRAVITY_MPS2 * how.tilt_rad * normal[:, 6:8].flip(1)
    shift[:, 3:6] = how.gyro_bias_radps * normal[:, 9:12]
    halved = torch.nn.functional.avg_pool1d(window, 2)
    slower = torch.nn.functional.interpolate(halved, WINDOW, mode="linear")
    window = torch.where((slow < how.slow_fraction)[:, None, None], slower, window)
    window = window * (sign * factor)[:, :, None] + shift[:, :, None]
    window[:, 0:3] += how.accel_noise_mps2 * noise[:, 0:3]
    window[:, 3:6] += how.gyro_noise_radps * noise[:, 3:6]
    height_m = torch.where(anonymous < how.anonymous_fraction, torch.zeros_like(height_m), height_m)
    return window, move_m * sign[:, :2], height_m


def _turned(pairs: Tensor, angle_rad: Tensor) -> Tensor:
    """(N, 2, T) turned by angles (N, 1) or (T,)."""
    c, s = torch.cos(angle_rad), torch.sin(angle_rad)
    return torch.stack([c * pairs[:, 0] - s * pairs[:, 1], s * pairs[:, 0] + c * pairs[:, 1]], dim=1)
