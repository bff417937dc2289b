"""`pdrbench reproduce NAME`."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from pdrbench.cli.options import Jobs, make_folder
from pdrbench.cli.output import AsJson, answer_only, note, print_json, print_table
from pdrbench.errors import PdrbenchError

HEAD: Final[Mapping[str, Mapping[str, Any]]] = {
    "id": {"no_wrap": True},
    "what": {"ratio": 1},
    "paper": {},
    "ours": {"justify": "right", "no_wrap": True},
    "95 % interval": {"no_wrap": True},
    "gate": {},
    "pass": {"no_wrap": True},
    "seeds": {"justify": "right"},
}


def reproduce(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME",
            help="Registered reproduction of a paper, or package.module:REPRODUCTION; without it, what is registered.",
        ),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Few seeds and rough figures: minutes, not hours.")] = False,
    seeds: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Seeds of every experiment.", show_default="as the reproduction says"),
    ] = None,
    jobs: Jobs = 1,
    out: Annotated[
        Path,
        typer.Option(metavar="FOLDER", file_okay=False, help="Measurements that a later run reuses, table, figures."),
    ] = Path("pdrbench-results/reproduce"),
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Draw the figures of the paper.")] = True,
    strict: Annotated[bool, typer.Option("--strict", help="Exit 1 where a claim misses its gate.")] = False,
    as_json: AsJson = False,
) -> None:
    """Measure what a paper claims, and print it beside what the paper states.

    What a run before has measured is not measured again. Exit 1 where something could not be measured or drawn.
    """
    if name is None:
        return _print_registered(as_json)
    with answer_only(as_json):
        from pdrbench_lab.reproduce import reproduce as machinery

        machinery.load_reproduction(name)
        make_folder(out)
        found = machinery.reproduce(name, out, quick=quick, seeds=seeds, jobs=jobs, progress=True)
        rows = found.rows
    if as_json:
        print_json({"claims": rows})
    else:
        title = found.reproduction.paper + (" (quick run: few seeds)" if quick else "")
        print_table(HEAD, [machinery.cells_of(row) for row in rows], title, ("seeds",))
        gated = [row for row in rows if row["pass"] is not None]
        note(f"{sum(row['pass'] for row in gated)} of {len(gated)} gates hold")
    sys.stdout.flush()  # drawing may take long
    for line in machinery.footnotes(found):
        note(line)
    if figures:
        with answer_only(as_json):
            files = machinery.draw_figures(found)
        for file in files:
            note(f"drew {file}")
    note(f"stored in {found.folder}")
    if found.failures or any(row["note"] for row in rows):
        raise PdrbenchError(
            "not everything could be measured, as listed above; run it again to try what failed once more"
        )
    missed = list(dict.fromkeys(row["id"] for row in rows if row["pass"] is False))
    if strict and missed:
        raise PdrbenchError(f"gates missed: {', '.join(missed)}")
    return None


def _print_registered(as_json: bool) -> None:
    """Everything that can be reproduced, and on standard error what does not load."""
    from pdrbench.registry import broken, entries
    from pdrbench_lab.reproduce.reproduce import load_reproduction
    from pdrbench_lab.reproduce.reproduction import REPRODUCTIONS_GROUP

    items: list[dict[str, Any]] = []
    reasons = dict(broken(REPRODUCTIONS_GROUP))
    with answer_only(as_json):
        for key, entry in entries(REPRODUCTIONS_GROUP).items():
            try:
                found, _ = load_reproduction(key)
            except PdrbenchError as error:
                reasons[key] = str(error)
                continue
            items.append(
                {
                    "id": key,
                    "package": entry.package,
                    "paper": found.paper,
                    "claims": len(found.claims),
                    "gates": sum(claim.gate is not None for claim in found.claims),
                    "experiments": {experiment.name: experiment.seeds for experiment in found.experiments},
                    "figures": bool(found.figures),
                    "broken": None,
                }
            )
    if as_json:
        return print_json({"items": items + [{"id": key, "broken": why} for key, why in reasons.items()]})
    head: dict[str, dict[str, Any]] = {
        "id": {"no_wrap": True},
        "from": {"no_wrap": True},
        "claims": {"justify": "right"},
        "paper": {"ratio": 1},
    }
    print_table(head, [[item["id"], item["package"], str(item["claims"]), item["paper"]] for item in items])
    for key, why in reasons.items():
        note(f"broken: {key}: {why}")
    return None
