"""`pdrbench map check PLAN`: a plan examined and drawn."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final

import typer

from pdrbench.cli.output import AsJson, answer_only, note, print_json, print_table, say
from pdrbench.errors import PdrbenchError
from pdrbench.io.log import Log
from pdrbench.recording import Recording
from pdrbench.trajectory import Trajectory
from pdrbench_formats.commands.inspect import FORMAT_HELP
from pdrbench_formats.detect import read as read_file
from pdrbench_formats.detect import read_plan
from pdrbench_formats.maps.plan import Plan

DOORS_HELP: Final = "Open rooms without a door: none; rooms: 0.9 m; nearest: shops of a mall too; wide: the whole wall."
MAX_ROWS: Final = 12  # of a list in a terminal; --json and --out have all

app = typer.Typer(help="Plans of buildings.", no_args_is_help=True)


@app.callback()
def _plans() -> None:
    """Plans of buildings."""


@app.command()
def check(
    plan_file: Annotated[Path, typer.Argument(metavar="PLAN", help="File, folder or archive with a plan.")],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw it: .html, .png, .svg or .pdf.", show_default="none")
    ] = None,
    walk_file: Annotated[
        Path | None, typer.Option("--walk", metavar="FILE", help="A recording with places: which walls does it cross?")
    ] = None,
    kind: Annotated[str | None, typer.Option("--format", metavar="NAME", help=FORMAT_HELP, show_default="any")] = None,
    doors: Annotated[str, typer.Option(metavar="HOW", help=DOORS_HELP)] = "none",
    as_json: AsJson = False,
) -> None:
    """List what a plan holds, what no way leads to, and what had to be repaired; draw it."""
    with answer_only(as_json):
        from pdrbench_formats.pages.map_check import check_walk, plan_facts
        from pdrbench_formats.pages.map_page import write_picture

        plan = read_plan(plan_file, kind, doors)
        walk = None if walk_file is None else check_walk(plan.building, _places(walk_file, plan))
        facts = {"path": str(plan_file), **plan_facts(plan)}
        if walk is not None:
            facts["walk"] = walk.facts()
            facts["warnings"] += list(walk.warnings)
        if out is not None:
            write_picture(plan, walk, out)
    if as_json:
        repairs = [{"kind": r.kind, "where": r.where, "what": r.what, "level": r.level} for r in plan.repairs]
        print_json({**facts, "repairs": repairs})
        return
    _print(facts, plan)
    if out is not None:
        note(f"drawn in {out}")


def _places(file: Path, plan: Plan) -> Trajectory:
    """The places of a recorded walk, in the frame of the plan where both know where they are on the Earth."""
    content = read_file(file)
    if not isinstance(content, (Log, Recording)):
        raise PdrbenchError(f"{file} holds no walk; name a recording with places")
    walk = content.reference
    if not len(walk):
        raise PdrbenchError(f"{file} holds a walk without a place; nothing can be compared with the plan")
    geo = getattr(content, "geo", None)
    if geo is None or plan.geo is None:
        return walk
    lat_deg, lon_deg = geo.to_geo(walk.xy_m)
    return Trajectory(t_s=walk.t_s, xy_m=plan.geo.to_local(lat_deg, lon_deg), level=walk.level, surveyed=walk.surveyed)


def _print(facts: dict[str, Any], plan: Plan) -> None:
    from pdrbench_formats.pages.map_page import shown

    for warning in facts["warnings"]:
        say(f"warning: {warning}")
    for name in ("path", "name", "format"):
        say(f"{name}: {facts[name]}")
    unconnected = ", ".join(str(level) for level in facts["unconnected_levels"]) or "none"
    say(f"levels without stairs or lift to another: {unconnected}")
    walk = facts.get("walk")
    if walk is not None:
        say(
            f"walk: {walk['places']} places, {walk['outside']} outside the floor, {walk['walls_crossed']} walls crossed"
        )
    repairs = [{"kind": r.kind, "where": r.where, "what": r.what} for r in plan.repairs]
    tables = {name: facts[name] for name in ("levels", "stairs", "lifts", "unreachable")} | {"repairs": repairs}
    if walk is not None:
        tables["walls crossed"] = walk["crossed_at"]
    for title, rows in tables.items():
        if not rows:
            say(f"{title}: none")
            continue
        more = f" (first {MAX_ROWS} of {len(rows)})" if len(rows) > MAX_ROWS else ""
        head: dict[str, Any] = {column: {"justify": "left"} for column in rows[0]}
        print_table(head, [[shown(value) for value in row.values()] for row in rows[:MAX_ROWS]], title=title + more)
