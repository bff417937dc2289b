"""`pdrbench inspect FILE`: what a file holds."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer

from pdrbench.building import Building
from pdrbench.cli.options import exit_on
from pdrbench.cli.output import AsJson, answer_only, print_json, print_table, say
from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray
from pdrbench.io import READERS
from pdrbench.io.log import Log
from pdrbench.recording import Recording
from pdrbench.result import Result
from pdrbench.sensors.checks import rate_of
from pdrbench.trajectory import Trajectory
from pdrbench_formats.detect import detect, unpacked
from pdrbench_formats.detect import read as read_file
from pdrbench_formats.maps.plan import Plan

TABLE: Final = "csv"  # format of tables of numbers, which a column map explains
RESULT: Final = "result"  # format of what `run --out` leaves
VECTORS: Final = ("accel", "gyro", "mag")  # a wrong unit shows in the mean length: 9.8 m/s2, 1 rad/s, 25 to 65 uT
FORMAT_HELP: Final = "Format, where the content does not show it."
COLUMNS_HELP: Final = "Column map of a table of numbers: TOML with [columns]."
RATE_HELP: Final = "Rows a second of a table that has no time."


def inspect(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Log, recording, map, fingerprints or stored walk.")],
    kind: Annotated[str | None, typer.Option("--format", metavar="NAME", help=FORMAT_HELP, show_default="any")] = None,
    columns: Annotated[
        Path | None, typer.Option("--columns", metavar="FILE", help=COLUMNS_HELP, show_default="guessed")
    ] = None,
    rate: Annotated[float | None, typer.Option(metavar="HZ", help=RATE_HELP, show_default="of its time")] = None,
    as_json: AsJson = False,
) -> None:
    """Print what a file holds, what was left out, and what is wrong; exit 1 where that is an error."""
    with answer_only(as_json):
        known = rated(columns, rate)
        kind, content = read_thing(file, kind if known is None else TABLE, strict=False, columns=known)
        facts = {"path": str(file), "format": kind, **describe(content)}
        if kind == TABLE and known is None:
            with unpacked(file) as table:
                hint = READERS[TABLE].hint
                facts["column map"] = hint(table) if hint is not None else ""
    findings = facts.get("findings", [])
    errors = [finding["code"] for finding in findings if finding["severity"] == "error"]
    failed = [f"not to be played as it is: {', '.join(errors)}"] if errors else []
    if as_json:
        print_json(facts)
        exit_on(failed)
        return
    facts.pop("findings", None)
    column_map = facts.pop("column map", "")
    for name, value in facts.items():
        if isinstance(value, Mapping):
            value = ", ".join(f"{key} {_short(item)}" for key, item in value.items()) or "none"
        if not isinstance(value, list):
            say(f"{name}: {_short(value)}")
    for name, rows in facts.items():
        if isinstance(rows, list) and rows:
            head: dict[str, Mapping[str, Any]] = {column: {"justify": "right"} for column in rows[0]}
            print_table(head, [[_short(value) for value in row.values()] for row in rows], title=name)
    for finding in findings:
        say("{severity} ({code}): {where}: {seen}; {remedy}".format(**finding))
    if column_map:
        say(f"\ncolumn map, to be kept in a file for --columns:\n\n{column_map}")
    exit_on(failed)


def rated(columns: Path | None, rate_hz: float | None) -> str | dict[str, float] | None:
    """The column map that a user names, or one that holds the rate only.

    Raises:
        PdrbenchError: Both are given.
    """
    if columns is None:
        return None if rate_hz is None else {"rate_hz": rate_hz}
    if rate_hz is not None:
        raise PdrbenchError(f"--rate {rate_hz:g} and --columns {columns}: write rate_hz = {rate_hz:g} into the file")
    return str(columns.absolute())


def read_thing(file: Path, kind: str | None, *, strict: bool = True, columns: Any = None) -> tuple[str, object]:
    """Format and content of a file or folder; a stored walk is one of its formats.

    Args:
        file: File or folder.
        kind: Format; None to recognise it.
        strict: False to read a walk with errors, which are then among its findings.
        columns: Column map of a table.
    """
    from pdrbench.evaluation import store

    if kind is None and file.is_file():
        with file.open("rb") as stream:
            kind = RESULT if stream.read(len(store.MAGIC)) == store.MAGIC else None
    if kind == RESULT:
        return RESULT, store.load(file)
    kind = detect(file) if kind is None else kind
    options: dict[str, Any] = {"strict": strict} if columns is None else {"strict": strict, "columns": columns}
    return kind, read_file(file, kind, **options)


def describe(content: object) -> dict[str, Any]:
    """What a file holds, as numbers, texts, mappings and tables (lists of rows)."""
    match content:
        case Log():
            return {
                "holds": "a walk",
                "device": content.device,
                "mounting": content.mounting,
                "start": None
                if content.start_unix_s is None
                else datetime.fromtimestamp(content.start_unix_s, UTC).isoformat(timespec="milliseconds"),
                "place": None if content.geo is None else f"{content.geo.lat_deg:g}, {content.geo.lon_deg:g}",
                "reference": _reference(content.reference),
                **{name: dict(getattr(content.report, name)) for name in ("skipped", "dropped", "mended")},
                "constant": " ".join(content.report.constant) or "none",
                "sensors": _sensors(content.rows),
                "findings": [dataclasses.asdict(finding) for finding in content.findings],
            }
        case Recording():
            return {
                "holds": "a walk",
                "id": content.id,
                "device": content.device,
                "mounting": content.mounting,
                "subject": dict(content.subject),
                "building": content.building.name if content.building is not None else "none",
                "reference": _reference(content.reference),
                "sensors": _sensors({name: stream.rows for name, stream in content.streams.items()}),
            }
        case Building():
            return Plan(content).describe()
        case Result():
            answers = content.estimates
            return {
                "holds": "a walk that was played",
                **{name: getattr(content, name) for name in ("env", "split", "walk", "localizer", "seed", "status")},
                "division": content.division,
                "failure": content.failure.strip().splitlines()[-1] if content.failure else "none",
                "answers": len(answers),
                "given": int(answers.given.sum()),
                "missing": dict(content.missing),
                "median step_ms": 1e3 * float(np.nanmedian(content.step_s)) if len(answers) else None,
                "provenance": {
                    name: value for name, value in content.provenance.items() if isinstance(value, (str, int, float))
                },
            }
    if hasattr(content, "describe"):
        own: dict[str, Any] = content.describe()
        return own
    return {"holds": type(content).__name__}


def _sensors(rows: Mapping[str, FloatArray]) -> list[dict[str, Any]]:
    """Rows, span, median rate and longest gap of each sensor, and the mean length of what is a vector."""
    table = []
    for name, values in rows.items():
        t_s = values[:, 0]
        gaps_s = np.diff(t_s)
        lengths = np.linalg.norm(values[:, 1:4], axis=1) if name in VECTORS else t_s[:0]
        table.append(
            {
                "sensor": name,
                "rows": len(values),
                "from_s": float(t_s[0]) if len(t_s) else None,
                "to_s": float(t_s[-1]) if len(t_s) else None,
                "median rate_hz": rate_of(t_s) or None,
                "longest gap_s": float(gaps_s.max()) if len(gaps_s) else None,
                "mean length": float(lengths.mean()) if len(lengths) else None,
            }
        )
    return table


def _reference(reference: Trajectory) -> dict[str, Any]:
    length_m = float(np.hypot(*np.diff(reference.xy_m, axis=0).T).sum()) if len(reference) > 1 else 0.0
    return {
        "places": len(reference),
        "surveyed": int(reference.surveyed.sum()),
        "length_m": length_m,
        "levels": " ".join(str(level) for level in np.unique(reference.level)) or "none",
    }


def _short(value: object) -> str:
    if value in (None, ""):
        return "–"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
