"""The walks on which the claims of a paper are measured."""

from __future__ import annotations

from pdrbench.building import Building
from pdrbench.localizer import Briefing
from pdrbench.recording import Recording
from pdrbench.registry import make_task


def walk_of(env: str, seed: int) -> tuple[Recording, Briefing]:
    """The walk of a seed, of the test split of an environment, and its briefing."""
    task = make_task(env)
    recording = task.load(task.split("test")[seed])
    return recording, task.brief(recording)


def map_of(recording: Recording) -> Building:
    """The building of a walk that has one."""
    assert recording.building is not None
    return recording.building
