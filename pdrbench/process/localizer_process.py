"""A localizer in a process of its own, behind the methods that `episode.play` calls."""

from __future__ import annotations

import json
import re
import signal
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Final, Literal, TypeVar

import numpy as np

from pdrbench.episode import RESET, REVISE, STEP, EstimateRow
from pdrbench.errors import EstimateError, PdrbenchError, RecordingWarning, UnsuitableError, plain_line, plain_text
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing, Observation
from pdrbench.process import messages
from pdrbench.process.budget import CONSTRUCTION, Budget, LocalizerExit, LocalizerTimeout, TimeAccount
from pdrbench.process.child_process import BEGUN, GRACE_S, EndedError, LateError, LaunchError, Limits
from pdrbench.process.launch import LaunchOrder, Process, find_launcher
from pdrbench.process.messages import MAX_REPLY_BYTES, ProtocolError, frame, read_reply
from pdrbench.process.serialise import pack_generator
from pdrbench.settings import with_settings_of
from pdrbench.trajectory import Trajectory

NOTED: Final = re.compile(rf"{RecordingWarning.__name__}: (.+)")
MAX_NOTES: Final = 4  # of a walk that are kept
MAX_NOTE_CHARACTERS: Final = 300
TRACK_ROWS_PER_STEP: Final = 400  # of a revised past: as many as an inertial unit of 400 Hz gives in a second
LAST_LOOK: Final = "last look"  # of figures that are lower bounds
Kind = TypeVar("Kind")


class LocalizerRaised(PdrbenchError):
    """A localizer raised; the message is its own traceback."""


@dataclass(frozen=True, slots=True)
class Terms:
    """Conditions under which a localizer runs."""

    # "process": a process by the standard means; "confined": by the launcher that a package adds
    isolation: Literal["process", "confined"]
    budget: Budget  # limits of its time
    period_s: float  # time between observations of the walk
    num_steps: int  # observations of the walk
    limits: Limits = field(default_factory=Limits)  # limits of its other resources
    is_rehearsal: bool = False  # whether the walk is not scored, and what is compiled is kept for those that are

    def order(self, localizer: str, target: str) -> LaunchOrder:
        """What a launcher is asked for."""
        return LaunchOrder(localizer, target, self.budget.walk_s, self.limits, self.is_rehearsal)


class LocalizerProcess:
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
    * `LaunchError`: not its fault: no process can be started, or what starts them was ended.
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
        self._child: Process | None = None
        self._is_asked = False  # true while an answer is awaited
        self._internal_error: Exception | None = None
        self.failure = ""
        self.has_broken = False  # true once its process did not answer, or answered nonsense
        self.has_begun = False  # true once it knows anything of the walk

    def start(self) -> None:
        """Starts the process, in which the localizer is then made."""
        ready = self._construct()
        if isinstance(ready, messages.Stale):
            assert self._child is not None
            self._child.end()
            ready = self._construct()
        if isinstance(ready, messages.Stale):
            raise LaunchError("sources of the localizer change while it is being loaded; run it again")
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

    def step(self, observation: Observation) -> EstimateRow | EstimateError:
        """Answers one observation; in place of an answer that cannot be scored comes why."""
        rows: Any = [*map(_TO_BYTES, map(observation.rows.__getitem__, self._sensors))]
        reply: messages.Answer | messages.Missing
        reply = self._ask(STEP, messages.Step(self._next(), observation.now_s, rows), _ANSWERS)
        if isinstance(reply, messages.Missing):
            return EstimateError(f"{reply.reason}: {reply.what}")
        return reply.claims

    @property
    def changed(self) -> list[str]:
        """As `Watched.changed`."""
        return self._seen().changed

    def disturbed(self) -> list[str]:
        """As `Watched.disturbed`."""
        return self._seen().disturbed

    def close(self) -> dict[str, object]:
        """Gives the process back, or ends it, and returns facts on it for the provenance of a result."""
        facts: dict[str, object] = {
            "isolation": {"mode": "unknown", "held": [], "missing": {}},
            "budget": asdict(self._terms.budget),
            "wall_s": round(self._account.spent_s, 3),
        }
        if self._child is not None:
            notes = _noted(self._child.output)
            used = self._child.end() if self.has_broken or self._is_asked else self._child.release()
            facts["isolation"] = dict(self._child.facts)
            child = {"cpu_s": used.cpu_s, "memory_mb": self._terms.limits.memory_mb}
            facts |= {"notes": notes} if notes else {}
            facts |= {"peak_mb": used.peak_mb, "child": child | ({} if used.is_measured else {"measured": LAST_LOOK})}
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

    def _construct(self) -> messages.Ready | messages.Stale:
        """Has a process make the localizer."""
        order = self._terms.order(self._name, self._target)
        began_s = time.monotonic()
        try:
            launcher = find_launcher(self._terms.isolation)
            self._child = launcher.launch(order, began_s + self._account.allowed_s(CONSTRUCTION))
        finally:
            self._account.spend(CONSTRUCTION, time.monotonic() - began_s)
        spec = with_settings_of(self._name, self._target)
        made = messages.Construct(self._next(), spec, json.dumps(self._parameters), self._is_watched)
        ready: messages.Ready | messages.Stale = self._ask(CONSTRUCTION, made, _READY)
        return ready

    def _ask(self, call: str, request: Any, kind: type[Kind], max_bytes: int = MAX_REPLY_BYTES) -> Kind:
        """The reply to a request within the budget; any failure ends the walk."""
        child = self._child
        assert child is not None
        allowed_s = self._account.allowed_s(call)
        began_s = time.monotonic()
        self._is_asked = True
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
        self._is_asked = False
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

    def _end_text(self, child: Process, error: EndedError) -> str:
        ended = child.end(0.0 if error.is_running else GRACE_S)
        if ended.lost:  # what starts processes went as well
            return f"{ended.lost}; {BEGUN}"
        if ended.killed:
            return f"the localizer's process was ended: {error}"
        if ended.code < 0:
            return f"the localizer's process died: {_signal_name(-ended.code)}({ended.code})"
        return f"the localizer's process ended with exit code ({ended.code}); raise an exception instead"


def _noted(output: str) -> list[str]:
    """What a localizer warned of while it played, each once."""
    found = dict.fromkeys(plain_line(text)[:MAX_NOTE_CHARACTERS] for text in NOTED.findall(output))
    return list(found)[:MAX_NOTES]


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return "signal"


_ANSWERS: Any = (messages.Answer, messages.Missing)
_READY: Any = (messages.Ready, messages.Stale)
_TO_BYTES: Final = np.ndarray.tobytes
