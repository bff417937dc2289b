"""ResNet-18 over time, with the output of RoNIN (Herath et al., ICRA 2020) or of TLIO (Liu et al., RA-L 2020).

Modules are named as the tensors of the published checkpoints are, so that a checkpoint that was converted to
safetensors loads without renaming. The input is a window of 1 s at 200 Hz: rates and specific force, gravity included,
in a frame whose z axis is vertical and whose yaw is any.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import torch
from torch import Tensor, nn

WINDOW: Final = 200  # samples, of both papers
CHANNELS: Final = 6  # rates x, y, z in rad/s; specific force x, y, z in m/s2
PLANES: Final = (64, 128, 256, 512)
BLOCKS: Final = 2  # a group, of ResNet-18
LAST_SAMPLES: Final = 7  # of a window of 200 after five strides of 2
TRANSITION: Final = 128
HIDDEN: Final = 512
DROPOUT: Final = 0.5  # of both papers
RONIN: Final = "ronin"
TLIO: Final = "tlio"
# Of the networks as published (their own code prints them), without what normalisation counts.
PARAMETERS: Final[Mapping[str, int]] = MappingProxyType({RONIN: 4_634_882, TLIO: 5_424_646})
LOG_SIGMA: Final = (-5.0, 2.0)  # ours: 7 mm to 7 m in a second; outside likelihood has no finite float16


class Residual(nn.Module):
    """Two convolutions of length 3 and a way round them.

    Args:
        inside, outside: Channels.
        stride: Of the first convolution.
    """

    def __init__(self, inside: int, outside: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv1d(inside, outside, 3, stride, 1, bias=False)
        self.bn1 = nn.BatchNorm1d(outside)
        self.conv2 = nn.Conv1d(outside, outside, 3, 1, 1, bias=False)
        self.bn2 = nn.BatchNorm1d(outside)
        changes = stride != 1 or inside != outside
        way = nn.Sequential(nn.Conv1d(inside, outside, 1, stride, bias=False), nn.BatchNorm1d(outside))
        self.downsample = way if changes else None

    def forward(self, x: Tensor) -> Tensor:
        way = x if self.downsample is None else self.downsample(x)
        return torch.relu(way + self.bn2(self.conv2(torch.relu(self.bn1(self.conv1(x))))))


class Trunk(nn.Module):
    """From (N, `CHANNELS`, `WINDOW`) to (N, 512, 7)."""

    def __init__(self) -> None:
        super().__init__()
        first = PLANES[0]
        self.input_block = nn.Sequential(
            nn.Conv1d(CHANNELS, first, 7, 2, 3, bias=False),
            nn.BatchNorm1d(first),
            nn.ReLU(inplace=True),
            nn.MaxPool1d(3, 2, 1),
        )
        groups, inside = [], first
        for number, outside in enumerate(PLANES):
            blocks = [Residual(inside, outside, 2 if number else 1)]
            blocks += [Residual(outside, outside, 1) for _ in range(BLOCKS - 1)]
            groups.append(nn.Sequential(*blocks))
            inside = outside
        self.residual_groups = nn.Sequential(*groups)

    def features(self, window: Tensor) -> Tensor:
        """(N, 512, 7) of windows."""
        out: Tensor = self.residual_groups(self.input_block(window))
        return out

    def begin(self) -> None:
        """Draws weights as both papers do: He for convolutions, normal of 0.01 for what is fully connected."""
        for module in self.modules():
            if isinstance(module, nn.Conv1d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")
            elif isinstance(module, nn.Linear):
                nn.init.normal_(module.weight, 0.0, 0.01)
                nn.init.zeros_(module.bias)


class RoninHead(nn.Module):
    """Fully connected output of RoNIN."""

    def __init__(self, outputs: int, dropout: float) -> None:
        super().__init__()
        self.transition = nn.Sequential(nn.Conv1d(PLANES[-1], TRANSITION, 1, bias=False), nn.BatchNorm1d(TRANSITION))
        self.fc = nn.Sequential(
            nn.Linear(TRANSITION * LAST_SAMPLES, HIDDEN),
            nn.ReLU(inplace=True),
            nn.Dropout(dropout),
            nn.Linear(HIDDEN, HIDDEN),
            nn.ReLU(inplace=True),
            nn.Dropout(dropout),
            nn.Linear(HIDDEN, outputs),
        )

    def forward(self, x: Tensor) -> Tensor:
        out: Tensor = self.fc(self.transition(x).flatten(1))
        return out


class TlioHead(nn.Module):
    """One of the two fully connected outputs of TLIO: the same sizes, other names."""

    def __init__(self, outputs: int, dropout: float) -> None:
        super().__init__()
        self.prep1 = nn.Conv1d(PLANES[-1], TRANSITION, 1, bias=False)
        self.bn1 = nn.BatchNorm1d(TRANSITION)
        self.fc1 = nn.Linear(TRANSITION * LAST_SAMPLES, HIDDEN)
        self.fc2 = nn.Linear(HIDDEN, HIDDEN)
        self.fc3 = nn.Linear(HIDDEN, outputs)
        self.dropout = nn.Dropout(dropout)

    def forward(self, x: Tensor) -> Tensor:
        x = self.dropout(torch.relu(self.fc1(self.bn1(self.prep1(x)).flatten(1))))
        out: Tensor = self.fc3(self.dropout(torch.relu(self.fc2(x))))
        return out


class Ronin(Trunk):
    """The mean velocity over a window, (N, 2) in m/s, in the frame of the window.

    Args:
        dropout: Fraction of the hidden outputs that training leaves out.
    """

    arch: Final = RONIN

    def __init__(self, dropout: float = DROPOUT) -> None:
        super().__init__()
        self.output_block = RoninHead(2, dropout)
        self.begin()

    def forward(self, window: Tensor) -> Tensor:
        out: Tensor = self.output_block(self.features(window))
        return out


class Tlio(Trunk):
    """The displacement over a window and the logarithms of its standard deviations, (N, 3) each, in m.

    Args:
        dropout: Fraction of the hidden outputs that training leaves out.
    """

    arch: Final = TLIO

    def __init__(self, dropout: float = DROPOUT) -> None:
        super().__init__()
        self.output_block1 = TlioHead(3, dropout)
        self.output_block2 = TlioHead(3, dropout)
        self.begin()

    def forward(self, window: Tensor) -> tuple[Tensor, Tensor]:
        features = self.features(window)
        return self.output_block1(features), self.output_block2(features).clamp(*LOG_SIGMA)


def num_parameters(network: nn.Module) -> int:
    """Of a network, all that training changes."""
    return sum(one.numel() for one in network.parameters() if one.requires_grad)
