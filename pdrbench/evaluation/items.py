"""What is to be computed, as names, and what is known of it before anything has run."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from pdrbench.episode import NUM_ANSWER_COLUMNS, estimates_from_rows
from pdrbench.errors import unknown_name
from pdrbench.evaluation import store
from pdrbench.evaluation.sources import (
    core_sha256,
    environment_sha256,
    localizer_target,
    machine,
    target_sha256,
    versions,
)
from pdrbench.isolation.budget import Budget
from pdrbench.isolation.isolated import Isolation
from pdrbench.isolation.reach import reach_of
from pdrbench.registry import localizers, make_task
from pdrbench.result import FAILED, Result
from pdrbench.task import HELD_OUT, Task, commitment

JUDGED: Final = ("test", HELD_OUT)  # splits whose truth nobody is told
NONE: Final = "none"  # isolation of a localizer that runs in the evaluating process


@dataclass(frozen=True, slots=True)
class Item:
    """One localizer on one walk with one seed, as names only.

    Attributes:
        env: Environment id.
        split: Split of the walk.
        walk: Walk id.
        localizer: As the user named it.
        target: Where its class is, a file with its absolute path.
        seed: Seed.
        parameters: Keyword arguments of the class.
        sources: Digest by what it is taken of; what runs must agree with it.
        key: Sha256 of everything above but `target`, of the budget and of the isolation that was asked for.
    """

    env: str
    split: str
    walk: str
    localizer: str
    target: str
    seed: int
    parameters: Mapping[str, Any]
    sources: Mapping[str, str]
    key: str

    @property
    def name(self) -> str:
        """File name of the result."""
        return store.result_name(self.env, self.localizer, self.walk, self.seed, self.key)


@dataclass(frozen=True, slots=True)
class Setting:
    """What all items of a sweep share.

    Attributes:
        folder: Where results go, and the notes of who has what in hand.
        sweep: Id of the sweep.
        keeps: True where results are stored in `folder`; False where they are handed back.
        budget: Time of every localizer.
        isolation: What localizers are run in: "auto", "process" or "none".
        owner: Process that gives the orders; 0 where the work is done in that process itself.
        world: What a process inherits and cannot learn later; a process of another world is not used again.
        secret: Behind the walks, where they are held out; never handed to what runs a localizer, never stored.
    """

    folder: Path
    sweep: str
    keeps: bool
    budget: Budget
    isolation: Isolation
    owner: int
    world: tuple[str, ...]
    secret: str | None = field(default=None, repr=False)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of an item.

    Attributes:
        name: File name of the result.
        state: "done"; "busy": a living process of another sweep computes it; "stale": this process, or the
            orders, are older than the sources.
        status: Status of the result where this process computed it.
        content: The result as in a file, where it is not stored.
    """

    name: str
    state: Literal["done", "busy", "stale"]
    status: str = ""
    content: bytes = b""


def plan(
    specs: Sequence[str],
    envs: Sequence[str],
    *,
    split: str,
    seeds: int,
    walks: int | Sequence[str] | None,
    parameters: Mapping[str, Any],
    budget: Budget,
    isolation: Isolation,
    secret: str | None = None,
) -> list[Item]:
    """Every item of a sweep, what shares a recording side by side."""
    core = core_sha256()
    targets = {spec: _find(spec) for spec in specs}
    if isolation != NONE:
        for spec, target in targets.items():
            reach_of(spec, target)  # raises where a child could not load it
    digests = {spec: target_sha256(target) for spec, target in targets.items()}
    items = []
    for env in envs:
        task = make_task(env, secret)
        sources = {"task_sha256": task.sha256, "environment_sha256": environment_sha256(task.id), "core_sha256": core}
        for walk in _chosen(task, split, walks):
            for spec in specs:
                for seed in range(seeds):
                    ingredients = {
                        "env": task.id,
                        "split": split,
                        "walk": walk,
                        "localizer": spec,
                        "seed": seed,
                        "parameters": dict(parameters),
                        "sources": sources | {"localizer_sha256": digests[spec]},
                    }
                    context = {
                        "version": versions()["pdrbench"],
                        "budget": budget.record(),
                        "isolation": isolation,
                    }
                    key = store.result_key(ingredients | context)
                    items.append(Item(**ingredients, target=targets[spec], key=key))  # type: ignore[arg-type]
    return items


def _chosen(task: Task, split: str, walks: int | Sequence[str] | None) -> Sequence[str]:
    """The first so many walks of a split, or those named."""
    known = task.split(split)
    if walks is None or isinstance(walks, int):
        return known[:walks]
    for walk in walks:
        if walk not in known:
            raise unknown_name(f"walk in the {split} split of {task.id}", walk, known)
    return [walk for walk in known if walk in walks]


def _find(spec: str) -> str:
    if ":" not in spec and spec not in localizers():
        raise unknown_name("localizer", spec, localizers())
    return localizer_target(spec)


def generator(seed: int, env: str, walk: str) -> np.random.Generator:
    """The localizer's randomness: the same for a seed and a walk, whatever ran before and wherever."""
    digest = hashlib.sha256(f"{env}\n{walk}".encode()).digest()
    return np.random.default_rng(np.random.SeedSequence([seed, *np.frombuffer(digest, dtype="<u4").tolist()]))


def item_provenance(item: Item, setting: Setting) -> dict[str, object]:
    """What produced a result."""
    return {
        "key": item.key,
        **item.sources,
        "parameters": dict(item.parameters),
        "budget": setting.budget.record(),
        "versions": versions(),
        "machine": machine(),
        "started_at": datetime.now(UTC).isoformat(timespec="seconds"),
        **({} if setting.secret is None else {"held_out": commitment(setting.secret)}),
    }


def dead_result(item: Item, setting: Setting, failure: str) -> Result:
    """The result of a walk over which the process died: nothing of what was answered is left."""
    nothing = np.zeros(0)
    return Result(
        env=item.env,
        split=item.split,
        walk=item.walk,
        localizer=item.localizer,
        seed=item.seed,
        estimates=estimates_from_rows(nothing, np.zeros((0, NUM_ANSWER_COLUMNS))),
        step_s=nothing,
        status=FAILED,
        failure=failure,
        provenance=item_provenance(item, setting) | {"isolation": {"mode": "unknown", "held": [], "missing": {}}},
    )
