"""Training: squared error first, then Gaussian likelihood; checkpoints after every epoch, resumed where it was stopped.

An epoch draws from a generator made of the seed and its number, so that a run that was resumed ends where one that was
not does: the same numbers on a CPU with the same number of threads.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from pdrbench.errors import PdrbenchError
from pdrbench_baselines.learned.batches import Augmentation, Batch, Feed
from pdrbench_baselines.learned.data import OWN, SOURCES, USUAL, load_or_gather
from pdrbench_baselines.learned.measure import LEVELS, WindowFigures, window_figures, windows_told
from pdrbench_baselines.learned.model import Network, Told, length_error, squared_error, surprise
from pdrbench_baselines.learned.weights import load_into, restore, store

MODEL: Final = "model.safetensors"  # the best one so far
STATE: Final = "state.safetensors"
PROGRESS: Final = "progress.json"
LARGEST_GRADIENT: Final = 5.0
LENGTH_WEIGHT: Final = 5.0  # ours: an error of 0.3 m counts half of what one of the course does


@dataclass(frozen=True, slots=True)
class TrainParams:
    """Settings of a run; all ours.

    Attributes:
        arch, width: Of the network.
        sources: Some of `SOURCES`.
        people: Number of people who walk for it.
        val_people: Number of those by whom the best epoch is chosen.
        epochs: Times that every window is seen.
        warm_up: Part of them with squared errors.
        batch: Walks at a time.
        rate: Of learning, at its largest.
        decay: Of weights.
        mall_repeats: Recorded walks are few: so often each is seen in an epoch.
        stand_weight: Of the loss for standing.
        keep: "best", the epoch that errs least on the people to choose by, or "last", where those are no guide.
        seed: Of everything.
        threads: Of torch.
    """

    arch: str = "resnet"
    width: int = 16
    sources: tuple[str, ...] = USUAL
    people: int = 1000
    val_people: int = 60
    epochs: int = 8
    warm_up: float = 0.3
    batch: int = 4
    rate: float = 1.5e-3
    decay: float = 1e-2
    mall_repeats: int = 6
    stand_weight: float = 0.05
    keep: str = "best"
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
        say: Is told what happens.

    Returns:
        What the best epoch says of the people to choose by.

    Raises:
        PdrbenchError: The folder holds a run of other settings, or its loss is not a number any more.
    """
    began_s = time.monotonic()
    torch.set_num_threads(params.threads)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    out.mkdir(parents=True, exist_ok=True)
    kept = windows_in or out
    say(f"windows of {', '.join(params.sources)}; they are kept in {kept}, and made anew in some minutes")
    windows = load_or_gather(kept, params.sources, params.people, recordings=recordings)
    val = load_or_gather(kept, ("people",), params.val_people, "val")
    walks = len(np.unique(windows.walk))
    say(f"{len(windows)} windows of {walks} walks, {len(val)} of other people to choose by; on {device}")
    run = _Run(out, params, device)
    feed, val_feed = Feed(windows, device), Feed(val, device)
    for epoch in range(run.done, params.epochs):
        started_s = time.monotonic()
        loss = run.epoch(epoch, feed, _repeated(feed, params.mall_repeats))
        figures = window_figures(run.network, val_feed, val)
        run.keep(epoch, loss, figures)
        took_s = time.monotonic() - started_s
        say(f"epoch {epoch + 1}/{params.epochs} {took_s:.0f} s: loss {loss:.3f}, val {figures.line()}")
        if budget_min is not None and time.monotonic() - began_s + took_s > 60.0 * budget_min:
            say(f"{budget_min:g} min are used up; run the same again to go on")
            break
    if not (out / MODEL).is_file():
        raise PdrbenchError(f"{out}: no epoch was run; give at least one")
    best = _fit_claim(restore(out / MODEL).to(device), val_feed)
    store(best, out / MODEL)
    figures = window_figures(best, val_feed, val)
    _write_card(out, kept, params, figures)
    return figures


def _fit_claim(network: Network, feed: Feed) -> Network:
    """The network with its standard deviations multiplied such that the shares of errors they hold are nearest to those
    that are claimed: likelihood heeds the few large errors, for which the others are claimed too large."""
    network.claim.fill_(1.0)
    squares = windows_told(network, feed).whitened_squares
    claims = np.geomspace(0.6, 1.6, 101)
    held = [[float(np.mean(squares / claim**2 <= -2.0 * np.log(1.0 - level))) for level in LEVELS] for claim in claims]
    worst = np.abs(np.array(held) - np.array(LEVELS)).max(axis=1)
    network.claim.fill_(float(claims[np.argmin(worst)]))
    return network


def _repeated(feed: Feed, repeats: int) -> Tensor:
    """Numbers of the walks of an epoch."""
    number = torch.arange(len(feed))
    is_recorded = (feed.source == SOURCES.index("mall")) | (feed.source == SOURCES.index(OWN))
    recorded = number[is_recorded]
    return torch.cat([number, *[recorded] * (repeats - 1)])


