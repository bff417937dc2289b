"""Which localizers decline an environment: found by a try of `reset`, without a process for each, and remembered."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.episode import Episode
from pdrbench.errors import REFUSALS, UnsuitableError
from pdrbench.evaluation.inprocess_run import make_informed
from pdrbench.evaluation.origin import environment_version, localizer_target, package_sha256, target_sha256
from pdrbench.evaluation.store import remember, remembered
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing
from pdrbench.radio import survey_of_table
from pdrbench.recording import MagneticMap
from pdrbench.registry import localizers, make_task
from pdrbench.settings import split_name

TRIED_WALKS: Final = 4  # a localizer that declines them all declines an environment; every mounting is among them
TRUSTED: Final = "pdrbench"  # the distribution whose localizers may run in this process
ROOM_M: Final = 5.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
MEMORY: Final = "suitability.json"


def declining(names: Iterable[str], env: str, split: str) -> dict[str, str]:
    """The reason of each localizer that declines the first walks of an environment, as a leaderboard tries them.

    Only localizers that come with pdrbench are asked, in this process. They are asked with a room in place of the
    building and one scan in place of the survey first: those that go on from there are to be played, and get no
    time to prepare themselves here.

    Args:
        names: Of localizers.
        env: As `make_task` takes it.
        split: Which walks.
    """
    task = make_task(env)
    walks = task.split(split)[:TRIED_WALKS]
    known = localizers()
    specs = [name for name in names if (entry := known.get(split_name(name)[0])) and entry.package == TRUSTED]
    # What another environment of Python has installed decides too, such as an optional dependency
    installed = sorted(path.name for place in sys.path for path in Path(place or ".").glob("*.dist-info"))
    identities = [[walk, task.walk_identity(walk)] for walk in walks]
    common = [environment_version(env), package_sha256("pdrbench"), installed, split, task.id, identities]
    keys = {spec: _key(spec, localizer_target(spec), target_sha256(localizer_target(spec)), common) for spec in specs}
    reasons = remembered(MEMORY)
    if todo := [spec for spec in specs if keys[spec] not in reasons]:
        reasons |= {keys[spec]: why for spec, why in _tried(todo, env, split, walks).items()}
        remember(MEMORY, reasons)
    return {spec: reasons[keys[spec]] for spec in specs if reasons[keys[spec]]}


def _tried(specs: Sequence[str], env: str, split: str, walks: Iterable[str]) -> dict[str, str]:
    """Why each declines the first walk that can be loaded, empty where it takes any of them."""
    task = make_task(env)
    why: dict[str, str] = {}
    left = list(specs)
    for walk in walks:
        try:
            episode = Episode(task.load(walk), task)
        except REFUSALS:
            continue
        for spec in list(left):
            reason = _reason(spec, episode, split)
            why[spec] = reason and why.get(spec, reason)
            if not reason:
                left.remove(spec)
    return {spec: why.get(spec, "") for spec in specs}


def _reason(spec: str, episode: Episode, split: str) -> str:
    """Why a localizer declines a walk; empty where it has to be played to know."""
    reason = ""
    for given in (_reduced(episode.briefing), episode.briefing):
        try:
            make_informed(spec, {}, split, episode.recording).reset(given, np.random.default_rng(0))
        except UnsuitableError as error:
            reason = str(error)
        except Exception:  # noqa: BLE001  it is played, and what it raises is reported
            return ""
        else:
            return ""
    return reason


def _reduced(briefing: Briefing) -> Briefing:
    """The same with a room about the start in place of the building, one scan or sample there in place of a survey."""
    start = briefing.start
    xy_m: FloatArray = np.zeros(2) if start is None else start.xy_m
    level = 0 if start is None else start.level
    room = Building("room", (FloorPolygon("room", xy_m + ROOM_M, np.full(4, WALL), 0.0, level),))
    scan = survey_of_table([xy_m], level, [0], np.array([[-50.0]]))
    sample = MagneticMap(xy_m[None], np.array([level]), np.zeros(1, dtype=np.int64), np.eye(3)[:1])
    return dataclasses.replace(
        briefing,
        building=None if briefing.building is None else room,
        radio_map=None if briefing.radio_map is None else scan,
        magnetic_map=None if briefing.magnetic_map is None else sample,
    )


def _key(*ingredients: object) -> str:
    return hashlib.sha256(json.dumps(ingredients).encode()).hexdigest()
