from __future__ import annotations

import math

import numpy as np
import pytest

from pdrbench.registry import make_localizer
from pdrbench_baselines.li2012.localizer import LI2012
from pdrbench_baselines.li2012.map_filter import StepModel
from pdrbench_lab.papers.li2012.claims import REPRODUCTION, all_in_order, in_order, less_by
from pdrbench_lab.papers.li2012.corridor_phone.corridor import CORRIDOR
from pdrbench_lab.papers.li2012.experiments import TURNS, length_errors_pct
from pdrbench_lab.papers.li2012.laps import ALGORITHMS, Crowd, Followed, follow
from pdrbench_lab.papers.li2012.paper_size import Sample, gated, mean_of, mean_of_steps, percentile_of_steps
from pdrbench_lab.papers.settings import merged
from pdrbench_lab.reproduce.reproduction import Gate, Measured


@pytest.fixture(scope="module")
def crowd():
    return Crowd(31, 0)


@pytest.fixture(scope="module")
def lap(crowd):
    return crowd.walk(0, 0, "hand")


def test_the_algorithms_are_the_registered_localizers():
    for name, query in (("alg1", "?generic=true&warping=false"), ("alg2", "?generic=true"), ("alg3", "")):
        assert make_localizer(f"li2012{query}")._params == merged(LI2012, ALGORITHMS[name], "li2012"), name


def test_steps_are_followed_to_where_the_body_was(crowd, lap):
    found = follow(*lap, crowd.filter_rng(0), {})
    reference = lap[0].reference
    assert 100 < len(found.end_s) < 170
    assert found.true_length_m.sum() == pytest.approx(np.hypot(*np.diff(reference.xy_m, axis=0).T).sum(), rel=0.08)
    assert found.turns[0] == 0
    assert found.turns[-1] == 4
    assert (np.diff(found.turns) >= 0).all()
    assert (found.along_m <= found.euclidean_m + 1.5).all()  # projected, it is no longer, but round a corner
    assert found.along_m.max() <= CORRIDOR.lap_m / 2
    # The corridor's direction is that of the body, corners and swaying aside.
    moved_m = np.diff(found.true_xy_m, axis=0)
    off = np.angle(np.exp(1j * (np.arctan2(moved_m[:, 1], moved_m[:, 0]) - found.corridor_rad[1:])))
    assert np.median(np.abs(off)) < math.radians(10)


def test_the_same_seed_gives_the_same_answers(crowd, lap):
    one, other = (follow(*lap, crowd.filter_rng(0), ALGORITHMS["alg2"]) for _ in range(2))
    assert one.xy_m.tobytes() == other.xy_m.tobytes()


def test_a_walk_after_handling_is_the_same_walk_later(crowd, lap):
    """So much later, after standing where it begins."""
    recording, briefing = crowd.handled_walk(0, "hand", 20.0)
    assert briefing.start.xy_m.tolist() == lap[1].start.xy_m.tolist()
    for name, stream in lap[0].streams.items():
        rows = recording.streams[name].rows
        assert (np.diff(rows[:, 0]) > 0).all()
        np.testing.assert_allclose(rows[-len(stream.rows) :, 0], stream.t_s + 20.0)
        np.testing.assert_array_equal(rows[-len(stream.rows) :, 1:], stream.rows[:, 1:])
    reference = recording.reference
    stands = reference.t_s < 20.0
    assert np.ptp(reference.xy_m[stands], axis=0).max() == 0
    assert np.hypot(*(reference.xy_m[~stands][0] - reference.xy_m[0])) < 0.2
    followed = follow(recording, briefing, crowd.filter_rng(0), {})
    assert 0 < len(followed.since(20.0).end_s) <= len(followed.end_s)
    assert (followed.since(20.0).end_s >= 20.0).all()


def test_a_hopeless_step_model_gets_lost_and_needs_another_tap(crowd, lap):
    hopeless = StepModel(0.0, 0.3)
    left = follow(*lap, crowd.filter_rng(0), ALGORITHMS["alg2"], model=hopeless)
    tapped = follow(*lap, crowd.filter_rng(0), ALGORITHMS["alg2"], model=hopeless, taps_again=True)
    assert left.failures == 0
    assert tapped.failures >= 3  # half of 92 m is missing, and 6 m make a failure
    assert tapped.euclidean_m.mean() < left.euclidean_m.mean()


