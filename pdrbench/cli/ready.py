"""What can be played, checked before anything slow begins."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from pdrbench.cli.output import note
from pdrbench.errors import DatasetError, UnsuitableError

OURS: Final = "pdrbench"  # the distribution whose code is trusted
BROKEN: Final = "it is broken"
SCORED_SPLIT: Final = "test"  # where none is named


def ready_environment(name: str, split: str | None) -> str:
    """The id, or the absolute path, of an environment that has this split and whose data is available.

    Raises:
        UnknownNameError: No such environment, or it has no such split.
        DatasetError: Its recorded data is not available.
    """
    from pdrbench.datasets import find
    from pdrbench.registry import make_task, task_place

    task = make_task(name)
    task.split(split or SCORED_SPLIT)
    if task.dataset is not None:
        find(task.dataset)
    return task_place(name) or task.id


def available_environments(split: str | None) -> tuple[str, ...]:
    """Every registered environment that can be played now; says which cannot and what to do."""
    from pdrbench.cli.list import environment_items

    chosen = []
    for item in environment_items():
        if item["broken"]:
            note(f"left out: {item['id']} is broken: {item['broken']}")
        elif not item["available"]:
            note(f"left out: {item['id']}: {item['missing']}")
        elif split is not None and not item["splits"].get(split):
            note(f"left out: {item['id']} has no {split!r} split")
        else:
            chosen.append(item["id"])
    if not chosen:
        raise DatasetError(
            f"no environment with data has walks in a {split or SCORED_SPLIT!r} split; see `pdrbench list envs`"
        )
    return tuple(chosen)


def check_localizer_exists(name: str, isolation: str) -> type | None:
    """The class of a localizer that comes with pdrbench; None for another, which is loaded in its own process.

    Raises:
        UnknownNameError: It is not registered.
        SettingsError: It does not have the settings in its name.
        PluginError: It does not load, or there is no such file or module.
    """
    from pdrbench.evaluation.origin import localizer_target, target_sha256
    from pdrbench.localizer_folder import find_target
    from pdrbench.registry import canonical_localizer, load_localizer, localizers
    from pdrbench.settings import split_name

    plain = split_name(name)[0]
    entry = localizers().get(plain)
    is_foreign = entry is None and (":" in plain or find_target(plain) is not None)
    if isolation == "none" or (entry is None and not is_foreign) or (entry is not None and entry.package == OURS):
        return load_localizer(name)
    target_sha256(localizer_target(name))
    canonical_localizer(name)
    return None


def ready_localizers(named: Sequence[str] | None, split: str | None, isolation: str = "process") -> tuple[str, ...]:
    """Those named, or every registered one; says which are left out and why.

    Raises:
        UnknownNameError: No such localizer.
        PluginError: One that was named does not load.
        UnsuitableError: None is left.
    """
    chosen, reasons = sorted_out(named, split, isolation)
    for name, why in reasons.items():
        note(f"left out: {name}: {why}")
    if not chosen:
        raise UnsuitableError("no localizer is left to run; see `pdrbench list localizers`")
    return chosen


def sorted_out(
    named: Sequence[str] | None, split: str | None, isolation: str = "process"
) -> tuple[tuple[str, ...], dict[str, str]]:
    """Localizers to run, and the reason by name of those that are left out; raises as `ready_localizers`."""
    from pdrbench.registry import LOCALIZERS_GROUP, PluginError, broken, canonical_localizer
    from pdrbench.registry import localizers as registered
    from pdrbench.task import KNOWN_SPLITS

    chosen = []
    reasons = {} if named else {name: f"{BROKEN}: {why}" for name, why in broken(LOCALIZERS_GROUP).items()}
    for name in dict.fromkeys(named or registered()):
        try:
            found = check_localizer_exists(name, isolation)
        except PluginError as error:
            if named:
                raise
            reasons[name] = f"{BROKEN}: {error}"
            continue
        if hasattr(found, "tell") and split not in KNOWN_SPLITS:
            reasons[name] = (
                f"it is given the reference, which the {split or SCORED_SPLIT!r} split withholds: "
                f"it runs with --split train, and in `pdrbench check env`"
            )
            continue
        chosen.append(canonical_localizer(name, loads=True if isolation == "none" else None))
    return tuple(dict.fromkeys(chosen)), reasons


def suited_localizers(
    named: Sequence[str] | None, envs: Sequence[str], split: str | None, isolation: str, *, shows_all: bool
) -> dict[str, list[str]]:
    """Localizers that suit each environment; says how many are left out, and of those that were named why.

    Args:
        named: Those to choose from; every registered one where None.
        envs: Ids or paths.
        split: What is played.
        isolation: What localizers run in.
        shows_all: Whether to name every one that is left out.

    Raises:
        UnsuitableError: None suits any of them. Else as `ready_localizers`.
    """
    from pdrbench.evaluation.suitability import declining
    from pdrbench.registry import make_task

    chosen, reasons = sorted_out(named, split, isolation)
    names_all = shows_all or bool(named)
    listed = {name for name, why in reasons.items() if names_all or why.startswith(BROKEN)}
    for name in listed:
        note(f"left out: {name}: {reasons[name]}")
    found = {}
    for env in envs:
        task = make_task(env)
        why = declining(chosen, env, split or SCORED_SPLIT)
        if names_all:
            for name, reason in why.items():
                note(f"left out: {name} on {task.id}: {reason}")
        elif count := len(why) + len(reasons) - len(listed):
            note(f"left out: {count} localizers that do not suit {task.id}; --all names them")
        if suited := [name for name in chosen if name not in why]:
            found[env] = suited
    if not found:
        raise UnsuitableError("no localizer is left to run; see `pdrbench list localizers`")
    return found
