"""Digests of walks, written into the package of their environment: a walk never changes under its version."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from pdrbench.errors import BundleError
from pdrbench.evaluation.store import write_whole
from pdrbench.registry import PINS_FILE, Pin, environments, find_entry, make_task, pin_of, pins_in, registered_task
from pdrbench_leaderboard.pack import has_data
from pdrbench_leaderboard.schema import write_json
from pdrbench_leaderboard.suites import suites


def pin(envs: Sequence[str] = (), replace: Collection[str] = ()) -> list[str]:
    """Loads every public walk of some environments and writes the digests into `walks.json` of their packages.

    Args:
        envs: Environments; those of all suites where it is empty.
        replace: Environments whose walks may have changed.

    Returns:
        What was done, one line for each environment.

    Raises:
        UnknownNameError: An environment is not registered.
        BundleError: Walks of an environment that is not in `replace` have changed, or it has no package to write into.
    """
    found: dict[Path, dict[str, Pin]] = {}
    lines = []
    for env in envs or [listed.env for suite in suites().values() for listed in suite.environments]:
        folder = find_entry("pdrbench.environments", "environment", env).folder
        task = make_task(env)
        if folder is None:
            raise BundleError(f"{env}: {environments()[env].target} is not in a package, where {PINS_FILE} could lie")
        if not has_data(env) or task.note:
            lines.append(f"{env}: left as it is, its registered data is not available")
            continue
        walks = {walk: task.computed_sha256(walk) for of_split in task.walks.values() for walk in of_split}
        found.setdefault(folder, dict(pins_in(folder)))[env] = _pinned(env, walks, replace)
        lines.append(f"{env}: {len(walks)} walks")
    for folder, pins in found.items():
        write_whole(folder / PINS_FILE, write_json(dict(sorted(pins.items()))))
    pins_in.cache_clear()
    registered_task.cache_clear()
    return lines


def _pinned(env: str, walks: Mapping[str, str], replace: Collection[str]) -> Pin:
    before = pin_of(env)
    if before is None or env in replace:
        return Pin(walks)
    changed = [walk for walk in {**before.walks, **walks} if before.walks.get(walk) != walks.get(walk)]
    if changed:
        raise BundleError(
            f"{env}: {len(changed)} of its walks have changed, the first is {changed[0]}; an environment whose walks "
            f"change gets a new version, or --replace {env} where there is no submission to it"
        )
    return before
