"""Training of `ronin`, `tlio` and `eqnio`: squared errors, then for the latter two Gaussian likelihood.

A step draws from a generator made of the seed and its number, so that a run that was resumed ends where one that was
not does: the same numbers on a CPU with the same number of threads.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from pdrbench.errors import PdrbenchError
from pdrbench.geometry import IntArray
from pdrbench_baselines.learned.odometry.equivariant import EqNio
from pdrbench_baselines.learned.odometry.resnet import Ronin
from pdrbench_baselines.learned.odometry.weights import load_into, network_of, restore, store
from pdrbench_baselines.learned.odometry.windows import KINDS, MALL, PEOPLE, OdometryWindows, load_or_gather

MODEL: Final = "model.safetensors"
STATE: Final = "state.safetensors"
PROGRESS: Final = "progress.json"
KEEP_EVERY: Final = 50  # steps
MAX_GRADIENT: Final = 5.0
VAL_BATCH: Final = 256
VAL_EVERY: Final = 20  # of the windows of other people one is asked: neighbours share 95 % of their samples


@dataclass(frozen=True, slots=True)
class OdometryTrainParams:
    """Settings of a run; ours unless a line says otherwise.

    Attributes:
        arch: "ronin", "tlio" or "eqnio".
        kinds: Sources, some of `windows.KINDS`.
        people: Simulated people who walk for it.
        val_people: Others, on whom progress is measured.
        steps: Batches in all; the rate of learning rises over the first tenth and falls to nothing at the last.
        batch: Windows at a time.
        warm_up: Fraction of the steps with squared errors, before likelihood.
        rate: Of learning, at its largest.
        decay: Of weights.
        dropout: 0.5 in the papers, for some hundred times as many steps.
        recorded_fraction: Of a batch, that is of recorded walks, where there are any.
        accel_bias_mps2, gyro_bias_radps, tilt_rad: Largest errors that a window is given, uniform, as of TLIO.
        init: File of trained weights whose trunk, or whose network, is where training begins; empty to draw weights.
        seed: Of everything.
        threads: Of torch.
    """

    arch: str
    kinds: tuple[str, ...] = (PEOPLE, MALL)
    people: int = 160
    val_people: int = 16
    steps: int = 1000
    batch: int = 64
    warm_up: float = 0.3
    rate: float = 1e-3
    decay: float = 1e-4
    dropout: float = 0.2
    recorded_fraction: float = 0.6
    accel_bias_mps2: float = 0.2
    gyro_bias_radps: float = 0.05
    tilt_rad: float = math.radians(5.0)
    init: str = ""
    seed: int = 0
    threads: int = 1


def train(
    out: Path,
    params: OdometryTrainParams,
    *,
    windows_in: Path | None = None,
    sets: Path | None = None,
    budget_min: float | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> dict[str, float]:
    """Trains a network into a folder, from where an earlier run of the same settings was stopped.

    Args:
        out: Gets `model.safetensors`, `card.json`, and what a resumed run needs.
        params: See `OdometryTrainParams`.
        windows_in: Folder of windows and manifests, which several runs may share; None for `out`.
        sets: Folder of recordings for the source "sets".
        budget_min: No step is begun after so long; the same command goes on.
        say: Receives messages on progress.

    Returns:
        Figures on simulated people who are in no training set, see `figures`.

    Raises:
        PdrbenchError: The folder holds a run of other settings, or its loss is not a number any more.
    """
    began_s = time.monotonic()
    torch.set_num_threads(params.threads)
    out.mkdir(parents=True, exist_ok=True)
    kept = windows_in or out
    windows = load_or_gather(kept, params.kinds, params.people, "train", sets)
    val = load_or_gather(kept, (PEOPLE,), params.val_people, "val")
    say(f"{len(windows)} windows of {len(np.unique(windows.walk))} walks, {len(val)} of other people")
    run = _Run(out, params)
    losses: list[float] = []
    for step in range(run.done, params.steps):
        losses.append(run.learn(windows, step))
        is_last = step + 1 == params.steps
        is_over = budget_min is not None and time.monotonic() - began_s > 60.0 * budget_min
        if is_last or is_over or (step + 1) % KEEP_EVERY == 0:
            run.keep(step + 1, float(np.mean(losses)))
            say(f"step {step + 1}/{params.steps}: loss {np.mean(losses):.4f}, {time.process_time():.0f} s of processor")
            losses = []
        if is_over and not is_last:
            say(f"{budget_min:g} min are used up; run the same again to go on")
            break
    measured = figures(run.network, val)
    card = {"params": asdict(params), "steps": run.done, "val": measured}
    (out / "card.json").write_text(json.dumps(card, indent=1) + "\n")
    return measured


class _Run:
    """Network, optimiser, and what is on the disk of them."""

    def __init__(self, out: Path, params: OdometryTrainParams) -> None:
        self.out, self.params, self.done = out, params, 0
        torch.use_deterministic_algorithms(True)
        torch.manual_seed(params.seed)
        self.network = network_of(params.arch, params.dropout)
        if params.init:
            _begin_with(self.network, restore(Path(params.init)))
        self._optimiser = torch.optim.AdamW(self.network.parameters(), lr=params.rate, weight_decay=params.decay)
        if (out / PROGRESS).is_file():
            self._resume()

    def learn(self, windows: OdometryWindows, step: int) -> float:
        """One step; returns its loss."""
        p = self.params
        rng = np.random.default_rng([p.seed, step])
        torch.manual_seed(1000003 * p.seed + step)
        window, move_m = _augmented(windows, _drawn(windows, p, rng), p, rng)
        for group in self._optimiser.param_groups:
            group["lr"] = p.rate * rate_factor(step / p.steps)
        self.network.train()
        loss = loss_of(self.network, window, move_m, step < p.warm_up * p.steps)
        self._optimiser.zero_grad(set_to_none=True)
        torch.autograd.backward(loss)
        nn.utils.clip_grad_norm_(self.network.parameters(), MAX_GRADIENT)
        self._optimiser.step()
        return float(loss.detach())

    def keep(self, done: int, loss: float) -> None:
        """Stores the network, and what it takes to go on."""
        if not np.isfinite(loss):
            raise PdrbenchError(f"step {done}: the loss is {loss}; lower the rate and begin in a new folder")
        self.done = done
        store(self.network, self.out / MODEL)
        state = {f"network.{name}": values for name, values in self.network.state_dict().items()}
        for number, moments in self._optimiser.state_dict()["state"].items():
            state |= {f"optimiser.{number}.{name}": torch.as_tensor(value) for name, value in moments.items()}
        save_file({name: values.detach().contiguous() for name, values in state.items()}, self.out / STATE)
        progress = {"params": asdict(self.params), "done": done, "loss": loss}
        (self.out / PROGRESS).write_text(json.dumps(progress, indent=1) + "\n")

    def _resume(self) -> None:
        progress = json.loads((self.out / PROGRESS).read_text())
        ours = json.loads(json.dumps(asdict(self.params)))
        if progress["params"] != ours:
            other = sorted(name for name in ours if ours[name] != progress["params"].get(name))
            raise PdrbenchError(f"{self.out} holds a run with other settings ({', '.join(other)}); give another folder")
        self.done = progress["done"]
        state = load_file(self.out / STATE)
        own = {name.removeprefix("network."): one for name, one in state.items() if name.startswith("network.")}
        load_into(self.network, own, self.out / STATE)
        moments: dict[int, dict[str, Any]] = {}
        for name, value in state.items():
            if name.startswith("optimiser."):
                _, number, which = name.split(".")
                moments.setdefault(int(number), {})[which] = value
        groups = self._optimiser.state_dict()["param_groups"]
        self._optimiser.load_state_dict({"state": moments, "param_groups": groups})


def _begin_with(network: nn.Module, trained: nn.Module) -> None:
    """Copies what both have: the trunk, or of a network inside another one the whole."""
    inner = network.backbone if isinstance(network, EqNio) and not isinstance(trained, EqNio) else network
    own = inner.state_dict()
    same = {name: values for name, values in trained.state_dict().items() if name in own}
    if not any(name.startswith("residual_groups") or name.startswith("backbone") for name in same):
        raise PdrbenchError("the weights to begin with share no trunk with this network")
    inner.load_state_dict(own | same)


def _drawn(windows: OdometryWindows, params: OdometryTrainParams, rng: np.random.Generator) -> IntArray:
    """(B,) numbers of windows, `recorded_fraction` of them of recorded walks."""
    is_recorded = windows.source != KINDS.index(PEOPLE)
    groups = [np.flatnonzero(is_recorded), np.flatnonzero(~is_recorded)]
    recorded = round(params.recorded_fraction * params.batch)
    counts = [recorded, params.batch - recorded]
    if not all(len(one) for one in groups):
        return rng.integers(len(windows), size=params.batch)
    return np.concatenate([rng.choice(one, count) for one, count in zip(groups, counts, strict=True)])


def _augmented(
    windows: OdometryWindows, which: IntArray, params: OdometryTrainParams, rng: np.random.Generator
) -> tuple[Tensor, Tensor]:
    """Windows (B, 6, T) and displacements (B, 2), turned by any yaw, with errors of sensors and of the tilt."""
    rows = windows.inputs(which).astype(np.float64)
    count = len(which)
    rows[:, 0:3] += rng.uniform(-1, 1, (count, 3, 1)) * params.gyro_bias_radps
    rows[:, 3:6] += rng.uniform(-1, 1, (count, 3, 1)) * params.accel_bias_mps2
    about = rng.uniform(0, 2 * np.pi, count)
    tilt = rng.uniform(0, params.tilt_rad, count)
    axis = np.column_stack([np.cos(about), np.sin(about), np.zeros(count)]) * np.tan(tilt)[:, None]
    for first in (0, 3):  # a small rotation, to first order
        part = rows[:, first : first + 3]
        rows[:, first : first + 3] = part + np.cross(axis[:, :, None], part, axis=1)
    yaw_rad = rng.uniform(0, 2 * np.pi, count)
    c, s = np.cos(yaw_rad)[:, None], np.sin(yaw_rad)[:, None]
    for first in (0, 3):
        x, y = rows[:, first].copy(), rows[:, first + 1].copy()
        rows[:, first], rows[:, first + 1] = c * x - s * y, s * x + c * y
    x, y = windows.move_m[which].T.astype(np.float64)
    move_m = np.column_stack([c[:, 0] * x - s[:, 0] * y, s[:, 0] * x + c[:, 0] * y])
    return torch.from_numpy(rows.astype(np.float32)), torch.from_numpy(move_m.astype(np.float32))


def loss_of(network: nn.Module, window: Tensor, move_m: Tensor, is_warm_up: bool) -> Tensor:
    """Mean over windows: squared error, or minus the logarithm of the Gaussian likelihood, of each axis.

    The height of a displacement is learned to be 0: walks whose height is known are on one level.
    """
    if isinstance(network, Ronin):
        error: Tensor = ((network(window) - move_m) ** 2).sum(dim=1)
        return error.mean()
    true_m = torch.cat([move_m, torch.zeros_like(move_m[:, :1])], dim=1)
    if isinstance(network, EqNio):
        frame, own_m, log_sigma = network(window)
        flat = torch.einsum("nij,nj->ni", frame, true_m[:, :2])
        true_m = torch.cat([flat, true_m[:, 2:]], dim=1)
    else:
        own_m, log_sigma = network(window)
    error = (own_m - true_m) ** 2
    each: Tensor = error if is_warm_up else 0.5 * error * torch.exp(-2.0 * log_sigma) + log_sigma
    return each.sum(dim=1).mean()


def figures(network: nn.Module, windows: OdometryWindows) -> dict[str, float]:
    """On windows of a set as they were recorded.

    Returns:
        `error_m`, the mean error of the displacement in a second; `speed_pct`, by how much the sum of the lengths is
        too long; of a network with a covariance `coverage_95_pct`, horizontal errors within its ellipse of 95 %.
    """
    network.eval()
    errors, lengths, held = [], [], []
    with torch.inference_mode():
        for which in np.array_split(
            np.arange(0, len(windows), VAL_EVERY), max(len(windows) // VAL_BATCH // VAL_EVERY, 1)
        ):
            own_m, white = outputs(network, torch.from_numpy(windows.inputs(which)), windows.move_m[which])
            errors.append(np.hypot(*(own_m - windows.move_m[which]).T))
            lengths.append(np.column_stack([np.hypot(*own_m.T), np.hypot(*windows.move_m[which].T)]))
            if white is not None:
                held.append(white <= -2.0 * math.log(0.05))
    own, true = np.concatenate(lengths).sum(axis=0)
    out = {"error_m": float(np.concatenate(errors).mean()), "speed_pct": float(100.0 * (own / true - 1.0))}
    return out | ({"coverage_95_pct": 100.0 * float(np.concatenate(held).mean())} if held else {})


def outputs(network: nn.Module, window: Tensor, move_m: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Horizontal displacements (N, 2), and the squared errors in units of the covariance (N,) where there is one."""
    if isinstance(network, Ronin):
        return network(window).numpy(), None
    if isinstance(network, EqNio):
        frame, own_m, log_sigma = network(window)
        flat = torch.einsum("nij,ni->nj", frame, own_m[:, :2]).numpy()
        error = np.einsum("nij,nj->ni", frame.numpy(), move_m - flat)
    else:
        own_m, log_sigma = network(window)
        flat = own_m[:, :2].numpy()
        error = move_m - flat
    return flat, ((error * np.exp(-log_sigma[:, :2].numpy())) ** 2).sum(axis=1)


def rate_factor(progress: float) -> float:
    """Rises for the first tenth, then falls to nothing as a cosine."""
    if progress < 0.1:
        return 0.05 + 0.95 * progress / 0.1
    return 0.5 * (1.0 + math.cos(math.pi * (progress - 0.1) / 0.9)) + 1e-3
