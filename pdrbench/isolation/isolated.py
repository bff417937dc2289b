"""A localizer in a process of its own, behind the methods that `episode.play` calls."""

from __future__ import annotations

import contextlib
import json
import signal
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal, TypeVar

import numpy as np

from pdrbench.episode import RESET, REVISE, STEP, Claims
from pdrbench.errors import PdrbenchError, UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.isolation import messages
from pdrbench.isolation.budget import CONSTRUCTION, Account, Budget, LocalizerExit, LocalizerTimeout
from pdrbench.isolation.confine import Limits, Record, mode
from pdrbench.isolation.launching import warm_launcher
from pdrbench.isolation.messages import MOST_REPLY_BYTES, ProtocolError, frame, read_reply
from pdrbench.isolation.reach import reach_of
from pdrbench.isolation.telling import pack_briefing, pack_generator, pack_reference
from pdrbench.isolation.watching import GRACE_S, Child, EndedError, IsolationError, LateError
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.trajectory import Trajectory

Isolation = Literal["auto", "process", "none"]
TRACK_ROWS_PER_STEP: Final = 400  # of a revised past: as many as an inertial unit of 400 Hz gives in a second
LEAVE_S: Final = 1.0  # for what a localizer of somebody else had to compile; it is only asked once the walk is over
MOST_ROOMS: Final = 8  # of those that it names
CPU_PER_WALL: Final = 4.0  # processor time that a walk may take, in its wall time: threads count
# What a localizer answered in place of an estimate, by the reason under which that counts as missing.
STAND_INS: Final[Mapping[str, Any]] = {
    "nothing": None,
    "type": NotImplemented,
    "shape": Estimate(np.zeros(0), 0),
    "nan": Estimate(np.full(2, np.nan), 0),
    "level": Estimate(np.zeros(2), 0.5),  # type: ignore[arg-type]
}
Kind = TypeVar("Kind")


class LocalizerRaised(PdrbenchError):
    """A localizer raised; the message is its own traceback."""


@dataclass(frozen=True, slots=True)
class Terms:
    """Under what terms a localizer runs.

    Attributes:
        isolation: "auto": as far as the system lets us; "process": a process of its own and nothing more.
        budget: Its time.
        limits: What else it may use.
        period_s: Time between observations of the walk.
        num_steps: Observations of the walk.
    """

    isolation: Literal["auto", "process"]
    budget: Budget
    period_s: float
    num_steps: int
    limits: Limits = field(default_factory=Limits)


