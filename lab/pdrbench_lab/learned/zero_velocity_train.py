"""Training of the zero-velocity detector on motion capture.

    python -m pdrbench_lab.learned zero-velocity --out zero_velocity.safetensors

Three of four trials of `foot_vicon_2` are learned from: one person under motion capture who walks, runs, crawls and
lifts the foot. No trial of `foot_vicon`, another day of the same person and unit, is: `FootVicon-v1` plays those. The
foot rests where its speed by motion capture is below a threshold, or where the authors say so: by the detector, with
the threshold, that gives the least error of the trial.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np
import torch
from scipy.signal import savgol_filter
from torch import Tensor, nn

from pdrbench.geometry import BoolArray, IntArray
from pdrbench_lab.learned.kept_arrays import keep, kept
from pdrbench_lab.learned.zero_velocity_network import UNITS, ZeroVelocityNetwork

if TYPE_CHECKING:
    from pdrbench_lab.foot_ins.experiments import FootWalk

WINDOW: Final = 300  # samples at 200 Hz; ours, 100 in the paper: in use the memory is never emptied
REST_MPS: Final = 0.1  # ours: a foot that rolls over its sole moves a unit on the instep by as much
SMOOTHED_SAMPLES: Final = 9  # of the positions, quadratic, for the speed
FIRST_LEARNED: Final = 40  # ours: earlier samples of a window only fill the memory
SET: Final = "foot_vicon_2"
HELD_OUT: Final = 4  # every fourth trial of it
# What follows changes windows, each by its own; ours.
TURNED_RAD: Final = 0.35  # about each axis: units are not strapped on alike
TURNED_ANYHOW: Final = 0.5  # fraction of windows that are turned by any rotation instead
PACE: Final = (0.8, 1.25)  # of time
SCALE: Final = 0.1  # of each half, at most
BIAS: Final = (0.3, 0.02)  # m/s2 and rad/s, at most
NOISE: Final = (0.1, 0.01)  # standard deviations, at most


def is_learned(number: int) -> bool:
    """Whether the `number`-th trial of the set is one to learn from."""
    return number % HELD_OUT != HELD_OUT - 1


def truth(walk: FootWalk) -> tuple[BoolArray, BoolArray]:
    """Where the foot rests by motion capture, and where that is known, of the n samples of a trial."""
    place = walk.reference
    assert place.z_m is not None
    seen_m = np.column_stack([place.xy_m, place.z_m])
    even_s = np.arange(place.t_s[0], place.t_s[-1], 1 / 200)
    even_m = np.column_stack([np.interp(even_s, place.t_s, one) for one in seen_m.T])
    speed = savgol_filter(even_m, SMOOTHED_SAMPLES, 2, deriv=1, delta=1 / 200, axis=0)
    rests = np.interp(walk.t_s, even_s, np.linalg.norm(speed, axis=1)) < REST_MPS
    lost = np.interp(walk.t_s, place.t_s, (~place.surveyed).astype(np.float64)) > 0
    near = np.convolve(lost, np.ones(2 * SMOOTHED_SAMPLES + 1), mode="same") > 0
    return rests, ~near


def by_authors(walk: FootWalk) -> tuple[BoolArray, BoolArray]:
    """Where the foot rests by the detector, with the threshold, of least error in this trial; known everywhere."""
    from pdrbench_lab.foot_ins.experiments import labelled
    from pdrbench_lab.readers import foot_vicon_labels

    published = foot_vicon_labels.read_published(walk.path)
    best = min(published.error_m, key=lambda name: published.error_m[name])
    return labelled(walk, published, best).is_rest, np.ones(len(walk.t_s), dtype=np.bool_)


LABELS: Final[Mapping[str, Callable[[FootWalk], tuple[BoolArray, BoolArray]]]] = MappingProxyType(
    {"speed": truth, "authors": by_authors}
)


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Samples of trials, one after the other.

    Attributes:
        rows: (n, 6) float32 specific force and rate.
        rests, known: (n,) see `truth`.
        trial: (n,) number of the trial.
    """

    rows: np.ndarray
    rests: BoolArray
    known: BoolArray
    trial: IntArray


def samples_of(labels: str, folder: Path | None = None) -> Samples:
    """Samples of all trials of the set, kept in a folder where one is given."""
    from pdrbench_lab.foot_ins.experiments import walks_of

    asked = {"set": SET, "labels": labels}
    files = None if folder is None else [folder / f"zero-velocity-{labels}{end}" for end in (".npz", ".json")]
    if files is not None and (found := kept(Samples, files[0], files[1], asked)) is not None:
        return found
    parts = []
    for number, walk in enumerate(walks_of(SET)):
        rows = np.column_stack([walk.accel, walk.gyro]).astype(np.float32)
        parts.append((rows, *LABELS[labels](walk), np.full(len(rows), number)))
    samples = Samples(*(np.concatenate(one) for one in zip(*parts, strict=True)))
    if files is not None:
        keep(samples, files[0], files[1], asked)
    return samples


