"""Every environment makes the walks that its package has pinned, number for number."""

from __future__ import annotations

import dataclasses

import gymnasium
import numpy as np
import pytest

from pdrbench.errors import DatasetError, PdrbenchError
from pdrbench.recording import Recording
from pdrbench.registry import environments, make_task, pin_of
from pdrbench.task import Task

NUM_QUICK = 1  # walks of each environment that the default run looks at


def task_or_skip(env: str) -> Task:
    task = make_task(env)
    if task.note:
        pytest.skip(task.note)
    return task


def changed_walks(task: Task, walks: list[str]) -> list[str]:
    try:
        return [walk for walk in walks if task.computed_sha256(walk) != task.walk_sha256[walk]]
    except DatasetError as error:
        pytest.skip(str(error))


def all_walks(task: Task) -> list[str]:
    return [walk for walks in task.walks.values() for walk in walks]


@pytest.mark.parametrize("env", environments())
def test_every_walk_is_pinned_and_a_sample_of_them_is_unchanged(env: str) -> None:
    """Where this fails a walk has changed: the environment needs a new version, see `pdrbench submit pin`."""
    task = task_or_skip(env)
    assert set(pin_of(env).walks) == set(all_walks(task))
    assert changed_walks(task, all_walks(task)[:NUM_QUICK]) == []


@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    "env",
    [pytest.param(env, marks=pytest.mark.long(seconds=200.0 if "Wifi" in env else 15.0)) for env in environments()],
)
def test_all_walks_are_the_same(env: str) -> None:
    task = task_or_skip(env)
    assert changed_walks(task, all_walks(task)) == []


def test_no_walk_is_generated_to_read_the_digest_of_an_environment() -> None:
    def load(walk: str) -> Recording:
        raise AssertionError(f"{walk} was loaded")

    for env in environments():
        assert len(dataclasses.replace(make_task(env), load=load).sha256) == 64


@pytest.mark.parametrize(
    "change",
    [
        lambda task, walk: dataclasses.replace(task, period_s=2 * task.period_s),
        lambda task, walk: dataclasses.replace(task, capacity={name: rows + 1 for name, rows in task.capacity.items()}),
        lambda task, walk: dataclasses.replace(task, start="pose"),
        lambda task, walk: changing(task, subject={"height_m": 1.0}),
        lambda task, walk: changing(task, mounting="hat"),
        lambda task, walk: changing(task, building=None),
        lambda task, walk: changing(task, reference=moved(task.load(walk))),
        lambda task, walk: changing(task, streams={}),
    ],
)
def test_whatever_is_handed_out_briefed_or_scored_changes_the_digest(change) -> None:
    task = make_task("BuildingSite-v0")
    walk = task.split("val")[0]
    changed = change(task, walk)
    assert changed.computed_sha256(walk) != task.computed_sha256(walk)
    unpinned = dataclasses.replace(changed, walks={"val": (walk,)}, walk_sha256={})
    assert unpinned.sha256 != dataclasses.replace(task, walks={"val": (walk,)}).sha256


def changing(task: Task, **fields: object) -> Task:
    return dataclasses.replace(task, load=lambda walk: dataclasses.replace(task.load(walk), **fields))


def moved(recording: Recording):
    """Its reference with the last bit of one number changed."""
    xy_m = recording.reference.xy_m.copy()
    xy_m[-1, 0] = np.nextafter(xy_m[-1, 0], np.inf)
    return dataclasses.replace(recording.reference, xy_m=xy_m)


def test_two_draws_in_another_order_are_another_walk(monkeypatch: pytest.MonkeyPatch) -> None:
    """The simulator may be rewritten; its walks stay the same."""
    from pdrbench_sim.people import person

    task = make_task("OfficeStride-v0")
    walk = task.split("val")[0]
    before = dataclasses.replace(task, walk_sha256={}).computed_sha256(walk)
    draw = person.draw_person

    def after_another_draw(rng: np.random.Generator):
        rng.random()
        return draw(rng)

    monkeypatch.setattr(person, "draw_person", after_another_draw)
    assert dataclasses.replace(task, walk_sha256={}).computed_sha256(walk) != before


def test_a_stated_digest_is_taken_as_it_is() -> None:
    task = dataclasses.replace(make_task("OfficeStride-v0"), stated_sha256="of files")
    assert task.sha256 == "of files"


def test_a_renamed_environment_keeps_its_walks_and_names_its_new_id() -> None:
    task = make_task("PhoneHandling-v0")
    assert (task.id, task.seed_name) == ("PhoneHandling-v0", "PhoneFiddle-v0")
    for make in (make_task, lambda name: gymnasium.make(f"pdrbench/{name}")):
        with pytest.raises(PdrbenchError, match="another id now: 'PhoneHandling-v0'"):
            make("PhoneFiddle-v0")
    assert "PhoneFiddle-v0" not in environments()