class IsolatedLocalizer:
    """Makes a localizer in a child process and passes every call on: `start` first, `close` last.

    Args:
        localizer: As the user named it.
        target: Where its class is: `module:Class` or `/absolute/file.py:Class`.
        parameters: Keyword arguments of the class, made of what JSON knows.
        terms: Under what terms it runs.
        reference: The truth for one that asks for it; None where nobody is told.

    Every call raises where the localizer did not answer as it should:

    * `UnsuitableError`: it declines the walk, or asks for a truth that nobody is told;
    * `LocalizerRaised`: it raised, or cannot be loaded;
    * `LocalizerTimeout`: it took too long;
    * `LocalizerExit`: its process ended, or was ended for what it used;
    * `ProtocolError`: it sent what is no reply;
    * `IsolationError`: not its fault: no process can be started, or somebody ended the launcher.
    """

    def __init__(
        self,
        localizer: str,
        target: str,
        *,
        parameters: Mapping[str, Any],
        terms: Terms,
        reference: Trajectory | None = None,
    ) -> None:
        self._name, self._target, self._parameters = localizer, target, dict(parameters)
        self._terms, self._reference = terms, reference
        self._account = Account(terms.budget, terms.period_s)
        self._sensors: tuple[str, ...] = ()
        self._number = 0
        self._num_steps = 0
        self._record = Record()
        self._child: Child | None = None
        self._mistake: Exception | None = None
        self._ships_with_us = False
        self.compiled_in_vain: tuple[str, ...] = ()
        self.failure = ""
        self.was_killed = False

    def start(self) -> None:
        """Starts the process, in which the localizer is then made."""
        terms = self._terms
        launcher = warm_launcher(terms.isolation == "auto", terms.limits)
        cpu_s = CPU_PER_WALL * terms.budget.total_s(terms.num_steps, terms.period_s)
        began_s = time.monotonic()
        reach = reach_of(self._name, self._target)
        self._ships_with_us = reach.ships_with_us
        self._child = launcher.fork(reach, cpu_s)
        self._hear_confined(self._child, began_s)
        made = messages.Construct(self._next(), self._target, json.dumps(self._parameters))
        ready = self._ask(CONSTRUCTION, made, messages.Ready)
        launcher.preload(ready.libraries)
        if ready.asks_for_truth:
            self._tell()
        if ready.revises:
            self.revise = self._revise

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        """Begins a walk."""
        self._sensors = tuple(briefing.sensors)
        self._ask(RESET, messages.Reset(self._next(), pack_briefing(briefing), pack_generator(rng)), messages.Done)
        assert self._child is not None
        self._child.stay_near()

    def step(self, observation: Observation) -> Claims | Estimate:
        """Answers one observation; what cannot be scored comes as something that cannot be scored for that reason."""
        rows: Any = [*map(_TO_BYTES, map(observation.rows.__getitem__, self._sensors))]
        reply: messages.Answer | messages.Missing
        reply = self._ask(STEP, messages.Step(self._next(), observation.now_s, rows), _ANSWERS)
        if isinstance(reply, messages.Missing):
            stand_in: Estimate = STAND_INS[reply.reason]
            return stand_in
        return reply.claims

    def close(self) -> dict[str, object]:
        """Ends the process and returns what is known of it, for the provenance of a result."""
        facts: dict[str, object] = {
            "isolation": {"mode": mode(self._record), "held": self._record.held, "missing": self._record.missing},
            "budget": self._terms.budget.record(),
        }
        if self._child is not None:
            ended = self._child.end()
            facts |= {
                "peak_mb": ended.peak_mb,
                "child": {"cpu_s": ended.cpu_s, "memory_mb": self._terms.limits.memory_mb},
            }
        return facts

    def finish(self) -> None:
        """Raises `ProtocolError` where it said more than it was asked, and what was a mistake of ours."""
        if self._mistake is not None:
            raise self._mistake
        if self._child is None:
            return
        self._child.check_silence()
        if not self._ships_with_us:
            with contextlib.suppress(LateError, EndedError, ProtocolError):
                leave = messages.Leave(self._next())
                answer = self._child.ask(frame(leave), time.monotonic() + LEAVE_S, MOST_REPLY_BYTES)
                reply = read_reply(answer, leave.number, messages.Done)
                if isinstance(reply, messages.Done):
                    self.compiled_in_vain = tuple(reply.text.split()[:MOST_ROOMS])

    def _revise(self) -> FloatArray | None:
        most = MOST_REPLY_BYTES + 48 * TRACK_ROWS_PER_STEP * self._terms.num_steps
        reply = self._ask(REVISE, messages.Revise(self._next()), messages.Track, most)
        return None if reply.rows is None else reply.rows.array()

    def _tell(self) -> None:
        if self._reference is None:
            raise UnsuitableError(
                f"{self._name} is told the truth, which nobody is on a test split; run it on train or val"
            )
        self._ask(CONSTRUCTION, messages.Tell(self._next(), pack_reference(self._reference)), messages.Done)

    def _next(self) -> int:
        self._number += 1
        return self._number

    def _hear_confined(self, child: Child, began_s: float) -> None:
        try:
            body = child.receive(began_s + self._account.allowed_s(CONSTRUCTION), MOST_REPLY_BYTES)
            confined = read_reply(body, 0, messages.Confined)
        except (LateError, EndedError, ProtocolError) as error:
            # nothing of the localizer has run yet: whatever became of its process is not its fault
            raise IsolationError(f"a process for the localizer did not begin: {error}; {child.output}") from error
        finally:
            self._account.spend(CONSTRUCTION, time.monotonic() - began_s)
        assert isinstance(confined, messages.Confined)
        self._record.held, self._record.missing = confined.held, confined.missing

    def _ask(self, call: str, request: Any, kind: type[Kind], most_bytes: int = MOST_REPLY_BYTES) -> Kind:
        """The reply to a request within the budget; every way in which it can go wrong ends the process."""
        child = self._child
        assert child is not None
        allowed_s = self._account.allowed_s(call)
        began_s = time.monotonic()
        try:
            body = child.ask(frame(request), began_s + allowed_s, most_bytes)
            self._account.spend(call, child.heard_s - began_s)
            reply = read_reply(body, request.number, kind)
        except LateError:
            child.ask_where()
            raise self._failed(LocalizerTimeout, self._told_late(call, allowed_s)) from None
        except EndedError as error:
            raise self._failed(LocalizerExit, self._told_end(child, error)) from None
        except ProtocolError as error:
            raise self._failed(ProtocolError, f"protocol error: {error}") from None
        except PdrbenchError:
            raise
        except Exception as error:
            self._mistake = error
            raise
        self._num_steps += call == STEP
        if not isinstance(reply, messages.Failed):
            return reply
        if reply.unsuitable:
            raise UnsuitableError(plain_text(reply.text))
        raise self._failed(LocalizerRaised, reply.text.rstrip())

    def _failed(self, kind: type[PdrbenchError], told: str) -> PdrbenchError:
        """The error of a walk that ends here; what the process said last is part of the failure."""
        said = "" if self._child is None else self._child.output.strip()
        self.failure = plain_text(f"{said}\n{told}".strip())
        return kind(plain_text(told))

    def _told_late(self, call: str, allowed_s: float) -> str:
        name = f"{call} {self._num_steps + 1}" if call == STEP else call
        return f"timeout: {name} took longer than the {allowed_s:.3g} s it had ({self._account.told(call)})"

    def _told_end(self, child: Child, error: EndedError) -> str:
        ended = child.end(0.0 if error.lives else GRACE_S)
        if ended.killed:
            return f"the localizer's process was ended: {error}"
        self.was_killed = ended.code == -signal.SIGKILL
        if ended.code < 0:
            return f"the localizer's process died: {_signal_name(-ended.code)}({ended.code})"
        return f"the localizer's process ended with exit code ({ended.code}); raise an exception instead"


def plain_text(text: str) -> str:
    """Without what a terminal would take as orders.

    >>> plain_text("a\\x1b[2Jb\\n\\tc")
    'a?[2Jb\\n\\tc'
    """
    return "".join(sign if sign in "\n\t" or sign.isprintable() else "?" for sign in text)


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return "signal"


_ANSWERS: Any = (messages.Answer, messages.Missing)
_TO_BYTES: Final = np.ndarray.tobytes