class Feed:
    """Batches of windows of some trials, each turned, slower or faster, with errors of the unit.

    Args:
        samples: Of all trials.
        device: Where batches are needed.
    """

    def __init__(self, samples: Samples, device: torch.device) -> None:
        self._device = device
        self._rows = torch.from_numpy(samples.rows).to(device)
        self._labels = torch.from_numpy(np.column_stack([samples.rests, samples.known]).astype(np.float32)).to(device)
        length = math.ceil(WINDOW * PACE[1]) + 1
        inside = samples.trial[: 1 - length] == samples.trial[length - 1 :]
        learned = np.array([is_learned(number) for number in samples.trial[: 1 - length].tolist()])
        self._begin = torch.from_numpy(np.flatnonzero(inside & learned)).to(device)
        self._left_out = np.flatnonzero(inside & ~learned)[:: WINDOW // 4]

    def batch(self, count: int, seed: int) -> tuple[Tensor, Tensor, Tensor]:
        """Windows (B, T, 6), where the foot rests (B, T), where that is known."""
        random = torch.Generator(self._device).manual_seed(seed)

        def normal(*shape: int) -> Tensor:
            return torch.randn(shape, generator=random, device=self._device)

        def uniform(*shape: int) -> Tensor:
            return torch.rand(shape, generator=random, device=self._device)

        begin = self._begin[torch.randint(len(self._begin), (count,), generator=random, device=self._device)]
        pace = PACE[0] + (PACE[1] - PACE[0]) * uniform(count, 1)
        at = pace * torch.arange(WINDOW, device=self._device)
        before, part = begin[:, None] + at.long(), (at - at.floor())[:, :, None]
        window = (1 - part) * self._rows[before] + part * self._rows[before + 1]
        halves = window.reshape(count, WINDOW, 2, 3)
        small, anyhow = TURNED_RAD / 2 * normal(count, 3), normal(count, 4)
        little = torch.cat([torch.ones_like(small[:, :1]), small], dim=1)
        rotation = _matrices(torch.where(uniform(count, 1) < TURNED_ANYHOW, anyhow, little))
        bias, noise = (torch.tensor(one, device=self._device)[:, None] for one in (BIAS, NOISE))
        halves = torch.einsum("nij,nthj->nthi", rotation, halves)
        halves = halves * (1 + SCALE * (2 * uniform(count, 1, 2, 1) - 1)) + bias * (2 * uniform(count, 1, 2, 3) - 1)
        halves = halves + noise * uniform(count, 1, 2, 1) * normal(count, WINDOW, 2, 3)
        rests, known = self._labels[before].unbind(dim=2)
        return halves.reshape(count, WINDOW, 6), rests, known

    def f1(self, network: ZeroVelocityNetwork) -> float:
        """Of rest, in windows of the trials that are left out as they were recorded."""
        at = torch.from_numpy(self._left_out[:, None] + np.arange(WINDOW)).to(self._device)
        with torch.inference_mode():
            said = network.eval()(self._rows[at])[0][:, FIRST_LEARNED:] > 0
        rests, known = (one > 0 for one in self._labels[at][:, FIRST_LEARNED:].unbind(dim=2))
        network.train()
        return float(2 * (said & rests & known).sum() / ((said & known).sum() + (rests & known).sum()))


def train(
    samples: Samples,
    steps: int,
    batch: int = 32,
    rate: float = 1e-3,
    seed: int = 0,
    minutes: float | None = None,
    device: str = "cpu",
    say: Callable[[str], None] = lambda line: None,
) -> ZeroVelocityNetwork:
    """A network that learned from `is_learned` trials.

    Args:
        samples: Of all trials.
        steps: Batches; the rate of learning rises over the first twentieth and falls to nothing at the last.
        batch: Windows at a time.
        rate: Of learning, at its largest.
        seed: Of everything.
        minutes: After which training ends at the latest; the rate falls with whichever has come further.
        device: "cpu", or "cuda", whose bytes differ from run to run.
        say: Receives messages on progress.
    """
    began_s = time.monotonic()
    torch.manual_seed(seed)
    where = torch.device(device)
    torch.use_deterministic_algorithms(where.type == "cpu")
    feed = Feed(samples, where)
    network = ZeroVelocityNetwork().to(where).train()
    for name, values in network.named_parameters():
        if "bias_hh" in name:  # of the forget gates: a deep network that forgets at once learns nothing
            nn.init.constant_(values[UNITS : 2 * UNITS], 1.0)
    optimiser = torch.optim.AdamW(network.parameters(), lr=rate, weight_decay=1e-4)
    step, progress = 0, 0.0
    while progress < 1.0:
        for group in optimiser.param_groups:
            group["lr"] = rate * min(progress / 0.05 + 0.01, 0.5 * (1 + math.cos(math.pi * progress)) + 1e-3)
        window, rests, known = feed.batch(batch, 1000003 * seed + step)
        logits, _ = network(window)
        each = nn.functional.binary_cross_entropy_with_logits(logits, rests, reduction="none") * known
        loss = each[:, FIRST_LEARNED:].sum() / known[:, FIRST_LEARNED:].sum()
        optimiser.zero_grad(set_to_none=True)
        torch.autograd.backward(loss)
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        step += 1
        used = 0.0 if minutes is None else (time.monotonic() - began_s) / (60.0 * minutes)
        progress = max(step / steps, used)
        if step % 100 == 0 or progress >= 1.0:
            f1 = feed.f1(network)
            say(f"step {step}/{steps}: loss {float(loss.detach()):.4f}, F1 of trials that are left out {f1:.3f}")
    return network.cpu().eval()


def _matrices(quaternions: Tensor) -> Tensor:
    """(B, 3, 3) of quaternions (B, 4) wxyz of any length."""
    w, x, y, z = nn.functional.normalize(quaternions, dim=1).unbind(dim=1)
    rows = [
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    ]
    return torch.stack(rows, dim=1).reshape(-1, 3, 3)
