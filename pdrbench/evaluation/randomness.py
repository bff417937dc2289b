"""The randomness that a localizer is given, from the seed, the walk and a nonce; with one it reveals neither.

A nonce is text of 32 hexadecimal digits. Without one, the randomness of a walk is the same in every run and anybody can
compute it beforehand; with one, only whoever knows the nonce can. It is published with the result, so that the run can
be repeated. That of held-out walks follows from their secret and is not published before the secret is.
"""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
from typing import Final

import numpy as np

from pdrbench.errors import PdrbenchError
from pdrbench.task import Task

DIGITS: Final = 32  # 128 bits
SECRET_LABEL: Final = b"pdrbench nonce of held-out walks"


def new_nonce() -> str:
    """A nonce that was never used."""
    return secrets.token_hex(DIGITS // 2)


def check_nonce(nonce: str) -> str:
    """The nonce itself; raises `PdrbenchError` where it is none and not empty."""
    if nonce and not re.fullmatch(rf"[0-9a-f]{{{DIGITS}}}", nonce):
        raise PdrbenchError(f"a nonce has {DIGITS} digits of 0-9a-f, or is empty; got {nonce!r:.80}")
    return nonce


def secret_nonce(secret: str) -> str:
    """The nonce of the walks that are drawn from a secret."""
    return hmac.new(secret.encode(), SECRET_LABEL, hashlib.sha256).hexdigest()[:DIGITS]


def generator(seed: int, task: Task, walk: str, nonce: str = "") -> np.random.Generator:
    """The localizer's randomness: the same for a seed, a walk and a nonce, whatever ran before and wherever.

    With a nonce its seed sequence, from which children are spawned, is a digest and names none of them. Without one
    there is nothing to hide, since whoever knows the names of walks can compute all numbers of their generators.
    """
    words = "\n".join((task.id, task.random_as.get(walk, walk), *([nonce] if nonce else [])))
    digest = hashlib.sha256(words.encode()).digest()
    seeds = np.random.SeedSequence([seed, *np.frombuffer(digest, dtype="<u4").tolist()])
    if nonce:
        seeds = np.random.SeedSequence(int.from_bytes(hashlib.sha256(seeds.generate_state(8).tobytes()).digest()))
    return np.random.default_rng(seeds)
