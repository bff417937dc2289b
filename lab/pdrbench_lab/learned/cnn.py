"""Training of the network of phones, in some minutes.

Sources are drawn as often as their weights say, and in each of them all walks alike.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
import torch
from torch import nn

from pdrbench.datasets import is_available
from pdrbench.geometry import FloatArray
from pdrbench.registry import make_task
from pdrbench_lab.learned.batches import Feed
from pdrbench_lab.learned.data import BEARERS, ENVIRONMENTS, OWN, SOURCES, Windows, load_or_gather
from pdrbench_lab.learned.measure import window_figures
from pdrbench_lab.learned.model import NetworkOutput, PhoneNetwork, surprise
from pdrbench_lab.learned.weights import store

MODEL: Final = "model.safetensors"
PROGRESS: Final = "progress.json"
MAX_GRADIENT: Final = 5.0
SPREAD_WEIGHT: Final = 0.02  # of the likelihood, which teaches spreads only
STAND_WEIGHT: Final = 0.02
LOOK: Final = 1500  # batches from one look at other people to the next
WEIGHTS: Final = {BEARERS: 1.0, "campus": 1.0, "mall": 1.0, "retail": 0.5, "museum": 0.3}


def usual_sources(chosen: Sequence[str] | None = None, *, has_own: bool = False) -> dict[str, float]:
    """Weights of chosen sources, or of all whose data is here; a user's own recordings are drawn as often as one."""
    if chosen is None:
        chosen = [name for name in WEIGHTS if name == BEARERS or _is_here(name)]
    weights = {name: WEIGHTS.get(name, 1.0) for name in chosen}
    return weights | ({OWN: 1.0} if has_own else {})


def _is_here(source: str) -> bool:
    dataset = make_task(ENVIRONMENTS[source]).dataset
    return dataset is None or is_available(dataset)


@dataclass(frozen=True, slots=True)
class CnnParams:
    """Settings of a run; all ours.

    Attributes:
        sources: How often windows of each of `SOURCES` are drawn, relative to the others.
        people: Number of simulated people.
        val_people: Number of others, on whom progress is measured.
        left_out: Sources, and beginnings of names of walks, that teach nothing.
        steps: Batches.
        batch: Windows in one.
        rate: Of learning, at its largest.
        decay: Of weights.
        seed: Of everything.
        threads: Of torch, and processes that gather windows.
    """

    sources: Mapping[str, float] = field(default_factory=usual_sources)
    people: int = 400
    val_people: int = 64
    left_out: tuple[str, ...] = ()
    steps: int = 9000
    batch: int = 128
    rate: float = 2e-3
    decay: float = 1e-2
    seed: int = 0
    threads: int = 1


def train_cnn(
    out: Path,
    params: CnnParams,
    *,
    windows_in: Path | None = None,
    recordings: Path | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> PhoneNetwork:
    """Trains a network into `model.safetensors` of a folder: the same bytes for the same settings on one machine.

    Args:
        out: Gets the weights, what was measured on the way, and windows with their manifest.
        params: See `CnnParams`.
        windows_in: Folder of windows and manifests, which several runs may share; None for `out`.
        recordings: Folder of a user's own recordings, for the source "own".
        say: Receives messages on progress.
    """
    torch.manual_seed(params.seed)
    torch.set_num_threads(params.threads)
    out.mkdir(parents=True, exist_ok=True)
    kept = windows_in or out
    windows = load_or_gather(kept, tuple(params.sources), params.people, recordings=recordings, jobs=params.threads)
    feed = Feed(windows)
    below = np.cumsum(_chances(windows, feed, params, kept))
    network = PhoneNetwork()
    optimiser = torch.optim.AdamW(network.parameters(), params.rate, weight_decay=params.decay)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, params.rate, total_steps=params.steps, pct_start=0.1)
    rng, drawn = torch.Generator().manual_seed(params.seed), np.random.default_rng(params.seed)
    val = load_or_gather(kept, (BEARERS,), params.val_people, "val", jobs=params.threads)
    val_feed, began_s = Feed(val), time.monotonic()
    losses: list[float] = []
    curve: list[dict[str, float]] = []
    for step in range(params.steps):
        which = np.searchsorted(below, below[-1] * drawn.random(params.batch), side="right")
        batch = feed.batch(torch.from_numpy(which), rng)
        said: NetworkOutput = network(batch.window, batch.height_m)
        loss = nn.functional.smooth_l1_loss(said.move_m, batch.move_m)
        total = loss + SPREAD_WEIGHT * surprise(replace(said, move_m=said.move_m.detach()), batch.move_m).mean()
        total = total + STAND_WEIGHT * nn.functional.binary_cross_entropy_with_logits(said.standing, batch.stands)
        optimiser.zero_grad()
        torch.autograd.backward(total)
        nn.utils.clip_grad_norm_(network.parameters(), MAX_GRADIENT)
        optimiser.step()
        schedule.step()
        losses.append(loss.item())
        if (step + 1) % LOOK == 0 or step + 1 == params.steps:
            figures = window_figures(network, val_feed, val)
            network.train()
            curve.append({"batch": step + 1, "loss": float(np.mean(losses[-LOOK:])), **asdict(figures)})
            said_s = f"batch {step + 1}/{params.steps}, {time.monotonic() - began_s:.0f} s"
            say(f"{said_s}: loss {curve[-1]['loss']:.4f}, val {figures.line()}")
    network.eval()
    store(network, out / MODEL)
    manifest = json.loads((kept / "manifest-train.json").read_text())["sha256"]
    facts = {"params": asdict(params), "windows_sha256": manifest, "curve": curve}
    (out / PROGRESS).write_text(json.dumps(facts, indent=1) + "\n")
    return network


def _chances(windows: Windows, feed: Feed, params: CnnParams, kept: Path) -> FloatArray:
    """(N,) how often each window is drawn: sources by their weights, in each all walks alike."""
    names = [walk["name"] for walk in json.loads((kept / "manifest-train.json").read_text())["walks"]]
    walk, source = (one[feed.number.numpy()] for one in (windows.walk, windows.source))
    is_out = np.array([name.startswith(params.left_out) for name in names])[walk] if params.left_out else False
    is_out = is_out | np.isin(np.array(SOURCES)[source], params.left_out)
    chance = np.where(is_out, 0.0, 1.0 / np.bincount(walk)[walk])
    for number, name in enumerate(SOURCES):
        of = source == number
        chance[of] *= params.sources.get(name, 0.0) / max(chance[of].sum(), 1e-9)
    return chance