def test_the_error_of_a_model_is_that_of_the_mean_step():
    steps = 40
    found = Followed(
        end_s=np.arange(steps, dtype=float),
        xy_m=np.zeros((steps, 2)),
        true_xy_m=np.zeros((steps, 2)),
        frequency_hz=np.full(steps, 2.0),
        model=np.where(np.arange(steps)[:, None] < 20, [0.2, 0.4], [0.2, 0.3]),
        true_length_m=np.full(steps, 0.7),
        heading_rad=np.zeros(steps),
        corrected_rad=np.zeros(steps),
        corridor_rad=np.zeros(steps),
        turns=np.repeat([0, 1], steps // 2),
        resets=0,
        failures=0,
        personal=StepModel(0.2, 0.3),
    )
    errors = length_errors_pct(found)
    assert errors[:2] == pytest.approx([100 / 7, 0.0])
    assert np.isnan(errors[2:]).all()
    assert len(errors) == TURNS + 1


def test_gains_are_those_of_means_and_orders_are_strict() -> None:
    runs = [{"a": 2.0, "b": 1.0}, {"a": 4.0, "b": 3.5}]
    assert less_by("b", "a")(runs).ours == pytest.approx(0.25)
    many = [{"a": 2.0, "b": 1.0 + 0.1 * (k % 2)} for k in range(20)]
    measured = less_by("b", "a")(many)
    assert measured.low < measured.ours < measured.high
    lap = {"by_lap_a_m": np.full(8, 20.0), "by_lap_b_m": np.full(8, 10.0)} | {
        f"steps_{of}": np.full(8, 10) for of in "ab"
    }
    assert all_in_order("ab")([lap]).ours == in_order("ab")([lap]).ours == 1.0
    assert all_in_order("ba")([lap]).ours == in_order("ba")([lap]).ours == all_in_order("aa")([lap]).ours == 0.0


def test_gates_know_both_samples(rng: np.random.Generator) -> None:
    """Of people who err by 1 m with a sigma of 0.5 m: sigma sqrt(1 / ours + 1 / theirs), 1.96 times, on either side."""
    sample = Sample(20, ("total", "steps"), mean_of)

    def width(seeds: int, people: int) -> float:
        steps = np.full(people, 100)
        runs = [{"total": 100 * rng.normal(1.0, 0.5, people), "steps": steps} for _ in range(seeds)]
        found = gated(lambda runs: Measured(1.0), sample, 2.0, 0.0, Gate(2.0, 2.0))(runs)
        assert found.gate is not None
        assert found.gate.low < 2.0 < found.gate.high
        return found.gate.high - found.gate.low

    assert width(40, 50) == pytest.approx(2 * 1.96 * 0.5 * math.sqrt(1 / 2000 + 1 / 20), rel=0.1)
    few = np.mean([width(10, 2) for _ in range(20)])
    assert few == pytest.approx(2 * 1.96 * 0.5 * math.sqrt(1 / 20 + 1 / 20), rel=0.15)
    alike = [{"total": np.full(8, 100.0), "steps": np.full(8, 100)}]  # no chance at all: the tolerance is left
    assert gated(lambda runs: Measured(1.0), sample, 2.0, 0.0, Gate(1.9, 2.2))(alike).gate == Gate(1.9, 2.2)


def test_percentiles_are_of_all_steps_of_a_sample() -> None:
    sample = Sample(2, ("deg",), percentile_of_steps(0.95), "steps")
    runs = [{"deg": np.arange(100.0), "steps": np.array([60, 40])}]
    assert sample.of_all(runs) == 94.0
    assert set(sample.drawn(runs, 50)) <= {56.0, 97.0, 94.0}  # the first twice, the second twice, or both
    assert Sample(2, ("deg",), mean_of_steps, "steps").of_all(runs) == pytest.approx(49.5)


def test_every_promised_gate_is_there():
    gates = {(claim.id, claim.what): claim.gate for claim in REPRODUCTION.claims if claim.gate is not None}
    assert len(gates) == 34
    ids = [claim_id for claim_id, _ in gates]
    assert {name: ids.count(name) for name in ("L7", "L8", "L12", "L22", "L23", "L24")} == {
        "L7": 2,
        "L8": 12,
        "L12": 3,
        "L22": 2,
        "L23": 1,
        "L24": 4,
    }
    assert ids.count("L1") == 8
    assert gates["L1", "hand, personal: error along the path, mean"] == Gate(1.2, 1.8)
