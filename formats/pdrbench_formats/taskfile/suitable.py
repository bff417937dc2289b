"""Which localizers decline the walks of a task file."""

from __future__ import annotations

from collections.abc import Iterable

from pdrbench.episode import Episode
from pdrbench.evaluation.suitability import declining
from pdrbench.registry import make_task
from pdrbench.result import UNSUITABLE, Result


def declined_results(names: Iterable[str], env: str, split: str, walks: Iterable[str]) -> list[Result]:
    """A result on these walks for each localizer that declines an environment, see `declining`."""
    task = make_task(env)
    episodes = [Episode(task.load(walk), task) for walk in walks]
    return [
        episode.result(localizer=name, seed=0, status=UNSUITABLE, failure=reason)
        for name, reason in declining(names, env, split).items()
        for episode in episodes
    ]
