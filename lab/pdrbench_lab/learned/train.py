"""Training of the network of feet: windows in short pieces of walks, then the memory, on whole walks; checkpoints.

Windows are learned with squared errors, then Gaussian likelihood. Their layers are then kept, and the memory learns
from whole walks, which costs little: each was passed through these layers three times before, each time with other
errors of its phone.

An epoch draws from a generator made of the seed and its number, so that a run that was resumed ends where one that was
not does: the same numbers on a CPU with the same number of threads.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from pdrbench.errors import PdrbenchError
from pdrbench_baselines.learned.attitude_sources import FOOT
from pdrbench_baselines.learned.constants import FEATURES
from pdrbench_lab.learned.batches import AUGMENTATION, REAL, Feed
from pdrbench_lab.learned.data import FEET, Windows, load_or_gather
from pdrbench_lab.learned.measure import LEVELS, WindowFigures, window_figures, window_outputs
from pdrbench_lab.learned.model import Network, NetworkOutput, length_error, squared_error, surprise
from pdrbench_lab.learned.weights import load_into, store

MODEL: Final = "model.safetensors"  # the best one so far
STATE: Final = "state.safetensors"
PROGRESS: Final = "progress.json"
MAX_GRADIENT: Final = 20.0
PIECE_S: Final = 10  # of walks while windows are learned
VIEWS: Final = 2  # of a walk, with other errors of its phone, while the memory learns
COURSE_WEIGHT: Final = 5.5  # ours: as of a standard deviation of 0.3 m, until the network gives its own
LENGTH_WEIGHT: Final = 50.0  # ours: as of one of 0.1 m; likelihood alone hardly minds steps a twentieth too long
WALK_WEIGHT: Final = 30.0  # ours: of the squared relative error of the length of a walk
SHORT_WALK_M: Final = 5.0  # added to that length: who stands makes no relative error


@dataclass(frozen=True, slots=True)
class TrainParams:
    """Settings of a run; all ours.

    Attributes:
        arch, width: Of the network.
        sources: Some of `SOURCES`.
        carried: "phone" or "foot".
        people: Number of people who walk for it.
        val_people: Number of those by whom the best epoch is chosen.
        epochs: Times that every window is seen.
        warm_up: Fraction of them with squared errors.
        batch: Pieces of walks at a time.
        memory_epochs: Times that every walk is seen by the memory afterwards.
        memory_batch: Walks at a time.
        rate: Of learning, at its largest.
        decay: Of weights.
        mall_repeats: Recorded walks are fewer than simulated ones: so often each is seen in an epoch.
        stand_weight: Of the loss for standing.
        seed: Of everything.
        threads: Of torch, and processes that gather windows.
    """

    arch: str = "resnet"
    width: int = 16
    sources: tuple[str, ...] = (FEET,)
    carried: str = FOOT
    people: int = 400
    val_people: int = 100
    epochs: int = 8
    warm_up: float = 0.3
    batch: int = 12
    memory_epochs: int = 30
    memory_batch: int = 16
    rate: float = 1.5e-3
    decay: float = 1e-2
    mall_repeats: int = 2
    stand_weight: float = 0.05
    seed: int = 0
    threads: int = 1


def train(
    out: Path,
    params: TrainParams,
    *,
    windows_in: Path | None = None,
    recordings: Path | None = None,
    budget_min: float | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> WindowFigures:
    """Trains a network into a folder, from where an earlier run of the same settings was stopped.

    Args:
        out: Gets windows with their manifests, `model.safetensors`, `card.json`, and what a resumed run needs.
        params: See `TrainParams`.
        windows_in: Folder of windows and manifests, which several runs may share; None for `out`.
        recordings: Folder of a user's own recordings, for the source "own".
        budget_min: No epoch is begun that would end later than that; the rate of learning then falls for the planned
            number of epochs all the same.
        say: Receives messages on progress.

    Returns:
        Its figures for people who are in no training set.

    Raises:
        PdrbenchError: The folder holds a run of other settings, its loss is not a number any more, or sources of phones
            and of feet are mixed.
    """
    if (params.carried == FOOT) != (FEET in params.sources) or (FEET in params.sources and len(params.sources) > 1):
        raise PdrbenchError(
            f"the source {FEET!r} alone is of feet; got {', '.join(params.sources)} for a {params.carried}: "
            "change --data, and leave --recordings out for a foot"
        )
    began_s = time.monotonic()
    torch.set_num_threads(params.threads)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    out.mkdir(parents=True, exist_ok=True)
    kept = windows_in or out
    say(f"windows of {', '.join(params.sources)}; they are kept in {kept}, and made anew in some minutes")
    others = FEET if params.carried == FOOT else "people"
    windows = load_or_gather(kept, params.sources, params.people, recordings=recordings, jobs=params.threads)
    val = load_or_gather(kept, (others,), params.val_people, "val", jobs=params.threads)
    walks = len(np.unique(windows.walk))
    say(f"{len(windows)} windows of {walks} walks, {len(val)} of other people; on {device}")
    run = _Run(out, params, device)
    val_feed = Feed(val, device)
    for phase in (_WindowPhase, _MemoryPhase):
        if run.done >= run.last_of(phase):
            continue
        work = phase(run, windows)
        for epoch in range(run.done, run.last_of(phase)):
            started_s = time.monotonic()
            loss = work.epoch(epoch)
            figures = window_figures(run.network, val_feed, val)
            run.keep(epoch, loss, figures)
            took_s = time.monotonic() - started_s
            say(f"epoch {epoch + 1}/{run.last} {took_s:.0f} s: loss {loss:.3f}, val {figures.line()}")
            if budget_min is not None and time.monotonic() - began_s + took_s > 60.0 * budget_min:
                say(f"{budget_min:g} min are used up; run the same again to go on")
                return _finish(run, kept, windows, val, val_feed)
    return _finish(run, kept, windows, val, val_feed)


def _finish(run: _Run, kept: Path, windows: Windows, val: Windows, val_feed: Feed) -> WindowFigures:
    path = run.out / MODEL
    if not path.is_file():
        raise PdrbenchError(f"{run.out}: no epoch was run; give at least one")
    network = run.network
    load_into(network, load_file(path), path)
    network.eval()
    network = _fit_claim(network, val, val_feed)
    store(network, path)
    figures = window_figures(network, val_feed, val)
    manifests = {
        group: json.loads((kept / f"manifest-{group}.json").read_text())["sha256"] for group in ("train", "val")
    }
    card = {"params": asdict(run.params), "windows_sha256": manifests, "val": asdict(figures)}
    (run.out / "card.json").write_text(json.dumps(card, indent=1) + "\n")
    return figures


def _fit_claim(network: Network, val: Windows, feed: Feed) -> Network:
    """The network with its standard deviations multiplied by one factor.

    With it the fractions of errors within the ellipses are nearest to the stated ones, in a hand and in a pocket:
    likelihood heeds the few large errors, for which the others are claimed too large.
    """
    network.claim.fill_(1.0)
    outputs = window_outputs(network, feed)
    in_pocket = val.pocket[outputs.number] == 1
    groups = [outputs.whitened_squares[one] for one in (in_pocket, ~in_pocket) if one.any()]
    claims = np.geomspace(0.6, 1.6, 101)
    held = [
        [[float(np.mean(squares / claim**2 <= -2.0 * np.log(1.0 - level))) for level in LEVELS] for squares in groups]
        for claim in claims
    ]
    off = np.abs(np.array(held) - np.array(LEVELS)).sum(axis=(1, 2))
    network.claim.fill_(float(claims[np.argmin(off)]))
    return network


def _repeated(feed: Feed, repeats: int) -> Tensor:
    """Numbers of the walks of an epoch."""
    number = torch.arange(len(feed))
    is_recorded = torch.isin(feed.source, torch.tensor(REAL))
    recorded = number[is_recorded]
    return torch.cat([number, *[recorded] * (repeats - 1)])


class _Run:
    """Network, optimiser, and what is on the disk of them."""

    def __init__(self, out: Path, params: TrainParams, device: str) -> None:
        self.out, self.params, self.device = out, params, device
        torch.use_deterministic_algorithms(device == "cpu")
        torch.manual_seed(params.seed)
        self.network = Network(params.arch, params.width, params.carried).to(device)
        self.how = AUGMENTATION[params.carried]
        self.done = 0
        self.last = params.epochs + params.memory_epochs
        self._curve: list[dict[str, float]] = []
        self._moments: dict[int, dict[str, Any]] = {}
        if (out / PROGRESS).is_file():
            self._resume()

    def last_of(self, phase: type[_WindowPhase] | type[_MemoryPhase]) -> int:
        """Number of the epoch after the last one of a phase."""
        return self.params.epochs if phase is _WindowPhase else self.last

    def optimise(self, parameters: Iterable[nn.Parameter], first: int) -> None:
        """Begins a phase whose first epoch is `first`, or goes on with it."""
        p = self.params
        self._optimiser = torch.optim.AdamW(parameters, lr=p.rate, weight_decay=p.decay)
        if self.done > first:
            groups = self._optimiser.state_dict()["param_groups"]
            self._optimiser.load_state_dict({"state": self._moments, "param_groups": groups})

    def learn(self, loss: Tensor, progress: float) -> float:
        """One step, after such a fraction of its phase."""
        for group in self._optimiser.param_groups:
            group["lr"] = self.params.rate * _rate_factor(progress)
        self._optimiser.zero_grad(set_to_none=True)
        torch.autograd.backward(loss)
        learned = [one for group in self._optimiser.param_groups for one in group["params"]]
        torch.nn.utils.clip_grad_norm_(learned, MAX_GRADIENT)
        self._optimiser.step()
        return float(loss.detach())

    def generator(self, epoch: int) -> torch.Generator:
        """Of an epoch; dropout draws from the same seed."""
        seed = self.params.seed * 1000 + epoch + 1
        torch.manual_seed(seed)
        return torch.Generator(self.device).manual_seed(seed)

    def keep(self, epoch: int, loss: float, figures: WindowFigures) -> None:
        """Stores the network, and what it takes to go on."""
        if not np.isfinite(loss):
            raise PdrbenchError(f"epoch {epoch + 1}: the loss is {loss}; lower the rate and begin in a new folder")
        self.done = epoch + 1
        self._curve.append({"epoch": epoch + 1, "loss": loss, **asdict(figures)})
        store(self.network, self.out / MODEL)
        state = {f"network.{name}": values for name, values in self.network.state_dict().items()}
        for number, moments in self._optimiser.state_dict()["state"].items():
            state |= {f"optimiser.{number}.{name}": torch.as_tensor(value) for name, value in moments.items()}
        save_file({name: values.detach().cpu().contiguous() for name, values in state.items()}, self.out / STATE)
        progress = {"params": asdict(self.params), "done": self.done, "curve": self._curve}
        (self.out / PROGRESS).write_text(json.dumps(progress, indent=1) + "\n")

    def _resume(self) -> None:
        progress = json.loads((self.out / PROGRESS).read_text())
        ours = json.loads(json.dumps(asdict(self.params)))
        if progress["params"] != ours:
            other = sorted(name for name in ours if ours[name] != progress["params"].get(name))
            raise PdrbenchError(f"{self.out} holds a run with other settings ({', '.join(other)}); give another folder")
        self.done, self._curve = progress["done"], progress["curve"]
        state = load_file(self.out / STATE)
        own = {name.removeprefix("network."): one for name, one in state.items() if name.startswith("network.")}
        load_into(self.network, own, self.out / STATE)
        for name, value in state.items():
            if name.startswith("optimiser."):
                _, number, which = name.split(".")
                self._moments.setdefault(int(number), {})[which] = value


class _WindowPhase:
    """The whole network learns, from pieces of walks with errors drawn anew every time."""

    def __init__(self, run: _Run, windows: Windows) -> None:
        self._run, self._feed = run, Feed(windows, run.device, PIECE_S)
        self._number = _repeated(self._feed, run.params.mall_repeats)
        run.optimise(run.network.parameters(), 0)

    def epoch(self, epoch: int) -> float:
        """One pass over all pieces; returns the mean loss."""
        run, p = self._run, self._run.params
        rng = run.generator(epoch)
        parts = torch.split(
            self._number[torch.randperm(len(self._number), generator=rng, device=rng.device).cpu()], p.batch
        )
        is_warm = epoch >= p.warm_up * p.epochs
        run.network.train()
        total = 0.0
        for step, which in enumerate(parts):
            batch = self._feed.batch(which, rng, run.how)
            outputs, _ = run.network.walks(batch.window, batch.height_m)
            loss = _loss(outputs, batch.move_m, batch.stands, batch.known, is_warm, p.stand_weight)
            total += run.learn(loss, (epoch + step / len(parts)) / p.epochs) * len(which)
        return total / len(self._number)


class _MemoryPhase:
    """Memory and head learn from whole walks, of which windows were seen `VIEWS` times before."""

    def __init__(self, run: _Run, windows: Windows) -> None:
        self._run = run
        feed = Feed(windows, run.device)
        self._number = _repeated(feed, run.params.mall_repeats)
        rng = torch.Generator(run.device).manual_seed(run.params.seed)
        network = run.network.eval()
        shape = (VIEWS, *feed.walks.shape)
        self._seen = torch.zeros(*shape, FEATURES + network.change)
        self._move_m, self._stands = torch.zeros(*shape, 2), torch.zeros(shape)
        self._known = torch.zeros(shape, dtype=torch.bool)
        with torch.no_grad():
            for view in range(VIEWS):
                for which in torch.split(torch.arange(len(feed)), 8):
                    batch = feed.batch(which, rng, run.how)
                    count, seconds = batch.height_m.shape
                    seen = network.seen(batch.window.flatten(0, 1), batch.height_m.flatten())
                    here = (view, which, slice(seconds))
                    self._seen[here] = seen.reshape(count, seconds, -1).cpu()
                    self._move_m[here] = batch.move_m.reshape(count, seconds, 2).cpu()
                    self._stands[here] = batch.stands.reshape(count, seconds).cpu()
                    self._known[here] = batch.known.reshape(count, seconds).cpu()
        run.optimise([*network.memory.parameters(), *network.head.parameters()], run.params.epochs)

    def epoch(self, epoch: int) -> float:
        """One pass over all walks, each as seen in one of the views; returns the mean loss."""
        run, p = self._run, self._run.params
        rng = run.generator(epoch)
        parts = torch.split(
            self._number[torch.randperm(len(self._number), generator=rng, device=rng.device).cpu()], p.memory_batch
        )
        run.network.train()  # recurrent layers on a GPU ask for it; windows are not looked at any more
        total = 0.0
        for step, which in enumerate(parts):
            view = torch.randint(VIEWS, (len(which),), generator=rng, device=rng.device).cpu()
            known = self._known[view, which]
            seconds = int(known.any(dim=0).nonzero().max()) + 1
            seen, move_m, stands = (
                one[view, which][:, :seconds].to(run.device) for one in (self._seen, self._move_m, self._stands)
            )
            known = known[:, :seconds].to(run.device)
            outputs, _ = run.network.remembering(seen)
            loss = _loss(outputs, move_m.flatten(0, 1), stands.flatten(), known.flatten(), True, p.stand_weight)
            loss = loss + WALK_WEIGHT * _walk_error(outputs, move_m, known).mean()
            total += run.learn(loss, (epoch - p.epochs + step / len(parts)) / p.memory_epochs) * len(which)
        return total / len(self._number)


def _walk_error(outputs: NetworkOutput, move_m: Tensor, known: Tensor) -> Tensor:
    """(B,) squared relative errors of the lengths of walks, of displacements (B, T, 2)."""
    own_m = (outputs.length_m.reshape(known.shape) * known).sum(dim=1)
    true_m = (move_m.norm(dim=2) * known).sum(dim=1)
    error: Tensor = ((own_m - true_m) / (true_m + SHORT_WALK_M)) ** 2
    return error


def _loss(
    outputs: NetworkOutput, move_m: Tensor, stands: Tensor, known: Tensor, is_warm: bool, stand_weight: float
) -> Tensor:
    """Lengths are learned by squared error all along: likelihood would shorten those of doubtful heading."""
    spread = (
        surprise(outputs.with_fixed_length(), move_m) if is_warm else COURSE_WEIGHT * squared_error(outputs, move_m)
    )
    standing = torch.nn.functional.binary_cross_entropy_with_logits(outputs.standing, stands, reduction="none")
    each = spread + LENGTH_WEIGHT * length_error(outputs, move_m) + stand_weight * standing
    return each[known].mean()


def _rate_factor(progress: float) -> float:
    """Rises for the first twentieth, then falls to nothing as a cosine."""
    if progress < 0.05:
        return 0.05 + 0.95 * progress / 0.05
    return float(0.5 * (1 + np.cos(np.pi * (progress - 0.05) / 0.95))) + 1e-3
