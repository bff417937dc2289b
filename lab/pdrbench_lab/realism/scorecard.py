"""The scorecard: every block measured, judged and counted."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from joblib.externals.loky import ProcessPoolExecutor, as_completed
from joblib.externals.loky.process_executor import TerminatedWorkerError

from pdrbench import __version__
from pdrbench.arithmetic import THREADS
from pdrbench_lab.realism import load_block
from pdrbench_lab.realism.block import Block
from pdrbench_lab.realism.criteria import ScorecardRow, block_rows, statistic_row, unmeasured
from pdrbench_lab.realism.measure import MeasuredBlock, RealSource, measure
from pdrbench_lab.realism.targets import NO_TARGET, PART, Targets, differing

GATE: Final = 0.85  # smallest fraction of rows that pass
DIED: Final = "its process died, perhaps for lack of memory; run it alone with --block and fewer walks with --count"


@dataclass(frozen=True, slots=True)
class ControlResult:
    """What became of values that are wrong on purpose.

    Attributes:
        name: Of the control.
        what: What was done to them.
        row: The row that has to fail.
        passes_without: Whether the row passes without the disturbance; where it does not, the control shows little.
    """

    name: str
    what: str
    row: ScorecardRow
    passes_without: bool

    @property
    def fails(self) -> bool:
        """True where the row could be judged and did not pass."""
        return self.row.judged and not self.row.passed

    def plain(self) -> dict[str, Any]:
        """As in JSON."""
        row = self.row.plain()
        head = {"block": row.pop("block"), "control": self.name, "done": self.what, "fails": self.fails}
        return {**head, "passes_without": self.passes_without, **row}


@dataclass(frozen=True, slots=True)
class Scorecard:
    """Every row and control, and what they were judged on.

    Attributes:
        rows: Block by block.
        controls: The same.
        measured: By block, what the rows were judged on.
        part: Of the real recordings.
        seed: Of the synthetic ones.
        differs: By block that was measured on recordings and is stored: names of what is not as stored.
    """

    rows: tuple[ScorecardRow, ...]
    controls: tuple[ControlResult, ...]
    measured: dict[str, MeasuredBlock]
    part: str
    seed: int
    differs: dict[str, list[str]]

    @property
    def num_passed(self) -> int:
        """Rows that pass."""
        return sum(row.passed for row in self.rows)

    @property
    def fraction(self) -> float:
        """Fraction of the rows that pass."""
        return self.num_passed / len(self.rows) if self.rows else 0.0

    @property
    def is_enough(self) -> bool:
        """True where the fraction reaches the gate and every control fails its row."""
        return self.fraction >= GATE and all(control.fails for control in self.controls)

    def plain(self) -> dict[str, Any]:
        """As in JSON."""
        return {
            "rows": [row.plain() for row in self.rows],
            "controls": [control.plain() for control in self.controls],
            "passed": self.num_passed,
            "share": self.fraction,
            "gate": GATE,
            "enough": self.is_enough,
            "part": self.part,
            "seed": self.seed,
            "version": __version__,
            "real_from": {name: found.origin for name, found in self.measured.items()},
            "targets_differ": self.differs,
            "failures": {name: dict(found.failures) for name, found in self.measured.items() if found.failures},
        }


def make_scorecard(measured: Sequence[MeasuredBlock], *, part: str, seed: int, stored: Targets) -> Scorecard:
    """Judges what was measured.

    Args:
        measured: Block by block.
        part: Of the real recordings.
        seed: Of the synthetic walks.
        stored: Targets that values measured on recordings are compared with.
    """
    rows: list[ScorecardRow] = []
    controls: list[ControlResult] = []
    differs = {}
    for result in measured:
        name, block = result.name, None if "block" in result.failures else load_block(result.name)
        of_block = _rows(block, result)
        rows += of_block
        if block is not None:
            passed = {row.statistic: row.passed for row in of_block}
            for key, control in block.controls.items():
                row = _control_row(block, key, result)
                controls.append(ControlResult(key, control.what, row, passed[control.statistic]))
        if result.origin == "recordings" and part == PART and result.real is not None and name in stored.blocks:
            differs[name] = differing(stored.blocks[name], result.real)
    return Scorecard(tuple(rows), tuple(controls), {found.name: found for found in measured}, part, seed, differs)


def measure_blocks(
    names: Sequence[str],
    source: RealSource,
    *,
    seed: int = 0,
    count: int | None = None,
    jobs: int = 1,
    report: Callable[[str], None] = lambda line: None,
) -> list[MeasuredBlock]:
    """Measures blocks, in their order; the same whatever the number of processes.

    One process, too, is a process of its own, with one numeric thread: sums stay the same.

    Args:
        names: Blocks, as `load_block` takes them.
        source: Of the real values.
        seed: Of the synthetic walks.
        count: Of synthetic walks; as each block says where None.
        jobs: Processes; a block is measured in one.
        report: Receives progress, line by line.
    """
    report(f"measuring {len(names)} block{'s' * (len(names) > 1)} in {min(jobs, len(names))} process(es)")
    executor = ProcessPoolExecutor(max_workers=min(jobs, len(names)) or 1, env=THREADS)
    found = {}
    try:
        futures = {executor.submit(measure, name, source, seed, count): name for name in names}
        for done, future in enumerate(as_completed(futures), start=1):
            name = futures[future]
            try:
                found[name] = future.result()
            except TerminatedWorkerError:
                found[name] = MeasuredBlock(name, failures={"synthetic": DIED})
            report(f"{done}/{len(names)} blocks: {name}{' failed' if found[name].failures else ''}")
    finally:
        executor.shutdown(wait=True, kill_workers=True)
    return [found[name] for name in names]


def _rows(block: Block | None, result: MeasuredBlock) -> list[ScorecardRow]:
    """Rows of a block; where real or synthetic values are missing, rows that say why."""
    if block is None or result.synthetic is None:
        return unmeasured(result.name, block, _first_line(result, "block", "synthetic"))
    if result.real is not None:
        return block_rows(result.name, block, result.real, result.synthetic)
    why = _first_line(result, "real")  # what needs no real value can be judged all the same
    rows = block_rows(result.name, block, NO_TARGET, result.synthetic)
    return [row if row.judged else dataclasses.replace(row, why=why) for row in rows]


def _control_row(block: Block, key: str, result: MeasuredBlock) -> ScorecardRow:
    name, values = block.controls[key].statistic, result.disturbed.get(key)
    if values is None:
        rows = unmeasured(result.name, block, _first_line(result, f"control {key}"))
        return next(row for row in rows if row.statistic == name)
    statistic = next(statistic for statistic in block.criteria if statistic.name == name)
    return statistic_row(result.name, block, statistic, result.real or NO_TARGET, values)


def _first_line(result: MeasuredBlock, *steps: str) -> str:
    return next((result.failures[step] for step in steps if step in result.failures), DIED).splitlines()[0]
