"""`IpinPhone-v1`: recorded phone walks between surveyed landmarks of a museum, from the IPIN 2023 competition.

Data: training logs of Track 3 (smartphone, off-site), registered as `ipin2023_track3`. The licence is not confirmed, so
no log travels with pdrbench.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping
from typing import Final

from pdrbench.datasets import dataset, find
from pdrbench.datasets.catalogue import DataFile
from pdrbench.errors import unknown_name
from pdrbench.recording import RadioMap, Recording
from pdrbench.sensors import sensor_spec
from pdrbench.task import Task
from pdrbench_envs.descriptions import describe
from pdrbench_envs.generated import start_place
from pdrbench_envs.recorded import checked_file, opaque_id
from pdrbench_formats.recordings import getsensordata
from pdrbench_formats.taskfile.survey import begun_at_first_place, radio_map_of

ENV: Final = "IpinPhone-v1"
DATASET: Final = "ipin2023_track3"
PERIOD_S: Final = 0.5  # as the competition asks for estimates
CAPACITY: Final = {"accel": 64, "gyro": 128, "mag": 64, "rotation": 64, "baro": 16, "wifi": 128, "ble": 64}
MOUNTING: Final = "hand"
SPLITS: Final = {"train": ("01", "21"), "val": ("03", "23"), "test": ("02", "04", "22", "24")}  # routes
SURVEYED: Final = ("train", "val")  # splits whose walks make the radio survey
_LOG: Final = re.compile(r"logs/IPIN2023_T3_TrainingTrial(?P<route>\d\d)_repetition(?P<repetition>\d\d)\.txt")
_ID_KEY: Final = b"pdrbench.ipin2023_phone"
_REMEDY: Final = f"download it again ({DATASET})"


def task() -> Task:
    """The environment."""
    registered = dataset(DATASET)
    return Task(
        id=ENV,
        summary="Phone walks between surveyed landmarks of a museum on two levels, start known, radio survey",
        description=describe("ipin_phone"),
        sensors=tuple(sensor_spec(name) for name in CAPACITY),
        capacity=CAPACITY,
        period_s=PERIOD_S,
        start="pose",
        walks={split: tuple(w for w in _walks() if _split_of(w) == split) for split in SPLITS},
        load=load,
        tell_start=start_place,
        radio_map=_radio_map,
        licence=registered.licence,
        source=registered.source_url,
        dataset=DATASET,
        units={walk: _route_of(walk) for walk in _walks()},
        unit_kind="route",
        noise_m=0.05,  # landmarks were surveyed, and are stood on by a person
    )


def load(walk: str) -> Recording:
    """One walk, from its first landmark on, which is given and not scored.

    Raises:
        UnknownNameError: There is no such walk.
        DatasetError: Its file is not available, or was changed.
    """
    walks = _walks()
    if walk not in walks:
        raise unknown_name(f"walk of {ENV}", walk, walks)
    file = walks[walk]
    log = getsensordata.read(checked_file(find(DATASET) / file.path, file.sha256, DATASET, _REMEDY))
    recording = log.recording(walk, None, sensor_spec, mounting=MOUNTING)
    return begun_at_first_place(recording)


@functools.cache
def _walks() -> Mapping[str, DataFile]:
    """File by walk, in the order of play."""
    names: dict[str, DataFile] = {}
    for file in dataset(DATASET).files:
        found = _LOG.fullmatch(file.path)
        if found is None:
            continue
        split = next(split for split, routes in SPLITS.items() if found["route"] in routes)
        name = opaque_id(file.path, _ID_KEY) if split == "test" else f"{found['route']}-{found['repetition']}"
        names[f"{split}-{name}"] = file
    return dict(sorted(names.items()))


def _split_of(walk: str) -> str:
    return walk.partition("-")[0]


def _route_of(walk: str) -> str:
    found = _LOG.fullmatch(_walks()[walk].path)
    assert found is not None
    return found["route"]


def _radio_map(recording: Recording) -> RadioMap | None:
    """The scans of walks of `train` and `val` on other routes."""
    route = _route_of(recording.id)
    return _survey(tuple(w for w in _walks() if _split_of(w) in SURVEYED and _route_of(w) != route))


@functools.lru_cache(maxsize=8)
def _survey(walks: tuple[str, ...]) -> RadioMap | None:
    return radio_map_of([load(walk) for walk in walks])
