"""`pdrbench validate-sim`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from pdrbench.cli.options import Jobs, make_folder, write_text
from pdrbench.cli.output import AsJson, answer_only, note, print_json, print_table
from pdrbench.errors import PdrbenchError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pdrbench_lab.realism.scorecard import Scorecard

RECORDINGS = "data"


def validate_sim(
    block: Annotated[
        list[str] | None,
        typer.Option("--block", metavar="NAME", help="Only this block; may be repeated.", show_default="all"),
    ] = None,
    count: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Synthetic walks of a block.", show_default="as each block says"),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, metavar="S", help="Seed of the synthetic walks.")] = 0,
    real: Annotated[
        str | None,
        typer.Option(
            metavar="FILE|data",
            help="Real values: a file of them, or measured on recordings.",
            show_default="recordings where they are available, else the packaged file",
        ),
    ] = None,
    part: Annotated[
        Literal["judge", "fit"],
        typer.Option(metavar="PART", help="Recordings to judge by, or those that parameters were fitted on."),
    ] = "judge",
    jobs: Jobs = 1,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", file_okay=False, help="Write the scorecard and its figures there.")
    ] = None,
    write_targets: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", dir_okay=False, help="Only measure the recordings and write what is packaged; no scorecard."
        ),
    ] = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit 1 where too few rows pass or a negative control does not fail.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Judge synthetic sensor streams by real ones: the same statistics of both, side by side.

    Real values come from recordings where they are available, else from a file that travels with pdrbench. Exit 1 where
    something could not be measured.
    """
    with answer_only(as_json):
        from pdrbench_lab.realism import BLOCKS, load_block, scorecard
        from pdrbench_lab.realism.format import footnotes, summary
        from pdrbench_lab.realism.measure import RealSource
        from pdrbench_lab.realism.targets import read_targets

        names = list(dict.fromkeys(block or BLOCKS))
        for name in block or ():
            load_block(name)
        if write_targets is not None:
            _write_targets(names, write_targets)
            return
        if out is not None:
            make_folder(out)
        source, stored = RealSource(part), read_targets()
        if real == RECORDINGS:
            source = RealSource(part, file=None)
        elif real is not None:
            read_targets(Path(real))  # a file that cannot be read is reported before any work is done
            source = RealSource(part, file=Path(real).resolve(), is_forced=True)
        measured = scorecard.measure_blocks(names, source, seed=seed, count=count, jobs=jobs, report=note)
        found = scorecard.make_scorecard(measured, part=part, seed=seed, stored=stored)
    if as_json:
        print_json(found.plain())
    else:
        _print_rows(found)
    sys.stdout.flush()  # drawing takes a while
    for line in (*footnotes(found), *(result.trace.rstrip() for result in found.measured.values() if result.trace)):
        note(line)
    if out is not None:
        with answer_only(as_json):
            _write(found, out)
    failed = [name for name, result in found.measured.items() if result.failures]
    if failed:
        raise PdrbenchError(f"not everything could be measured, as reported above: {', '.join(failed)}")
    if strict and not found.is_enough:
        raise PdrbenchError(f"the gate is missed: {summary(found)}")


def _write_targets(names: Sequence[str], path: Path) -> None:
    from pdrbench_lab.realism import BLOCKS, load_block
    from pdrbench_lab.realism.measure import RealSource, real_values
    from pdrbench_lab.realism.targets import EMPTY, encode, read_targets, with_blocks

    before = read_targets(path) if path.exists() else EMPTY
    measured = {}
    for name in names:
        block = load_block(name)
        if block.datasets:
            note(f"{name}: reading {', '.join(block.datasets)}")
            measured[name] = real_values(name, block, RealSource(file=None))[1]
    known = [*BLOCKS, *(name for name in names if name not in BLOCKS)]
    write_text(path, encode(with_blocks(before, measured, known)))
    note(f"wrote {path}: {len(measured)} blocks measured")


def _print_rows(found: Scorecard) -> None:
    from pdrbench_lab.realism.format import HEAD, cells, control_line, summary

    wide, right, whole = {"ratio": 2}, {"justify": "right"}, {"no_wrap": True}
    options: dict[str, dict[str, Any]] = {
        "what": wide, "real": right, "synthetic": right, "distance": right | whole, "found": right, "pass": whole,
        "why": wide,
    }  # fmt: skip
    rows = [cells(row) for row in found.rows]
    title = (
        f"real: recordings of the part {found.part!r}, median (quartiles); "
        f"synthetic: seed {found.seed}, median (P10 to P90)"
    )
    print_table({name: options.get(name, {}) for name in HEAD}, rows, title=title)
    for control in found.controls:
        sys.stdout.write(control_line(control) + "\n")
    sys.stdout.write(summary(found) + "\n")


def _write(found: Scorecard, folder: Path) -> None:
    from pdrbench_lab.realism import BLOCKS
    from pdrbench_lab.realism.format import to_json, to_markdown
    from pdrbench_lab.realism.pictures import draw_blocks
    from pdrbench_lab.realism.walkthrough import draw_walkthrough

    write_text(folder / "scorecard.json", to_json(found))
    write_text(folder / "scorecard.md", to_markdown(found))
    files = draw_blocks(found, folder)
    if set(found.measured) >= set(BLOCKS):
        files += draw_walkthrough(found, folder)
    for file in files:
        note(f"drew {file}")
    note(f"stored in {folder}")
