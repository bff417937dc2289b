"""Batches of windows on the device that trains: level, turned by the phone's yaw, and with what phones do wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from torch import Tensor

from pdrbench_baselines.learned.data import SOURCES, Windows
from pdrbench_baselines.learned.signals import GRAVITY_MPS2, HORIZON, WINDOW

STANDS_M: Final = 0.1  # in a second; below it somebody stands, sways or shuffles
_MIRROR: Final = (-1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0, 1.0)  # x to -x: rates are axial vectors


@dataclass(frozen=True, slots=True)
class Augmentation:
    """By how much windows are changed in training; standard deviations and shares, ours unless a line says otherwise.

    Errors come on top of those of the simulated phones, which are of two kinds only.
    """

    accel_scale: float = 0.01
    accel_bias_mps2: float = 0.05
    accel_noise_mps2: float = 0.05
    gyro_scale: float = 0.01
    gyro_bias_radps: float = 0.01
    gyro_noise_radps: float = 0.01
    tilt_rad: float = math.radians(0.8)  # sources.md 1.5, of the reported attitude
    slow_share: float = 0.25  # of the windows are as from a phone of half the rate
    cut_share: float = 0.1  # begin with the recording, less than 4 s ago
    mirror_share: float = 0.5  # of simulated ones: left and right of a person are alike
    anonymous_share: float = 0.3  # nobody tells how tall the person is


@dataclass(frozen=True, slots=True)
class Batch:
    """N windows and what they should tell.

    Attributes:
        window: (N, channels, samples).
        height_m: (N,).
        move_m: (N, 2) in the frame of each window.
        stands: (N,) 0 or 1.
        yaw_rad: (N,) of that frame.
    """

    window: Tensor
    height_m: Tensor
    move_m: Tensor
    stands: Tensor
    yaw_rad: Tensor


class Feed:
    """Windows of a set, by number.

    Args:
        windows: All of them.
        device: Where they are kept.
    """

    def __init__(self, windows: Windows, device: str) -> None:
        rows = np.concatenate([windows.accel, windows.gyro, windows.up, windows.twist], axis=1)
        self.device = device
        self._rows = torch.from_numpy(rows).to(device)
        self._end, self._begin = (torch.from_numpy(one).to(device) for one in (windows.end, windows.begin))
        self._move_m = torch.from_numpy(windows.move_m).to(device)
        self._height_m = torch.from_numpy(windows.height_m).to(device)
        self._is_real = torch.from_numpy(windows.source == SOURCES.index("mall")).to(device)

    def batch(self, which: Tensor, rng: torch.Generator | None = None, how: Augmentation | None = None) -> Batch:
        """Windows by number (N,); with a generator they are augmented."""
        how = how or Augmentation()
        end, begin = self._end[which], self._begin[which]
        if rng is not None:
            cut = _rand(rng, len(which), self.device) < how.cut_share
            kept = HORIZON + (_rand(rng, len(which), self.device) * (WINDOW - HORIZON)).long()
            begin = torch.where(cut, torch.maximum(begin, end - kept), begin)
        at = end[:, None] + torch.arange(-WINDOW, 0, device=self.device)
        is_there = at >= begin[:, None]
        rows = self._rows[at.clamp(min=0)] * is_there[:, :, None]
        yaw_rad = torch.atan2(rows[:, :, 10].sum(dim=1), rows[:, :, 9].sum(dim=1))
        window = rows[:, :, :9].transpose(1, 2).clone()
        for first in (0, 3):
            window[:, first : first + 2] = _turned(window[:, first : first + 2], -yaw_rad[:, None])
        move_m = _turned(self._move_m[which].T.unsqueeze(0), -yaw_rad)[0].T
        height_m = self._height_m[which]
        stands = (move_m.norm(dim=1) < STANDS_M).to(window.dtype)
        if rng is not None:
            window, move_m, height_m = self._changed(window, move_m, height_m, which, rng, how)
            window = window * is_there[:, None, :]
        return Batch(window, height_m, move_m, stands, yaw_rad)

    def _changed(
        self, window: Tensor, move_m: Tensor, height_m: Tensor, which: Tensor, rng: torch.Generator, how: Augmentation
    ) -> tuple[Tensor, Tensor, Tensor]:
        count = len(window)
        share = [_rand(rng, count, self.device) for _ in range(3)]
        slow = (share[0] < how.slow_share)[:, None, None]
        halved = torch.nn.functional.avg_pool1d(window, 2)
        window = torch.where(slow, torch.nn.functional.interpolate(halved, WINDOW, mode="linear"), window)
        mirrored = (share[1] < how.mirror_share) & ~self._is_real[which]
        sign = torch.where(
            mirrored[:, None], torch.tensor(_MIRROR, device=self.device), torch.ones(9, device=self.device)
        )
        window = window * sign[:, :, None]
        move_m = move_m * sign[:, :2]
        height_m = torch.where(share[2] < how.anonymous_share, torch.zeros_like(height_m), height_m)
        normal = _randn(rng, (count, 12, 1), self.device)
        factor = torch.ones_like(window[:, :, :1])
        factor[:, 0:3] += how.accel_scale * normal[:, 0:3]
        factor[:, 3:6] += how.gyro_scale * normal[:, 3:6]
        shift = torch.zeros_like(factor)
        shift[:, 0:3] = how.accel_bias_mps2 * normal[:, 6:9]
        shift[:, 0:2] += GRAVITY_MPS2 * how.tilt_rad * normal[:, 6:8].flip(1)
        shift[:, 3:6] = how.gyro_bias_radps * normal[:, 9:12]
        noise = _randn(rng, (count, 6, WINDOW), self.device)
        noise[:, 0:3] *= how.accel_noise_mps2
        noise[:, 3:6] *= how.gyro_noise_radps
        changed = window * factor + shift
        changed[:, :6] += noise
        return changed, move_m, height_m

    def __len__(self) -> int:
        return len(self._end)

    def in_order(self, size: int = 512) -> Iterator[Batch]:
        """All of them, as they were recorded."""
        for which in torch.split(torch.arange(len(self), device=self.device), size):
            yield self.batch(which)


def _turned(pairs: Tensor, angle_rad: Tensor) -> Tensor:
    """(N, 2, T) turned by angles (N, 1) or (T,)."""
    c, s = torch.cos(angle_rad), torch.sin(angle_rad)
    return torch.stack([c * pairs[:, 0] - s * pairs[:, 1], s * pairs[:, 0] + c * pairs[:, 1]], dim=1)


def _rand(rng: torch.Generator, count: int, device: str) -> Tensor:
    """Drawn on the CPU, so that every device learns from the same numbers."""
    return torch.rand(count, generator=rng).to(device)


def _randn(rng: torch.Generator, shape: tuple[int, ...], device: str) -> Tensor:
    return torch.randn(shape, generator=rng).to(device)
