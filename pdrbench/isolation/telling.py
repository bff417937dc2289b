"""Briefings, references and generators as messages, and back: what comes out is the same to the last bit."""

from __future__ import annotations

import json
from typing import Any, Final

import numpy as np

from pdrbench.building import Building, FloorPolygon
from pdrbench.building.polygons import Zone as BuildingZone
from pdrbench.errors import PdrbenchError
from pdrbench.isolation import messages
from pdrbench.isolation.messages import Array, pack_columns, unpack_columns
from pdrbench.localizer import Briefing
from pdrbench.recording import RadioMap, SensorSpec
from pdrbench.trajectory import Start, Trajectory

SURVEY_COLUMNS: Final = ("xy_m", "level", "walk", "first", "access_point", "rssi_dbm", "age_s")
REFERENCE_COLUMNS: Final = ("t_s", "xy_m", "level", "surveyed", "heading_rad", "z_m")


def pack_briefing(briefing: Briefing) -> messages.Told:
    """As a message."""
    start, radio_map = briefing.start, briefing.radio_map
    return messages.Told(
        building=None if briefing.building is None else _pack_building(briefing.building),
        sensors=[
            messages.Sensor(s.name, list(s.columns), Array.of(s.low), Array.of(s.high), s.rate_hz, s.what)
            for s in briefing.sensors.values()
        ],
        period_s=briefing.period_s,
        start=None
        if start is None
        else messages.Begin(Array.of(start.xy_m), int(start.level), start.heading_rad, start.radius_m),
        radio_map=None
        if radio_map is None
        else messages.Survey(pack_columns(radio_map, SURVEY_COLUMNS), radio_map.surveyed),
        subject=dict(briefing.subject),
        mounting=briefing.mounting,
    )


def unpack_briefing(told: messages.Told) -> Briefing:
    """The briefing in a message."""
    start, survey = told.start, told.radio_map
    sensors = [
        SensorSpec(s.name, tuple(s.columns), s.low.array(), s.high.array(), s.rate_hz, s.what) for s in told.sensors
    ]
    return Briefing(
        building=None if told.building is None else _unpack_building(told.building),
        sensors={sensor.name: sensor for sensor in sensors},
        period_s=told.period_s,
        start=None if start is None else Start(start.xy_m.array(), start.level, start.heading_rad, start.radius_m),
        radio_map=None if survey is None else RadioMap(**unpack_columns(survey.columns), surveyed=survey.surveyed),
        subject=told.subject,
        mounting=told.mounting,
    )


def pack_reference(reference: Trajectory) -> dict[str, Array]:
    """As columns of a message."""
    return pack_columns(reference, REFERENCE_COLUMNS)


def unpack_reference(columns: dict[str, Array]) -> Trajectory:
    """The reference in the columns of a message."""
    return Trajectory(**unpack_columns(columns))


def pack_generator(rng: np.random.Generator) -> messages.Dice:
    """The generator with its state, and with what its children would be spawned from.

    Raises:
        PdrbenchError: It is none that `numpy.random.default_rng` makes.
    """
    bits = rng.bit_generator
    seeds = bits.seed_seq
    if not isinstance(bits, np.random.PCG64) or not isinstance(seeds, np.random.SeedSequence):
        raise PdrbenchError(f"a localizer is handed a generator of numpy.random.default_rng; got {bits!r}")
    entropy: Any = seeds.entropy
    return messages.Dice(
        name="PCG64",
        state=json.dumps(bits.state),
        entropy=json.dumps(entropy if isinstance(entropy, int) else [int(word) for word in entropy]),
        spawn_key=[int(key) for key in seeds.spawn_key],
        num_spawned=seeds.n_children_spawned,
    )


def unpack_generator(dice: messages.Dice) -> np.random.Generator:
    """The generator in a message."""
    seeds = np.random.SeedSequence(
        json.loads(dice.entropy), spawn_key=dice.spawn_key, n_children_spawned=dice.num_spawned
    )
    bits = np.random.PCG64(seeds)
    bits.state = json.loads(dice.state)
    return np.random.Generator(bits)


def _pack_building(building: Building) -> messages.Map:
    return messages.Map(
        building.name,
        [
            messages.Polygon(
                polygon.id,
                Array.of(polygon.outline_xy_m),
                Array.of(polygon.neighbour),
                polygon.height_m,
                polygon.level,
                polygon.kind,
                [Array.of(hole) for hole in polygon.holes],
            )
            for polygon in building.polygons
        ],
        [messages.Zone(z.id, z.name, Array.of(z.outline_xy_m), z.level, z.kind) for z in building.zones],
    )


def _unpack_building(told: messages.Map) -> Building:
    return Building(
        told.name,
        tuple(
            FloorPolygon(
                polygon.id,
                polygon.outline_xy_m.array(),
                polygon.neighbour.array(),
                polygon.height_m,
                polygon.level,
                polygon.kind,
                tuple(hole.array() for hole in polygon.holes),
            )
            for polygon in told.polygons
        ),
        tuple(BuildingZone(z.id, z.name, z.outline_xy_m.array(), z.level, z.kind) for z in told.zones),
    )
