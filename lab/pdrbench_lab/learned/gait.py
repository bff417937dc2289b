"""A network whose length is a step rate times a bounded step length, so that weak shaking cannot shorten a walk.

What shakes a phone is divided by its own size before the network sees it: a phone that is held softly and one that is
held stiffly give nearly the same input. The autocorrelation of the shaking, which is the rhythm of the steps whatever
its size, enters beside it. Steps per second have an output of their own, which is trained on step counts. The length of
a step is that of the published law of body height and step rate times a factor between 0.6 and 1.65.

Features far from those of training (Mahalanobis distance, Lee et al. 2018) make the network doubt itself: the factor
goes to 1, which leaves the step law, and the covariance grows with the square of the distance.
"""

from __future__ import annotations

import math
from typing import ClassVar

import torch
from torch import Tensor, nn

from pdrbench.errors import PdrbenchError
from pdrbench_baselines.learned.attitude_sources import PHONE
from pdrbench_baselines.learned.constants import (
    CHANGE,
    DOUBT_M,
    FEATURES,
    FLOOR,
    GAIT,
    GAIT_INPUTS,
    LAGS,
    LAW_M,
    MAX_LOG_FACTOR,
    MAX_STEPS_HZ,
    OUTPUTS,
    SHAKES,
    STEP_LAGS,
    USUAL_HEIGHT_M,
)
from pdrbench_baselines.learned.signals import RATE_HZ, SLOW_S, WINDOW
from pdrbench_lab.learned.model import Network, NetworkOutput, along


class GaitNetwork(Network):
    """See the module; used as `Network`.

    Args:
        width: Of the trunk's first stage.
        carried: What carries the sensors; phones only.
    """

    inputs: ClassVar[int] = GAIT_INPUTS
    more_features: ClassVar[int] = 3 * len(LAGS) + 2
    change: ClassVar[int] = CHANGE + 1  # and the height of the person over the usual one, m
    outputs: ClassVar[int] = OUTPUTS + 1  # and logit of the step rate; the length is one of its factor

    own_attitude: ClassVar[bool] = True

    def __init__(self, width: int = 32, carried: str = PHONE) -> None:
        if carried != PHONE:
            raise PdrbenchError(f"{GAIT} networks are of phones, not of a {carried}; take another architecture")
        super().__init__("resnet", width, carried)
        self.arch = GAIT
        half = math.ceil(3 * SLOW_S * RATE_HZ)
        kernel = torch.exp(-0.5 * (torch.arange(-half, half + 1) / (SLOW_S * RATE_HZ)) ** 2)
        self.slow_kernel: Tensor
        self.register_buffer("slow_kernel", (kernel / kernel.sum())[None, None], persistent=False)
        self.usual_features: Tensor  # mean of the features of training
        self.register_buffer("usual_features", torch.zeros(FEATURES))
        self.whitening: Tensor  # (FEATURES, FEATURES); zero until it is fitted: nothing is far then
        self.register_buffer("whitening", torch.zeros(FEATURES, FEATURES))
        self.trust: Tensor  # in what is learned of the length of a person's steps: power of their factor
        self.register_buffer("trust", torch.ones(1))
        self.near: Tensor  # squared distance below which nothing is doubted
        self.register_buffer("near", torch.ones(1))

    def split(self, window: Tensor) -> tuple[Tensor, Tensor]:
        """(N, 6, T) slow motion and shaking of the force and the rates in windows (N, `CHANNELS`, T)."""
        rows = window[:, :6]
        pad = self.slow_kernel.shape[2] // 2
        padded = nn.functional.pad(rows, (pad, pad), mode="reflect")
        slow = nn.functional.conv1d(padded.flatten(0, 1)[:, None], self.slow_kernel).reshape(rows.shape)
        return slow, rows - slow

    def _features(self, window: Tensor, height_m: Tensor) -> Tensor:
        slow, shaking = self.split(window)
        normal, size = _normalised(shaking)
        integrals = torch.cumsum(torch.cat([slow[:, 0:2], window[:, 5:6]], dim=1), dim=2) / RATE_HZ
        integrals = (integrals - integrals.mean(dim=2, keepdim=True)) / self.derived_scale
        flat = size[:, :, None].expand(-1, -1, WINDOW)
        x = torch.cat([1.5 * normal, slow[:, 3:6], window[:, 6:9], integrals, flat], dim=1)
        known = (height_m > 0).to(window.dtype)
        person = torch.stack([self._taller_m(height_m) / USUAL_HEIGHT_M[1], known], dim=1)
        more = torch.cat([rhythm(normal), person], dim=1)
        output: Tensor = self.neck(torch.cat([self.trunk(x), more], dim=1))
        return output

    def step_rhythm(self, window: Tensor) -> Tensor:
        """(N,) largest autocorrelation at the period of a step, not a number where nothing shakes: 0.35 of walkers.

        Of windows (N, `CHANNELS`, `WINDOW`).
        """
        normal, size = _normalised(self.split(window)[1])
        steps = [i for i, lag in enumerate(LAGS) if STEP_LAGS[0] <= lag <= STEP_LAGS[1]]
        peak = rhythm(normal).reshape(-1, 3, len(LAGS))[:, :, steps].amax(dim=(1, 2))
        return torch.where(size[:, 0] > SHAKES, peak, torch.full_like(peak, math.nan))

    def _change(self, window: Tensor, height_m: Tensor) -> Tensor:
        return torch.cat([super()._change(window, height_m), self._taller_m(height_m)[:, None]], dim=1)

    @staticmethod
    def _taller_m(height_m: Tensor) -> Tensor:
        return torch.where(height_m > 0, height_m - USUAL_HEIGHT_M[0], torch.zeros_like(height_m))

    def distance2(self, features: Tensor) -> Tensor:
        """(N,) squared Mahalanobis distances of features (N, `FEATURES`) over that below which nothing is doubted."""
        return ((features - self.usual_features) @ self.whitening).square().sum(dim=1) / self.near

    def _output(self, features: Tensor, change: Tensor) -> NetworkOutput:
        base = super()._output(features, change)
        out = self.head(features)
        far = self.distance2(features[:, :FEATURES]).clamp(min=1.0)
        doubt = 1.0 - 1.0 / far
        steps_hz = MAX_STEPS_HZ * torch.sigmoid(out[:, OUTPUTS])
        factor = torch.exp(MAX_LOG_FACTOR * torch.tanh(out[:, 6]) * (1.0 - doubt) * self.trust)
        length_m = steps_hz * step_law_m(steps_hz, USUAL_HEIGHT_M[0] + change[:, -1]) * factor
        return NetworkOutput(
            along(base.course_m, length_m),
            length_m,
            base.course_m,
            widened(base.cholesky_m, far, DOUBT_M * doubt),
            base.standing,
            steps_hz,
            doubt,
        )


