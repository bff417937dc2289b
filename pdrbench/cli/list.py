"""`pdrbench list envs|localizers|reproductions|metrics|datasets`."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping
from typing import Any

import typer

from pdrbench.cli.output import AsJson, answer_only, note, print_json, print_table
from pdrbench.errors import DatasetError, PdrbenchError

app = typer.Typer(no_args_is_help=True, help="List what is registered.")

Item = dict[str, Any]


@app.command("envs")
def envs(as_json: AsJson = False) -> None:
    """Registered environments: what they offer, and whether their data is at hand."""
    with answer_only(as_json):
        items = environment_items()
    if as_json:
        return print_json({"items": items})
    head: Mapping[str, Mapping[str, Any]] = {
        "id": {"no_wrap": True},
        "data": {"no_wrap": True},
        "walks": {},
        "sensors": {},
        "start": {"no_wrap": True},
        "licence": {},
        "summary": {"ratio": 1},
    }
    print_table(head, [_environment_row(item) for item in items if not item["broken"]])
    return _tell_problems(items)


@app.command("localizers")
def localizers(as_json: AsJson = False) -> None:
    """Registered localizers."""
    with answer_only(as_json):
        items = localizer_items()
    if as_json:
        return print_json({"items": items})
    head: Mapping[str, Mapping[str, Any]] = {
        "id": {"no_wrap": True},
        "from": {"no_wrap": True},
        "summary": {"ratio": 1},
    }
    print_table(head, [[i["id"], i["package"], i["summary"]] for i in items if not i["broken"]])
    return _tell_problems(items)


@app.command("reproductions")
def reproductions(as_json: AsJson = False) -> None:
    """Registered reproductions of papers."""
    with answer_only(as_json):
        items = reproduction_items()
    if as_json:
        return print_json({"items": items})
    head: Mapping[str, Mapping[str, Any]] = {
        "id": {"no_wrap": True},
        "from": {"no_wrap": True},
        "claims": {"justify": "right"},
        "paper": {"ratio": 1},
    }
    print_table(head, [[i["id"], i["package"], str(i["claims"]), i["paper"]] for i in items if not i["broken"]])
    return _tell_problems(items)


@app.command("metrics")
def metrics(as_json: AsJson = False) -> None:
    """Metrics, their units, and which direction is better."""
    from pdrbench.metrics import METRICS

    items = [
        {"id": m.name, "unit": m.unit, "better": m.better, "family": m.family, "summary": m.what}
        for m in METRICS.values()
    ]
    if as_json:
        return print_json({"items": items})
    head: Mapping[str, Mapping[str, Any]] = {
        "id": {"no_wrap": True},
        "unit": {"no_wrap": True},
        "better": {"no_wrap": True},
        "family": {"no_wrap": True},
        "summary": {"ratio": 1},
    }
    return print_table(head, [[str(item[name]) for name in head] for item in items])


@app.command("datasets")
def datasets(as_json: AsJson = False) -> None:
    """Registered recorded datasets, and where they lie."""
    items = dataset_items()
    if as_json:
        return print_json({"items": items})
    head: Mapping[str, Mapping[str, Any]] = {
        "id": {"no_wrap": True},
        "at hand": {"overflow": "fold"},
        "fetch": {"no_wrap": True},
        "MB": {"justify": "right"},
        "licence": {},
        "summary": {"ratio": 1},
    }
    return print_table(head, [_dataset_row(item) for item in items])


def environment_items() -> list[Item]:
    """One item per registered environment, and one per plug-in that cannot be listed."""
    from pdrbench.registry import ENVIRONMENTS_GROUP, broken, environments

    items = [_environment_item(name) for name in environments()]
    return items + _broken_items(broken(ENVIRONMENTS_GROUP))


def _environment_item(name: str) -> Item:
    from pdrbench.datasets import is_available
    from pdrbench.registry import environments, make_task

    item: Item = {"id": name, "package": environments()[name].package, "available": False, "broken": None}
    try:
        task = make_task(name)
        has_data = task.dataset is None or is_available(task.dataset)
    except DatasetError as error:
        return item | {"missing": str(error)}
    except PdrbenchError as error:
        return item | {"broken": str(error)}
    return item | {
        "available": has_data,
        "missing": None if has_data else how_to_get(task.dataset),
        "summary": task.summary,
        "dataset": task.dataset,
        "splits": {split: len(walks) for split, walks in task.walks.items()},
        "sensors": [spec.name for spec in task.sensors],
        "start": task.start,
        "period_s": task.period_s,
        "licence": task.licence,
        "source": task.source,
        "note": task.note,
        "superseded_by": task.superseded_by,
    }


def how_to_get(dataset: str | None) -> str:
    """What `find` says of a dataset that is not at hand."""
    from pdrbench.datasets import find

    try:
        return "" if dataset is None else f"its data lies in {find(dataset)}"
    except DatasetError as error:
        return str(error)


def _environment_row(item: Item) -> list[str]:
    availability = "embedded" if item.get("dataset") is None else "at hand"
    return [
        item["id"],
        availability if item["available"] else "missing",
        "\n".join(f"{split} {count}" for split, count in item.get("splits", {}).items()),
        ", ".join(item.get("sensors", ())),
        item.get("start", ""),
        item.get("licence", ""),
        "; ".join(filter(None, (item.get("summary", "").removesuffix("."), item.get("note", "")))),
    ]


def localizer_items() -> list[Item]:
    """One item per registered localizer, and one per plug-in that cannot be listed."""
    from pdrbench.registry import LOCALIZERS_GROUP, broken
    from pdrbench.registry import localizers as registered

    items = [_localizer_item(name) for name in registered()]
    return items + _broken_items(broken(LOCALIZERS_GROUP))


def _localizer_item(name: str) -> Item:
    from pdrbench.registry import PluginError, load_localizer
    from pdrbench.registry import localizers as registered

    entry = registered()[name]
    item: Item = {"id": name, "package": entry.package, "target": entry.target, "broken": None}
    try:
        found = load_localizer(name)
    except PluginError as error:
        return item | {"broken": str(error)}
    summary = (inspect.getdoc(found) or "").partition("\n\n")[0].replace("\n", " ")
    return item | {"summary": summary, "is_told_the_truth": hasattr(found, "tell")}


def reproduction_items() -> list[Item]:
    """One item per registered reproduction, and one per plug-in that cannot be listed."""
    from pdrbench.registry import REPRODUCTIONS_GROUP, broken
    from pdrbench.registry import reproductions as registered

    items = [_reproduction_item(name) for name in registered()]
    return items + _broken_items(broken(REPRODUCTIONS_GROUP))


def _reproduction_item(name: str) -> Item:
    from pdrbench.evaluation.reproduce import load_reproduction
    from pdrbench.registry import PluginError
    from pdrbench.registry import reproductions as registered

    entry = registered()[name]
    item: Item = {"id": name, "package": entry.package, "target": entry.target, "broken": None}
    try:
        found, _ = load_reproduction(name)
    except PluginError as error:
        return item | {"broken": str(error)}
    return item | {
        "paper": found.paper,
        "claims": len(found.claims),
        "gates": sum(claim.gate is not None for claim in found.claims),
        "experiments": {experiment.name: experiment.seeds for experiment in found.experiments},
        "figures": bool(found.figures),
    }


def _broken_items(reasons: Mapping[str, str]) -> list[Item]:
    return [
        {"id": name, "package": name.partition(":")[0], "available": False, "broken": reason}
        for name, reason in reasons.items()
    ]


def _tell_problems(items: Iterable[Item]) -> None:
    """On standard error: what is broken, and how to get what is missing."""
    for item in items:
        if item["broken"]:
            note(f"broken: {item['id']}: {item['broken']}")
        elif item.get("missing"):
            note(f"missing: {item['id']}: {item['missing']}")


def dataset_items() -> list[Item]:
    """One item per registered dataset."""
    from pdrbench.datasets import datasets as registered

    return [_dataset_item(name) for name in registered()]


def _dataset_item(name: str) -> Item:
    from pdrbench.datasets import dataset, find, is_available

    known = dataset(name)
    available = is_available(name)
    return {
        "id": name,
        "summary": known.summary,
        "available": available,
        "folder": str(find(name)) if available else None,
        "fetchable": known.is_fetchable,
        "how_to_get": known.how_to_get,
        "files": len(known.files),
        "bytes": known.total_bytes,
        "licence": known.licence,
        "licence_note": known.licence_note,
        "source": known.source_url,
        "commit": known.commit,
        "citation": known.citation,
    }


def _dataset_row(item: Item) -> list[str]:
    megabytes = f"{item['bytes'] / 1e6:.1f}"
    fetch = "yes" if item["fetchable"] else "no"
    return [item["id"], item["folder"] or "no", fetch, megabytes, item["licence"], item["summary"]]
