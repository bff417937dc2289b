"""Digests of the walks of suites: what was run before and after a change of code that moved no walk may stand together.

The digest of a generated environment is one of its source, and changes with every comment. A pin tells which of those
digests make the same walks, because somebody made them and compared.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from pdrbench.errors import BundleError
from pdrbench.evaluation.store import write_whole
from pdrbench.leaderboard.pack import is_at_hand
from pdrbench.leaderboard.schema import write_json
from pdrbench.leaderboard.suites import PINS_FILE, Pin, pins, suites
from pdrbench.localizer import Briefing
from pdrbench.recording import Recording
from pdrbench.registry import make_task


def pin(replace: Collection[str] = ()) -> list[str]:
    """Pins the walks of every suite, and writes what is pinned beside the suites.

    Args:
        replace: Environments whose walks may have changed.

    Returns:
        What was done, one line for each environment.

    Raises:
        BundleError: Walks of another environment have changed.
    """
    found, lines = dict(pins()), []
    for suite in suites().values():
        for share in suite.environments:
            if not is_at_hand(share.env):
                lines.append(f"{share.env}: left as it is, its recorded data is not at hand")
                continue
            found[share.env] = _pinned(share.env, walks_sha256(share.env, suite.walks(share.env)), replace)
            lines.append(f"{share.env}: {found[share.env].walks_sha256[:12]}")
    write_whole(Path(__file__).with_name(PINS_FILE), write_json(found))
    pins.cache_clear()
    return lines


def _pinned(env: str, sha256: str, replace: Collection[str]) -> Pin:
    before, at_hand = pins().get(env), make_task(env).sha256
    if before is None or env in replace:
        return Pin(task_sha256=(at_hand,), walks_sha256=sha256)
    if before.walks_sha256 != sha256:
        raise BundleError(
            f"{env}: its walks have changed; an environment whose walks change gets a new version, or --replace {env} "
            f"where there is no submission to it"
        )
    others = tuple(digest for digest in before.task_sha256 if digest != at_hand)
    return msgspec.structs.replace(before, task_sha256=(at_hand, *others))


def walks_sha256(env: str, walks: tuple[str, ...]) -> str:
    """Digest of everything that is told, handed out and scored on some walks of an environment."""
    task = make_task(env)
    digest = hashlib.sha256()
    for walk in walks:
        recording = task.load(walk)
        for part in (*_of_recording(recording), *_of_briefing(task.brief(recording))):
            digest.update(part)
    return digest.hexdigest()


def _of_recording(recording: Recording) -> Iterator[bytes]:
    yield recording.id.encode()
    for name, stream in sorted(recording.streams.items()):
        yield name.encode()
        yield _bytes(stream.rows)
    reference = recording.reference
    yield _bytes(reference.t_s, reference.xy_m, reference.level, reference.surveyed)
    yield _bytes(*(part for part in (reference.heading_rad, reference.z_m) if part is not None))


def _of_briefing(briefing: Briefing) -> Iterator[bytes]:
    if briefing.start is not None:
        start = briefing.start
        yield _bytes(
            start.xy_m, start.level, start.radius_m, np.nan if start.heading_rad is None else start.heading_rad
        )
    if briefing.building is not None:
        for polygon in briefing.building.polygons:
            yield _bytes(polygon.outline_xy_m, polygon.neighbour, polygon.height_m, polygon.level)
    if briefing.radio_map is not None:
        survey = briefing.radio_map
        yield _bytes(survey.xy_m, survey.level, survey.first, survey.access_point, survey.rssi_dbm, survey.age_s)


def _bytes(*values: Any) -> bytes:
    return b"".join(np.ascontiguousarray(value).tobytes() for value in values)