def step_law_m(steps_hz: Tensor, height_m: Tensor) -> Tensor:
    """(N,) usual length of a step at a step rate, of people of a height; 0.3 m at least."""
    usual_m, per_height, usual_height_m, per_hz, usual_hz = LAW_M
    taller_m = height_m - usual_height_m
    length_m = usual_m + per_height * taller_m + per_hz * (steps_hz - usual_hz) * height_m / usual_height_m
    return length_m.clamp(min=0.3)


def widened(cholesky_m: Tensor, far: Tensor, added_m: Tensor) -> Tensor:
    """(N, 2, 2) Cholesky factors of covariances (N, 2, 2) times `far` (N,), plus `added_m`^2 (N,) on the diagonal."""
    l11, l21, l22 = cholesky_m[:, 0, 0], cholesky_m[:, 1, 0], cholesky_m[:, 1, 1]
    first = (far * l11**2 + added_m**2).sqrt()
    lower = far * l11 * l21 / first
    second = (far * (l21**2 + l22**2) + added_m**2 - lower**2).clamp(min=1e-8).sqrt()
    return torch.stack([first, torch.zeros_like(first), lower, second], dim=1).reshape(-1, 2, 2)


def _normalised(shaking: Tensor) -> tuple[Tensor, Tensor]:
    """(N, 6, T) shaking over its own size, and (N, 2) sizes of force and rates: 1 of walkers, 0 at rest."""
    normal, sizes = [], []
    for first, floor in zip((0, 3), FLOOR, strict=True):
        one = shaking[:, first : first + 3]
        size2 = one.square().sum(dim=1).mean(dim=1)
        normal.append(one / (size2 + floor**2).sqrt()[:, None, None])
        sizes.append(size2 / (size2 + floor**2))
    return torch.cat(normal, dim=1), torch.stack(sizes, dim=1)


def rhythm(normal: Tensor) -> Tensor:
    """(N, 3 lags) autocorrelation of the vertical force, of all force and of all rates, at `LAGS`."""
    spectrum = torch.fft.rfft(normal, n=2 * WINDOW, dim=2)
    power = spectrum.real.square() + spectrum.imag.square()
    power = torch.stack([power[:, 2], power[:, 0:3].sum(dim=1), power[:, 3:6].sum(dim=1)], dim=1)
    auto = torch.fft.irfft(power, n=2 * WINDOW, dim=2)
    relative: Tensor = auto[:, :, list(LAGS)] / (auto[:, :, :1] + 1e-3 * WINDOW)
    return relative.flatten(1)
