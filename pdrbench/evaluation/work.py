"""What a process does with the items that it is handed."""

from __future__ import annotations

import functools
import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Sequence
from typing import Any, Final

from pdrbench.errors import UnknownNameError
from pdrbench.evaluation import claims, store
from pdrbench.evaluation.apart import play_apart
from pdrbench.evaluation.here import play_here
from pdrbench.evaluation.items import NONE, Item, Outcome, Setting
from pdrbench.evaluation.sources import core_sha256, environment_sha256, target_sha256
from pdrbench.recording import Recording
from pdrbench.registry import PluginError, make_task
from pdrbench.task import Task

OWNER_LOOK_S: Final = 0.5  # between looks whether the owner lives


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
            result = play_here(item, task, recording, setting)
        else:
            result = play_apart(item, task, recording, setting)
        if setting.keeps:
            store.save(result, path)
            return Outcome(name, "done", result.status)
    return Outcome(name, "done", result.status, store.encode(result))