class _Run:
    """Network, optimiser, and what is on the disk of them."""

    def __init__(self, out: Path, params: TrainParams, device: str) -> None:
        self._out, self._params, self._device = out, params, device
        torch.use_deterministic_algorithms(device == "cpu")
        torch.manual_seed(params.seed)
        self.network = Network(params.arch, params.width).to(device)
        self._optimiser = torch.optim.AdamW(self.network.parameters(), lr=params.rate, weight_decay=params.decay)
        self.done, self._best = 0, float("inf")
        self._curve: list[dict[str, float]] = []
        if (out / PROGRESS).is_file():
            self._resume()

    def epoch(self, epoch: int, feed: Feed, number: Tensor) -> float:
        """One pass over windows by number; returns the mean loss."""
        p = self._params
        rng = torch.Generator().manual_seed(p.seed * 1000 + epoch + 1)
        torch.manual_seed(p.seed * 1000 + epoch + 1)  # of dropout
        order = number[torch.randperm(len(number), generator=rng)]
        parts = torch.split(order, p.batch)
        is_warm = epoch >= p.warm_up * p.epochs
        self.network.train()
        total = 0.0
        for step, which in enumerate(parts):
            share = (epoch + step / len(parts)) / p.epochs
            for group in self._optimiser.param_groups:
                group["lr"] = p.rate * _rate_share(share)
            batch = feed.batch(which, rng, Augmentation())
            told, _ = self.network.walks(batch.window, batch.height_m)
            loss = _loss(told, batch, is_warm, p.stand_weight)
            self._optimiser.zero_grad(set_to_none=True)
            torch.autograd.backward(loss)
            torch.nn.utils.clip_grad_norm_(self.network.parameters(), LARGEST_GRADIENT)
            self._optimiser.step()
            total += float(loss.detach()) * len(which)
        loss_mean = total / max(sum(len(part) for part in parts), 1)
        if not np.isfinite(loss_mean):
            raise PdrbenchError(f"epoch {epoch + 1}: the loss is {loss_mean}; lower the rate and begin in a new folder")
        return loss_mean

    def keep(self, epoch: int, loss: float, figures: WindowFigures) -> None:
        """Stores the network where it is the best so far, and what it takes to go on."""
        self.done = epoch + 1
        self._curve.append({"epoch": epoch + 1, "loss": loss, **asdict(figures)})
        is_warm = epoch >= self._params.warm_up * self._params.epochs
        judged = figures.error_m if is_warm else 1e3 + figures.error_m  # a network without a covariance is no choice
        if judged < self._best or self._params.keep == "last":
            self._best = judged
            store(self.network, self._out / MODEL)
        state = {f"network.{name}": values for name, values in self.network.state_dict().items()}
        for number, moments in self._optimiser.state_dict()["state"].items():
            state |= {f"optimiser.{number}.{name}": torch.as_tensor(value) for name, value in moments.items()}
        save_file({name: values.detach().cpu().contiguous() for name, values in state.items()}, self._out / STATE)
        told = {"params": asdict(self._params), "done": self.done, "best": self._best, "curve": self._curve}
        (self._out / PROGRESS).write_text(json.dumps(told, indent=1) + "\n")

    def _resume(self) -> None:
        told = json.loads((self._out / PROGRESS).read_text())
        ours = json.loads(json.dumps(asdict(self._params)))
        if told["params"] != ours:
            other = sorted(name for name in ours if ours[name] != told["params"].get(name))
            raise PdrbenchError(
                f"{self._out} holds a run with other settings ({', '.join(other)}); give another folder"
            )
        self.done, self._best, self._curve = told["done"], told["best"], told["curve"]
        state = load_file(self._out / STATE)
        own = {name.removeprefix("network."): one for name, one in state.items() if name.startswith("network.")}
        load_into(self.network, own, self._out / STATE)
        moments: dict[int, dict[str, Any]] = {}
        for name, value in state.items():
            if name.startswith("optimiser."):
                _, number, which = name.split(".")
                moments.setdefault(int(number), {})[which] = value
        groups = self._optimiser.state_dict()["param_groups"]
        self._optimiser.load_state_dict({"state": moments, "param_groups": groups})


def _loss(told: Told, batch: Batch, is_warm: bool, stand_weight: float) -> Tensor:
    """Lengths are learned by squared error all along: likelihood would shorten those of doubtful course."""
    move_m, known = batch.move_m, batch.known
    spread = surprise(told.with_fixed_length(), move_m) if is_warm else squared_error(told, move_m)
    stands = torch.nn.functional.binary_cross_entropy_with_logits(told.standing, batch.stands, reduction="none")
    each = spread + LENGTH_WEIGHT * length_error(told, move_m) + stand_weight * stands
    return each[known].mean()


def _rate_share(share: float) -> float:
    """Rises for the first twentieth, then falls to nothing as a cosine."""
    if share < 0.05:
        return 0.05 + 0.95 * share / 0.05
    return float(0.5 * (1 + np.cos(np.pi * (share - 0.05) / 0.95))) + 1e-3


def _write_card(out: Path, kept: Path, params: TrainParams, figures: WindowFigures) -> None:
    manifests = {
        group: json.loads((kept / f"manifest-{group}.json").read_text())["sha256"] for group in ("train", "val")
    }
    card = {"params": asdict(params), "windows_sha256": manifests, "val": asdict(figures)}
    (out / "card.json").write_text(json.dumps(card, indent=1) + "\n")
