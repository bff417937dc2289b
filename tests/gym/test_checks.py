"""Every check passes on correct code, and each fails on its own defect, with the likely cause."""

from __future__ import annotations

import dataclasses
import random  # noqa: TID251  a localizer under test seeds it

import numpy as np
import pytest

from pdrbench.errors import UnsuitableError
from pdrbench.gym import check_localizer, check_task
from pdrbench.localizer import Estimate
from pdrbench.recording import SensorStream
from pdrbench.trajectory import Start


def failures(checks):
    return {check.name: check.why for check in checks if not check.passed}


def altered(task, change):
    """The task with every recording changed."""
    return dataclasses.replace(task, load=lambda walk: change(task.load(walk)))


@pytest.fixture
def strides(task_maker):
    """A small task: strides are not needed for these checks, accelerations are enough."""
    return task_maker({"accel": 24})


def test_a_sound_task_passes(phone_task) -> None:
    checks = check_task(phone_task)
    assert failures(checks) == {}
    assert len({check.name for check in checks}) == len(checks) > 15


def test_an_unknown_task_fails_with_the_nearest_name_and_one_that_does_not_load_says_so(strides) -> None:
    (check,) = check_task("CampusStrid-v0")
    assert not check.passed and "CampusStride-v1" in check.why

    def broken(walk):
        raise KeyError(walk)

    (check,) = check_task(dataclasses.replace(strides, load=broken))
    assert not check.passed and "KeyError" in check.why


def test_random_recordings_are_found(strides) -> None:
    rng = np.random.default_rng(0)

    def jitter(recording):
        stream = recording.streams["accel"]
        noisy = stream.rows + np.array([0, 1, 0, 0]) * rng.random((len(stream.rows), 1))
        return dataclasses.replace(recording, streams={"accel": SensorStream(stream.spec, noisy)})

    found = failures(check_task(altered(strides, jitter)))
    assert "randomness" in found["walks load twice the same"]


def test_what_a_task_gives_away_or_lacks_is_found(strides, task_maker) -> None:
    found = failures(check_task(altered(strides, lambda recording: dataclasses.replace(recording, id="walk-a"))))
    assert "ids must agree" in found["walks load twice the same"]
    task = dataclasses.replace(strides, radio_map=lambda recording: leaking_survey(recording))
    assert "is the reference" in failures(check_task(task))["the briefing holds no truth"]
    task = task_maker({"accel": 24}, tell_start=lambda recording: Start(xy_m=[500.0, 0.0], level=0))
    assert "from where the reference begins" in failures(check_task(task))["the briefed start is where the walk begins"]
    task = task_maker({"accel": 24}, walks={"train": ("walk-a",)})
    assert "no test split" in failures(check_task(task))["splits are there"]


def leaking_survey(recording):
    """A radio map whose places are the walk."""
    from pdrbench.recording import RadioMap

    scans = len(recording.reference)
    return RadioMap(
        xy_m=recording.reference.xy_m,
        level=recording.reference.level,
        walk=np.zeros(scans),
        first=np.arange(scans + 1),
        access_point=np.arange(scans),
        rssi_dbm=np.full(scans, -50.0),
        age_s=np.zeros(scans),
    )


def test_own_scans_in_the_radio_map_are_found(task_maker) -> None:
    from pdrbench.recording import RadioMap

    def survey(recording):
        wifi = recording.streams["wifi"].rows
        own = wifi[wifi[:, 0] == wifi[0, 0]]
        return RadioMap(
            xy_m=[[0.0, 0.0]],
            level=[0],
            walk=[0],
            first=[0, len(own)],
            access_point=own[::-1, 1],
            rssi_dbm=own[::-1, 2],
            age_s=own[::-1, 4],
        )

    found = failures(check_task(task_maker({"wifi": 512}, radio_map=survey)))
    assert list(found) == ["the radio map leaves out the walk's own scans"]


def test_a_given_position_that_is_scored_is_reported(strides) -> None:
    def score_all(recording):
        reference = recording.reference
        everything = dataclasses.replace(reference, surveyed=np.ones(len(reference)))
        return dataclasses.replace(recording, reference=everything)

    assert (
        "surveyed=False"
        in failures(check_task(altered(strides, score_all)))["something is scored, and not the briefed start"]
    )


def test_a_walk_that_stands_still_fails_the_check(strides) -> None:
    def freeze(recording):
        reference = recording.reference
        frozen = dataclasses.replace(
            reference, xy_m=np.tile(reference.xy_m[:1], (len(reference), 1)), level=reference.level * 0
        )
        return dataclasses.replace(recording, reference=frozen)

    found = failures(check_task(altered(strides, freeze)))
    assert "does the pedestrian walk" in found["an oracle has no error, and standing still has more"]


class Sound:
    """Depends on observations and on its rng only, and keeps every rule."""

    def reset(self, briefing, rng) -> None:
        briefing.require(sensors=("accel",), start=True)
        self._rng, self._xy_m, self._kept = rng, np.array(briefing.start.xy_m), []

    def look(self, observation) -> float:
        return float(observation["accel"][:, 1:].sum())

    def step(self, observation):
        self._xy_m = self._xy_m + 0.1 * self.look(observation) + self._rng.normal(size=2)
        return Estimate(xy_m=self._xy_m, level=0)


