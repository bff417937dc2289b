"""Toy blocks from measuring to counting, in processes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pdrbench.errors import DatasetError, UnknownNameError
from pdrbench.registry import PluginError
from pdrbench_lab.realism import BLOCKS, load_block
from pdrbench_lab.realism.format import control_line, footnotes, shown, summary, to_json, to_markdown
from pdrbench_lab.realism.measure import RealSource, measure, real_values
from pdrbench_lab.realism.scorecard import Scorecard, make_scorecard, measure_blocks
from pdrbench_lab.realism.targets import EMPTY, DatasetSource, Targets, encode, reduce, with_blocks

WALK, PUBLISHED = "toy_blocks:WALK", "toy_blocks:PUBLISHED"
DEFAULT = RealSource()
NOWHERE = DatasetSource(source_url="", commit="", licence="MIT", sha256="", num_files=0)

pytestmark = pytest.mark.usefixtures("toys")


def scorecard(
    *names: str, source: RealSource = DEFAULT, stored: Targets = EMPTY, seed: int = 0, count: int | None = None
) -> Scorecard:
    """Measured in this process: starting one takes seconds."""
    measured = [measure(name, source, seed, count) for name in names]
    return make_scorecard(measured, part=source.part, seed=seed, stored=stored)


def test_rows_controls_and_fraction() -> None:
    found = scorecard(WALK, PUBLISHED)
    assert [(row.statistic, row.passed) for row in found.rows] == [
        ("step_s", True),
        ("spread_m", True),
        ("n", True),
        ("alpha", True),
        ("classifier", True),
        ("alpha", False),
    ]
    assert found.num_passed == 5 and found.fraction == pytest.approx(5 / 6)
    assert {c.name: (c.fails, c.passes_without) for c in found.controls} == {
        "half pace": (True, True),
        "nothing": (False, True),
        "half pace, classified": (True, True),
    }
    assert not found.is_enough
    assert summary(found) == ("5 of 6 rows pass (83%; the gate is 85%); 2 of 3 negative controls fail, as they must")
    assert control_line(found.controls[0]) == "Toy walk: at half the pace -> step_s fails: yes"
    assert not footnotes(found)


def test_the_number_of_processes_changes_nothing() -> None:
    lines: list[str] = []
    found = measure_blocks([PUBLISHED, WALK], DEFAULT, seed=4, jobs=2, report=lines.append)
    judged = make_scorecard(found, part="judge", seed=4, stored=EMPTY)
    assert to_json(judged) == to_json(scorecard(PUBLISHED, WALK, seed=4))
    assert lines[0].startswith("measuring 2 blocks") and lines[-1].startswith("2/2 blocks")


def test_another_seed_gives_other_walks() -> None:
    one, other = scorecard(WALK), scorecard(WALK, seed=7000)  # 7 ms: shows in the deciles
    assert other.rows[0].synthetic != one.rows[0].synthetic and other.rows[0].real == one.rows[0].real


def test_the_number_of_walks_is_passed_on() -> None:
    found = scorecard(WALK, count=11)
    assert found.rows[0].num_synthetic == 11
    few = scorecard(WALK, count=4)
    assert not few.rows[0].judged and "at least 10 are needed" in few.rows[0].why
    control = few.controls[0]
    assert not control.fails  # what cannot be judged has not failed
    assert "not judged" in control_line(control)


def test_a_failing_block_is_reported_and_hides_no_other() -> None:
    found = scorecard("toy_blocks:BROKEN", WALK, "toy_blocks:ABSENT", "toy_blocks:gone")
    by_block = {name: [row for row in found.rows if row.block == name] for name in found.measured}
    assert [row.passed for row in by_block[WALK]] == [True] * 5
    assert {row.why for row in by_block["toy_blocks:BROKEN"]} == {"ZeroDivisionError: no walks at all"}
    absent = {row.statistic: row for row in by_block["toy_blocks:ABSENT"]}
    assert absent["alpha"].passed  # needs no recording
    assert "not available" in absent["step_s"].why and not absent["step_s"].judged
    assert [row.statistic for row in by_block["toy_blocks:gone"]] == ["all"]
    assert "ZeroDivisionError" in found.measured["toy_blocks:BROKEN"].trace
    assert not found.measured["toy_blocks:ABSENT"].trace  # a user can correct it
    assert len(footnotes(found)) == 3
    assert len(found.plain()["failures"]) == 3


def test_a_process_that_ends() -> None:
    (measured,) = measure_blocks(["toy_blocks:DEADLY"], DEFAULT)
    found = make_scorecard([measured], part="judge", seed=0, stored=EMPTY)
    assert not found.num_passed and "process died" in found.rows[0].why


def test_stored_values_give_the_same_scores_as_the_recordings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    block = load_block(WALK)
    path = tmp_path / "targets.json"
    measured = reduce(block, block.real("judge"))
    monkeypatch.setattr("pdrbench_lab.realism.targets.source_of", lambda name: NOWHERE)
    path.write_text(encode(with_blocks(EMPTY, {WALK: measured}, [WALK])))
    recorded = scorecard(WALK)
    stored = scorecard(WALK, source=RealSource(file=path, is_forced=True))
    assert stored.rows == recorded.rows
    assert [found.measured[WALK].origin for found in (recorded, stored)] == ["recordings", "stored"]
    monkeypatch.delenv("PDRBENCH_DATA")
    assert scorecard(WALK, source=RealSource(file=path)).rows == recorded.rows
    with pytest.raises(DatasetError, match="part 'fit' are not stored"):
        real_values(WALK, block, RealSource(part="fit", file=path))
    with pytest.raises(DatasetError, match="has no block 'other'"):
        real_values("other", block, RealSource(file=path))


def test_recordings_that_are_not_as_stored(tmp_path: Path) -> None:
    block = load_block(WALK)
    target = reduce(block, {**block.real("judge"), "step_s": block.real("judge")["step_s"] * 1.1})
    stored = with_blocks(EMPTY, {}, [])
    stored.blocks[WALK] = target
    found = scorecard(WALK, stored=stored)
    assert found.differs == {WALK: ["step_s", "step_s by walk"]}
    assert "step_s" in footnotes(found)[0]
    assert scorecard(WALK, stored=stored, source=RealSource(part="fit")).differs == {}  # only one part is stored


def test_the_part_is_passed_on() -> None:
    found = scorecard(WALK, source=RealSource(part="fit"))
    assert found.rows[0].num_real == 40 and found.part == "fit"


def test_a_page_and_a_file_for_machines() -> None:
    found = scorecard(WALK)
    page = to_markdown(found)
    assert page.count("\n| Toy walk |") == 5 and "* Toy walk: nothing changed -> step_s fails: no" in page
    plain = json.loads(to_json(found))
    keys = ("block", "statistic", "real", "synthetic", "distance", "pass", "why")
    assert all(key in row for row in plain["rows"] for key in keys)
    assert plain["rows"][2]["distance"] is None and plain["controls"][0]["fails"] is True
    assert plain["share"] == 1.0 and plain["enough"] is False


def test_names_of_blocks() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'phone'"):
        load_block("phon")
    with pytest.raises(PluginError, match="is int, not a Block"):
        load_block("toy_blocks:NOT_A_BLOCK")
    for name in ("toy_blocks:gone", "no_such_module:BLOCK"):
        with pytest.raises(PluginError, match="cannot be loaded"):
            load_block(name)
    assert all(target.startswith("pdrbench_lab.realism.") and target.isascii() for target in BLOCKS.values())


@pytest.mark.parametrize(
    ("value", "text"), [(0.0, "0"), (12345.6, "12346"), (0.5, "0.5"), (2.5e-7, "2.50e-07"), (-33.333, "-33.3")]
)
def test_numbers_are_short(value: float, text: str) -> None:
    assert shown(value) == text
