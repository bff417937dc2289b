"""A walk with the localizer in the evaluating process."""

from __future__ import annotations

import contextlib
import dataclasses
import time
import traceback
from collections.abc import Mapping
from typing import IO, Any

import numpy as np

from pdrbench.episode import play
from pdrbench.errors import UnknownNameError, UnsuitableError
from pdrbench.evaluation import store
from pdrbench.evaluation.deadlines import Deadlines
from pdrbench.evaluation.jobs import Finished, JobContext
from pdrbench.evaluation.randomness import generator
from pdrbench.evaluation.walk_job import HIDDEN_SPLITS, NONE, WalkJob, load_walk, provenance_of, refused
from pdrbench.localizer import Localizer
from pdrbench.process.budget import CONSTRUCTION
from pdrbench.recording import Recording
from pdrbench.registry import PluginError, make_localizer
from pdrbench.result import FAILED, UNSUITABLE, Result
from pdrbench.settings import with_settings_of


def compute_in_process(job: WalkJob, context: JobContext, note: IO[bytes], memory: dict[str, Any]) -> Finished:
    """The work of a job with the localizer in the process that does it, which it may take down."""
    result = refused(job, memory)
    if result is None:
        began_s = time.process_time()
        result = _play(job, memory)
        cpu_s = round(time.process_time() - began_s, 3)
        result = dataclasses.replace(result, provenance={**result.provenance, "cpu_s": cpu_s})
    return result.status, store.encode(result)


def _play(job: WalkJob, memory: dict[str, Any]) -> Result:
    episode = load_walk(job, memory)
    deadlines = Deadlines(job.budget, episode.task.period_s)
    provenance = provenance_of(job) | {"isolation": {"mode": NONE, "held": [], "missing": {}}}
    spec = with_settings_of(job.localizer, job.target)
    rng = generator(job.seed, episode.task, job.walk, job.nonce)
    status = FAILED
    deadlines.start()
    try:
        with np.errstate(), contextlib.chdir("."):
            with deadlines(CONSTRUCTION):
                localizer = make_informed(spec, job.parameters, job.split, episode.recording)
            return play(
                localizer, episode, rng, name=job.localizer, seed=job.seed, guard=deadlines, provenance=provenance
            )
    except (PluginError, UnknownNameError, KeyboardInterrupt):
        raise
    except UnsuitableError as error:
        status, failure = UNSUITABLE, str(error)
    except BaseException:  # noqa: BLE001  a constructor may raise anything; an alarm may ring on a threshold
        failure = traceback.format_exc()
    finally:
        deadlines.stop()
    return episode.result(localizer=job.localizer, seed=job.seed, status=status, failure=failure, provenance=provenance)


def make_informed(spec: str, parameters: Mapping[str, Any], split: str, recording: Recording) -> Localizer:
    """A new localizer; one that asks for the truth is given it, where the truth is public."""
    localizer = make_localizer(spec, **parameters)
    if hasattr(localizer, "tell"):
        if split in HIDDEN_SPLITS:
            raise UnsuitableError(
                f"{spec} needs the reference, which no localizer is given on a {split} split; run it on train or val"
            )
        localizer.tell(recording.reference)
    return localizer
