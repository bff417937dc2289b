"""`pdrbench malls survey|plans|steps|own-session|order`."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from pdrbench.cli.options import Isolation, Jobs
from pdrbench.cli.output import AsJson, answer_only, print_json, print_table, say

if TYPE_CHECKING:
    from pdrbench_envs.malls.splits import Walk

app = typer.Typer(no_args_is_help=True, help="What MallPhone-v2 and MallPhoneLost-v2 are made of.")


@app.command("survey")
def survey(as_json: AsJson = False) -> None:
    """How many scans the survey of each split has, and how far they are from the places that are scored."""
    from pdrbench_envs.malls.splits import KNOWN, LATER, NUM_FOLDS, UNSEEN
    from pdrbench_lab.malls.draw import distances_m, played, scans_of_site, splits

    made = splits()
    parts: list[tuple[str, str | int, Sequence[Any]]] = [("val", "val", made.val)]
    parts += [(f"test, {group}", "test", made.test) for group in (KNOWN, UNSEEN, LATER)]
    parts += [(f"train, fold {fold}", fold, made.train[fold]) for fold in range(NUM_FOLDS)]
    rows = []
    with answer_only(as_json):
        for name, of, outings in parts:
            group = name.removeprefix("test, ") if of == "test" else KNOWN
            walks = played(outings, group) if of == "test" else _walks(outings)
            surveyed = made.survey(of)
            scans = sum(
                len(scans_of_site(s).scan_xy_m([w.path for w in surveyed if w.site == s])) for s in _sites(surveyed)
            )
            units = sum(outing[0].walks[0].group == group for outing in outings)
            row = {"part": name, "outings": units, "walks": len(walks), "survey_walks": len(surveyed), "scans": scans}
            rows.append(row | _near(distances_m(walks, surveyed)))
        floors = [_floor_row(made, floor) for floor in sorted({(w.site, w.floor) for w in made.survey("test")})]
    if as_json:
        print_json({"parts": rows, "floors": floors})
        return
    _print(rows, "walks, and how far the places that they mark are from the nearest scan of their survey")
    _print(floors, "the same of the test walks on each floor that has a survey")


def _walks(outings: Iterable[Any]) -> list[Walk]:
    return [walk for outing in outings for session in outing for walk in session.walks]


def _sites(walks: Iterable[Walk]) -> list[str]:
    return sorted({walk.site for walk in walks})


def _floor_row(made: Any, floor: tuple[str, str]) -> dict[str, Any]:
    from pdrbench_lab.malls.draw import distances_m, scans_of_site

    tested = [walk for walk in _walks(made.test) if (walk.site, walk.floor) == floor and walk.is_new]
    surveyed = [walk for walk in made.survey("test") if (walk.site, walk.floor) == floor]
    scans = len(scans_of_site(floor[0]).scan_xy_m([walk.path for walk in surveyed]))
    row = {"part": " ".join(floor), "walks": len(tested), "survey_walks": len(surveyed), "scans": scans}
    return row | _near(distances_m(tested, surveyed))


def _near(distance_m: Any) -> dict[str, Any]:
    """Places by distance to the nearest scan, in the strata of the tables of results."""
    near, far = (distance_m < 3.0).mean(), (distance_m > 10.0).mean()
    median_m = float(np.median(distance_m))
    return {
        "places": len(distance_m),
        "median_m": round(median_m, 1) if np.isfinite(median_m) else None,
        "0-3 m": round(float(near), 2),
        "3-10 m": round(float(1 - near - far), 2),
        "> 10 m": round(float(far), 2),
    }


def _print(rows: Sequence[dict[str, Any]], title: str) -> None:
    right = {"justify": "right", "no_wrap": True}
    head: dict[str, dict[str, Any]] = {name: {"no_wrap": True} if k == 0 else right for k, name in enumerate(rows[0])}
    print_table(head, [["-" if cell is None else str(cell) for cell in row.values()] for row in rows], title=title)


@app.command("plans")
def plans(as_json: AsJson = False) -> None:
    """How often walks cross what their plan calls an obstacle, by floor, and the walks of train and val concerned."""
    from pdrbench_envs.malls.environment import played_walks
    from pdrbench_envs.malls.splits import walks
    from pdrbench_lab.malls.plans import plan_faults

    of_floor: dict[tuple[str, str], list[Walk]] = {}
    for walk in walks():
        of_floor.setdefault((walk.site, walk.floor), []).append(walk)
    with answer_only(as_json):
        found = [plan_faults(shared) for _, shared in sorted(of_floor.items())]
    rows = [
        {
            "floor": f"{fault.site} {fault.floor}",
            "walks": fault.walks,
            "legs": fault.legs,
            "legs through > 0.5 m": fault.crossed,
            "walks with a leg through > 2 m": len(fault.blocked),
            "places outside": fault.outside,
        }
        for fault in found
    ]
    total = {key: sum(row[key] for row in rows) for key in rows[0] if key != "floor"}  # type: ignore[misc]
    rows.append({"floor": "all", **total})
    blocked = {path for fault in found for path in fault.blocked}
    listed = sorted(w for w, p in played_walks().items() if p.path in blocked and p.split != "test")
    if as_json:
        print_json({"floors": rows, "walks": listed})
        return
    _print(rows, "straight lines between waypoints (legs) and what they cross")
    say("walks of train and val with a leg through more than 2 m: " + " ".join(listed))


@app.command("steps")
def steps(jobs: Jobs = 1, as_json: AsJson = False) -> None:
    """Length of a step and turn of the reported headings against the plan, on train; and what fitting them brings."""
    from pdrbench_lab.malls.steps import rows_left_out, rows_of_sites, stepped_walks

    with answer_only(as_json):
        walks = stepped_walks(jobs)
        sites, left_out = rows_of_sites(walks), rows_left_out(walks)
    if as_json:
        print_json({"malls": sites, "left_out": left_out})
        return
    _print(sites, "legs of train walked straight ahead; standard errors by outing")
    _print(left_out, f"{len(walks)} walks of train, fitted on the folds that a walk is not in")


@app.command("own-session")
def own_session(
    localizer: Annotated[str, typer.Argument(metavar="LOCALIZER", help="Any localizer.")] = "wifi_knn",
    jobs: Jobs = 1,
    isolation: Isolation = "process",
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", file_okay=False, help="Store every walk here, and go on from it.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Play val with and without the other walks of a walk's own session in its survey, and pair the errors."""
    from pdrbench.evaluation import evaluate
    from pdrbench_lab.malls import own_session as module
    from pdrbench_lab.malls.pairing import paired

    rows = []
    with answer_only(as_json):
        play = functools.partial(evaluate, localizer, split="val", jobs=jobs, isolation=isolation, out=out)
        for env, function in (("MallPhoneLost-v2", "lost"), ("MallPhone-v2", "known")):
            rows.append(paired(env, f"{module.__file__}:{function}", play))
    if as_json:
        print_json({"localizer": localizer, "rows": rows})
        return
    _print(rows, f"{localizer} on val: mean error over walks, their own session in the survey and not")


