"""Experiments on the gates of Woodman & Harle 2008 that are missed, and on what the paper leaves open (W14 to W16)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np

from pdrbench.geometry import FloatArray, wrap_rad
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors.stride import STRIDE
from pdrbench.trajectory import Start
from pdrbench_lab.papers.paper_walks import walk_of
from pdrbench_lab.papers.woodman2008.experiments import FILTER, LOST, converge, run, starts_of
from pdrbench_lab.papers.woodman2008.literal import Woodman2008Literal

COUNTED: Final[dict[str, dict[str, Any]]] = {  # by which the particles of a tracked walker are counted (W15)
    "paper": {"filter": FILTER},
    "delta_001": {"filter": {"kld_delta": 0.01}},
    "delta_01": {"filter": {"kld_delta": 0.1}},
    "live": {"filter": {**FILTER, "live_only": True}},
    "literal": {"filter": {**FILTER, "max_particles": 20_000}, "make": Woodman2008Literal},
}
RADIO: Final = tuple(  # m2 of an access point, dBm that half of the scans notice (W14)
    (area_m2, detection_dbm) for area_m2 in (70, 110, 190) for detection_dbm in (-88, -82, -76)
)


def tracking(seed: int) -> dict[str, Any]:
    """Particles while the walker is tracked from a known start, by setting and with strides without errors (W15)."""
    recording, briefing = walk_of(LOST, seed)
    from_known = replace(briefing, start=_start(recording))
    walks = {name: (recording, options) for name, options in COUNTED.items()}
    walks["exact"] = exact_strides(recording), COUNTED["paper"]
    numbers: dict[str, Any] = {}
    for name, (walk, options) in walks.items():
        one = run(walk, from_known, np.random.default_rng([seed, 15]), **options)
        counts = one.num_particles[one.tracks & one.correct]
        numbers |= {f"average_{name}": float(counts.mean()), f"largest_{name}": float(counts.max())}
    return numbers


def search(seed: int) -> dict[str, Any]:
    """Whether the first single cluster is the walker's, from an unknown start, by what is changed (W16).

    `exact`: strides without errors; `straight`: the walk's constant turn taken out of its strides, other errors left;
    `many`: half of epsilon, which is twice as many particles; `waits`: a single cluster that has lasted twenty strides.
    """
    recording, briefing = walk_of(LOST, seed)
    settings: dict[str, tuple[Recording, dict[str, Any]]] = {
        "exact": (exact_strides(recording), {}),
        "straight": (without_drift(recording), {}),
        "many": (recording, {"filter": {**FILTER, "kld_epsilon": 0.025}}),
        "waits": (recording, {"steady_strides": 20}),
        "exact_many": (exact_strides(recording), {"filter": {**FILTER, "kld_epsilon": 0.025}}),
    }
    numbers: dict[str, Any] = {}
    for name, (walk, options) in settings.items():
        found = converge(walk, briefing, seed, **options)
        numbers[f"correct_{name}"] = [one.is_correct(one.first) for one in found]
    return numbers


def radio(seed: int) -> dict[str, Any]:
    """WLAN starts for densities of access points and sensitivities of the receiver (W14)."""
    from pdrbench_sim.radio.wlan import PropagationParams

    numbers: dict[str, Any] = {}
    known_dbm: dict[bytes, FloatArray] = {}
    for area_m2, detection_dbm in RADIO:
        params = PropagationParams(area_per_access_point_m2=float(area_m2), detection_dbm=float(detection_dbm))
        found = starts_of(seed, params, known_dbm)
        name = f"{area_m2}_{-detection_dbm}"
        numbers |= {f"{key}_{name}": found[key] for key in ("small", "num_strong", "particles_of_four")}
    return numbers


def exact_strides(recording: Recording) -> Recording:
    """The same walk with strides as they were walked."""
    reference = recording.reference
    assert reference.z_m is not None and reference.heading_rad is not None
    return _with_strides(
        recording,
        np.hypot(*np.diff(reference.xy_m, axis=0).T),
        np.diff(reference.z_m),
        wrap_rad(np.diff(reference.heading_rad)),
    )


def without_drift(recording: Recording) -> Recording:
    """The same strides less the turn that all of them have in common."""
    _, length_m, height_m, turn_rad = recording.streams["stride"].rows.T
    drift_rad = wrap_rad(turn_rad - exact_strides(recording).streams["stride"].rows[:, 3]).mean()
    return _with_strides(recording, length_m, height_m, wrap_rad(turn_rad - drift_rad))


def _with_strides(recording: Recording, *columns: Any) -> Recording:
    rows = np.column_stack([recording.streams["stride"].rows[:, 0], *columns])
    return replace(recording, streams={**recording.streams, "stride": SensorStream(STRIDE, rows)})


def _start(recording: Recording) -> Start:
    reference = recording.reference
    assert reference.heading_rad is not None
    return Start(reference.xy_m[0], int(reference.level[0]), float(reference.heading_rad[0]))
