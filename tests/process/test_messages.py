"""Messages between the evaluating process and a localizer's: round trips, and malformed replies are refused."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.episode import EstimateRow
from pdrbench.localizer import Briefing
from pdrbench.process import messages
from pdrbench.process.messages import ProtocolError, frame, frame_size, read_reply, read_request
from pdrbench.process.serialise import ArrayMessage, pack_generator, unpack_generator
from pdrbench.recording import MagneticMap, RadioMap
from pdrbench.registry import make_task
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start

CLAIMS = EstimateRow(1.0, 2.0, 0.0, 0.5, 0.1, 1.0)
ANSWERS: Any = (messages.Answer, messages.Missing)


def body(message: msgspec.Struct) -> bytes:
    return frame(message)[messages.LENGTH_BYTES :]


def received(briefing: Briefing, rng: np.random.Generator) -> messages.Reset:
    request = read_request(body(messages.Reset(1, briefing, pack_generator(rng))))
    assert isinstance(request, messages.Reset)
    return request


def assert_same(one: Any, other: Any) -> None:
    """Equal to the last bit, field by field."""
    assert type(one) is type(other)
    if isinstance(one, np.ndarray):
        assert (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    elif isinstance(one, Mapping):
        assert [*one] == [*other]
        for key in one:
            assert_same(one[key], other[key])
    elif dataclasses.is_dataclass(one) and not isinstance(one, Building):
        for field in dataclasses.fields(one):
            assert_same(getattr(one, field.name), getattr(other, field.name))
    else:
        assert one == other


@pytest.mark.parametrize("heading_rad", [0.5, None])
def test_a_briefing_arrives_as_it_was_sent(
    heading_rad: float | None, office: Building, rng: np.random.Generator
) -> None:
    survey = RadioMap(
        rng.random((2, 2)),
        np.array([0, 1]),
        np.zeros(2),
        np.array([0, 1, 3]),
        np.arange(3),
        -rng.random(3),
        rng.random(3),
    )
    start = Start(np.array([1.0, 2.0]), 1, heading_rad)
    sensors = {name: sensor_spec(name) for name in ("wifi", "accel")}
    sent = Briefing(office, sensors, 0.5, start, survey, {"height_m": 1.8}, "pocket")
    assert_same(received(sent, rng).briefing, sent)


def test_a_magnetic_map_and_a_reference_arrive_as_they_were_sent(rng: np.random.Generator) -> None:
    sample = MagneticMap(np.ones((2, 2)), np.zeros(2, int), np.arange(2), rng.random((2, 3)))
    assert_same(received(Briefing(None, {}, 1.0, magnetic_map=sample), rng).briefing.magnetic_map, sample)
    task = make_task("CampusStride-v1")
    sent = task.load(task.split("train")[0]).reference
    request = read_request(body(messages.GiveReference(1, sent)))
    assert isinstance(request, messages.GiveReference)
    assert_same(request.reference, sent)


@pytest.mark.parametrize("entropy", [None, 7, [3, 141592653589793, 1], np.array([5, 2**31], np.uint32)])
def test_a_generator_keeps_its_state_and_its_children(entropy: Any) -> None:
    rng = np.random.default_rng(entropy)
    rng.random(5)
    rng.spawn(2)
    came = unpack_generator(received(Briefing(None, {}, 1.0), rng).rng)
    assert came.spawn(1)[0].random(3).tolist() == rng.spawn(1)[0].random(3).tolist()
    assert came.random(7).tolist() == rng.random(7).tolist()
    assert came.integers(0, 2**31, 3).tolist() == rng.integers(0, 2**31, 3).tolist()


def test_replies_are_taken_for_the_request_they_answer() -> None:
    reply = read_reply(body(messages.Answer(3, CLAIMS)), 3, ANSWERS)
    assert isinstance(reply, messages.Answer)
    assert reply.claims == CLAIMS
    assert isinstance(reply.claims, EstimateRow)
    assert isinstance(read_reply(body(messages.Failed(3, False, "oh")), 3, ANSWERS), messages.Failed)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x00",
        b"garbage",
        b"\x91" * 100_000,  # arrays in arrays in arrays
        b"\x81" * 100_000,
        b"\xdd\xff\xff\xff\xff",  # an array of four billion
        b"\xc6\xff\xff\xff\xff",  # bytes that never come
        body(messages.Answer(2, CLAIMS)),  # another request
        body(messages.Answer(3, CLAIMS)) + b"\x00",  # one byte more
        msgspec.msgpack.encode(["answer", 3, CLAIMS[:5]]),
        msgspec.msgpack.encode(["answer", 3, [*CLAIMS, 0.0]]),
        msgspec.msgpack.encode(["answer", 3, [*CLAIMS[:5], "1"]]),
        msgspec.msgpack.encode(["answer", 3, [*CLAIMS[:5], None]]),
        body(messages.Done(3)),  # another kind
        body(messages.Ready(3, True, True)),
        body(messages.Step(3, 0.0, [])),  # a request
        msgspec.msgpack.encode(["answer", 3, CLAIMS, "more"]),
        msgspec.msgpack.encode(["answer", 3.5, CLAIMS]),
        msgspec.msgpack.encode(["answer", "3", CLAIMS]),
        msgspec.msgpack.encode(["missing", 3, "mood", ""]),
        msgspec.msgpack.encode(["nonsense", 3]),
        msgspec.msgpack.encode({"answer": 3}),
        b"\x93\xa6failed\x03\xc2\xa1\xff",  # text that is no UTF-8
    ],
)
def test_malformed_replies_are_refused(content: bytes) -> None:
    with pytest.raises(ProtocolError):
        read_reply(content, 3, ANSWERS)


@pytest.mark.parametrize(
    "rows",
    [
        ArrayMessage("<f8", (2, 6), bytes(95)),
        ArrayMessage("<f8", (-1, 6), b""),
        ArrayMessage("<f8", (2**62, 2**62), b""),
        ArrayMessage("<i8", (1 << 40,), bytes(8)),
        ArrayMessage("|O", (1,), bytes(8)),  # type: ignore[arg-type]
        ["<f8", [1.0], bytes(8)],
        [[0.0] * 6],
    ],
)
def test_a_track_that_is_no_array_is_refused(rows: object) -> None:
    content = msgspec.msgpack.encode(["track", 1, rows])
    with pytest.raises(ProtocolError, match="cannot be read"):
        read_reply(content, 1, messages.Track)


def test_a_frame_is_refused_by_its_length_before_it_is_read() -> None:
    assert frame_size(b"\x00\x00\x01", 64) is None
    assert frame_size(b"\x40\x00\x00\x00", 64) == 68
    with pytest.raises(ProtocolError, match="1073741824 bytes"):
        frame_size((1 << 30).to_bytes(4, "little"), 64)