@app.command("order")
def order(
    seed: Annotated[int, typer.Option(min=0, metavar="S", help="Seed of the synthetic floors and walks.")] = 0,
    count: Annotated[int, typer.Option(min=6, metavar="N", help="Synthetic walks.")] = 90,
    as_json: AsJson = False,
) -> None:
    """Kendall's tau between the order of localizers on val and on synthetic malls, with its interval."""
    from pdrbench_lab.realism.ordering import FROM_SURVEY, LOCALIZERS, real, synthetic, tau_interval

    with answer_only(as_json):
        recorded, made = real("judge"), synthetic(seed, count)
        tau, low, high = tau_interval(recorded, made)
        rows = [
            {"localizer": name, "val": _mean(recorded[name]), "synthetic": _mean(made[name])}
            for name in sorted(LOCALIZERS, key=lambda name: float(recorded[name].mean()))
        ]
        sides = [
            {"part": side, **_near(values[FROM_SURVEY])} for side, values in (("val", recorded), ("synthetic", made))
        ]
    if as_json:
        print_json({"tau": tau, "low": low, "high": high, "rows": rows, "from_survey": sides})
        return
    _print(rows, "mean error over walks, m")
    _print(sides, "how far places are from the nearest scan of their survey")
    say(f"Kendall's tau {tau:.2f} ({low:.2f} to {high:.2f}, outings and floors drawn anew)")


def _mean(errors_m: Any) -> float:
    return round(float(errors_m.mean()), 2)
