"""A small network from a window of signals to the displacement of its last second, with its covariance.

A covariance learned by likelihood is an idea of TLIO (Liu et al. 2020), a level frame of any yaw one of RoNIN (Herath
et al. 2020); sizes and everything else are ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from torch import Tensor, nn

from pdrbench.geometry import FloatArray
from pdrbench_baselines.learned.constants import INPUTS, LOG_SIGMA, OUTPUTS, SCALES, USUAL_HEIGHT_M
from pdrbench_baselines.learned.reckoning import WindowAnswer
from pdrbench_lab.learned.threads import one_thread

WIDTHS: Final = (32, 64, 64, 96, 96)  # of the layers, each with half the samples of the one before
KERNELS: Final = (7, 3, 3, 3, 3)
HIDDEN: Final = 96


@dataclass(frozen=True, slots=True)
class NetworkOutput:
    """What the network says of N windows.

    Attributes:
        move_m: (N, 2) in the frame of the window.
        cholesky_m: (N, 2, 2) lower triangular factor of its covariance.
        standing: (N,) logit of standing still.
    """

    move_m: Tensor
    cholesky_m: Tensor
    standing: Tensor


class PhoneNetwork(nn.Module):
    """Convolutions that make a vector every 0.64 s.

    The displacement of the last second comes from the last one, beside the mean of all, which says how the phone is
    carried.
    """

    def __init__(self) -> None:
        super().__init__()
        self.layers, inside = nn.ModuleList(), INPUTS
        for outside, kernel in zip(WIDTHS, KERNELS, strict=True):
            convolution = nn.Conv1d(inside, outside, kernel, 2, kernel // 2, bias=False)
            self.layers.append(nn.Sequential(convolution, nn.BatchNorm1d(outside)))
            inside = outside
        self.dropout = nn.Dropout(0.2)
        self.mix, self.head = nn.Linear(2 * inside, HIDDEN), nn.Linear(HIDDEN, OUTPUTS)
        self.scale: Tensor
        self.register_buffer("scale", torch.tensor(SCALES).reshape(1, -1, 1), persistent=False)
        self.claim: Tensor  # by which what is learned of standard deviations is multiplied
        self.register_buffer("claim", torch.ones(1))

    def forward(self, window: Tensor, height_m: Tensor) -> NetworkOutput:
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
        return NetworkOutput(out[:, :2], cholesky, out[:, 5])

    def ask(self, features: FloatArray, height_m: float) -> WindowAnswer:
        """What is said of one window (`CHANNELS`, `WINDOW`); the height is that of the person, 0 where unknown."""
        with one_thread(), torch.inference_mode():
            said = self(torch.from_numpy(features).float()[None], torch.tensor([height_m]).float())
        move_m, cholesky_m = (one[0].numpy().astype(np.float64) for one in (said.move_m, said.cholesky_m))
        return WindowAnswer(move_m, cholesky_m, float(said.standing[0]))


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
