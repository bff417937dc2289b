"""Suites: which environments, walks and seeds a submission is made of."""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Collection, Mapping
from importlib.resources import files as package_files
from typing import Annotated, Final

import msgspec

from pdrbench.errors import BundleError, unknown_name
from pdrbench.registry import make_task
from pdrbench.task import commitment
from pdrbench_leaderboard.schema import Line, Name

SUITES_FILE: Final = "suites.toml"


class OtherSecretError(BundleError):
    """A secret that is not the one behind the held-out walks of a leaderboard in its round."""


class SuiteEnvironment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a suite takes of one environment."""

    env: Name  # id, with its version
    walks: Annotated[int, msgspec.Meta(ge=1)]  # the first so many of the test split, or all there are
    # Error of the reference: no honest localizer is closer to it in three quarters of all moments
    noise_m: Annotated[float, msgspec.Meta(ge=0)]
    still: bool = False  # whether the pedestrian stands still, so that an estimate may as well
    commitment: str = ""  # as the one of the suite, where the round of this leaderboard is another


class Suite(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a submission is run on."""

    name: Name  # with its version
    summary: Line  # one sentence
    # Runs of every walk of a localizer that draws random numbers; one of any other
    seeds: Annotated[int, msgspec.Meta(ge=1)]
    metrics: tuple[Name, ...]  # that its tables show first; the first one ranks
    environments: tuple[SuiteEnvironment, ...]  # in the order of their tables
    # sha256 of the secret behind the held-out walks of this round, where a leaderboard has none of its own; empty: none
    commitment: str = ""
    held_out_walks: Annotated[int, msgspec.Meta(ge=0)] = 0  # of each environment
    published: tuple[str, ...] = ()  # secrets of past rounds

    def environment(self, env: str) -> SuiteEnvironment:
        """What the suite takes of an environment; raises `UnknownNameError` where it takes nothing."""
        for listed in self.environments:
            if listed.env == env:
                return listed
        raise unknown_name(f"environment in {self.name}", env, [listed.env for listed in self.environments])

    def round_of(self, env: str) -> str:
        """sha256 of the secret behind the held-out walks of an environment in its present round; may be empty."""
        return self.environment(env).commitment or self.commitment

    def secret_of(self, env: str, secrets: Collection[str]) -> str | None:
        """The one among some secrets that is behind the held-out walks of an environment.

        Returns:
            None where there are no secrets at all.

        Raises:
            OtherSecretError: None of them is; says whose they are.
        """
        for secret in secrets:
            if commitment(secret) == self.round_of(env):
                return secret
        if not secrets:
            return None
        others = [suite.name for suite in suites().values() for secret in secrets if suite.environments_of(secret)]
        if others:
            whose = f"that of {others[0]}"
        else:
            whose = "another" if set(secrets).isdisjoint(self.published) else "one of an earlier round"
        raise OtherSecretError(
            f"this is not the secret behind the held-out walks of {self.name} in {env}, its sha256 differs: "
            f"it is {whose}"
        )

    def environments_of(self, secret: str) -> list[str]:
        """Environments whose held-out walks are drawn from a secret in this round."""
        return [listed.env for listed in self.environments if self.round_of(listed.env) == commitment(secret)]

    def walks(self, env: str) -> tuple[str, ...]:
        """Ids of the walks of an environment."""
        return make_task(env).split("test")[: self.environment(env).walks]


@functools.cache
def suites() -> Mapping[str, Suite]:
    """Every suite by name."""
    content = package_files("pdrbench_leaderboard").joinpath(SUITES_FILE).read_text(encoding="utf-8")
    return {name: msgspec.convert({"name": name, **table}, Suite) for name, table in tomllib.loads(content).items()}


def find_suite(name: str) -> Suite:
    """The suite of this name; raises `UnknownNameError`."""
    if name not in suites():
        raise unknown_name("suite", name, suites())
    return suites()[name]


def boards_of(secret: str) -> list[tuple[str, str]]:
    """Suite and environment of each leaderboard whose held-out walks are drawn from a secret in this round.

    Raises:
        OtherSecretError: There are none.
    """
    found = [(suite.name, env) for suite in suites().values() for env in suite.environments_of(secret)]
    if not found:
        raise OtherSecretError("a secret is behind the held-out walks of no suite in this round: its sha256 is another")
    return found


def successor(name: str) -> str:
    """The present version of a suite, by the name of an earlier one; "SUITE" where there is none.

    >>> successor("pdr-core-v0")
    'pdr-core-v3'
    """
    stem = name.rpartition("-v")[0]
    return next((known for known in suites() if stem and known.rpartition("-v")[0] == stem), "SUITE")
