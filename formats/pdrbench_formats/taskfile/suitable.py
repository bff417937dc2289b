"""Which localizers decline walks, found out without a process for each."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Final

import numpy as np

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.episode import Episode
from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing
from pdrbench.radio import survey_of_table
from pdrbench.recording import Recording
from pdrbench.registry import localizers, make_localizer
from pdrbench.result import UNSUITABLE, Result
from pdrbench.task import Task

COUNTS: Final = "counts"  # attribute of a localizer whose metres are a count of what it says
TRUSTED: Final = "pdrbench"  # the distribution whose localizers may run in this process
ROOM_M: Final = 5.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def declining(names: Iterable[str], task: Task, walks: Iterable[str]) -> list[Result]:
    """A result on every walk for each localizer that declines them all.

    Only localizers that come with pdrbench are asked, in this process. They are asked with a room in place of the
    building and one scan in place of the survey first: those that go on from there are to be played, and get no
    time to prepare themselves here.
    """
    recordings = [task.load(walk) for walk in walks]
    found = []
    for name in names:
        entry = localizers().get(name)
        if entry is None or entry.package != TRUSTED:
            continue
        reasons = [_reason(name, task, recording) for recording in recordings]
        if all(reasons):
            pairs = zip(recordings, reasons, strict=True)
            found += [
                Episode(recording, task).result(localizer=name, seed=0, status=UNSUITABLE, failure=reason)
                for recording, reason in pairs
            ]
    return found


def counting(names: Iterable[str]) -> dict[str, str]:
    """What a metre of the path stands for, by localizer, of those that come with pdrbench and count instead."""
    found = {}
    for name in names:
        entry = localizers().get(name)
        if entry is not None and entry.package == TRUSTED:
            found[name] = str(getattr(make_localizer(name), COUNTS, ""))
    return {name: what for name, what in found.items() if what}


def _reason(name: str, task: Task, recording: Recording) -> str:
    """Why a localizer declines a walk; empty where it has to be played to know."""
    briefing = task.brief(recording)
    reason = ""
    for given in (_reduced(briefing), briefing):
        try:
            make_localizer(name).reset(given, np.random.default_rng(0))
        except UnsuitableError as error:
            reason = str(error)
        except Exception:  # noqa: BLE001  it is played, and what it raises is reported
            return ""
        else:
            return ""
    return reason


def _reduced(briefing: Briefing) -> Briefing:
    """The same with a room about the start in place of the building, and one scan there in place of the survey."""
    start = briefing.start
    xy_m: FloatArray = np.zeros(2) if start is None else start.xy_m
    level = 0 if start is None else start.level
    room = Building("room", (FloorPolygon("room", xy_m + ROOM_M, np.full(4, WALL), 0.0, level),))
    scan = survey_of_table([xy_m], level, [0], np.array([[-50.0]]))
    return dataclasses.replace(
        briefing,
        building=None if briefing.building is None else room,
        radio_map=None if briefing.radio_map is None else scan,
    )
