"""Walks of an environment as a Minari dataset, for offline reinforcement learning and imitation."""

from __future__ import annotations

import contextlib
import os
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.errors import PdrbenchError, RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.gym.env import LocalizationEnv
from pdrbench.registry import environments
from pdrbench.task import Task

PLACE_VARIABLE: Final = "MINARI_DATASETS_PATH"
PUBLIC_SPLITS: Final = ("train", "val")  # whose reference may be handed out


def export_minari(
    task: Task,
    folder: Path | str,
    *,
    split: str = "train",
    walks: int | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> str:
    """Writes the walks of a split; the action of each step is where the pedestrian was, at x_m, y_m, level.

    One episode a walk, as `LocalizationEnv` plays it, with its rewards; walks are written one by one.

    Args:
        task: The environment.
        folder: Of Minari datasets; `MINARI_DATASETS_PATH` to read it.
        split: "train" or "val".
        walks: Only the first so many.
        progress: Called with walks done, walks in all, and the id of the one that was written.

    Returns:
        Id of the dataset, as in `minari.load_dataset(id)`.

    Raises:
        PdrbenchError: Minari is not installed, the split is withheld, or the dataset exists.
        RecordingError: A walk has no reference.
    """
    if split not in PUBLIC_SPLITS:
        raise PdrbenchError(f"the reference of the {split!r} split is withheld; export {' or '.join(PUBLIC_SPLITS)}")
    try:
        import minari
    except ImportError as error:
        raise PdrbenchError(f"needs minari ({error}): pip install pdrbench[minari]") from error
    name, _, version = task.id.rpartition("-")
    dataset_id = f"pdrbench/{name}/{split}-{version}"
    folder = Path(folder).absolute()
    if (folder / dataset_id).exists():
        raise PdrbenchError(f"{folder / dataset_id} exists; choose another folder or delete it")
    folder.mkdir(parents=True, exist_ok=True)
    chosen = task.split(split)[:walks]
    env = LocalizationEnv(task, split)
    facts: dict[str, Any] = {
        "env": f"pdrbench/{task.id}" if task.id in environments() else None,
        "action_space": env.action_space,
        "observation_space": env.observation_space,
        "algorithm_name": "reference",
        "author": "pdrbench",
        "description": f"{task.summary} Actions are the reference. Licence: {task.licence}. Source: {task.source}.",
    }
    dataset = None
    with _stored_in(folder), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that no address of an author is stated
        for number, walk in enumerate(chosen):
            buffer = _episode(minari.data_collector.EpisodeBuffer, env, walk, number)
            if dataset is None:
                dataset = minari.create_dataset_from_buffers(dataset_id, [buffer], **facts)
            else:
                dataset.update_dataset_from_buffer([buffer])
            if progress is not None:
                progress(number + 1, len(chosen), walk)
    return dataset_id


def _episode(make_buffer: Any, env: LocalizationEnv, walk: str, number: int) -> Any:
    """One walk, answered with its reference."""
    observation, _ = env.reset(options={"walk": walk})
    target = env.target
    if target is None:
        raise RecordingError(f"walk {walk!r} of {env.task.id} has no reference to take actions from")
    observations: list[dict[str, FloatArray]] = [observation]
    rewards = []
    for action in target:
        observation, reward, *_ = env.step(action)
        observations.append(observation)
        rewards.append(float(reward))
    ends = np.arange(1, len(target) + 1) == len(target)
    return make_buffer(
        id=number,
        options={"walk": walk},
        observations={key: np.stack([each[key] for each in observations]) for key in observation},
        actions=target,
        rewards=rewards,
        terminations=ends.tolist(),
        truncations=[False] * len(target),
        infos={},
    )


@contextlib.contextmanager
def _stored_in(folder: Path) -> Iterator[None]:
    """Minari takes the place of its datasets from a variable only."""
    before = os.environ.get(PLACE_VARIABLE)
    os.environ[PLACE_VARIABLE] = str(folder)
    try:
        yield
    finally:
        if before is None:
            del os.environ[PLACE_VARIABLE]
        else:
            os.environ[PLACE_VARIABLE] = before
