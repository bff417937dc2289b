"""Who walks where: the walks of the Campus environments, their kinds, and what a walk takes place in."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.recording import RadioMap
from pdrbench_envs.campus.buildings import BUILDINGS, BuildingKind, draw_places
from pdrbench_envs.generated import GeneratedWalks, Split

if TYPE_CHECKING:
    from pdrbench.building import Building
    from pdrbench_sim.people.route import NavigationMesh, Place
    from pdrbench_sim.phone.population import Bearer
    from pdrbench_sim.record import BuildingScene

SPLITS: Final = {"train": Split(walks=100), "val": Split(walks=40), "test": Split(walks=100)}
DURATION_S: Final = (120.0, 240.0)  # of a walk, least and most; ours
ONE_LEVEL: Final = 3  # one walk in so many stays on its level
ROUND: Final = 9  # walks after which it is another one of three, so that this follows no kind of nine people
SURVEY_MONTHS: Final = (0.0, 12.0)  # ago; ours
_SEED: Final = 20261128
_BUILDING, _SCENE, _SURVEY, _PERSON, _PLACES, _PLAN, _PHONE, _WALK = range(8)  # one stream of random numbers each


@dataclass(frozen=True, slots=True, eq=False)
class CampusWalks:
    """The walks of one environment, each in a building and by a person of its own.

    Attributes:
        env: Their ids are those of this environment.
        people: Kinds of people, keys of `pdrbench_sim.phone.population.KINDS`.
        number: Of the environment in seeds.
        by_lift: Whether people take lifts as well as stairs.
        held_out: Walks that a secret gives. A board that plays some of them plays others where there are more.
    """

    env: str
    people: tuple[str, ...]
    number: int
    by_lift: bool
    held_out: int = 300

    @property
    def walks(self) -> GeneratedWalks:
        """Their ids and seeds."""
        return GeneratedWalks(self.env, _SEED, SPLITS, Split(walks=self.held_out))

    def groups(self, walk: str) -> tuple[str, str]:
        """The kind of its building, and that of its person."""
        _, index = self.walks.place_of(walk)
        return tuple(BUILDINGS)[index % len(BUILDINGS)], self.people[index % len(self.people)]

    def changes_level(self, walk: str) -> bool:
        """Whether it uses stairs or a lift: two in three of each kind of building and person."""
        _, index = self.walks.place_of(walk)
        return (index + index // ROUND) % ONE_LEVEL != ONE_LEVEL - 1

    def rng(self, walk: str, stream: int) -> np.random.Generator:
        """The generator of one stream of random numbers of a walk."""
        return np.random.default_rng(self.seed(walk, stream))

    def seed(self, walk: str, stream: int = _WALK) -> list[int]:
        """The numbers that a stream of random numbers of a walk begins with; those of its signals."""
        split, index = self.walks.place_of(walk)
        return self.walks.numbers(split, stream, index, self.number)

    def duration_s(self, walk: str) -> float:
        """It ends then, or earlier where a person has no place left to go to."""
        return float(self.rng(walk, _PLAN).uniform(*DURATION_S))

    def phone(self, walk: str) -> str:
        """Name of the profile of its phone, where the person has none of its own."""
        return ("phone_mid", "phone_good")[int(self.rng(walk, _PHONE).integers(2))]

    def bearer(self, walk: str) -> Bearer:
        """The person of a walk with a phone."""
        from pdrbench_sim.phone.population import KINDS, draw_bearer

        return draw_bearer(self.rng(walk, _PERSON), KINDS[self.groups(walk)[1]])

    def places(self, walk: str, mesh: NavigationMesh) -> list[Place]:
        """What the person visits."""
        changes = self.changes_level(walk)
        rng, duration_s = self.rng(walk, _PLACES), self.duration_s(walk)
        return draw_places(rng, mesh, duration_s, changes=changes, by_lift=self.by_lift)

    def building(self, walk: str) -> Building:
        """Drawn anew for each walk."""
        return _building(self, walk)

    def scene(self, walk: str) -> BuildingScene:
        """The building with its fields."""
        return _scene(self, walk)

    def survey(self, walk: str) -> RadioMap:
        """Of the building."""
        from pdrbench_sim.radio.walked_survey import draw_survey, survey_walking

        scene, rng = self.scene(walk), self.rng(walk, _SURVEY)
        params = draw_survey(rng, self._kind(walk).m_per_m2, SURVEY_MONTHS)
        return survey_walking(rng, scene.networks, scene.mesh, params)

    def _kind(self, walk: str) -> BuildingKind:
        return BUILDINGS[self.groups(walk)[0]]


@functools.lru_cache(maxsize=2)
def _building(of: CampusWalks, walk: str) -> Building:
    split, index = of.walks.place_of(walk)
    name = f"{of.groups(walk)[0]} {of.walks.number(split)}.{index}"
    return of._kind(walk).draw(of.rng(walk, _BUILDING), name)


@functools.lru_cache(maxsize=2)
def _scene(of: CampusWalks, walk: str) -> BuildingScene:
    from pdrbench_sim.record import make_scene

    rng = of.rng(walk, _SCENE)
    return make_scene(rng, of.building(walk), networks=of._kind(walk).draw_networks(rng))
