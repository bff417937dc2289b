"""A localizer in a process of its own, behind the methods that `episode.play` calls."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Final, Literal, TypeVar

import numpy as np

from pdrbench.episode import RESET, REVISE, STEP, EstimateRow
from pdrbench.errors import PdrbenchError, UnsuitableError, plain_text
from pdrbench.geometry import FloatArray
from pdrbench.isolation import messages
from pdrbench.isolation.boot import CAN_CONFINE, ProtectionRecord
from pdrbench.isolation.budget import CONSTRUCTION, Budget, LocalizerExit, LocalizerTimeout, TimeAccount
from pdrbench.isolation.child_process import (
    BEGUN,
    GRACE_S,
    ChildProcess,
    EndedError,
    IsolationError,
    LateError,
)
from pdrbench.isolation.confine import Limits, mode
from pdrbench.isolation.launcher_client import warm_launcher
from pdrbench.isolation.messages import MAX_REPLY_BYTES, ProtocolError, frame, read_reply
from pdrbench.isolation.read_permissions import permissions_of
from pdrbench.isolation.serialise import pack_generator
from pdrbench.isolation.spawned import SpawnedProcess
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.settings import with_settings_of
from pdrbench.trajectory import Trajectory

Isolation = Literal["auto", "confined", "process", "none"]
TRACK_ROWS_PER_STEP: Final = 400  # of a revised past: as many as an inertial unit of 400 Hz gives in a second
CPU_PER_WALL: Final = 4.0  # processor time that a walk may take, in its wall time: threads count
LAST_LOOK: Final = "last look"  # of figures that are lower bounds
NEEDED: Final = ("landlock-files", "seccomp")  # without which a localizer reads files, or connects
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
    """Conditions under which a localizer runs."""

    # "auto": confined as far as the system grants it; "confined": an error where it lacks one of `NEEDED`; "process": a
    # process of its own and nothing more
    isolation: Literal["auto", "confined", "process"]
    budget: Budget  # limits of its time
    period_s: float  # time between observations of the walk
    num_steps: int  # observations of the walk
    limits: Limits = field(default_factory=Limits)  # limits of its other resources


class IsolatedLocalizer:
    """Makes a localizer in a child process and passes every call on to it: `start` first, `close` last.

    Args:
        localizer: As the user named it, with its settings.
        target: Where its class is: `module:Class` or `/absolute/file.py:Class`.
        parameters: Keyword arguments of the class, as JSON can hold them.
        terms: Conditions under which it runs.
        reference: For a localizer that asks for it; None where no localizer is given the reference.
        is_watched: Whether `changed` and `disturbed` are wanted, as `Watched` has them; spoils observations.
        reference_follows: Whether a localizer that asks for the reference is given it later, by the method `tell`.

    Every call raises where the localizer did not answer as it should:

    * `UnsuitableError`: it declines the walk, or asks for a reference that no localizer is given;
    * `LocalizerRaised`: it raised, or cannot be loaded;
    * `LocalizerTimeout`: it took too long;
    * `LocalizerExit`: its process ended, or was ended because it exceeded a limit;
    * `ProtocolError`: it sent something other than a valid reply;
    * `IsolationError`: not its fault: no process can be started, or the launcher was ended.
    """

    def __init__(
        self,
        localizer: str,
        target: str,
        *,
        parameters: Mapping[str, Any],
        terms: Terms,
        reference: Trajectory | None = None,
        is_watched: bool = False,
        reference_follows: bool = False,
    ) -> None:
        self._name, self._target, self._parameters = localizer, target, dict(parameters)
        self._terms, self._reference = terms, reference
        self._is_watched, self._reference_follows = is_watched, reference_follows
        self._account = TimeAccount(terms.budget, terms.period_s)
        self._sensors: tuple[str, ...] = ()
        self._number = 0
        self._num_steps = 0
        self._record = ProtectionRecord()
        self._child: ChildProcess | SpawnedProcess | None = None
        self._internal_error: Exception | None = None
        self.failure = ""
        self.has_broken = False  # true once its process did not answer, or answered nonsense
        self.has_begun = False  # true once it knows anything of the walk

    def start(self) -> None:
        """Starts the process, in which the localizer is then made."""
        terms = self._terms
        permissions = permissions_of(self._name, self._target)
        launcher = None
        if CAN_CONFINE:
            launcher = warm_launcher(terms.isolation != "process", terms.limits, permissions.packages)
        cpu_s = CPU_PER_WALL * terms.budget.walk_s  # which a child can read: nothing of the walk may be in it
        began_s = time.monotonic()
        if not permissions.is_builtin:
            from pdrbench.isolation.numba_cache import compile_package  # takes half a second to import

            for package in permissions.toolbox:
                compile_package(package)
        if launcher is not None:
            if permissions.is_builtin:
                launcher.preload_builtin(self._target.partition(":")[0])
            self._child = launcher.fork(permissions, cpu_s)
        else:
            self._child = SpawnedProcess(terms.limits, permissions)
        self._receive_protections(self._child, began_s)
        spec = with_settings_of(self._name, self._target)
        made = messages.Construct(self._next(), spec, json.dumps(self._parameters), self._is_watched)
        ready = self._ask(CONSTRUCTION, made, messages.Ready)
        if ready.asks_for_truth and self._reference_follows:
            self.tell = self._tell
        elif ready.asks_for_truth:
            if self._reference is None:
                raise UnsuitableError(
                    f"{self._name} needs the reference, which no localizer is given on a test split; "
                    f"run it on train or val"
                )
            self._tell(self._reference)
        if ready.revises:
            self.revise = self._revise

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        """Begins a walk."""
        self._sensors = tuple(briefing.sensors)
        self.has_begun = True
        self._ask(RESET, messages.Reset(self._next(), briefing, pack_generator(rng)), messages.Done)
        assert self._child is not None
        self._child.share_processor()

    def step(self, observation: Observation) -> EstimateRow | Estimate:
        """Answers one observation; in place of an answer that cannot be scored comes one of `STAND_INS`."""
        rows: Any = [*map(_TO_BYTES, map(observation.rows.__getitem__, self._sensors))]
        reply: messages.Answer | messages.Missing
        reply = self._ask(STEP, messages.Step(self._next(), observation.now_s, rows), _ANSWERS)
        if isinstance(reply, messages.Missing):
            stand_in: Estimate = STAND_INS[reply.reason]
            return stand_in
        return reply.claims

    @property
    def changed(self) -> list[str]:
        """As `Watched.changed`."""
        return self._seen().changed

    def disturbed(self) -> list[str]:
        """As `Watched.disturbed`."""
        return self._seen().disturbed

    def close(self) -> dict[str, object]:
        """Ends the process and returns facts on it for the provenance of a result."""
        facts: dict[str, object] = {
            "isolation": {"mode": mode(self._record), "held": self._record.held, "missing": self._record.missing},
            "budget": asdict(self._terms.budget),
            "wall_s": round(self._account.spent_s, 3),
        }
        if self._child is not None:
            child: dict[str, object] = {"memory_mb": self._terms.limits.memory_mb}
            try:
                ended = self._child.end()
                peak_mb, cpu_s = ended.peak_mb, ended.cpu_s
                child |= {"measured": LAST_LOOK} if isinstance(self._child, SpawnedProcess) else {}
            except IsolationError:  # the launcher, which measures it, has ended
                (peak_mb, cpu_s), child["measured"] = self._child.last_seen, LAST_LOOK
            facts |= {"peak_mb": peak_mb, "child": {"cpu_s": cpu_s, **child}}
        return facts

    def finish(self) -> None:
        """Raises `ProtocolError` where an answer came without a request, and a pending error of this package."""
        if self._internal_error is not None:
            raise self._internal_error
        if self._child is None:
            return
        self._child.check_silence()

    def _revise(self) -> FloatArray | None:
        max_bytes = MAX_REPLY_BYTES + 48 * TRACK_ROWS_PER_STEP * self._terms.num_steps
        reply = self._ask(REVISE, messages.Revise(self._next()), messages.Track, max_bytes)
        return reply.rows

    def _tell(self, reference: Trajectory) -> None:
        self._ask(CONSTRUCTION, messages.GiveReference(self._next(), reference), messages.Done)

    def _seen(self) -> messages.Seen:
        return self._ask(RESET, messages.Report(self._next()), messages.Seen)

    def _next(self) -> int:
        self._number += 1
        return self._number

    def _receive_protections(self, child: ChildProcess | SpawnedProcess, began_s: float) -> None:
        try:
            body = child.receive(began_s + self._account.allowed_s(CONSTRUCTION), MAX_REPLY_BYTES)
            confined = read_reply(body, 0, messages.Confined)
        except (LateError, EndedError, ProtocolError) as error:
            # no code of the localizer has run yet: whatever happened to its process is not its fault
            raise IsolationError(f"a process for the localizer did not begin: {error}; {child.output}") from error
        finally:
            self._account.spend(CONSTRUCTION, time.monotonic() - began_s)
        assert isinstance(confined, messages.Confined)
        self._record.held, self._record.missing = confined.held, confined.missing
        child.look_at(confined.held)
        lacking = [name for name in NEEDED if name not in confined.held]
        if self._terms.isolation == "confined" and lacking:
            raise PdrbenchError(f"confinement was asked for, and the system denies {' and '.join(lacking)}")

    def _ask(self, call: str, request: Any, kind: type[Kind], max_bytes: int = MAX_REPLY_BYTES) -> Kind:
        """The reply to a request within the budget; any failure ends the walk."""
        child = self._child
        assert child is not None
        allowed_s = self._account.allowed_s(call)
        began_s = time.monotonic()
        try:
            body = child.ask(frame(request), began_s + allowed_s, max_bytes)
            self._account.spend(call, child.last_read_s - began_s)
            reply = read_reply(body, request.number, kind)
        except LateError:
            child.request_traceback()
            name = f"{call} {self._num_steps + 1}" if call == STEP else call
            rule = self._account.rule(call)
            self._account.spend(call, time.monotonic() - began_s)
            why = f"timeout: {name} took longer than the {allowed_s:.3g} s it had ({rule})"
            raise self._failed(LocalizerTimeout, why) from None
        except EndedError as error:
            self._account.spend(call, time.monotonic() - began_s)
            raise self._failed(LocalizerExit, self._end_text(child, error)) from None
        except ProtocolError as error:
            raise self._failed(ProtocolError, f"protocol error: {error}") from None
        except PdrbenchError:
            raise
        except Exception as error:
            self._internal_error = error
            raise
        self._num_steps += call == STEP
        if not isinstance(reply, messages.Failed):
            return reply
        if reply.unsuitable:
            raise UnsuitableError(plain_text(reply.text))
        raise self._failed(LocalizerRaised, reply.text.rstrip())

    def _failed(self, kind: type[PdrbenchError], text: str) -> PdrbenchError:
        """The error of a walk that ends here; the last output of the process is part of the failure."""
        self.has_broken = kind is not LocalizerRaised
        output = "" if self._child is None else self._child.output.strip()
        self.failure = plain_text(f"{output}\n{text}".strip())
        return kind(plain_text(text))

    def _end_text(self, child: ChildProcess | SpawnedProcess, error: EndedError) -> str:
        try:
            ended = child.end(0.0 if error.is_running else GRACE_S)
        except IsolationError as lost:  # the launcher went as well
            return f"{lost}; {BEGUN}"
        if child.has_exceeded_memory:
            limit_mb = self._terms.limits.memory_mb
            return f"the localizer's process was ended: memory: it needed more than the limit of {limit_mb} MB"
        if ended.killed:
            return f"the localizer's process was ended: {error}"
        if ended.code < 0:
            return f"the localizer's process died: {_signal_name(-ended.code)}({ended.code})"
        return f"the localizer's process ended with exit code ({ended.code}); raise an exception instead"


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return "signal"


_ANSWERS: Any = (messages.Answer, messages.Missing)
_TO_BYTES: Final = np.ndarray.tobytes
