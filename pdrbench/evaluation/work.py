"""What is to be computed, as names, and what a process does with it."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import gc
import hashlib
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, Literal, cast

import numpy as np

from pdrbench.episode import NUM_ANSWER_COLUMNS, Episode, estimates_from_rows, play
from pdrbench.errors import PdrbenchError, UnknownNameError, UnsuitableError, unknown_name
from pdrbench.evaluation import claims, store
from pdrbench.evaluation.deadlines import Deadlines
from pdrbench.evaluation.sources import (
    core_sha256,
    environment_sha256,
    localizer_target,
    machine,
    target_sha256,
    versions,
)
from pdrbench.isolation.budget import CONSTRUCTION, Budget
from pdrbench.isolation.isolated import IsolatedLocalizer, Isolation, Terms
from pdrbench.isolation.reach import reach_of
from pdrbench.isolation.watching import IsolationError
from pdrbench.localizer import Localizer
from pdrbench.recording import Recording
from pdrbench.registry import PluginError, localizers, make_localizer, make_task
from pdrbench.result import FAILED, UNSUITABLE, Result
from pdrbench.task import HELD_OUT, Task, commitment

JUDGED: Final = ("test", HELD_OUT)  # splits whose truth nobody is told
OWNER_LOOK_S: Final = 0.5  # between looks whether the owner lives
NONE: Final = "none"  # isolation of a localizer that runs in the evaluating process
MOST_LAUNCHES: Final = 3  # a walk over which somebody ends the launcher is given up after this many tries
MOST_KILLS: Final = 2  # so is one over which somebody else, or the system short of memory, killed the localizer


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


def run_group(items: Sequence[Item], setting: Setting) -> list[Outcome]:
    """Computes and stores items, neighbours of which share a recording; never raises for what a localizer does."""
    if setting.owner:
        settle(setting.owner)
    walk = functools.lru_cache(maxsize=1)(functools.partial(_load_walk, secret=setting.secret))  # of neighbours
    outcomes = []
    for item in items:
        if setting.owner and os.getppid() != setting.owner:
            break  # nobody waits for the rest
        if setting.owner and not is_current(item, setting):
            outcomes.append(Outcome(item.name, "stale"))
            continue
        outcomes.append(_run(item, setting, walk))
    if setting.owner:
        _keep_loaded()
    return outcomes


@functools.cache
def settle(owner: int) -> None:
    """Makes a worker process fit for strange code: interrupts are the owner's business, and so is standard output.

    A joblib worker whose owner was killed would wait for more work for minutes; ours ends.
    """
    threading.Thread(target=_end_with, args=(owner,), daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.stdout.flush()
    os.dup2(2, 1)


def _end_with(owner: int) -> None:
    while os.getppid() == owner:
        time.sleep(OWNER_LOOK_S)
    os._exit(1)


@functools.cache
def _keep_loaded() -> None:
    """Takes what the first group has loaded out of garbage collection.

    joblib's workers collect everything once a second, which took 25 ms each time with numpy and an environment loaded.
    """
    gc.collect()
    gc.freeze()


@functools.cache
def _remembered() -> dict[str, object]:
    """What this process has loaded or inherited, by name, with its digest at that time."""
    return {}


def is_current(item: Item, setting: Setting) -> bool:
    """True where the code that this process has in memory is the code that the item asks for.

    A worker of a cluster, which has no owner, lives long and is not replaced: what it cannot have loaded, since only
    processes of localizers do, is looked at afresh.
    """
    memory = _remembered()
    if not setting.owner:
        memory.pop(item.target, None)
    if memory.setdefault("world", setting.world) != setting.world:
        return False
    try:
        for place, digest in (
            ("core", core_sha256),
            (f"env {item.env}", functools.partial(environment_sha256, item.env)),
            (item.target, functools.partial(target_sha256, item.target)),
        ):
            if place not in memory:
                memory[place] = digest()
    except (KeyError, PluginError):
        return False
    loaded = (memory["core"], memory[f"env {item.env}"], memory[item.target])
    wanted = tuple(item.sources[name] for name in ("core_sha256", "environment_sha256", "localizer_sha256"))
    try:
        return loaded == wanted and make_task(item.env).sha256 == item.sources["task_sha256"]
    except UnknownNameError:
        return False


def _load_walk(env: str, walk: str, *, secret: str | None) -> tuple[Task, Recording]:
    task = make_task(env, secret)
    return task, task.load(walk)


def _run(item: Item, setting: Setting, walk: Any) -> Outcome:
    name, path = item.name, setting.folder / item.name
    if setting.keeps and path.exists():
        return Outcome(name, "done")
    with claims.ledger(setting.folder, setting.sweep).claim(name) as note:
        if note is None:
            return Outcome(name, "busy")
        if setting.keeps and path.exists():
            return Outcome(name, "done")  # stored by another sweep between the look and the claim
        task, recording = walk(item.env, item.walk)
        if setting.isolation == NONE:
            result = _play_here(item, task, recording, setting)
        else:
            result = _play_apart(item, task, recording, setting)
        if setting.keeps:
            store.save(result, path)
            return Outcome(name, "done", result.status)
    return Outcome(name, "done", result.status, store.encode(result))


def _play_apart(item: Item, task: Task, recording: Recording, setting: Setting) -> Result:
    """The walk with the localizer in a process of its own; once more where that ended through no fault of its own."""
    num_launches = num_kills = 0
    while True:
        try:
            result, was_killed = _play_isolated(item, task, recording, setting)
        except IsolationError as error:
            num_launches += 1
            if num_launches == MOST_LAUNCHES:
                return dead_result(item, setting, f"{error} (after {num_launches} tries)")
            continue
        num_kills += was_killed
        if not was_killed or num_kills == MOST_KILLS:
            return result


def _play_isolated(item: Item, task: Task, recording: Recording, setting: Setting) -> tuple[Result, bool]:
    """The walk in a child process, and whether that was killed by somebody else."""
    episode = Episode(recording, task)
    terms = Terms(cast(Any, setting.isolation), setting.budget, task.period_s, len(episode))
    localizer = IsolatedLocalizer(
        item.localizer,
        item.target,
        parameters=item.parameters,
        terms=terms,
        reference=None if item.split in JUDGED else recording.reference,
    )
    status, failure = FAILED, ""
    try:
        localizer.start()
        rng = generator(item.seed, item.env, item.walk)
        result = play(localizer, episode, rng, name=item.localizer, seed=item.seed)
        localizer.finish()
    except IsolationError:
        raise
    except UnsuitableError as error:
        result, status, failure = None, UNSUITABLE, str(error)
    except PdrbenchError as error:
        result, failure = None, localizer.failure or str(error)
    finally:
        facts = localizer.close()
    if localizer.compiled_in_vain:
        from pdrbench.isolation.numba_cache import compile_room  # takes half a second to import

        for room in localizer.compiled_in_vain:
            compile_room(room)  # for the walks to come
    if result is None:
        result = episode.result(localizer=item.localizer, seed=item.seed, status=status, failure=failure)
    elif result.status == FAILED:
        result = dataclasses.replace(result, failure=localizer.failure or result.failure)
    missed = {} if result.status != FAILED else {"missed": len(episode) - episode.num_answered}
    provenance = item_provenance(item, setting) | facts | missed
    return dataclasses.replace(result, provenance=provenance), localizer.was_killed


def _play_here(item: Item, task: Task, recording: Recording, setting: Setting) -> Result:
    """The walk with the localizer in this process, which it may take down."""
    deadlines = Deadlines(setting.budget, task.period_s)
    episode = Episode(recording, task)
    provenance = item_provenance(item, setting) | {"isolation": {"mode": NONE, "held": [], "missing": {}}}
    status = FAILED
    deadlines.start()
    try:
        with np.errstate(), contextlib.chdir("."):
            with deadlines(CONSTRUCTION):
                localizer = make_told(_loadable(item), item.parameters, item.split, recording)
            return play(
                localizer,
                episode,
                generator(item.seed, item.env, item.walk),
                name=item.localizer,
                seed=item.seed,
                guard=deadlines,
                provenance=provenance,
            )
    except (PluginError, UnknownNameError, KeyboardInterrupt):
        raise
    except UnsuitableError as error:
        status, failure = UNSUITABLE, str(error)
    except BaseException:  # noqa: BLE001  a constructor may raise anything; an alarm may ring on a threshold
        failure = traceback.format_exc()
    finally:
        deadlines.stop()
    return episode.result(
        localizer=item.localizer, seed=item.seed, status=status, failure=failure, provenance=provenance
    )


def make_told(spec: str, parameters: Mapping[str, Any], split: str, recording: Recording) -> Localizer:
    """A new localizer; one that asks for the truth is told it, where the truth is public."""
    localizer = make_localizer(spec, **parameters)
    if hasattr(localizer, "tell"):
        if split in JUDGED:
            raise UnsuitableError(
                f"{spec} is told the truth, which nobody is on a {split} split; run it on train or val"
            )
        localizer.tell(recording.reference)
    return localizer


def _loadable(item: Item) -> str:
    return item.target if item.target.partition(":")[0].endswith(".py") else item.localizer


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
