"""A frame that turns with its input, around TLIO's network: EqNIO (Jayanth et al., ICLR 2025), the group O(2).

Under a rotation about the vertical or a reflection at a vertical plane the horizontal part of a force turns, or is
reflected, its vertical part stays. A rate is an axial vector, which a reflection treats otherwise; so it is written as
the product of two vectors that are perpendicular to it (section 4.1 of the paper). Linear maps of the horizontal
vectors that mix channels and times but never x with y, and factors on them that depend on their lengths and on the
vertical parts only, turn with their input. The last of them gives two vectors, which Gram-Schmidt makes a frame. The
backbone receives the window in that frame; displacement and covariance are turned back.
"""

from __future__ import annotations

from typing import Final

import torch
from torch import Tensor, nn

from pdrbench_lab.learned.odometry.resnet import DROPOUT, Tlio

EQNIO: Final = "eqnio"
VECTORS: Final = 3  # force, and the two whose product is the rate
SCALARS: Final = 9  # vertical parts, horizontal lengths and horizontal products of these three
HIDDEN: Final = 128  # channels of vectors, and of scalars, of the paper
KERNEL: Final = 16  # samples, of the paper; padded by the samples at both ends
TINY: Final = 1e-6


class _VectorLinear(nn.Module):
    """Mixes channels of (N, C, 2, T), the same for x and y."""

    def __init__(self, inside: int, outside: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.empty(outside, inside))
        nn.init.normal_(self.weight, 0.0, inside**-0.5)

    def forward(self, vectors: Tensor) -> Tensor:
        return torch.einsum("oi,nixt->noxt", self.weight, vectors)


class _Gate(nn.Module):
    """Directions of vectors, times lengths that follow from all lengths and scalars."""

    def __init__(self, hidden: int) -> None:
        super().__init__()
        self.linear = nn.Linear(2 * hidden, 2 * hidden, bias=False)
        self.norm = nn.LayerNorm(2 * hidden)
        self.hidden = hidden

    def forward(self, vectors: Tensor, scalars: Tensor) -> tuple[Tensor, Tensor]:
        # not `norm`, which is ten times slower over an axis of two
        length = vectors.square().sum(dim=2).clamp(min=TINY**2).sqrt()
        known = torch.cat([length, scalars], dim=1).transpose(1, 2)
        out = self.norm(torch.relu(self.linear(known))).transpose(1, 2)
        unit = vectors / length[:, :, None]
        return unit * out[:, : self.hidden, None], out[:, self.hidden :]


class _OverTime(nn.Module):
    """A convolution over time, the same for x and y, and another one of the scalars."""

    def __init__(self, hidden: int) -> None:
        super().__init__()
        self.vectors = nn.Conv1d(hidden, hidden, KERNEL, padding="same", padding_mode="replicate", bias=False)
        self.scalars = nn.Conv1d(hidden, hidden, KERNEL, padding="same", padding_mode="replicate", bias=False)

    def forward(self, vectors: Tensor, scalars: Tensor) -> tuple[Tensor, Tensor]:
        count, hidden, _, samples = vectors.shape
        apart = vectors.transpose(1, 2).reshape(2 * count, hidden, samples)
        out = self.vectors(apart).reshape(count, 2, hidden, samples).transpose(1, 2)
        return out, self.scalars(scalars)


class FrameNetwork(nn.Module):
    """(N, 2, 2) frames of windows: the rows are the axes, in the frame of the window.

    Args:
        hidden: Channels.
    """

    def __init__(self, hidden: int = HIDDEN) -> None:
        super().__init__()
        self.first_vectors = _VectorLinear(VECTORS, hidden)
        self.first_scalars = nn.Conv1d(SCALARS, hidden, 1, bias=False)
        self.first_gate, self.over_time, self.gate = _Gate(hidden), _OverTime(hidden), _Gate(hidden)
        self.pooled_vectors = _VectorLinear(hidden, hidden)
        self.pooled_scalars = nn.Conv1d(hidden, hidden, 1, bias=False)
        self.pooled_gate = _Gate(hidden)
        self.axes = _VectorLinear(hidden, 2)

    def forward(self, vectors: Tensor, scalars: Tensor) -> Tensor:
        vectors, scalars = self.first_gate(self.first_vectors(vectors), self.first_scalars(scalars))
        vectors, scalars = self.gate(*self.over_time(vectors, scalars))
        vectors, scalars = vectors.mean(dim=3, keepdim=True), scalars.mean(dim=2, keepdim=True)
        vectors, _ = self.pooled_gate(self.pooled_vectors(vectors), self.pooled_scalars(scalars))
        first, second = self.axes(vectors)[:, :, :, 0].unbind(dim=1)
        return gram_schmidt(first, second)


