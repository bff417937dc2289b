"""`pdrbench list envs|localizers|metrics|sensors|formats|datasets`."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import typer

from pdrbench.cli.output import AsJson, answer_only, note, print_json, print_table
from pdrbench.errors import DatasetError, PdrbenchError
from pdrbench.registry import (
    ENVIRONMENTS_GROUP,
    LOCALIZERS_GROUP,
    PluginEntry,
    broken,
    entries,
    load_localizer,
    make_task,
)

app = typer.Typer(no_args_is_help=True, help="List what is registered.")

Item = dict[str, Any]
Head = Mapping[str, Mapping[str, Any]]
WHOLE: Mapping[str, Any] = {"no_wrap": True}
RIGHT: Mapping[str, Any] = {"justify": "right"}
REST: Mapping[str, Any] = {"ratio": 1}
CUT: Mapping[str, Any] = {"no_wrap": True, "overflow": "ellipsis"}  # so that an item is a line


def _print_items(
    items: Sequence[Item],
    head: Head,
    as_json: bool,
    cells: Callable[[Item], list[str]] | None = None,
    dispensable: Sequence[str] = (),
) -> None:
    """Prints one item a line, and on standard error what is broken and what data is missing.

    Args:
        items: Under `broken` the reason why an item cannot be used, or None.
        head: Options of rich by column.
        as_json: True to print the items themselves.
        cells: What stands in the columns of an item; the values under their names where None.
        dispensable: Columns that a narrow terminal goes without, the first first.
    """
    if as_json:
        return print_json({"items": items})
    rows = [item for item in items if not item["broken"]]
    lines = [cells(item) if cells else [str(item[name]) for name in head] for item in rows]
    print_table(head, lines, dispensable=dispensable)
    for item in items:
        if item["broken"]:
            note(f"broken: {item['id']}: {item['broken']}")
        elif item.get("note"):
            note(f"{item['id']}: {item['note']}")
    if missing := sorted({str(item["dataset"]) for item in rows if item.get("missing")}):
        note(f"recorded data is missing: {', '.join(missing)}; `pdrbench data fetch NAME` gets it or says how")
    return None


def _items(found: Mapping[str, PluginEntry], group: str, describe: Callable[[PluginEntry], Item]) -> list[Item]:
    """One item for each entry found, and one for each plug-in of the group that cannot be listed.

    `describe` loads an entry and returns the fields of its kind.
    """
    items: list[Item] = []
    for name, entry in found.items():
        item: Item = {"id": name, "package": entry.package, "broken": None}
        if isinstance(entry.target, str):
            item["target"] = entry.target
        try:
            item |= describe(entry)
        except PdrbenchError as error:
            item |= {"available": False, "broken": str(error)}
        items.append(item)
    for name, why in broken(group).items():
        items.append({"id": name, "package": name.partition(":")[0], "available": False, "broken": why})
    return items


def _summary(thing: object) -> str:
    """The first paragraph of a docstring, on one line."""
    return (inspect.getdoc(thing) or "").partition("\n\n")[0].replace("\n", " ")


def _module_summary(function: Callable[..., Any]) -> Item:
    return {"summary": _summary(inspect.getmodule(function))}


@app.command("envs")
def envs(as_json: AsJson = False) -> None:
    """Registered environments: what they offer, and whether their data is available."""
    with answer_only(as_json):
        items = environment_items()
    head = {"id": WHOLE, "data": WHOLE, "walks": {**RIGHT, **WHOLE}, "start": WHOLE, "summary": CUT}
    _print_items(items, head, as_json, _environment_row, ("walks",))


@app.command("localizers")
def localizers(as_json: AsJson = False) -> None:
    """Registered localizers."""

    def describe(entry: PluginEntry) -> Item:
        found = load_localizer(entry.id)
        return {"summary": _summary(found), "is_told_the_truth": hasattr(found, "tell")}

    with answer_only(as_json):
        items = _items(entries(LOCALIZERS_GROUP), LOCALIZERS_GROUP, describe)
    _print_items(items, {"id": WHOLE, "summary": CUT}, as_json)


@app.command("metrics")
def metrics(as_json: AsJson = False) -> None:
    """Metrics, their units, and which direction is better."""
    from pdrbench.metrics import METRICS

    def describe(entry: PluginEntry) -> Item:
        metric = METRICS[entry.id]
        return {"unit": metric.unit, "better": metric.better, "family": metric.family, "summary": metric.what}

    items = _items(METRICS.entries(), METRICS.group, describe)
    head = dict.fromkeys(("id", "unit", "better", "family"), WHOLE) | {"summary": REST}
    _print_items(items, head, as_json, dispensable=("family", "unit"))


@app.command("sensors")
def sensors(as_json: AsJson = False) -> None:
    """Sensors, and the columns of their rows."""
    from pdrbench.sensors import SENSORS

    def describe(entry: PluginEntry) -> Item:
        spec = SENSORS[entry.id]
        return {"columns": " ".join(spec.columns), "rate_hz": spec.rate_hz, "summary": spec.what}

    items = _items(SENSORS.entries(), SENSORS.group, describe)
    _print_items(items, {"id": WHOLE, "columns": {}, "summary": REST}, as_json)


@app.command("formats")
def formats(as_json: AsJson = False) -> None:
    """Formats of files that `inspect` and `convert` read."""
    from pdrbench.io import READERS

    def describe(entry: PluginEntry) -> Item:
        reader = READERS[entry.id]
        return {"summary": reader.summary} if reader.summary else _module_summary(reader.read)

    items = _items(READERS.entries(), READERS.group, describe)
    _print_items(items, {"id": WHOLE, "package": WHOLE, "summary": REST}, as_json)


@app.command("datasets")
def datasets(as_json: AsJson = False) -> None:
    """Registered recorded datasets, and where they are."""
    from pdrbench.datasets import datasets as registered

    items = [_dataset_item(name) for name in registered()]
    head = {"id": WHOLE, "available": WHOLE, "fetch": WHOLE, "MB": RIGHT, "licence": {}, "summary": REST}
    _print_items(items, head, as_json, _dataset_row, ("available", "MB", "fetch", "licence"))


def environment_items() -> list[Item]:
    """One item for each registered environment, and one for each plug-in that cannot be listed."""
    return _items(entries(ENVIRONMENTS_GROUP), ENVIRONMENTS_GROUP, _describe_environment)


def _describe_environment(entry: PluginEntry) -> Item:
    from pdrbench.datasets import find

    try:
        task = make_task(entry.id)
    except DatasetError as error:
        return {"available": False, "missing": str(error)}
    missing = None
    try:
        if task.dataset is not None:
            find(task.dataset)
    except DatasetError as error:
        missing = str(error)
    return {
        "available": missing is None,
        "missing": missing,
        "summary": task.summary,
        "dataset": task.dataset,
        "splits": {split: len(walks) for split, walks in task.walks.items()},
        "sensors": [spec.name for spec in task.sensors],
        "start": task.start,
        "period_s": task.period_s,
        "licence": task.licence,
        "source": task.source,
        "note": task.note,
    }


def _environment_row(item: Item) -> list[str]:
    availability = "embedded" if item.get("dataset") is None else "available"
    return [
        item["id"],
        availability if item["available"] else "missing",
        str(item.get("splits", {}).get("test", "")),
        item.get("start", ""),
        item.get("summary", "").removesuffix("."),
    ]


def _dataset_item(name: str) -> Item:
    from pdrbench.datasets import dataset, find, is_available

    known = dataset(name)
    available = is_available(name)
    return {
        "id": name,
        "summary": known.summary,
        "available": available,
        "broken": None,
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
