"""A localizer on one walk with one seed: what is known of it before anything has run, and of its result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.episode import Episode
from pdrbench.errors import REFUSALS, PdrbenchError, unknown_name
from pdrbench.evaluation import store
from pdrbench.evaluation.jobs import Finished, Job, JobContext
from pdrbench.evaluation.origin import environment_version, localizer_target, machine, target_sha256, versions
from pdrbench.evaluation.randomness import secret_nonce
from pdrbench.process.budget import Budget
from pdrbench.process.launch import CONFINED, Isolation, find_launcher
from pdrbench.registry import make_task, task_place
from pdrbench.result import FAILED, Result
from pdrbench.task import HELD_OUT, Task, commitment
from pdrbench.trajectory import ESTIMATE_COLUMNS, Estimates

SCORED_SPLIT: Final = "test"  # where none is named
HIDDEN_SPLITS: Final = ("test", HELD_OUT)  # no localizer is given their truth
MAX_DEATHS: Final = 3  # processes of ours that may die over a walk: the machine may be short of memory
NONE: Final = "none"  # isolation of a localizer that runs in the evaluating process


@dataclass(frozen=True, slots=True, kw_only=True)
class WalkJob(Job):
    """One localizer on one walk with one seed."""

    env: str  # id
    task: str  # the environment as `make_task` takes it: its id, or the absolute path of a task that is a file
    split: str
    walk: str
    localizer: str  # as the user named it
    target: str  # where its class is, a file with its absolute path
    parameters: Mapping[str, Any]  # keyword arguments of the class
    budget: Budget
    isolation: Isolation  # what the localizer runs in
    nonce: str = field(default="", repr=False)  # of its randomness, see `randomness`
    # Behind the walks, where they are held out; never handed to what runs a localizer, never stored
    secret: str | None = field(default=None, repr=False)

    @property
    def label(self) -> str:
        """What progress calls it."""
        return f"{self.localizer} on {self.env}"

    def present_sources(self) -> Mapping[str, str]:
        """What `sources` is at present, on this machine."""
        task = make_task(self.task, self.secret)
        return sources_of(task, self.walk, environment_version(self.task), target_sha256(self.target))

    def decode(self, content: bytes, path: Path) -> Result:
        """The result in a file."""
        return store.decode(content, str(path))

    def give_up(self, context: JobContext, how: str) -> Finished:
        """A failed result without answers."""
        failure = f"the evaluating process died over this walk: {' '.join(how.split())}"
        return FAILED, store.encode(crashed_result(self, failure))


def plan_walks(
    specs: Mapping[str, Sequence[str]],
    *,
    split: str | None,
    seeds: Sequence[int],
    walks: int | Sequence[str] | None,
    parameters: Mapping[str, Any],
    budget: Budget,
    isolation: Isolation,
    nonce: str = "",
    secret: str | None = None,
) -> list[WalkJob]:
    """Every job of a sweep, those on one walk side by side; `specs` are the localizers of each environment."""
    nonce = nonce if secret is None else secret_nonce(secret)
    targets = {spec: localizer_target(spec) for of_env in specs.values() for spec in of_env}
    if isolation != NONE:
        launcher = find_launcher(isolation)
        for spec, target in targets.items():
            launcher.check(spec, target)
    digests = {spec: target_sha256(target) for spec, target in targets.items()}
    jobs = []
    places: dict[str, str] = {}
    for env, of_env in specs.items():
        task, place = make_task(env, secret), task_place(env) or ""
        env = task.id
        if places.setdefault(env, place) != place:
            raise PdrbenchError(
                f"two environments call themselves {env}: {places[env] or 'the registered one'} and {place}"
            )
        version = environment_version(place or env)
        played = split or SCORED_SPLIT
        for walk in _chosen(task, played, walks):
            for spec in of_env:
                for seed in seeds:
                    ingredients: dict[str, Any] = {
                        "env": env,
                        "split": played,
                        "walk": walk,
                        "localizer": spec,
                        "seed": seed,
                        "parameters": dict(parameters),
                        "sources": sources_of(task, walk, version, digests[spec]),
                        "isolation": isolation,
                    }
                    if nonce:  # results without one keep the keys that they are stored under
                        ingredients["nonce"] = nonce
                    context = {"versions": versions(), "budget": asdict(budget)}
                    key = store.result_key(ingredients | context)
                    name = store.result_name(env, spec, walk, seed, key)
                    jobs.append(
                        WalkJob(
                            **ingredients,
                            name=name,
                            key=key,
                            # Jobs on one walk share the recording; strangers' begin in an order of chance, one by one
                            group=(env, walk, name) if isolation == CONFINED else (env, walk),
                            family=name,  # a localizer that crashes has a process of its own anyway
                            max_deaths=MAX_DEATHS,
                            task=place or env,
                            target=targets[spec],
                            budget=budget,
                            secret=secret,
                        )
                    )
    return jobs


def sources_of(task: Task, walk: str, version: str, localizer_sha256: str) -> dict[str, str]:
    """What has to agree, besides ids and versions, for a stored result to be used again."""
    return {**task.walk_identity(walk), "environment": version, "localizer_sha256": localizer_sha256}


def _chosen(task: Task, split: str, walks: int | Sequence[str] | None) -> Sequence[str]:
    """The first so many walks of a split, or those named."""
    known = task.split(split)
    if walks is None or isinstance(walks, int):
        return known[:walks]
    for walk in walks:
        if walk not in known:
            raise unknown_name(f"walk in the {split} split of {task.id}", walk, known)
    return [walk for walk in known if walk in walks]


def load_walk(job: WalkJob, memory: dict[str, Any]) -> Episode:
    """The walk of a job, fresh; the recording is loaded once for neighbours."""
    if memory.get("walk") != job.group:
        task = make_task(job.task, job.secret)
        memory.update(walk=job.group, task=task, recording=task.load(job.walk))
    return Episode(memory["recording"], memory["task"])


def refused(job: WalkJob, memory: dict[str, Any]) -> Result | None:
    """The failed result of a walk that cannot be loaded or replayed; None where it can."""
    try:
        load_walk(job, memory)
    except REFUSALS as error:
        return crashed_result(job, f"the walk is refused: {error}")
    return None


def provenance_of(job: WalkJob) -> dict[str, object]:
    """What produces the result."""
    return {
        "key": job.key,
        **job.sources,
        "parameters": dict(job.parameters),
        "budget": asdict(job.budget),
        "versions": versions(),
        "machine": machine(),
        "started_at": datetime.now(UTC).isoformat(timespec="seconds"),
        **({} if job.task == job.env else {"task": job.task}),
        **({} if not job.nonce or job.secret is not None else {"nonce": job.nonce}),
        **({} if job.secret is None else {"held_out": commitment(job.secret)}),
    }


def crashed_result(job: WalkJob, failure: str) -> Result:
    """The result of a walk over which the process died: no answer is left."""
    return Result(
        env=job.env,
        split=job.split,
        walk=job.walk,
        localizer=job.localizer,
        seed=job.seed,
        estimates=Estimates.from_columns(np.zeros(0), np.zeros((len(ESTIMATE_COLUMNS), 0))),
        step_s=np.zeros(0),
        status=FAILED,
        failure=failure,
        provenance=provenance_of(job) | {"isolation": {"mode": "unknown", "held": [], "missing": {}}},
    )
