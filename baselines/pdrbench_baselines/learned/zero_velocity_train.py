"""Training of the zero-velocity detector on motion capture.

    python -m pdrbench_baselines.learned.zero_velocity_train --out zero_velocity.safetensors

Three of four trials of `foot_vicon_2` are learned from: one person under motion capture who walks, runs, crawls and
lifts the foot. No trial of `foot_vicon`, another day of the same person and unit, is: `FootVicon-v0` plays those. The
foot rests where its speed by motion capture is below a threshold.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import torch
from scipy.signal import savgol_filter
from scipy.spatial.transform import Rotation
from torch import nn

from pdrbench.geometry import BoolArray
from pdrbench_baselines.learned.zero_velocity_network import UNITS, ZeroVelocityNetwork, store

if TYPE_CHECKING:
    from pdrbench_baselines.foot_ins.experiments import FootWalk

WINDOW: Final = 100  # samples at 200 Hz
REST_MPS: Final = 0.1  # ours: a foot that rolls over its sole moves a unit on the instep by as much
SMOOTHED_SAMPLES: Final = 9  # of the positions, quadratic, for the speed
FIRST_LEARNED: Final = 40  # ours: earlier samples of a window only fill the memory
SET: Final = "foot_vicon_2"
HELD_OUT: Final = 4  # every fourth trial of it
TURNED_RAD: Final = 0.35  # ours: about each axis; units are not strapped on alike
EVERY: Final = 10  # samples between windows


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


def train(steps: int, batch: int = 32, rate: float = 1e-3, seed: int = 0) -> ZeroVelocityNetwork:
    """A network that learned from `is_learned` trials, each window turned by another small rotation."""
    from pdrbench_baselines.foot_ins.experiments import walks_of

    torch.manual_seed(seed)
    torch.use_deterministic_algorithms(True)
    rng = np.random.default_rng(seed)
    rows, rests, known, begin = _windows([walk for i, walk in enumerate(walks_of(SET)) if is_learned(i)])
    network = ZeroVelocityNetwork().train()
    for name, values in network.named_parameters():
        if "bias_hh" in name:  # of the forget gates: a deep network that forgets at once learns nothing
            nn.init.constant_(values[UNITS : 2 * UNITS], 1.0)
    optimiser = torch.optim.AdamW(network.parameters(), lr=rate, weight_decay=1e-4)
    for step in range(steps):
        for group in optimiser.param_groups:
            group["lr"] = rate * min((step + 1) / 20, 0.5 * (1 + np.cos(np.pi * step / steps)) + 1e-3)
        at = rng.choice(begin, batch)[:, None] + np.arange(WINDOW)
        window = _turned(rows[at], rng)
        logits, _ = network(torch.from_numpy(window))
        target, weight = torch.from_numpy(rests[at]), torch.from_numpy(known[at])
        each = nn.functional.binary_cross_entropy_with_logits(logits, target, reduction="none") * weight
        loss = each[:, FIRST_LEARNED:].sum() / weight[:, FIRST_LEARNED:].sum()
        optimiser.zero_grad(set_to_none=True)
        torch.autograd.backward(loss)
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        if (step + 1) % 50 == 0:
            print(f"step {step + 1}/{steps}: loss {float(loss.detach()):.4f}", flush=True)  # noqa: T201
    return network.eval()


def _windows(walks: list[FootWalk]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Samples (n, 6) of trials one after the other, rest and known (n,), and where windows begin."""
    parts, first = [], 0
    for walk in walks:
        rests, known = truth(walk)
        samples = np.column_stack([walk.accel, walk.gyro]).astype(np.float32)
        begin = first + np.arange(0, len(samples) - WINDOW, EVERY)
        parts.append((samples, rests.astype(np.float32), known.astype(np.float32), begin))
        first += len(samples)
    rows, rests, known, begin = (np.concatenate(one) for one in zip(*parts, strict=True))
    return rows, rests, known, begin


def _turned(window: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(B, T, 6) windows turned, each by a rotation of its own."""
    rotation = Rotation.from_rotvec(rng.normal(0.0, TURNED_RAD, (len(window), 3))).as_matrix().astype(np.float32)
    halves = [np.einsum("nij,ntj->nti", rotation, window[:, :, part]) for part in (slice(0, 3), slice(3, 6))]
    return np.concatenate(halves, axis=2)


def main() -> None:
    """Trains and stores a network."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    torch.set_num_threads(1)
    print(store(train(given.steps, seed=given.seed), given.out))  # noqa: T201


if __name__ == "__main__":
    main()
