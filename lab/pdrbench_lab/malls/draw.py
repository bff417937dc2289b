"""Compares draws of the splits by how dense a survey they leave: `python -m pdrbench_lab.malls.draw`."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence

import numpy as np
from scipy.spatial import cKDTree

from pdrbench.geometry import FloatArray
from pdrbench_envs.malls.splits import KNOWN, Outing, Walk, is_new, known_and_other_outings, num_walks, splits, walks
from pdrbench_envs.malls.surveys import Scans, scans_of

NUM_DRAWS = 200
NUM_COMPARED = 20
NEAR_M = 10.0
TEST_RANGE, VAL_RANGE = (84, 92), (75, 85)  # new walks on known floors, see `splits.is_new`
MIN_OUTINGS = 14  # intervals resample outings


def scans_of_site(site: str) -> Scans:
    """Scans and waypoints of every walk of a mall."""
    return scans_of(tuple(walk.path for walk in walks() if walk.site == site))


def distances_m(played: Iterable[Walk], survey: Sequence[Walk]) -> FloatArray:
    """(P,) from each waypoint to the nearest scan of a survey on the same floor; infinite where there is none."""
    of_floor: dict[tuple[str, str], list[str]] = {}
    for walk in played:
        of_floor.setdefault((walk.site, walk.floor), []).append(walk.path)
    found: list[FloatArray] = [np.zeros(0)]
    for (site, floor), paths in sorted(of_floor.items()):
        scans = scans_of_site(site)
        xy_m = scans.waypoint_xy_m(paths)
        near = scans.scan_xy_m([walk.path for walk in survey if (walk.site, walk.floor) == (site, floor)])
        found.append(np.asarray(cKDTree(near).query(xy_m)[0]) if len(near) else np.full(len(xy_m), np.inf))
    return np.concatenate(found)


def played(outings: Iterable[Outing], group: str = KNOWN) -> list[Walk]:
    """The walks of a group in some outings that are new, see `splits.is_new`."""
    every = [walk for outing in outings for session in outing for walk in session.walks]
    return [walk for walk in every if walk.group == group and is_new(walk)]


def density(walks_of: Sequence[Walk], survey: Sequence[Walk]) -> float:
    """The fraction of waypoints within `NEAR_M` of a scan."""
    return float((distances_m(walks_of, survey) <= NEAR_M).mean())


def best_draws() -> tuple[int, int]:
    """The draw of test and the draw of val whose less dense survey is the densest of all pairs that are compared.

    Compared are pairs with enough walks, enough outings and every known floor in both, of the draws of test with the
    densest survey before walks are kept for val. It looks at places and times only, at no estimate.
    """
    of_test = {draw: _densities(draw, None)[0] for draw in range(NUM_DRAWS)}
    densest = sorted(of_test, key=lambda draw: -of_test[draw])[:NUM_COMPARED]
    pairs = [(test_draw, val_draw) for test_draw in densest for val_draw in range(NUM_DRAWS)]
    return max(pairs, key=lambda pair: min(_densities(*pair)))


def _densities(test_draw: int, val_draw: int | None) -> tuple[float, ...]:
    """Density of the survey of test walks on known floors and of val walks; -1 where a draw does not qualify."""
    made = splits(test_draw, val_draw)
    outings = [outing for outing in made.test if outing[0].walks[0].group == KNOWN]
    of_split = [("test", outings, TEST_RANGE)] + ([] if val_draw is None else [("val", list(made.val), VAL_RANGE)])
    floors = {floor for outing in known_and_other_outings()[0] for floor in num_walks(outing)}
    found = []
    for split, drawn, (fewest, most) in of_split:
        walks_of = played(drawn)
        is_enough = fewest <= len(walks_of) <= most and len(drawn) >= MIN_OUTINGS
        if not is_enough or {(walk.site, walk.floor) for walk in walks_of} != floors:
            return (-1.0, -1.0)
        found.append((walks_of, made.survey(split)))
    return tuple(density(*each) for each in found)


def main() -> None:
    """Prints the two draws."""
    print("TEST_DRAW = {}, VAL_DRAW = {}".format(*best_draws()), file=sys.stderr)  # noqa: T201


if __name__ == "__main__":
    main()
