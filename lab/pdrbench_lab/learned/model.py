"""Two small networks from a window of signals to the displacement of its last second, with its covariance.

What a window shows goes through a memory of the walk (a gated recurrent unit, one step a second): how long the
steps of a person are, and how the phone lies in a pocket, shows at starts and turns, which most windows do not contain.
So the memory also gets the change of velocity from one second to the next, as the accelerometer has it: the difference
of two displacements, but for what tilt and bias add, and these stay nearly the same for many seconds.

The ideas are those of RoNIN (Herath et al. 2020: residual, temporal convolutional and recurrent networks on a level
frame) and TLIO (Liu et al. 2020: a covariance learned by likelihood); sizes and everything else are ours.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

import numpy as np
import torch
from torch import Tensor, nn

from pdrbench.errors import unknown_name
from pdrbench.geometry import FloatArray
from pdrbench_baselines.learned.attitude_sources import FOOT, PHONE
from pdrbench_baselines.learned.constants import (
    CHANGE,
    CNN,
    CNN_INPUTS,
    DERIVED_SCALES,
    FEATURES,
    INPUTS,
    LOG_SIGMA,
    MEMORY,
    OUTPUTS,
    SCALES,
    USUAL_HEIGHT_M,
)
from pdrbench_baselines.learned.reckoning import WindowAnswer
from pdrbench_baselines.learned.signals import HORIZON, RATE_HZ, WINDOW
from pdrbench_lab.learned.rest_velocity import RestVelocity
from pdrbench_lab.learned.threads import one_thread

WIDTHS: Final = (32, 64, 64, 96, 96)  # of the layers for phones, each with half the samples of the one before
KERNELS: Final = (7, 3, 3, 3, 3)
HIDDEN: Final = 96
DERIVED: Final = {PHONE: (0.5, 0.5, 0.7), FOOT: DERIVED_SCALES}  # m/s, m/s, rad


@dataclass(frozen=True, slots=True)
class NetworkOutput:
    """What a network says of N windows.

    Attributes:
        move_m: (N, 2) in the frame of the window: `length_m` along `course_m`.
        length_m: (N,) expected length of the displacement. The mean displacement is shorter wherever the heading is
            doubtful, and distances would come out short.
        course_m: (N, 2) in the direction of travel, of a length without meaning after the warm-up.
        cholesky_m: (N, 2, 2) lower triangular factor of its covariance.
        standing: (N,) logit of standing still.
    """

    move_m: Tensor
    length_m: Tensor
    course_m: Tensor
    cholesky_m: Tensor
    standing: Tensor

    def with_fixed_length(self) -> NetworkOutput:
        """The same, whose displacement teaches headings only."""
        return replace(self, move_m=along(self.course_m, self.length_m.detach()))


class _Residual(nn.Module):
    """Two convolutions and a way round them."""

    def __init__(self, inside: int, outside: int, stride: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.Conv1d(inside, outside, 3, stride, 1, bias=False),
            nn.BatchNorm1d(outside),
            nn.ReLU(inplace=True),
            nn.Conv1d(outside, outside, 3, 1, 1, bias=False),
            nn.BatchNorm1d(outside),
        )
        self.way = nn.Identity() if inside == outside and stride == 1 else nn.Conv1d(inside, outside, 1, stride)

    def forward(self, x: Tensor) -> Tensor:
        return torch.relu(self.body(x) + self.way(x))


class _Causal(nn.Module):
    """Two dilated convolutions that look back only, and a way round them."""

    def __init__(self, width: int, dilation: int) -> None:
        super().__init__()
        self.back = 2 * dilation
        self.first = nn.Conv1d(width, width, 3, dilation=dilation)
        self.second = nn.Conv1d(width, width, 3, dilation=dilation)

    def forward(self, x: Tensor) -> Tensor:
        y = torch.relu(self.first(nn.functional.pad(x, (self.back, 0))))
        return torch.relu(x + self.second(nn.functional.pad(y, (self.back, 0))))


class Network(nn.Module):
    """A trunk over the time of a window, a memory over the windows of a walk, and a head.

    Args:
        arch: "resnet" or "tcn".
        width: Of the trunk's first stage.
        carried: What carries the sensors, "phone" or "foot".
    """

    inputs: ClassVar[int] = INPUTS
    more_features: ClassVar[int] = 0  # of a window, beside those of the trunk
    change: ClassVar[int] = CHANGE
    outputs: ClassVar[int] = OUTPUTS

    def __init__(self, arch: str = "resnet", width: int = 32, carried: str = PHONE) -> None:
        super().__init__()
        if arch not in ARCHITECTURES:
            raise unknown_name("architecture", arch, ARCHITECTURES)
        if carried not in (PHONE, FOOT):
            raise unknown_name("way of carrying", carried, (PHONE, FOOT))
        self.arch, self.width, self.carried = arch, width, carried
        self.trunk = ARCHITECTURES[arch](width, self.inputs)
        with torch.no_grad():
            self.trunk.eval()
            features = self.trunk(torch.zeros(1, self.inputs, WINDOW)).shape[1] + self.more_features
            self.trunk.train()
        self.neck = nn.Sequential(nn.Linear(features, FEATURES), nn.ReLU(inplace=True), nn.Dropout(0.1))
        self.memory = nn.GRU(FEATURES + self.change, MEMORY, batch_first=True)
        self.head = nn.Sequential(nn.Linear(FEATURES + MEMORY, 96), nn.ReLU(inplace=True), nn.Linear(96, self.outputs))
        self.scale: Tensor
        self.register_buffer("scale", torch.tensor(SCALES[carried]).reshape(1, -1, 1), persistent=False)
        self.derived_scale: Tensor
        self.register_buffer("derived_scale", torch.tensor(DERIVED[carried]).reshape(1, -1, 1), persistent=False)
        self.rested = RestVelocity() if carried == FOOT else None
        self.rise_and_fall: Tensor
        self.register_buffer("rise_and_fall", _rise_and_fall(), persistent=False)
        self.claim: Tensor  # by which what is learned of standard deviations is multiplied; fitted after training
        self.register_buffer("claim", torch.ones(1))

    def forward(self, window: Tensor, height_m: Tensor, memory: Tensor | None = None) -> tuple[NetworkOutput, Tensor]:
        """Of N walks, one window each, a second after the one before.

        Args:
            window: (N, `CHANNELS`, `WINDOW`).
            height_m: (N,) of people, 0 where unknown.
            memory: (1, N, `MEMORY`) what the second before gave; None at the beginning of walks.

        Returns:
            output: Of N windows.
            memory: For the next second.
        """
        return self.walks(window[:, None], height_m[:, None], memory)

    def walks(self, window: Tensor, height_m: Tensor, memory: Tensor | None = None) -> tuple[NetworkOutput, Tensor]:
        """Of B walks of T seconds: windows (B, T, `CHANNELS`, `WINDOW`), heights (B, T); the output has B T rows."""
        count, seconds = window.shape[:2]
        seen = self.seen(window.flatten(0, 1), height_m.flatten())
        return self.remembering(seen.reshape(count, seconds, FEATURES + self.change), memory)

    def ask(self, features: FloatArray, height_m: float, memory: Tensor | None) -> tuple[WindowAnswer, Tensor]:
        """What is said of one window (`CHANNELS`, `WINDOW`) after the memory of the second before, and its memory."""
        with one_thread(), torch.inference_mode():
            window = torch.from_numpy(features).to(torch.float32)[None]
            output, memory = self(window, torch.tensor([height_m], dtype=torch.float32), memory)
        answer = WindowAnswer(
            output.move_m[0].numpy().astype(np.float64),
            output.cholesky_m[0].numpy().astype(np.float64),
            float(output.standing[0]),
        )
        return answer, memory

    def remembering(self, seen: Tensor, memory: Tensor | None = None) -> tuple[NetworkOutput, Tensor]:
        """The output for (B, T, `FEATURES` + `change`) that was seen; B T rows."""
        past, memory = self.memory(seen, memory)
        features = torch.cat([seen[:, :, :FEATURES], past], dim=2).flatten(0, 1)
        return self._output(features, seen[:, :, FEATURES:].flatten(0, 1)), memory

    def seen(self, window: Tensor, height_m: Tensor) -> Tensor:
        """(N, `FEATURES` + `change`) of windows (N, `CHANNELS`, `WINDOW`) of people of heights (N,)."""
        return torch.cat([self._features(window, height_m), self._change(window, height_m)], dim=1)

    def _change(self, window: Tensor, height_m: Tensor) -> Tensor:
        """(N, `change`); acceleration under a triangle of 1 s to either side is the difference of two displacements.

        Of a foot, which rests, the displacement itself is known.
        """
        if self.rested is not None:
            velocity_mps = self.rested(window)[:, :, -HORIZON:].mean(dim=2)
        else:
            velocity_mps = (window[:, 0:2, -len(self.rise_and_fall) :] * self.rise_and_fall).sum(dim=2)
        yaw_rad = torch.cumsum(window[:, 5], dim=1) / RATE_HZ
        yaw_rad = yaw_rad - yaw_rad.mean(dim=1, keepdim=True)
        return torch.cat([velocity_mps, yaw_rad[:, [-2 * HORIZON - 1, -HORIZON - 1, -1]]], dim=1)

    def _features(self, window: Tensor, height_m: Tensor) -> Tensor:
        known = (height_m > 0).to(window.dtype)
        tall = known * (height_m - USUAL_HEIGHT_M[0]) / USUAL_HEIGHT_M[1]
        person = torch.stack([tall, known], dim=1)[:, :, None].expand(-1, -1, window.shape[2])
        summed = torch.cumsum(window[:, [0, 1, 5]], dim=2) / RATE_HZ
        derived = summed - summed.mean(dim=2, keepdim=True)
        if self.rested is not None:
            derived = torch.cat([self.rested(window), derived[:, 2:]], dim=1)
        derived = derived / self.derived_scale
        output: Tensor = self.neck(self.trunk(torch.cat([window / self.scale, derived, person], dim=1)))
        return output

    def _output(self, features: Tensor, change: Tensor) -> NetworkOutput:
        out = self.head(features)
        low, high = LOG_SIGMA
        first, second = out[:, 2].clamp(low, high).exp(), out[:, 4].clamp(low, high).exp()
        zero = torch.zeros_like(first)
        cholesky = torch.stack([first, zero, out[:, 3].clamp(-2.0, 2.0), second], dim=1).reshape(-1, 2, 2)
        course_m, length_m = out[:, 0:2], nn.functional.softplus(out[:, 6])
        return NetworkOutput(along(course_m, length_m), length_m, course_m, self.claim * cholesky, out[:, 5])


class PhoneNetwork(nn.Module):
    """The network of phones, without a memory; used as `Network`.

    Convolutions make a vector every 0.64 s. The displacement of the last second comes from the last one, beside the
    mean of all, which says how the phone is carried.
    """

    arch: ClassVar[str] = CNN
    width: ClassVar[int] = WIDTHS[0]
    carried: ClassVar[str] = PHONE
    inputs: ClassVar[int] = CNN_INPUTS

    def __init__(self) -> None:
        super().__init__()
        self.layers, inside = nn.ModuleList(), CNN_INPUTS
        for outside, kernel in zip(WIDTHS, KERNELS, strict=True):
            convolution = nn.Conv1d(inside, outside, kernel, 2, kernel // 2, bias=False)
            self.layers.append(nn.Sequential(convolution, nn.BatchNorm1d(outside)))
            inside = outside
        self.dropout = nn.Dropout(0.2)
        self.mix, self.head = nn.Linear(2 * inside, HIDDEN), nn.Linear(HIDDEN, 6)
        self.scale: Tensor
        self.register_buffer("scale", torch.tensor(SCALES[PHONE]).reshape(1, -1, 1), persistent=False)
        self.claim: Tensor  # by which what is learned of standard deviations is multiplied
        self.register_buffer("claim", torch.ones(1))

    def forward(self, window: Tensor, height_m: Tensor, memory: None = None) -> tuple[NetworkOutput, None]:
        """What is said of windows (N, `CHANNELS`, `WINDOW`) of people of heights (N,), 0 where unknown."""
        taller = torch.where(height_m > 0, (height_m - USUAL_HEIGHT_M[0]) / USUAL_HEIGHT_M[1], 0.0)
        person = torch.stack([taller, (height_m > 0).to(window.dtype)], dim=1)
        seen = torch.cat([window / self.scale, person[:, :, None].expand(-1, -1, window.shape[2])], dim=1)
        for layer in self.layers:
            seen = torch.relu(layer(seen))
        both = self.dropout(torch.cat([seen[:, :, -1], seen.mean(dim=2)], dim=1))
        out = self.head(self.dropout(torch.relu(self.mix(both))))
        spread = self.claim * torch.exp(out[:, [2, 4]].clamp(*LOG_SIGMA))
        cross = self.claim * out[:, 3].clamp(-2.0, 2.0)
        cholesky = torch.stack([spread[:, 0], torch.zeros_like(cross), cross, spread[:, 1]], dim=1).reshape(-1, 2, 2)
        return NetworkOutput(out[:, :2], out[:, :2].norm(dim=1), out[:, :2], cholesky, out[:, 5]), None

    def walks(self, window: Tensor, height_m: Tensor, memory: None = None) -> tuple[NetworkOutput, None]:
        """Of B walks of T seconds: windows (B, T, `CHANNELS`, `WINDOW`), heights (B, T); the output has B T rows."""
        output: NetworkOutput = self(window.flatten(0, 1), height_m.flatten())[0]
        return output, None

    def ask(self, features: FloatArray, height_m: float, memory: Any) -> tuple[WindowAnswer, Any]:
        """What is said of one window (`CHANNELS`, `WINDOW`)."""
        with one_thread(), torch.inference_mode():
            said, _ = self(torch.from_numpy(features).float()[None], torch.tensor([height_m]).float())
        move_m, cholesky_m = (one[0].numpy().astype(np.float64) for one in (said.move_m, said.cholesky_m))
        return WindowAnswer(move_m, cholesky_m, float(said.standing[0])), memory


def _rise_and_fall() -> Tensor:
    """(2 `HORIZON`,) weights of samples, a triangle whose sum is 1 s in units of a sample: m/s2 become m/s."""
    rise = (torch.arange(HORIZON) + 0.5) / HORIZON
    return torch.cat([rise, rise.flip(0)]) / RATE_HZ


def along(course_m: Tensor, length_m: Tensor) -> Tensor:
    """(N, 2) of lengths (N,) along courses (N, 2)."""
    move_m: Tensor = course_m / (torch.linalg.vector_norm(course_m, dim=1, keepdim=True) + 1e-6) * length_m[:, None]
    return move_m


def _resnet(width: int, inputs: int) -> nn.Module:
    """Stages at 25, 12.5 and 6.25 Hz; what is left of time is flattened, since only the last second is asked for."""
    return nn.Sequential(
        nn.Conv1d(inputs, width, 7, 2, 3, bias=False),
        nn.BatchNorm1d(width),
        nn.ReLU(inplace=True),
        _Residual(width, width, 1),
        _Residual(width, 2 * width, 2),
        _Residual(2 * width, 2 * width, 1),
        _Residual(2 * width, 4 * width, 2),
        _Residual(4 * width, 4 * width, 1),
        nn.Conv1d(4 * width, 32, 1),
        nn.ReLU(inplace=True),
        nn.Flatten(),
        nn.Dropout(0.2),
    )


class _Last(nn.Module):
    """(N, C) what a sequence (N, C, T) came to."""

    def forward(self, x: Tensor) -> Tensor:
        return x[:, :, -1]


def _tcn(width: int, inputs: int) -> nn.Module:
    """At 25 Hz; dilations 1 to 16 look back 5 s."""
    blocks = [_Causal(width, 2**k) for k in range(5)]
    return nn.Sequential(nn.Conv1d(inputs, width, 7, 2, 3), nn.ReLU(inplace=True), *blocks, _Last(), nn.Dropout(0.1))


AnyNetwork = Network | PhoneNetwork
ARCHITECTURES: Final = {"resnet": _resnet, "tcn": _tcn}


def squared_error(output: NetworkOutput, move_m: Tensor) -> Tensor:
    """(N,) of mean displacements, with which training begins."""
    return ((output.course_m - move_m) ** 2).sum(dim=1)


def length_error(output: NetworkOutput, move_m: Tensor) -> Tensor:
    """(N,) squared error of lengths."""
    error_m2: Tensor = (output.length_m - torch.linalg.vector_norm(move_m, dim=1)) ** 2
    return error_m2


def surprise(output: NetworkOutput, move_m: Tensor) -> Tensor:
    """(N,) minus the Gaussian log likelihood, less its constant: log l11 + log l22 + |L^-1 e|^2 / 2."""
    white = whitened(output, move_m)
    spread = torch.diagonal(output.cholesky_m, dim1=1, dim2=2).log().sum(dim=1)
    return spread + 0.5 * (white**2).sum(dim=1)


def whitened(output: NetworkOutput, move_m: Tensor) -> Tensor:
    """(N, 2) errors in units of what was claimed: L^-1 e."""
    error_m = move_m - output.move_m
    first = error_m[:, 0] / output.cholesky_m[:, 0, 0]
    second = (error_m[:, 1] - output.cholesky_m[:, 1, 0] * first) / output.cholesky_m[:, 1, 1]
    return torch.stack([first, second], dim=1)
