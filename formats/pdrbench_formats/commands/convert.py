"""`pdrbench convert IN OUT`."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

from pdrbench.building import Building
from pdrbench.cli.options import write_text
from pdrbench.cli.output import AsJson, answer_only, note, print_json
from pdrbench.errors import PdrbenchError
from pdrbench.io.log import Log
from pdrbench.recording import Recording
from pdrbench.result import Result
from pdrbench_formats.commands.inspect import COLUMNS_HELP, FORMAT_HELP, TABLE, read_thing
from pdrbench_formats.commands.map import DOORS_HELP
from pdrbench_formats.detect import read_plan
from pdrbench_formats.export import FORMATS
from pdrbench_formats.maps.plan import Plan


def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", help="Log, recording, map or stored walk.")],
    out: Annotated[
        Path,
        typer.Argument(
            metavar="OUT", help="A new folder for a walk, a .geojson for a map, a .csv or .tum for a stored walk."
        ),
    ],
    kind: Annotated[str | None, typer.Option("--format", metavar="NAME", help=FORMAT_HELP, show_default="any")] = None,
    name: Annotated[str | None, typer.Option(metavar="ID", help="Of the walk.", show_default="the file's")] = None,
    map_file: Annotated[
        Path | None, typer.Option("--map", metavar="FILE", help="Where the walk took place.", show_default="none")
    ] = None,
    columns: Annotated[
        Path | None, typer.Option("--columns", metavar="FILE", help=COLUMNS_HELP, show_default="guessed")
    ] = None,
    mounting: Annotated[str, typer.Option(metavar="WHERE", help="Where the device was: hand, pocket, foot.")] = "",
    doors: Annotated[str, typer.Option(metavar="HOW", help=DOORS_HELP)] = "none",
    as_json: AsJson = False,
) -> None:
    """Convert a file into pdrbench's own storage: exact, mapped into memory, never unpickled."""
    with answer_only(as_json):
        from pdrbench_formats.maps import geojson
        from pdrbench_formats.recordings import native

        found, content = read_thing(source, TABLE if columns is not None else kind, columns=columns)
        match content:
            case Log() | Recording():
                _check_out(out, "", "a walk becomes a folder")
                building = None if map_file is None else read_plan(map_file, None, doors).building
                native.write(_recording(content, source, name, building, mounting), out)
            case Building() | Plan():
                _check_out(out, ".geojson", "a map becomes a .geojson file")
                plan = read_plan(source, found, doors)
                geojson.write(plan.building, out)
                for warning in plan.warnings:
                    note(f"warning: {warning}")
            case Result():
                _check_out(out, ".tum" if out.suffix == ".tum" else ".csv", "the answers become a .csv or .tum file")
                write_text(out, FORMATS[out.suffix](content.estimates, None, None, content.walk))
            case _:
                raise PdrbenchError(f"{source}: {found} is read, and converted into no other format")
    if as_json:
        print_json({"path": str(out), "from": found})
    else:
        note(f"{source} ({found}) is stored in {out}")


def _check_out(out: Path, suffix: str, rule: str) -> None:
    if out.suffix != suffix:
        raise PdrbenchError(f"{rule}; {out} is none: name one")
    if out.exists():
        raise PdrbenchError(f"{out} exists; choose another name or delete it")
    if not out.absolute().parent.is_dir():
        raise PdrbenchError(f"there is no folder {out.absolute().parent}; make it first")


def _recording(
    content: Log | Recording, source: Path, name: str | None, building: Building | None, mounting: str
) -> Recording:
    from pdrbench.sensors import sensor_spec

    if isinstance(content, Recording):
        return dataclasses.replace(
            content, id=name or content.id, building=building or content.building, mounting=mounting or content.mounting
        )
    return content.recording(name or source.name.partition(".")[0], building, sensor_spec, mounting=mounting)