def test_a_sound_localizer_passes(phone_task) -> None:
    checks = check_localizer(Sound, phone_task)
    assert failures(checks) == {}
    assert len(checks) == 10


class Revises(Sound):
    """Revises its estimates when the walk is over."""

    def look(self, observation) -> float:
        self._kept.append((observation.now_s, float(observation["accel"][:, 1:].sum())))
        return 0.0

    def revise(self):
        total = sum(value for _, value in self._kept)
        return np.array([[t_s, total, 0.0, 0.0] for t_s, _ in self._kept])


def test_a_revised_past_may_use_later_observations(phone_task) -> None:
    checks = check_localizer(Revises, phone_task, seconds=5.0)
    assert failures(checks) == {}
    (remark,) = [check.why for check in checks if check.name == "answers every observation"]
    assert "ms a step, revised in" in remark


class RevisesWrongly(Revises):
    def revise(self):
        return super().revise()[:, :3]


class RevisesByChance(Revises):
    def revise(self):
        return super().revise() + np.random.default_rng().random() * np.eye(4)[1]


class RevisesFromKept(Sound):
    def look(self, observation) -> float:
        self._kept.append((observation.now_s, observation["accel"]))
        return 0.0

    def revise(self):
        return np.array([[t_s, rows[:, 1:].sum(), 0.0, 0.0] for t_s, rows in self._kept])


class CrashesBare(Sound):
    def reset(self, briefing, rng) -> None:
        briefing.sensors["accel"]
        super().reset(briefing, rng)


class Silent(Sound):
    def step(self, observation):
        return None


class Raises(Sound):
    def step(self, observation):
        raise ZeroDivisionError("by nothing")


class Leaves(Sound):
    def step(self, observation):
        raise SystemExit(0)


class NeverBegins(Sound):
    def reset(self, briefing, rng) -> None:
        raise KeyError("no key")


class OwnChance(Sound):
    def look(self, observation) -> float:
        return float(np.random.default_rng().random())


class GlobalChance(Sound):
    def look(self, observation) -> float:
        np.random.seed(1)  # noqa: NPY002
        return 0.0


class GlobalPython(Sound):
    def look(self, observation) -> float:
        random.seed(len(observation["accel"]))
        return 0.0


class Remembers(Sound):
    total = 0.0

    def look(self, observation) -> float:
        self.total += 1.0
        return self.total


class Changes(Sound):
    def look(self, observation) -> float:
        observation["accel"][:, 1] = 0.0
        return 0.0


class Keeps(Sound):
    def look(self, observation) -> float:
        self._kept.append(observation["accel"])
        return float(sum(rows[:, 1:].sum() for rows in self._kept))


@pytest.mark.parametrize(
    ("localizer", "name", "words"),
    [
        (CrashesBare, "declines with UnsuitableError only", "KeyError"),
        (Silent, "answers every observation", "returned None instead of an Estimate"),
        (Raises, "answers every observation", "by nothing"),
        (Leaves, "answers every observation", "raised SystemExit"),
        (NeverBegins, "answers every observation", "no key"),
        (OwnChance, "same generator, same answers", "randomness besides"),
        (GlobalChance, "global random state is left alone", "numpy.random"),
        (GlobalPython, "global random state is left alone", "global state of random"),
        (Remembers, "reset forgets the walk before", "reset leave something"),
        (Changes, "observations are neither changed nor kept", "changes the rows of 'accel'"),
        (Keeps, "observations are neither changed nor kept", "copy what is kept"),
        (RevisesWrongly, "answers every observation", "revise returns an array"),
        (RevisesByChance, "same generator, same answers", "randomness besides"),
        (RevisesFromKept, "observations are neither changed nor kept", "copy what is kept"),
    ],
)
def test_each_fault_is_found(phone_task, localizer, name, words) -> None:
    state = random.getstate(), np.random.get_state()  # noqa: NPY002
    found = failures(check_localizer(localizer, phone_task, seconds=5.0))
    random.setstate(state[0])
    np.random.set_state(state[1])  # noqa: NPY002
    assert words in found[name]
    assert not any("reshape" in why for why in found.values())


@pytest.mark.parametrize("base", [Sound, Revises])
def test_a_look_ahead_is_found(phone_task, base) -> None:
    """A localizer with the recording is not causal, however it came by it; a revised past does not hide it."""
    handed_over = []

    class Peeks(base):
        def look(self, observation) -> float:
            super().look(observation)
            return handed_over[-1]

    def brief(recording):
        handed_over.append(float(recording.streams["accel"].rows[-1, 1]))
        return Start(xy_m=recording.reference.xy_m[0], level=0)

    found = failures(check_localizer(Peeks, dataclasses.replace(phone_task, tell_start=brief), seconds=5.0))
    assert list(found) == ["what comes later changes nothing before"]
    assert "are answered differently" in next(iter(found.values()))


def test_a_class_that_is_no_localizer_fails_at_once() -> None:
    (check,) = check_localizer(lambda: object())
    assert not check.passed and "lacks reset" in check.why
    (check,) = check_localizer("no_such-v0")
    assert not check.passed and "no localizer named" in check.why


def test_a_localizer_that_declines_everything_fails_with_the_reasons(phone_task) -> None:
    class Declines(Sound):
        def reset(self, briefing, rng) -> None:
            raise UnsuitableError("needs a barometer")

    _, check = check_localizer(Declines, phone_task)
    assert not check.passed and "needs a barometer" in check.why
