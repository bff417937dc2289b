"""The scorecard: every block measured, judged and counted."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from joblib.externals.loky import ProcessPoolExecutor, as_completed
from joblib.externals.loky.process_executor import TerminatedWorkerError

from pdrbench import __version__
from pdrbench.isolation.launcher_client import THREADS
from pdrbench_sim.realism import load_block
from pdrbench_sim.realism.block import Block, Control
from pdrbench_sim.realism.criteria import ScorecardRow, block_rows, statistic_row, unmeasured
from pdrbench_sim.realism.measure import RECORDINGS, MeasuredBlock, RealSource, measure
from pdrbench_sim.realism.targets import NO_TARGET, PART, Target, Targets, differing

GATE: Final = 0.85  # smallest fraction of rows that pass
DIED: Final = "its process died, perhaps for lack of memory; run it alone with --block and fewer walks with --count"


@dataclass(frozen=True, slots=True)
class ControlResult:
    """What became of values that are wrong on purpose.

    Attributes:
        name: Of the control.
        what: What was done to them.
        row: The row that had to fail.
        fails: True where it could be judged and did not pass.
        passes_without: Whether the row passes without the disturbance; where it does not, the control shows little.
    """

    name: str
    what: str
    row: ScorecardRow
    fails: bool
    passes_without: bool

    def plain(self) -> dict[str, Any]:
        """As in JSON."""
        row = self.row.plain()
        head = {"block": row.pop("block"), "control": self.name, "done": self.what, "fails": self.fails}
        return {**head, "passes_without": self.passes_without, **row}


@dataclass(frozen=True, slots=True)
class Scorecard:
    """What was found.

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
        """True where the share reaches the gate and every control fails its row."""
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
        of_block = _rows(name, block, result)
        rows += of_block
        if block is not None:
            controls += _controls(name, block, result, of_block)
        if result.origin == RECORDINGS and part == PART and result.real is not None and name in stored.blocks:
            differs[name] = differing(stored.blocks[name], result.real)
    return Scorecard(tuple(rows), tuple(controls), {found.name: found for found in measured}, part, seed, differs)


def measure_blocks(
    names: Sequence[str],
    source: RealSource,
    *,
    seed: int = 0,
    count: int | None = None,
    jobs: int = 1,
    tell: Callable[[str], None] = lambda line: None,
) -> list[MeasuredBlock]:
    """Measures blocks, in their order; the same whatever the number of processes.

    One process, too, is a process of its own, with one numeric thread: sums stay the same.

    Args:
        names: Blocks, as `load_block` takes them.
        source: Of the real values.
        seed: Of the synthetic walks.
        count: Of synthetic walks; as each block says where None.
        jobs: Processes; a block is measured in one.
        tell: Receives what is done, line by line.
    """
    tell(f"measuring {len(names)} block{'s' * (len(names) > 1)} in {min(jobs, len(names))} process(es)")
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
            tell(f"{done}/{len(names)} blocks: {name}{' failed' if found[name].failures else ''}")
    finally:
        executor.shutdown(wait=True, kill_workers=True)
    return [found[name] for name in names]


def _rows(name: str, block: Block | None, result: MeasuredBlock) -> list[ScorecardRow]:
    """Rows of a block; where a half is missing, rows that tell why."""
    if block is None or result.synthetic is None:
        return unmeasured(name, block, _first_line(result, "block", "synthetic"))
    if result.real is not None:
        return block_rows(name, block, result.real, result.synthetic)
    why = _first_line(result, "real")  # what needs no real value can be judged all the same
    rows = block_rows(name, block, NO_TARGET, result.synthetic)
    return [row if row.judged else dataclasses.replace(row, why=why) for row in rows]


def _first_line(result: MeasuredBlock, *halves: str) -> str:
    return next((result.failures[half] for half in halves if half in result.failures), DIED).splitlines()[0]


def _controls(name: str, block: Block, result: MeasuredBlock, rows: Iterable[ScorecardRow]) -> Iterator[ControlResult]:
    passes = {row.statistic: row.passed for row in rows}
    real = NO_TARGET if result.real is None else result.real
    for key, control in block.controls.items():
        row = _control_row(name, block, control, real, result, key)
        fails = row.judged and not row.passed
        yield ControlResult(key, control.what, row, fails, passes.get(control.statistic, False))


def _control_row(
    name: str, block: Block, control: Control, real: Target, result: MeasuredBlock, key: str
) -> ScorecardRow:
    values = result.disturbed.get(key)
    if values is None:
        why = _first_line(result, f"control {key}")
        return next(row for row in unmeasured(name, block, why) if row.statistic == control.statistic)
    statistic = next(statistic for statistic in block.criteria if statistic.name == control.statistic)
    return statistic_row(name, block, statistic, real, values)
