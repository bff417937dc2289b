"""A walk with the localizer in the evaluating process."""

from __future__ import annotations

import contextlib
import traceback
from collections.abc import Mapping
from typing import Any

import numpy as np

from pdrbench.episode import Episode, play
from pdrbench.errors import UnknownNameError, UnsuitableError
from pdrbench.evaluation.deadlines import Deadlines
from pdrbench.evaluation.items import JUDGED, NONE, Item, Setting, generator, item_provenance
from pdrbench.isolation.budget import CONSTRUCTION
from pdrbench.localizer import Localizer
from pdrbench.recording import Recording
from pdrbench.registry import PluginError, make_localizer
from pdrbench.result import FAILED, UNSUITABLE, Result
from pdrbench.task import Task


def play_here(item: Item, task: Task, recording: Recording, setting: Setting) -> Result:
    """The walk with the localizer in this process, which it may take down."""
    deadlines = Deadlines(setting.budget, task.period_s)
    episode = Episode(recording, task)
    provenance = item_provenance(item, setting) | {"isolation": {"mode": NONE, "held": [], "missing": {}}}
    status = FAILED
    deadlines.start()
    try:
        with np.errstate(), contextlib.chdir("."):
            with deadlines(CONSTRUCTION):
                localizer = make_told(_loadable(item), item.parameters, item.split, recording)
            return play(
                localizer,
                episode,
                generator(item.seed, item.env, item.walk),
                name=item.localizer,
                seed=item.seed,
                guard=deadlines,
                provenance=provenance,
            )
    except (PluginError, UnknownNameError, KeyboardInterrupt):
        raise
    except UnsuitableError as error:
        status, failure = UNSUITABLE, str(error)
    except BaseException:  # noqa: BLE001  a constructor may raise anything; an alarm may ring on a threshold
        failure = traceback.format_exc()
    finally:
        deadlines.stop()
    return episode.result(
        localizer=item.localizer, seed=item.seed, status=status, failure=failure, provenance=provenance
    )


def make_told(spec: str, parameters: Mapping[str, Any], split: str, recording: Recording) -> Localizer:
    """A new localizer; one that asks for the truth is told it, where the truth is public."""
    localizer = make_localizer(spec, **parameters)
    if hasattr(localizer, "tell"):
        if split in JUDGED:
            raise UnsuitableError(
                f"{spec} is told the truth, which nobody is on a {split} split; run it on train or val"
            )
        localizer.tell(recording.reference)
    return localizer


def _loadable(item: Item) -> str:
    return item.target if item.target.partition(":")[0].endswith(".py") else item.localizer
