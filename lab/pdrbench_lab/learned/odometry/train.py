"""Training of `ronin` and `tlio`: squared errors, then for the latter Gaussian likelihood.

A step draws from a generator made of the seed and its number, so that a run that was resumed ends where one that was
not does: the same numbers on a CPU with the same number of threads, where `minutes` do not cut it short.
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
from pdrbench.geometry import BoolArray, IntArray
from pdrbench_lab.learned.odometry.aligned import LENGTH
from pdrbench_lab.learned.odometry.resnet import Ronin
from pdrbench_lab.learned.odometry.weights import load_into, network_of, restore, store
from pdrbench_lab.learned.odometry.windows import KINDS, MALL, PEOPLE, OdometryWindows, load_or_gather

MODEL: Final = "model.safetensors"
STATE: Final = "state.safetensors"
PROGRESS: Final = "progress.json"
KEEP_EVERY: Final = 50  # steps
CPU: Final = torch.device("cpu")
MAX_GRADIENT: Final = 5.0
SAY_S: Final = 20.0  # between checkpoints on a GPU, which makes many steps in that
VAL_BATCH: Final = 256
VAL_EVERY: Final = 20  # of the windows of other people one is asked: neighbours share 95 % of their samples


@dataclass(frozen=True, slots=True)
class OdometryTrainParams:
    """Settings of a run; ours unless a line says otherwise.

    Attributes:
        arch: "ronin" or "tlio".
        kinds: Sources, some of `windows.KINDS`.
        people: Simulated people who walk for it.
        val_people: Others, on whom progress is measured.
        leave_out: Every so many outings of recorded walks one is left out, to judge by; 0 to learn from all.
        steps: Batches in all; the rate of learning rises over the first tenth and falls to nothing at the last.
        minutes: After which a run ends, if not by then by its steps; the rate of learning falls with whichever of the
            two has come further. None for all steps.
        batch: Windows at a time.
        warm_up: Fraction of the run with squared errors, before likelihood.
        rate: Of learning, at its largest.
        decay: Of weights.
        dropout: As in the papers.
        recorded_fraction: Of a batch, that is of recorded walks, where there are any.
        accel_bias_mps2, gyro_bias_radps, tilt_rad: Largest errors that a window is given, uniform, as of TLIO.
        init: File of trained weights whose trunk, or whose network, is where training begins; empty to draw weights.
        seed: Of everything.
        threads: Of torch, and processes that gather windows.
    """

    arch: str
    kinds: tuple[str, ...] = (PEOPLE, MALL)
    people: int = 160
    val_people: int = 16
    leave_out: int = 8
    steps: int = 1000
    minutes: float | None = None
    batch: int = 64
    warm_up: float = 0.3
    rate: float = 1e-3
    decay: float = 1e-4
    dropout: float = 0.5
    recorded_fraction: float = 0.4
    accel_bias_mps2: float = 0.2
    gyro_bias_radps: float = 0.05
    tilt_rad: float = math.radians(5.0)
    init: str = ""
    seed: int = 0
    threads: int = 1


class Feed:
    """Windows on a device, from which batches are drawn and augmented.

    Args:
        windows: Of walks.
        params: See `OdometryTrainParams`.
        device: Where batches are needed.
    """

    def __init__(self, windows: OdometryWindows, params: OdometryTrainParams, device: torch.device = CPU) -> None:
        self._params, self._device = params, device
        self._rows = torch.from_numpy(windows.rows).to(device)
        self._begin = torch.from_numpy(windows.begin).to(device)
        self._move_m = torch.from_numpy(windows.move_m).to(device)
        is_recorded, learned = windows.source != KINDS.index(PEOPLE), ~left_out(windows, params)
        groups = [np.flatnonzero(is_recorded & learned), np.flatnonzero(~is_recorded)]
        recorded = round(params.recorded_fraction * params.batch)
        counts = [recorded, params.batch - recorded] if all(map(len, groups)) else [params.batch] * 2
        self._groups = [
            (torch.from_numpy(one).to(device), n) for one, n in zip(groups, counts, strict=True) if len(one)
        ]

    def batch(self, step: int) -> tuple[Tensor, Tensor]:
        """Windows (B, 6, T) and displacements (B, 2), turned by any yaw, with errors of sensors and of the tilt."""
        p, count = self._params, self._params.batch
        random = torch.Generator(self._device).manual_seed(1000003 * p.seed + step)

        def uniform(*shape: int) -> Tensor:
            return torch.rand(shape, generator=random, device=self._device)

        which = torch.cat(
            [one[torch.randint(len(one), (n,), generator=random, device=self._device)] for one, n in self._groups]
        )
        samples = torch.arange(LENGTH, device=self._device)
        rows = self._rows[self._begin[which][:, None] + samples].reshape(count, LENGTH, 2, 3)  # rate, force
        largest = torch.tensor([p.gyro_bias_radps, p.accel_bias_mps2], device=self._device)
        rows = rows + (2 * uniform(count, 1, 2, 3) - 1) * largest[:, None]
        about, tilt = 2 * math.pi * uniform(count), p.tilt_rad * uniform(count)
        axis = torch.stack([about.cos(), about.sin(), torch.zeros_like(about)], dim=1) * tilt.tan()[:, None]
        rows = rows + torch.linalg.cross(axis[:, None, None].expand_as(rows), rows)  # a small rotation, to first order
        yaw = 2 * math.pi * uniform(count)
        turn = torch.stack([yaw.cos(), -yaw.sin(), yaw.sin(), yaw.cos()], dim=1).reshape(count, 2, 2)
        flat = torch.einsum("nij,ntsj->ntsi", turn, rows[..., :2])
        window = torch.cat([flat, rows[..., 2:]], dim=3).reshape(count, LENGTH, 6).transpose(1, 2).contiguous()
        return window, torch.einsum("nij,nj->ni", turn, self._move_m[which])


def left_out(windows: OdometryWindows, params: OdometryTrainParams) -> BoolArray:
    """(N,) whether windows are of a recorded outing that is not learned from."""
    if not params.leave_out:
        return np.zeros(len(windows), dtype=np.bool_)
    is_last: BoolArray = windows.outing % params.leave_out == params.leave_out - 1
    is_last &= windows.source != KINDS.index(PEOPLE)
    return is_last


def train(
    out: Path,
    params: OdometryTrainParams,
    *,
    windows_in: Path | None = None,
    sets: Path | None = None,
    budget_min: float | None = None,
    device: str = "cpu",
    say: Callable[[str], None] = lambda line: None,
) -> dict[str, float]:
    """Trains a network into a folder, from where an earlier run of the same settings was stopped.

    Args:
        out: Gets `model.safetensors`, `card.json`, and what a resumed run needs.
        params: See `OdometryTrainParams`.
        windows_in: Folder of windows and manifests, which several runs may share; None for `out`.
        sets: Folder of recordings for the source "sets".
        budget_min: No step is begun after so long; the same command goes on.
        device: "cpu", or "cuda", whose bytes differ from run to run.
        say: Receives messages on progress.

    Returns:
        Figures on simulated people who are in no training set, see `figures`, and with "outings_" before their names
        those on outings that are left out.

    Raises:
        PdrbenchError: The folder holds a run of other settings, or its loss is not a number any more.
    """
    began_s = time.monotonic()
    torch.set_num_threads(params.threads)
    out.mkdir(parents=True, exist_ok=True)
    kept = windows_in or out
    windows = load_or_gather(kept, params.kinds, params.people, "train", sets, params.threads)
    val = load_or_gather(kept, (PEOPLE,), params.val_people, "val", jobs=params.threads)
    outings = np.flatnonzero(left_out(windows, params))
    say(
        f"{len(windows)} windows of {len(np.unique(windows.walk))} walks, {len(outings)} of them left out, "
        f"{len(val)} of other people"
    )

    def measured() -> dict[str, float]:
        found = figures(run.network, val)
        if len(outings):
            found |= {f"outings_{name}": value for name, value in figures(run.network, windows, outings).items()}
        return found

    run = _Run(out, params, device)
    feed = Feed(windows, params, run.device)
    reported_s = began_s
    losses: list[Tensor] = []
    found = measured() if run.is_over else {}
    while not run.is_over:
        losses.append(run.learn(feed))
        is_stopped = budget_min is not None and time.monotonic() - began_s > 60.0 * budget_min
        if run.is_over or is_stopped or run.done % KEEP_EVERY == 0:
            loss = float(torch.stack(losses).mean())
            losses = []
            if run.is_over or is_stopped or run.device == CPU or time.monotonic() - reported_s > SAY_S:
                run.keep(loss)
                reported_s, found = time.monotonic(), measured()
                say(f"step {run.done}/{params.steps}: loss {loss:.4f}, {reported_s - began_s:.0f} s; {line(found)}")
        if is_stopped and not run.is_over:
            say(f"{budget_min:g} min are used up; run the same again to go on")
            break
    card = {"params": asdict(params), "steps": run.done, "val": found}
    (out / "card.json").write_text(json.dumps(card, indent=1) + "\n")
    return found


def line(found: dict[str, float]) -> str:
    """Figures in one line."""
    return ", ".join(f"{name} {value:.3f}" for name, value in found.items())


class _Run:
    """Network, optimiser, and what is on the disk of them."""

    def __init__(self, out: Path, params: OdometryTrainParams, device: str = "cpu") -> None:
        self.out, self.params, self.done = out, params, 0
        self.device = torch.device(device)
        if self.device == CPU:
            torch.use_deterministic_algorithms(True)
        else:  # 10 bits of products are enough, and bytes are not the same again anyway
            torch.backends.cuda.matmul.allow_tf32 = torch.backends.cudnn.benchmark = True
        torch.manual_seed(params.seed)
        network = network_of(params.arch, params.dropout)
        if params.init:
            _begin_with(network, restore(Path(params.init)))
        self.network = network.to(self.device)
        self._optimiser = torch.optim.AdamW(self.network.parameters(), lr=params.rate, weight_decay=params.decay)
        self._before_s, self._began_s = 0.0, time.monotonic()
        if (out / PROGRESS).is_file():
            self._resume()

    @property
    def _used_s(self) -> float:
        return self._before_s + time.monotonic() - self._began_s

    @property
    def progress(self) -> float:
        """Of the run, 1 at its end."""
        p = self.params
        return max(self.done / p.steps, 0.0 if p.minutes is None else self._used_s / (60.0 * p.minutes))

    @property
    def is_over(self) -> bool:
        return self.progress >= 1.0

    def learn(self, feed: Feed) -> Tensor:
        """One step; returns its loss."""
        p, progress = self.params, self.progress
        torch.manual_seed(1000003 * p.seed + self.done)
        window, move_m = feed.batch(self.done)
        for group in self._optimiser.param_groups:
            group["lr"] = p.rate * rate_factor(progress)
        self.network.train()
        loss = loss_of(self.network, window, move_m, progress < p.warm_up)
        self._optimiser.zero_grad(set_to_none=True)
        torch.autograd.backward(loss)
        nn.utils.clip_grad_norm_(self.network.parameters(), MAX_GRADIENT)
        self._optimiser.step()
        self.done += 1
        return loss.detach()

    def keep(self, loss: float) -> None:
        """Stores the network, and what it takes to go on."""
        if not np.isfinite(loss):
            raise PdrbenchError(f"step {self.done}: the loss is {loss}; lower the rate and begin in a new folder")
        store(self.network, self.out / MODEL)
        state = {f"network.{name}": values for name, values in self.network.state_dict().items()}
        for number, moments in self._optimiser.state_dict()["state"].items():
            state |= {f"optimiser.{number}.{name}": torch.as_tensor(value) for name, value in moments.items()}
        save_file({name: values.detach().cpu().contiguous() for name, values in state.items()}, self.out / STATE)
        progress = {"params": asdict(self.params), "done": self.done, "used_s": self._used_s, "loss": loss}
        (self.out / PROGRESS).write_text(json.dumps(progress, indent=1) + "\n")

    def _resume(self) -> None:
        progress = json.loads((self.out / PROGRESS).read_text())
        ours = json.loads(json.dumps(asdict(self.params)))
        if progress["params"] != ours:
            other = sorted(name for name in ours if ours[name] != progress["params"].get(name))
            raise PdrbenchError(f"{self.out} holds a run with other settings ({', '.join(other)}); give another folder")
        self.done, self._before_s = progress["done"], progress["used_s"]
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
    """Copies what both have: the trunk."""
    own = network.state_dict()
    same = {name: values for name, values in trained.state_dict().items() if name in own}
    if not any(name.startswith("residual_groups") for name in same):
        raise PdrbenchError("the weights to begin with share no trunk with this network")
    network.load_state_dict(own | same)


def loss_of(network: nn.Module, window: Tensor, move_m: Tensor, is_warm_up: bool) -> Tensor:
    """Mean over windows: squared error, or minus the logarithm of the Gaussian likelihood, of each axis.

    The height of a displacement is learned to be 0: walks whose height is known are on one level.
    """
    if isinstance(network, Ronin):
        error: Tensor = ((network(window) - move_m) ** 2).sum(dim=1)
        return error.mean()
    true_m = torch.cat([move_m, torch.zeros_like(move_m[:, :1])], dim=1)
    own_m, log_sigma = network(window)
    error = (own_m - true_m) ** 2
    each: Tensor = error if is_warm_up else 0.5 * error * torch.exp(-2.0 * log_sigma) + log_sigma
    return each.sum(dim=1).mean()


def figures(network: nn.Module, windows: OdometryWindows, which: IntArray | None = None) -> dict[str, float]:
    """On windows of a set as they were recorded.

    Args:
        network: Is asked.
        windows: Every `VAL_EVERY`-th is one to ask of.
        which: Numbers of some of them; None for all.

    Returns:
        `error_m`, the mean error of the displacement in a second; `speed_pct`, by how much the sum of the lengths is
        too long; of a network with a covariance `coverage_95_pct`, horizontal errors within its ellipse of 95 %.
    """
    network.eval()
    device = next(network.parameters()).device
    asked = (np.arange(len(windows)) if which is None else which)[::VAL_EVERY]
    errors, lengths, held = [], [], []
    with torch.inference_mode():
        for some in np.array_split(asked, max(len(asked) // VAL_BATCH, 1)):
            true_m = windows.move_m[some]
            own_m, white = outputs(network, torch.from_numpy(windows.inputs(some)).to(device), true_m)
            errors.append(np.hypot(*(own_m - true_m).T))
            lengths.append(np.column_stack([np.hypot(*own_m.T), np.hypot(*true_m.T)]))
            if white is not None:
                held.append(white <= -2.0 * math.log(0.05))
    own, true = np.concatenate(lengths).sum(axis=0)
    out = {"error_m": float(np.concatenate(errors).mean()), "speed_pct": float(100.0 * (own / true - 1.0))}
    return out | ({"coverage_95_pct": 100.0 * float(np.concatenate(held).mean())} if held else {})


def outputs(network: nn.Module, window: Tensor, move_m: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Horizontal displacements (N, 2), and the squared errors in units of the covariance (N,) where there is one."""
    if isinstance(network, Ronin):
        return network(window).cpu().numpy(), None
    *frame, own_m, log_sigma = (one.cpu() for one in network(window))
    axes = frame[0].numpy() if frame else np.tile(np.eye(2, dtype=np.float32), (len(window), 1, 1))
    flat = np.einsum("nij,ni->nj", axes, own_m[:, :2].numpy())
    error = np.einsum("nij,nj->ni", axes, move_m - flat)
    return flat, ((error * np.exp(-log_sigma[:, :2].numpy())) ** 2).sum(axis=1)


def rate_factor(progress: float) -> float:
    """Rises for the first tenth, then falls to nothing as a cosine."""
    if progress < 0.1:
        return 0.05 + 0.95 * progress / 0.1
    return 0.5 * (1.0 + math.cos(math.pi * (progress - 0.1) / 0.9)) + 1e-3
