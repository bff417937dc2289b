"""Every environment makes the walks that its package has pinned, number for number."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from pdrbench.arithmetic import rounds_as_pinned
from pdrbench.cli.ready import newest_versions
from pdrbench.errors import DatasetError, PdrbenchError
from pdrbench.recording import Recording
from pdrbench.registry import environments, make_task, pin_of
from pdrbench.task import Task

SLOW = "WestportFoot-v0"  # to make; OfficeFoot-v1 is made by the same code
SUPERSEDED = newest_versions(environments())  # by a version that has the same generator
NUM_QUICK = 1  # walks of each environment that the default run looks at
MEANS = Path(__file__).parent / "walk_means.json"  # of those walks: `python tests/envs/test_pinned_walks.py` writes it
WITHOUT_AVX512 = {"MallPhoneMagnetic-v0", "MallPhoneMagneticLost-v0"}  # pinned on a processor that has none
LONG_S = {"LabStrideWifi": 200.0, "LabStrideLost": 35.0}  # for all walks, where it is much more than of the others
OTHER_BITS = 1e-6  # of the spread of a column: rounding of the last bit, some thousand times accumulated


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


def rounds_otherwise(env: str) -> bool:
    """Whether sines and exponentials have other last bits here than where the walks of an environment were pinned."""
    return rounds_as_pinned() == (env in WITHOUT_AVX512)


def means(task: Task, walk: str) -> dict[str, list[list[float]]]:
    """By array of a walk, for each of its columns: number of rows, mean and root mean square."""
    recording = task.load(walk)
    reference = recording.reference
    arrays = {name: stream.rows for name, stream in recording.streams.items()}
    arrays |= {"reference": np.column_stack([reference.t_s, reference.xy_m, reference.level, reference.surveyed])}
    if (radio_map := task.radio_map(recording)) is not None:
        arrays |= {"scans": radio_map.xy_m, "readings": radio_map.rssi_dbm[:, None]}
    return {name: list(columns(rows)) for name, rows in sorted(arrays.items())}


def columns(rows: np.ndarray) -> Iterator[list[float]]:
    for column in rows.T:
        finite = column[np.isfinite(column)]
        mean, size = (float(np.mean(finite)), float(np.sqrt(np.mean(finite**2)))) if len(finite) else (0.0, 0.0)
        yield [len(column), mean, size]


def assert_near(found: dict[str, list[list[float]]], stored: dict[str, list[list[float]]]) -> None:
    """Every column has as many rows, and but for other last bits the same mean and size."""
    assert found.keys() == stored.keys()
    for name, wanted in stored.items():
        for (rows, *now), (stored_rows, *before) in zip(found[name], wanted, strict=True):
            assert rows == stored_rows, name
            np.testing.assert_allclose(now, before, rtol=0, atol=OTHER_BITS * max(before[1], 1.0), err_msg=name)


def all_walks(task: Task) -> list[str]:
    return [walk for walks in task.walks.values() for walk in walks]


@pytest.mark.parametrize(
    "env",
    [
        pytest.param(
            env, marks=pytest.mark.long(seconds=10 if env == SLOW else 3) if env in {SLOW, *SUPERSEDED} else ()
        )
        for env in environments()
    ],
)
def test_every_walk_is_pinned_and_a_sample_of_them_is_unchanged(env: str) -> None:
    """Where this fails a walk has changed: the environment needs a new version, see `pdrbench submit pin`."""
    task = task_or_skip(env)
    assert set(pin_of(env).walks) == set(all_walks(task))
    sample = all_walks(task)[:NUM_QUICK]
    changed = changed_walks(task, sample)
    assert changed == [] or rounds_otherwise(env)
    stored = json.loads(MEANS.read_text(encoding="utf-8"))
    for walk in changed:  # a processor whose functions differ in the last bit
        assert_near(means(task, walk), stored[env])


@pytest.mark.parametrize("change", ["a row less", "another number"])
def test_a_walk_that_is_another_one_is_found_on_every_processor(change: str) -> None:
    task = make_task("OfficeStride-v1")
    before = means(task, all_walks(task)[0])
    after = json.loads(json.dumps(before))
    after["stride"][1][0 if change == "a row less" else 1] += -1 if change == "a row less" else 1e-5
    assert_near(before, json.loads(json.dumps(before)))
    with pytest.raises(AssertionError):
        assert_near(after, before)


@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    "env",
    [pytest.param(env, marks=pytest.mark.long(seconds=LONG_S.get(env[:-3], 15.0))) for env in environments()],
)
def test_all_walks_are_the_same(env: str) -> None:
    task = task_or_skip(env)
    changed = changed_walks(task, all_walks(task))
    if changed and rounds_otherwise(env):
        pytest.skip("generated with functions whose last bit differs on this processor; one walk is compared by means")
    assert changed == []


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


if __name__ == "__main__":  # what has no data here stays as it is
    found = json.loads(MEANS.read_text(encoding="utf-8")) if MEANS.exists() else {}
    for name in environments():
        try:
            one = make_task(name)
            if name in WITHOUT_AVX512 or changed_walks(one, all_walks(one)[:NUM_QUICK]):
                found[name] = means(one, all_walks(one)[0])
        except (DatasetError, pytest.skip.Exception) as error:
            print(f"{name}: {error}")
    MEANS.write_text(json.dumps(found, indent=1, sort_keys=True) + "\n", encoding="utf-8")
