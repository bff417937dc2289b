"""A walk with the localizer in a process of its own."""

from __future__ import annotations

import dataclasses
from typing import Any, Final, cast

from pdrbench.episode import Episode, play
from pdrbench.errors import PdrbenchError, UnsuitableError
from pdrbench.evaluation.items import JUDGED, Item, Setting, dead_result, generator, item_provenance
from pdrbench.isolation.isolated import IsolatedLocalizer, Terms
from pdrbench.isolation.watching import IsolationError
from pdrbench.recording import Recording
from pdrbench.result import FAILED, UNSUITABLE, Result
from pdrbench.task import Task

MOST_LAUNCHES: Final = 3  # a walk over which somebody ends the launcher is given up after this many tries
MOST_KILLS: Final = 2  # so is one over which somebody else, or the system short of memory, killed the localizer


def play_apart(item: Item, task: Task, recording: Recording, setting: Setting) -> Result:
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
