"""`PhoneSteps-v1`: recorded walks with a phone carried in seven ways, and switches under the feet.

No place was surveyed in them, but steps were counted. So the place is the count: every step is one metre of a
straight line, and errors in metres are steps that were missed or made up.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from pdrbench.datasets import dataset, find
from pdrbench.datasets.catalogue import DataFile
from pdrbench.errors import DatasetError, unknown_name
from pdrbench.recording import Recording
from pdrbench.sensors import sensor_spec
from pdrbench.task import Task
from pdrbench.trajectory import Start
from pdrbench_envs.recorded import opaque_id
from pdrbench_lab.readers import phone_steps
from pdrbench_lab.readers.registered_files import locate

ENV: Final = "PhoneSteps-v1"
DATASET: Final = "phone_steps"
PERIOD_S: Final = 0.5
START_XY_M: Final = (100.0, 100.0)  # not the origin, where an answer of nothing would be right
CAPACITY: Final = 512  # 406 Hz for 0.5 s makes 203 rows; room for what comes in a heap
RATE_HZ: Final = 200.0  # nominal: the phones deliver 100, 200 and 405 Hz
SPLITS: Final = {"A": "train", "B": "test"}  # by person
MOUNTINGS: Final = {
    "Armband": "arm",
    "BackPocket": "pocket",
    "FrontPocket": "pocket",
    "InHand": "hand",
    "NeckPouch": "neck",
    "Purse": "bag",
    "SwingingArm": "swing",
}
_ID_KEY: Final = b"pdrbench.phone_steps"
_DESCRIPTION: Final = """\
Two people walk for two to four minutes with a phone in the hand, in a front or a back pocket of the trousers, in a
purse, in a pouch at the neck, on an armband, or in the hand of a swinging arm; switches under their feet report, some
ten times a second, which foot stands (Salvi, Velardo, Brynes, Tarassenko 2018).

**Places are counts**: where they walked is not known. Every step is one metre of a straight line along x from the
start, (100, 100), so an answer (100 + n, 100) says that n steps were made so far, an error of a metre is a step, and
`drift_pct` is the error of the last count in percent. Errors along the walk contain the delay of an online counter, two
or three steps; a localizer that revises its answers when the walk is over is scored without it. What the switches make
of a flickering contact, a foot that comes down twice within 0.6 s, is no step.

**Handed out** every 0.5 s: the accelerometer, at 100 Hz to 406 Hz by phone. How the phone is carried is given.

**What is hard**: slow walks on a carpet with the phone in a steady hand, which swing by less than 0.2 g, and purses.

**Splits**: by person, `train` one, `test` the other under opaque ids in shuffled order.
"""


def task() -> Task:
    """The environment."""
    walks = _walks()
    registered = dataset(DATASET)
    by_split = {split: tuple(walk for walk in walks if walk.startswith(f"{split}-")) for split in SPLITS.values()}
    return Task(
        id=ENV,
        summary="Steps counted with a phone in seven carry positions, recorded; no places",
        description=_DESCRIPTION,
        sensors=(replace(sensor_spec("accel"), rate_hz=RATE_HZ),),
        capacity={"accel": CAPACITY},
        period_s=PERIOD_S,
        start="pose",
        walks=by_split,
        load=load,
        tell_start=tell_start,
        licence=registered.licence,
        source=f"{registered.source_url} commit {registered.commit}",
        dataset=DATASET,
        units={walk: str(file.facts["subject"]) for walk, file in walks.items()},
        unit_kind="person",
    )


def load(walk: str) -> Recording:
    """One walk; its reference is the count of steps.

    Raises:
        UnknownNameError: There is no such walk.
        DatasetError: Its files are not available, or were changed.
    """
    walks = _walks()
    if walk not in walks:
        raise unknown_name(f"walk of {ENV}", walk, walks)
    file = walks[walk]
    found = locate(DATASET)
    lacking = [name for name in (file.path, file.path.replace("accelerometer", "stepcounter")) if name not in found]
    if lacking:
        raise DatasetError(
            f"{find(DATASET)}: no file has the hash registered for {lacking[0]}; run `pdrbench data verify {DATASET}`"
        )
    log = phone_steps.read(found[file.path])
    spec = replace(sensor_spec("accel"), rate_hz=RATE_HZ)
    log = replace(log, device=str(file.facts["device"]))
    reference = replace(log.reference, xy_m=log.reference.xy_m + START_XY_M)
    return log.recording(
        walk, None, lambda _: spec, reference=reference, mounting=MOUNTINGS[str(file.facts["position"])]
    )


def facts(walk: str) -> Mapping[str, object]:
    """Person, phone, floor and position of a walk, for tables; a localizer sees none of it but the mounting."""
    return _walks()[walk].facts


def tell_start(recording: Recording) -> Start:
    """No step was made yet; steps are counted along x."""
    return Start(xy_m=recording.reference.xy_m[0], level=0, heading_rad=0.0)


@functools.cache
def _walks() -> dict[str, DataFile]:
    """The registered accelerometer file of each walk, in the order of play, which is that of digests."""
    files = [file for file in dataset(DATASET).files if file.path.endswith("accelerometer.csv.gz")]
    opaque = {opaque_id(file.path, _ID_KEY): file for file in files}
    return {f"{SPLITS[str(opaque[key].facts['subject'])]}-{key}": opaque[key] for key in sorted(opaque)}
