"""The environments of the malls with the walk's own session in the survey, to measure what leaving it out does.

Not registered: `pdrbench malls own-session` plays them beside `MallPhone-v2` and `MallPhoneLost-v2`.
"""

from __future__ import annotations

import dataclasses

from pdrbench.recording import RadioMap, Recording
from pdrbench.task import Task
from pdrbench_envs.malls import environment
from pdrbench_envs.malls.splits import survey_of, walks
from pdrbench_envs.malls.surveys import scans_of


def known() -> Task:
    """`MallPhone-v2`, and the scans of the other walks of a walk's session."""
    return _with_own_session(environment.task(), "MallPhoneOwnSession-v1")


def lost() -> Task:
    """`MallPhoneLost-v2`, and the scans of the other walks of a walk's session."""
    return _with_own_session(environment.task_lost(), "MallPhoneLostOwnSession-v1")


def _with_own_session(task: Task, name: str) -> Task:
    return dataclasses.replace(task, id=name, radio_map=_radio_map)


def _radio_map(recording: Recording) -> RadioMap:
    played = environment.played_walks()[recording.id]
    here = [walk for walk in walks() if walk.site == played.site]
    survey = {walk.path for walk in survey_of(played.part)}
    survey |= {walk.path for walk in here if walk.session == played.session}
    return scans_of(tuple(walk.path for walk in here)).radio_map(sorted(survey - {played.path}))
