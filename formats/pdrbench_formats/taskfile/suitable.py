"""Which localizers decline the walks of a task file, and which count instead."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from pdrbench.episode import Episode
from pdrbench.evaluation.suitability import TRUSTED, declining
from pdrbench.registry import localizers, make_localizer, make_task
from pdrbench.result import UNSUITABLE, Result

COUNTS: Final = "counts"  # attribute of a localizer whose metres are a count of what it says


def declined_results(names: Iterable[str], env: str, split: str, walks: Iterable[str]) -> list[Result]:
    """A result on these walks for each localizer that declines an environment, see `declining`."""
    task = make_task(env)
    episodes = [Episode(task.load(walk), task) for walk in walks]
    return [
        episode.result(localizer=name, seed=0, status=UNSUITABLE, failure=reason)
        for name, reason in declining(names, env, split).items()
        for episode in episodes
    ]


def counting(names: Iterable[str]) -> dict[str, str]:
    """What a metre of the path stands for, by localizer, of those that come with pdrbench and count instead."""
    found = {}
    for name in names:
        entry = localizers().get(name)
        if entry is not None and entry.package == TRUSTED:
            found[name] = str(getattr(make_localizer(name), COUNTS, ""))
    return {name: what for name, what in found.items() if what}
