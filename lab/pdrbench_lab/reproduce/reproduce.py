"""`reproduce`: measures what a paper claims, and sets it beside what the paper states."""

from __future__ import annotations

import json
import math
import os
import traceback
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pdrbench.evaluation import store
from pdrbench.evaluation.jobs import JobContext, check_counts
from pdrbench.evaluation.origin import machine, package_sha256, versions
from pdrbench.evaluation.scheduler import run_all
from pdrbench.registry import PluginEntry, PluginError, entries, environments, find_entry, localizers
from pdrbench_lab.reproduce.experiments import measure, plain_numbers, plan_experiments
from pdrbench_lab.reproduce.number_text import three_digits
from pdrbench_lab.reproduce.reproduction import REPRODUCTIONS_GROUP, Claim, Measured, Numbers, Reproduction, Value

SEEDS_FOLDER: Final = "seeds"
FIGURES_FOLDER: Final = "figures"
FIGURES_NOTE: Final = ".drawn.json"  # what the figures were drawn from
OURS: Final = "pdrbench"  # the distribution whose plug-ins every reproduction may use


@dataclass(frozen=True, slots=True)
class Failure:
    """A seed for which an experiment gave no numbers."""

    experiment: str
    seed: int
    why: str  # traceback, or how the process ended
    path: Path  # file that holds the same text

    @property
    def last_line(self) -> str:
        """The line of a traceback that names the error."""
        return self.why.strip().splitlines()[-1] if self.why.strip() else "no reason given"