class EqNio(nn.Module):
    """TLIO's network in a frame that turns with its input; the output as of `Tlio`, with a full covariance.

    Args:
        dropout: Of the backbone.
    """

    arch: Final = EQNIO

    def __init__(self, dropout: float = DROPOUT) -> None:
        super().__init__()
        self.frame = FrameNetwork()
        self.backbone = Tlio(dropout)
        self.scalars_scale: Tensor
        self.register_buffer("scalars_scale", torch.tensor(_SCALARS_SCALE), persistent=False)

    def forward(self, window: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Of windows (N, 6, T).

        Returns:
            frame: (N, 2, 2).
            move_m: (N, 3) in that frame.
            log_sigma: (N, 3) in that frame.
        """
        vectors, scalars = parts(window)
        frame = self.frame(vectors * _SCALE, scalars * self.scalars_scale[:, None])
        move_m, log_sigma = self.backbone(in_frame(vectors, window, frame))
        return frame, move_m, log_sigma


_SCALE: Final = 0.2  # ours: m/s2 of a walk are some five, roots of rates one
_SCALARS_SCALE: Final = (0.1, 1.0, 1.0, 0.2, 1.0, 1.0, 0.2, 0.2, 1.0)


def parts(window: Tensor) -> tuple[Tensor, Tensor]:
    """Vectors and scalars of windows (N, 6, T).

    A rate w of size |w| is w1 x w2 with w1 horizontal: w1 = sqrt(|w|) (w_y, -w_x, 0) / |w_xy| and w2 = w x w1 / |w|.
    Where a rate is vertical, any horizontal direction would do, and none turns with the input: both vectors are 0 there
    and the rate is lost, which no recorded sample meets.

    Returns:
        vectors: (N, 3, 2, T) horizontal parts of force, w1, w2.
        scalars: (N, 9, T) vertical parts of the three, their horizontal lengths, and their horizontal products.
    """
    rate, force = window[:, 0:3], window[:, 3:6]
    size = rate.norm(dim=1)
    flat = rate[:, :2].norm(dim=1).clamp(min=TINY)
    root = size.clamp(min=TINY).sqrt()
    one = torch.stack([rate[:, 1], -rate[:, 0], torch.zeros_like(size)], dim=1) * (root / flat)[:, None]
    two = torch.linalg.cross(rate, one, dim=1) / size.clamp(min=TINY)[:, None]
    vectors = torch.stack([force[:, :2], one[:, :2], two[:, :2]], dim=1)
    length = vectors.norm(dim=2)
    products = torch.stack([(vectors[:, i] * vectors[:, j]).sum(dim=1) for i, j in ((0, 1), (0, 2), (1, 2))], dim=1)
    heights = torch.stack([force[:, 2], one[:, 2], two[:, 2]], dim=1)
    return vectors, torch.cat([heights, length, products], dim=1)


def in_frame(vectors: Tensor, window: Tensor, frame: Tensor) -> Tensor:
    """Windows (N, 6, T) whose horizontal axes are those of a frame; rates are products of their two vectors there."""
    turned = torch.einsum("nij,nvjt->nvit", frame, vectors)
    height = torch.zeros_like(window[:, 0])
    rate, force = window[:, 0:3], window[:, 3:6]
    one = torch.cat([turned[:, 1], height[:, None]], dim=1)
    size, flat = rate.norm(dim=1).clamp(min=TINY), rate[:, :2].norm(dim=1)
    two = torch.cat([turned[:, 2], (-size.rsqrt() * flat)[:, None]], dim=1)
    return torch.cat([torch.linalg.cross(one, two, dim=1), turned[:, 0], force[:, 2:3]], dim=1)


def gram_schmidt(first: Tensor, second: Tensor) -> Tensor:
    """(N, 2, 2) whose rows are unit vectors along `first` (N, 2) and along what of `second` is perpendicular to it."""
    one = first / first.norm(dim=1, keepdim=True).clamp(min=TINY)
    rest = second - (second * one).sum(dim=1, keepdim=True) * one
    two = rest / rest.norm(dim=1, keepdim=True).clamp(min=TINY)
    return torch.stack([one, two], dim=1)
