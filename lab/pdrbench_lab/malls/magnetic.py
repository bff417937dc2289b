"""The environments of the malls with a magnetic survey, of the very walks that their radio survey is made of.

The magnetometer of these phones is calibrated as they go: what a walk adds to the field in the frame of the phone is
constant within nearly every walk and differs by some microtesla from one recording session to the next. The survey
keeps it, as a survey would.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import Final

from pdrbench.recording import MagneticMap, Recording
from pdrbench.task import Task
from pdrbench_envs.malls import environment
from pdrbench_lab.malls.field_survey import fields_of

_DESCRIPTION: Final = """
**Magnetic survey**: the briefing also carries what the magnetometers of the walks of the radio survey measured,
averaged over 0.4 s, in a level frame that turns with the phone (right, ahead, up), at places interpolated between
waypoints. A calibrated magnetometer is off by some microtesla, by another vector in every recording session.
"""


def task() -> Task:
    """`MallPhone-v2` with a magnetic survey."""
    return _with_magnetic_map(environment.task(), "MallPhoneMagnetic-v1")


def task_lost() -> Task:
    """`MallPhoneLost-v2` with a magnetic survey."""
    return _with_magnetic_map(environment.task_lost(), "MallPhoneMagneticLost-v1")


def _with_magnetic_map(base: Task, name: str) -> Task:
    return dataclasses.replace(
        base,
        id=name,
        summary=f"{base.summary}, and a magnetic survey",
        description=base.description + _DESCRIPTION,
        magnetic_map=functools.partial(_magnetic_map, environment.walks_at_hand()),
    )


def _magnetic_map(at_hand: frozenset[str], recording: Recording) -> MagneticMap:
    played = environment.played_walk(recording.id)
    return _survey(played.site, played.part, at_hand)


@functools.lru_cache(maxsize=6)
def _survey(site: str, survey: str | int, at_hand: frozenset[str]) -> MagneticMap:
    return fields_of(environment.paths_of(site, at_hand)).magnetic_map(environment.survey_paths(site, survey, at_hand))
