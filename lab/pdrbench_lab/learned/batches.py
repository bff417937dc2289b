"""Batches of walks on the device that trains: windows second by second, level, turned by the phone's yaw, and with what
phones do wrong, which stays the same for the whole of a walk."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from torch import Tensor

from pdrbench_baselines.learned.attitude_sources import FOOT, PHONE
from pdrbench_baselines.learned.signals import GRAVITY_MPS2, HORIZON, WINDOW
from pdrbench_lab.learned.data import OWN, SOURCES, Windows

LONGEST: Final = 150  # seconds of a walk in training
REAL: Final = tuple(SOURCES.index(name) for name in ("mall", "museum", "retail", OWN))
STANDS_M: Final = 0.1  # in a second; below it the person stands, sways or shuffles
_MIRROR: Final = (-1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0, 1.0)  # x to -x: rates are axial vectors


@dataclass(frozen=True, slots=True)
class Augmentation:
    """Changes of windows in training: standard deviations and fractions, ours unless a line says otherwise.

    Errors come on top of those of the simulated phones, which are of two kinds only.
    """

    accel_scale: float = 0.01
    accel_bias_mps2: float = 0.05
    accel_noise_mps2: float = 0.05
    gyro_scale: float = 0.01
    gyro_bias_radps: float = 0.01
    gyro_noise_radps: float = 0.01
    tilt_rad: float = math.radians(0.8)  # sources.md 1.5, of the reported attitude
    slow_share: float = 0.25  # of the walks are as from a phone of half the rate
    mirror_share: float = 0.5  # of simulated ones: left and right of a person are alike
    anonymous_share: float = 0.15  # the height of the person is not given


UNCHANGED: Final = Augmentation(
    accel_scale=0.0,
    accel_bias_mps2=0.0,
    accel_noise_mps2=0.0,
    gyro_scale=0.0,
    gyro_bias_radps=0.0,
    gyro_noise_radps=0.0,
    tilt_rad=0.0,
    slow_share=0.0,
    mirror_share=0.0,
    anonymous_share=0.0,
)
AUGMENTATION: Final = {
    PHONE: Augmentation(),
    # Units on feet are better and one kind is simulated, of any rate, on left feet and right ones; the rest is ours.
    FOOT: Augmentation(
        accel_scale=0.005,
        accel_bias_mps2=0.03,
        gyro_bias_radps=0.002,
        tilt_rad=math.radians(0.2),
        slow_share=0.0,
        mirror_share=0.0,
    ),
}


@dataclass(frozen=True, slots=True)
class Batch:
    """B walks of T seconds and what their windows should give; where a walk is shorter, its end is not known.

    Attributes:
        window: (B, T, channels, samples).
        height_m: (B, T).
        move_m: (B T, 2) in the frame of each window.
        stands: (B T,) 0 or 1.
        known: (B T,) whether the displacement is known.
        yaw_rad: (B T,) of that frame.
        number: (B T,) of each window.
        steps: (B T,) in the last second, not a number where they are not known.
    """

    window: Tensor
    height_m: Tensor
    move_m: Tensor
    stands: Tensor
    known: Tensor
    yaw_rad: Tensor
    number: Tensor
    steps: Tensor


class Feed:
    """Windows of a set as walks, second by second.

    Args:
        windows: All of them.
        device: Where they are kept.
        longest: Seconds of a walk; longer ones become several.

    Attributes:
        walks: (W, T) numbers of windows, each a second after the one before; -1 after the end of a walk.
        source: (W,) number of the source of each.
    """

    def __init__(self, windows: Windows, device: str, longest: int = LONGEST) -> None:
        rows = np.concatenate([windows.accel, windows.gyro, windows.up, windows.twist], axis=1)
        self.device = device
        self.walks, self.source = _walks(windows, longest)
        self._rows = torch.from_numpy(rows).to(device)
        self._end, self._begin = (torch.from_numpy(one).to(device) for one in (windows.end, windows.begin))
        self._move_m = torch.from_numpy(windows.move_m).to(device)
        self._height_m = torch.from_numpy(windows.height_m).to(device)
        self._steps = torch.from_numpy(windows.steps).to(device)
        self._is_known = torch.from_numpy(windows.known).to(device)
        self._is_real = torch.from_numpy(np.isin(windows.source, REAL)).to(device)

    def __len__(self) -> int:
        return len(self.walks)

    def batch(self, which: Tensor, rng: torch.Generator | None = None, how: Augmentation | None = None) -> Batch:
        """Walks by number (B,); with a generator they are augmented."""
        how = how or Augmentation()
        number = self.walks[which]
        number = number[:, : int((number >= 0).sum(dim=1).max())].to(self.device)
        count, seconds = number.shape
        flat = number.clamp(min=0).flatten()
        at = self._end[flat][:, None] + torch.arange(-WINDOW, 0, device=self.device)
        is_there = at >= self._begin[flat][:, None]
        rows = self._rows[at.clamp(min=0)] * is_there[:, :, None]
        yaw_rad = torch.atan2(rows[:, :, 10].sum(dim=1), rows[:, :, 9].sum(dim=1))
        window = rows[:, :, :9].transpose(1, 2).contiguous()
        for first in (0, 3):
            window[:, first : first + 2] = _turned(window[:, first : first + 2], -yaw_rad[:, None])
        move_m = _turned(self._move_m[flat].T.unsqueeze(0), -yaw_rad)[0].T
        height_m = self._height_m[flat]
        stands = (move_m.norm(dim=1) < STANDS_M).to(window.dtype)
        known = self._is_known[flat] & (number.flatten() >= 0)
        if rng is not None:
            change = _Change(rng, self._is_real[number[:, 0]], how, self.device)
            window, move_m, height_m = change.applied(window, move_m, height_m, seconds)
            window = window * is_there[:, None, :]
        window = window.reshape(count, seconds, *window.shape[1:])
        height_m = height_m.reshape(count, seconds)
        return Batch(window, height_m, move_m, stands, known, yaw_rad, number.flatten(), self._steps[flat])

    def in_order(self, how: Augmentation | None = None, size: int = 8) -> Iterator[Batch]:
        """All of them, as they were recorded, or changed in the same way every time."""
        rng = None if how is None else torch.Generator().manual_seed(0)
        for which in torch.split(torch.arange(len(self)), size):
            yield self.batch(which, rng, how)


def _walks(windows: Windows, longest: int) -> tuple[Tensor, Tensor]:
    """(W, `longest`) numbers of windows, each a second after the one before, and (W,) sources."""
    phase = (windows.end - windows.begin) % HORIZON
    order = np.lexsort((windows.end, phase, windows.walk))
    one, other = order[:-1], order[1:]
    is_next = windows.walk[one] == windows.walk[other]
    is_next &= windows.end[other] - windows.end[one] == HORIZON
    parts = np.split(order, np.flatnonzero(~is_next) + 1)
    pieces = [piece for part in parts for piece in np.split(part, range(longest, len(part), longest))]
    pieces = [piece for piece in pieces if windows.known[piece].any()]
    table = np.full((len(pieces), longest), -1)
    for row, piece in zip(table, pieces, strict=True):
        row[: len(piece)] = piece
    source = windows.source[[int(piece[0]) for piece in pieces]]
    return torch.from_numpy(table), torch.from_numpy(source)


class _Change:
    """What is wrong with the phones of B walks.

    Args:
        rng: Draws it.
        is_real: (B,) recorded walks are not mirrored: a declination of the compass would be, too.
        how: How much.
        device: Of everything.
    """

    def __init__(self, rng: torch.Generator, is_real: Tensor, how: Augmentation, device: str) -> None:
        self._rng, self._how, self._device = rng, how, device
        count = len(is_real)
        drawn = [torch.rand(count, generator=rng, device=rng.device).to(device) for _ in range(3)]
        self._is_slow = drawn[0] < how.slow_share
        is_mirrored = (drawn[1] < how.mirror_share) & ~is_real
        mirror, same = torch.tensor(_MIRROR, device=device), torch.ones(9, device=device)
        self._sign = torch.where(is_mirrored[:, None], mirror, same)
        self._is_anonymous = drawn[2] < how.anonymous_share
        normal = _randn(rng, (count, 12), device)
        self._factor = torch.ones((count, 9), device=device)
        self._factor[:, 0:3] += how.accel_scale * normal[:, 0:3]
        self._factor[:, 3:6] += how.gyro_scale * normal[:, 3:6]
        self._shift = torch.zeros((count, 9), device=device)
        self._shift[:, 0:3] = how.accel_bias_mps2 * normal[:, 6:9]
        self._shift[:, 0:2] += GRAVITY_MPS2 * how.tilt_rad * normal[:, 6:8].flip(1)
        self._shift[:, 3:6] = how.gyro_bias_radps * normal[:, 9:12]

    def applied(self, window: Tensor, move_m: Tensor, height_m: Tensor, seconds: int) -> tuple[Tensor, Tensor, Tensor]:
        """To the windows (B T, ...) of walks of so many seconds."""

        def each(of_walks: Tensor) -> Tensor:
            return of_walks.repeat_interleave(seconds, dim=0)

        halved = torch.nn.functional.avg_pool1d(window, 2)
        slow = torch.nn.functional.interpolate(halved, WINDOW, mode="linear")
        window = torch.where(each(self._is_slow)[:, None, None], slow, window)
        sign = each(self._sign)
        window = window * (sign * each(self._factor))[:, :, None] + each(self._shift)[:, :, None]
        noise = _randn(self._rng, (len(window), 6, WINDOW), self._device)
        window[:, 0:3] += self._how.accel_noise_mps2 * noise[:, 0:3]
        window[:, 3:6] += self._how.gyro_noise_radps * noise[:, 3:6]
        height_m = torch.where(each(self._is_anonymous), torch.zeros_like(height_m), height_m)
        return window, move_m * sign[:, :2], height_m


def _turned(pairs: Tensor, angle_rad: Tensor) -> Tensor:
    """(N, 2, T) turned by angles (N, 1) or (T,)."""
    c, s = torch.cos(angle_rad), torch.sin(angle_rad)
    return torch.stack([c * pairs[:, 0] - s * pairs[:, 1], s * pairs[:, 0] + c * pairs[:, 1]], dim=1)


def _randn(rng: torch.Generator, shape: tuple[int, ...], device: str) -> Tensor:
    """Drawn where the generator is: a GPU draws other numbers than a CPU."""
    return torch.randn(shape, generator=rng, device=rng.device).to(device)