@dataclass(frozen=True, slots=True)
class Reproduced:
    """What a run of a reproduction found."""

    reproduction: Reproduction  # what was run
    # One for each claim: id, what, paper, ours, low, high, gate, pass; unit, seeds, failed, note. `ours`, `low` and
    # `high` are NaN where there is none; `note` says why. `pass` is None where nothing is demanded; a claim with a gate
    # does not pass where a seed failed
    rows: tuple[Mapping[str, Any], ...]
    # Numbers of every seed that succeeded, in the order of the seeds, by experiment
    measured: Mapping[str, Sequence[Numbers]]
    failures: tuple[Failure, ...]  # seeds that did not
    quick: bool  # true where it was a quick run
    folder: Path  # where everything is stored
    entry: PluginEntry  # where the reproduction came from

    def to_markdown(self) -> str:
        """The table and what failed, as a page."""
        head = ["id", "what", "paper", "ours", "95 % interval", "gate", "pass", "seeds"]
        lines = [f"# {self.reproduction.name}", "", self.reproduction.paper, ""]
        if self.quick:
            lines += ["A quick run: few seeds, wide intervals.", ""]
        lines += [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
        for row in self.rows:
            cells = (cell.replace("|", "\\|").replace("\n", " ") for cell in cells_of(row))
            lines.append(f"| {' | '.join(cells)} |")
        lines += ["", *(f"* {line}" for line in footnotes(self))]
        return "\n".join(lines).rstrip() + "\n"


def _row(claim: Claim, runs: Sequence[Numbers], failed: int) -> dict[str, Any]:
    measured, note = _compute(claim.value, runs)
    gate = measured.gate or claim.gate
    return {
        "id": claim.id,
        "what": claim.what,
        "paper": claim.paper,
        "ours": measured.ours,
        "low": measured.low,
        "high": measured.high,
        "gate": "" if gate is None else gate.text(claim.unit),
        "pass": None if gate is None else gate.holds(measured.ours) and not failed,
        "unit": claim.unit,
        "seeds": len(runs),
        "failed": failed,
        "note": note,
    }


def _compute(value: Value, runs: Sequence[Numbers]) -> tuple[Measured, str]:
    """The value of a claim, and why there is none."""
    if not runs:
        return Measured(math.nan), "nothing was measured"
    try:
        found = value(runs)
        return Measured(float(found.ours), float(found.low), float(found.high), found.gate), ""
    except Exception as error:  # noqa: BLE001  one wrong claim must not hide the others
        return Measured(math.nan), f"{type(error).__name__}: {error}"


def cells_of(row: Mapping[str, Any]) -> list[str]:
    """Cells of a row for people: id, what, paper, ours, interval, gate, pass, seeds."""
    has_interval = not (math.isnan(row["low"]) or math.isnan(row["high"]))
    return [
        row["id"],
        row["what"],
        row["paper"],
        three_digits(row["ours"], row["unit"]),
        f"{three_digits(row['low'], row['unit'])} to {three_digits(row['high'], row['unit'])}" if has_interval else "–",
        row["gate"],
        {True: "yes", False: "no", None: "shown"}[row["pass"]],
        f"{row['seeds']}" + (f", {row['failed']} failed" if row["failed"] else ""),
    ]


def footnotes(found: Reproduced) -> list[str]:
    """What the table does not show, a line each."""
    lines = [
        f"{failure.experiment}, seed {failure.seed} failed: {failure.last_line}; "
        f"see {failure.path.relative_to(found.folder)}"
        for failure in found.failures
    ]
    return lines + [f"{row['id']} ({row['what']}): {row['note']}" for row in found.rows if row["note"]]


def reproduce(
    name: str, out: Path | str, *, quick: bool = False, seeds: int | None = None, jobs: int = 1, progress: bool = False
) -> Reproduced:
    """Measures every claim of a paper.

    What a run before has measured with the same sources is read, not measured again, also by a full run after a quick
    one. The numbers depend on the seeds and not on `jobs`. An experiment that raises or takes its process down costs
    that seed only; it is tried again by the next run.

    Args:
        name: Registered name, or `package.module:REPRODUCTION`.
        out: Folder; everything goes into a folder of the reproduction's name in it: `seeds/` holds what each seed gave,
            `claims.json` and `claims.md` the table.
        quick: Few seeds, as the reproduction chooses them.
        seeds: So many seeds of every experiment instead.
        jobs: Processes.
        progress: Shows on stderr how far it is.

    Raises:
        PdrbenchError: An unknown name, a reproduction that does not load, a full disk, sources that change meanwhile.
    """
    check_counts(seeds=seeds, jobs=jobs)
    reproduction, entry = load_reproduction(name)
    counts = {e.name: seeds or (e.quick_seeds if quick else e.seeds) for e in reproduction.experiments}
    folder = Path(out).absolute() / reproduction.name
    jobs_to_do = plan_experiments(reproduction.experiments, counts, _packages(entry))
    context = JobContext(store.make_folder(folder / SEEDS_FOLDER), uuid.uuid4().hex, os.getpid(), measure)
    numbers = run_all(jobs_to_do, context, jobs, is_warm=False, progress=progress, what="measurements")
    measured: dict[str, list[Numbers]] = {experiment.name: [] for experiment in reproduction.experiments}
    failures = []
    for job in jobs_to_do:
        if job.name in numbers:
            measured[job.family].append(numbers[job.name])
        else:
            path = job.failure_path(folder / SEEDS_FOLDER)
            why = path.read_text(encoding="utf-8") if path.exists() else ""
            failures.append(Failure(job.family, job.seed, why, path))
    rows = [
        _row(claim, measured[claim.experiment], sum(failure.experiment == claim.experiment for failure in failures))
        for claim in reproduction.claims
    ]
    found = Reproduced(reproduction, tuple(rows), measured, tuple(failures), quick, folder, entry)
    _write_table(found)
    return found


def load_reproduction(name: str) -> tuple[Reproduction, PluginEntry]:
    """A reproduction and where it came from; its experiments and figures are there.

    Raises:
        UnknownNameError: It is not registered; suggests the nearest name.
        PluginError: It or one of its functions does not load.
    """
    place, _, attribute = name.partition(":")
    entry = (
        PluginEntry(name, name, place.partition(".")[0])
        if attribute
        else find_entry(REPRODUCTIONS_GROUP, "reproduction", name)
    )
    found = entry.load()
    if not isinstance(found, Reproduction):
        raise PluginError(f"{name!r} from {entry.package}: {entry.target} is {type(found).__name__}, no Reproduction")
    if not attribute and found.name != name:
        raise PluginError(f"{name!r} from {entry.package} calls itself {found.name!r}")
    for target in filter(None, (*(experiment.measure for experiment in found.experiments), found.figures)):
        if not callable(PluginEntry(name, target, entry.package).load()):
            raise PluginError(f"{name!r} from {entry.package}: {target} is no function")
    return found, entry


def _packages(entry: PluginEntry) -> set[str]:
    """Top-level packages whose code may take part: of the reproduction, and of the plug-ins beside it and of ours."""
    registered = (*environments().values(), *localizers().values(), *entries(REPRODUCTIONS_GROUP).values())
    targets = [entry.target, *(other.target for other in registered if other.package in (entry.package, OURS))]
    return {target.partition(":")[0].partition(".")[0] for target in targets}


def _write_table(found: Reproduced) -> None:
    document = {
        "reproduction": found.reproduction.name,
        "paper": found.reproduction.paper,
        "quick": found.quick,
        "versions": versions(),
        "machine": machine(),
        "claims": [{key: _plain(value) for key, value in row.items()} for row in found.rows],
    }
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    store.write_whole(found.folder / "claims.json", text.encode())
    store.write_whole(found.folder / "claims.md", found.to_markdown().encode())


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def draw_figures(found: Reproduced) -> list[Path]:
    """The figures of the paper, in the folder `figures`; those drawn before from the same are kept.

    Raises:
        PluginError: The function that draws raised.
    """
    target = found.reproduction.figures
    if not target:
        return []
    folder = store.make_folder(found.folder / FIGURES_FOLDER)
    key = store.result_key(
        {
            "sources": {package: package_sha256(package) for package in sorted({OURS, *_packages(found.entry)})},
            "quick": found.quick,
            "measured": {name: [plain_numbers(numbers) for numbers in runs] for name, runs in found.measured.items()},
        }
    )
    drawn = _drawn_before(folder, key)
    if drawn is not None:
        return drawn
    draw = PluginEntry(found.reproduction.name, target, found.entry.package).load()
    try:
        files = [Path(file) for file in draw(folder, found.measured, found.quick)]
    except Exception as error:  # a reproduction's own code may raise anything
        raise PluginError(f"the figures of {found.reproduction.name} failed:\n{traceback.format_exc()}") from error
    note = {"key": key, "files": [file.relative_to(folder).as_posix() for file in files]}
    store.write_whole(folder / FIGURES_NOTE, json.dumps(note).encode())
    return files


def _drawn_before(folder: Path, key: str) -> list[Path] | None:
    try:
        note = json.loads((folder / FIGURES_NOTE).read_bytes())
        files = [folder / name for name in note["files"]]
        return files if note["key"] == key and all(file.exists() for file in files) else None
    except (OSError, ValueError, KeyError, TypeError):
        return None
