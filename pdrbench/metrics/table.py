"""Every metric by name: what a table may show, and where it is computed. Those of other packages follow ours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final, Literal

from pdrbench.errors import PdrbenchError
from pdrbench.registry import Table


@dataclass(frozen=True, slots=True)
class Metric:
    """One column of a table.

    Attributes:
        name: With its unit.
        unit: As printed; empty for a fraction, a count or a ratio.
        better: "lower", "higher", or "none" where a value says nothing about better or worse.
        family: Group of metrics, as a heading of the page on metrics.
        what: One sentence: the formula, and how a row of a table is made of the walks.
        target: `module:function`.
        constants: Keyword arguments of the function, printed with the score; `method` is that of the percentile.
        takes: Names of the arguments of the function, in order: see `scoring.score`.
        over_walks: What makes a row of a table of its walks, of `statistics.SUMMARIES`; "median" for times that may be
            infinite.
    """

    name: str
    unit: str
    better: Literal["lower", "higher", "none"]
    family: str
    what: str
    target: str
    constants: Mapping[str, float | str] = field(default_factory=dict)
    takes: tuple[str, ...] = ("held", "reference")
    over_walks: Literal["mean", "median"] = "mean"

    @property
    def scale(self) -> Literal["any", "size", "fraction"]:
        """What its values can be, as `statistics.mean_interval` takes it; a fraction beyond 1 counts as a size."""
        return "fraction" if not self.unit else "any" if self.better == "none" else "size"

    def __post_init__(self) -> None:
        object.__setattr__(self, "constants", MappingProxyType(dict(self.constants)))


def _by_name(*metrics: Metric) -> Mapping[str, Metric]:
    table = {metric.name: metric for metric in metrics}
    if len(table) != len(metrics):
        raise PdrbenchError("two metrics have the same name; rename one of them")
    return MappingProxyType(table)


HAZEN: Final[Mapping[str, str]] = {"method": "hazen"}  # numpy.quantile, as the IPIN scorer
POSITION: Final = "pdrbench.metrics.position"
ODOMETRY: Final = "pdrbench.metrics.odometry"
INERTIAL: Final = "pdrbench.metrics.inertial"
GLOBAL: Final = "pdrbench.metrics.global_localisation"
UNCERTAINTY: Final = "pdrbench.metrics.uncertainty"
FLOOR_PLAN: Final = "pdrbench.metrics.floor_plan"
PENALTIES: Final[Mapping[str, float | str]] = {"per_level_m": 15.0, "per_building_m": 50.0, **HAZEN}  # IPIN, EvAAL
FOUND: Final[Mapping[str, float]] = {"within_m": 5.0, "hold_s": 10.0}
LOST: Final[Mapping[str, float]] = {**FOUND, "lost_m": 10.0, "lost_for_s": 10.0}
NTH: Final = ((50, "median"), *((percent, f"{percent}th percentile") for percent in (75, 90, 95)))
MOVING: Final[Mapping[str, float]] = {"min_speed_mps": 0.3, "speed_window_s": 1.0}

# fmt: off
BUILTIN: Final = _by_name(
    Metric("mean_m", "m", "lower", "position",
           "Mean over walks of the walk's mean Euclidean error.", f"{POSITION}:mean_m"),
    Metric("rmse_m", "m", "lower", "position",
           "Mean over walks of the walk's root mean square Euclidean error, nothing aligned.", f"{POSITION}:rmse_m"),
    *(Metric(f"p{percent}_m", "m", "lower", "position",
             f"Mean over walks of the walk's {nth} (Hazen) of the error.",
             f"{POSITION}:percentile_m", {"quantile": percent / 100, **HAZEN})
      for percent, nth in NTH),
    Metric("max_m", "m", "lower", "position",
           "Mean over walks of the walk's largest error.", f"{POSITION}:max_m"),
    Metric("n", "", "none", "position",
           "Mean over walks of the number of surveyed positions that are scored.", f"{POSITION}:num_scored"),
    *(Metric(f"success_{metres}m", "", "higher", "position",
             f"Mean over walks of the fraction of positions with an error of at most {metres} m.",
             f"{POSITION}:success", {"within_m": float(metres)})
      for metres in (1, 2, 3, 5, 10)),
    Metric("along_path_mean_m", "m", "lower", "position",
           "Mean over walks of the walk's mean error along the reference path, the shorter arc on loops; "
           "blind across the path, so read it beside mean_m.",
           f"{POSITION}:along_path_mean_m", {"loop_gap_m": 2.0, "same_place_m": 0.001}),
    Metric("bias_m", "m", "lower", "position",
           "Mean over walks of the length of the walk's mean error vector.", f"{POSITION}:bias_m"),
    Metric("ce50_m", "m", "lower", "position",
           "Mean over walks of the median circular error (Hazen) over all rows, wrong level or not, where the "
           "reference has z.", f"{POSITION}:circular_error_m", {"quantile": 0.50, **HAZEN}),
    Metric("ce95_m", "m", "lower", "position",
           "Mean over walks of the 95th percentile (Hazen) of the circular error over all rows, wrong level or not, "
           "where the reference has z.", f"{POSITION}:circular_error_m", {"quantile": 0.95, **HAZEN}),
    *(Metric(f"{letter}e{percent}_m", "m", "lower", "position",
             f"Mean over walks of the {nth} (Hazen) of the {kind} error, where the reference has z.",
             f"{POSITION}:{kind}_error_m", {"quantile": percent / 100, "level_height_m": 4.0, **HAZEN},
             ("held", "reference", "building"))
      for letter, kind in (("v", "vertical"), ("s", "spherical"))
      for percent, nth in ((50, "median"), (95, "95th percentile"))),
    Metric("p75_level_penalised_m", "m", "lower", "competition",
           "Mean over walks of the walk's third quartile (Hazen) of error + 15 m per wrong level + 50 m in the wrong "
           "building (IPIN, EvAAL); ranks the leaderboards.",
           "pdrbench.metrics.competition:p75_level_penalised_m", PENALTIES),
    Metric("lost", "", "lower", "competition",
           "Fraction of walks whose p75_level_penalised_m is above 10 m, or above 2 m where the sensors are on a foot.",
           "pdrbench.metrics.competition:is_lost", {**PENALTIES, "lost_m": 10.0, "lost_on_foot_m": 2.0},
           ("held", "reference", "mounting")),
    Metric("mean_level_penalised_m", "m", "lower", "competition",
           "Mean over walks of the walk's mean error + 15 m per wrong level (Kaggle indoor location).",
           "pdrbench.metrics.competition:mean_level_penalised_m", {"per_level_m": 15.0, "per_building_m": 0.0}),
    Metric("etri_level_penalised_m", "m", "lower", "competition",
           "Mean over walks of the walk's mean error + 4 m per wrong level + 50 m in the wrong building "
           "(EvAAL-ETRI).",
           "pdrbench.metrics.competition:mean_level_penalised_m", {"per_level_m": 4.0, "per_building_m": 50.0}),
    Metric("level_hit_rate", "", "higher", "level",
           "Mean over walks of the fraction of positions on the right level.", "pdrbench.metrics.level:level_hit_rate"),
    Metric("level_change_delay_s", "s", "lower", "level",
           "Mean over walks of the walk's mean time from a change of level to the estimate's arrival there; the "
           "whole stay where it never arrives.", "pdrbench.metrics.level:level_change_delay_s"),
    Metric("level_changes_missed", "", "lower", "level",
           "Mean over walks of the fraction of changes of level after which the estimate never arrives there.",
           "pdrbench.metrics.level:level_changes_missed"),
    Metric("ate_m", "m", "lower", "odometry",
           "Mean over walks of the root mean square Euclidean error, nothing aligned.", f"{ODOMETRY}:ate_m"),
    Metric("ate_start_aligned_m", "m", "lower", "odometry",
           "Mean over walks of the root mean square error after aligning first position and first direction.",
           f"{ODOMETRY}:ate_start_aligned_m", {"yaw_base_m": 5.0}),
    Metric("ate_start_translation_only", "", "none", "odometry",
           "Fraction of walks whose ate_start_aligned_m had no direction to align by: a track stood still.",
           f"{ODOMETRY}:ate_start_translation_only", {"yaw_base_m": 5.0}),
    Metric("ate_se2_aligned_m", "m", "lower", "odometry",
           "Mean over walks of the root mean square error after the best rotation and translation of the whole "
           "track, which hides every constant error of heading.",
           f"{ODOMETRY}:ate_se2_aligned_m", {"min_spread_m": 0.1}),
    Metric("ate_se2_translation_only", "", "none", "odometry",
           "Fraction of walks whose ate_se2_aligned_m was not rotated: a track stood still.",
           f"{ODOMETRY}:ate_se2_translation_only", {"min_spread_m": 0.1}),
    Metric("rte_60s_m", "m", "lower", "odometry",
           "Mean over walks of the root mean square error at the end of 60 s windows that are aligned at their "
           "start; one window where the walk is shorter.",
           f"{ODOMETRY}:rte_m", {"window_s": 60.0, "start_every_s": 1.0, "yaw_base_m": 5.0}),
    Metric("rte_60s_whole_walk", "", "none", "odometry",
           "Fraction of walks shorter than 60 s, whose rte_60s_m is that of the whole walk.",
           f"{ODOMETRY}:rte_whole_walk", {"window_s": 60.0}),
    Metric("drift_pct", "%", "lower", "odometry",
           "Mean over walks of the error at the last surveyed position over the length of the path, nothing "
           "aligned.", f"{ODOMETRY}:drift_pct", {"rate_hz": 1.0}),
    Metric("loop_closure_pct", "%", "lower", "odometry",
           "Mean over the walks that end where they began of the loop-closure error over the length of the path; over "
           "that of the estimate's path, if it moves, where the reference is both ends only.",
           f"{ODOMETRY}:loop_closure_pct", {"loop_gap_m": 2.0, "rate_hz": 1.0, "min_moved_m": 1.0},
           ("held", "reference", "resampled")),
    Metric("distance_error_pct", "%", "none", "odometry",
           "Mean over walks of the signed error of the distance walked, estimate and reference both held at 1 Hz; "
           "0 is best.",
           f"{ODOMETRY}:distance_error_pct", takes=("resampled", "reference")),
    Metric("heading_mean_deg", "°", "lower", "inertial",
           "Mean over walks of the walk's mean error of the claimed heading, wrapped, while the reference moves.",
           f"{INERTIAL}:heading_mean_deg", MOVING),
    Metric("heading_p95_deg", "°", "lower", "inertial",
           "Mean over walks of the walk's 95th percentile (Hazen) of the error of the claimed heading, wrapped, while "
           "the reference moves.", f"{INERTIAL}:heading_percentile_deg", {"quantile": 0.95, **HAZEN, **MOVING}),
    Metric("heading_bias_deg", "°", "none", "inertial",
           "Mean over walks of the walk's circular mean error of the claimed heading, counter-clockwise positive, "
           "while the reference moves; 0 is best, and the signs of walks cancel.",
           f"{INERTIAL}:heading_bias_deg", MOVING),
    Metric("heading_drift_degpmin", "°/min", "lower", "inertial",
           "Mean over walks of the size of the walk's drift of the claimed heading: the slope of the unwrapped error "
           "over time by Theil and Sen.",
           f"{INERTIAL}:heading_drift_degpmin", {"min_span_s": 10.0, **MOVING}),
    Metric("heading_share", "", "none", "inertial",
           "Mean over walks of the fraction of positions, while the reference moves, at which a heading is claimed.",
           f"{INERTIAL}:heading_share", MOVING),
    Metric("velocity_rmse_mps", "m/s", "lower", "inertial",
           "Mean over walks of the root mean square error of the velocity vector over windows of 1 s, or from one "
           "position to the next where they are farther apart.",
           f"{INERTIAL}:velocity_rmse_mps", {"window_s": 1.0}),
    Metric("eag_mps", "m/s", "lower", "inertial",
           "Mean over walks of the walk's median (Hazen) of the error over the time since the start, which has to be "
           "known (error accumulation gradient).", f"{INERTIAL}:eag_mps", {"min_elapsed_s": 1.0, **HAZEN}),
    Metric("eag_distance_pct", "%", "lower", "inertial",
           "Mean over walks of the walk's median (Hazen) of the error over the distance walked since the start, which "
           "has to be known.",
           f"{INERTIAL}:eag_distance_pct", {"min_distance_m": 1.0, "rate_hz": 1.0, **HAZEN}),
    Metric("eag_turn_mprad", "m/rad", "lower", "inertial",
           "Mean over walks of the walk's median (Hazen) of the error over the angle turned since the start, which has "
           "to be known.",
           f"{INERTIAL}:eag_turn_mprad", {"min_turn_rad": 1.0, "leg_m": 1.0, **HAZEN}),
    Metric("convergence_s", "s", "lower", "global localisation",
           "Time by which half of the walks have an error that stays within 5 m on the right level for at least 10 s, "
           "counted from the first surveyed position; 'never' where fewer do.",
           f"{GLOBAL}:convergence_s", FOUND, over_walks="median"),
    Metric("first_within_5m_s", "s", "lower", "global localisation",
           "Time by which half of the walks have had an error within 5 m on the right level, counted from the first "
           "surveyed position; 'never' where fewer do.",
           f"{GLOBAL}:first_within_s", {"within_m": 5.0}, over_walks="median"),
    *(Metric(f"converged_{seconds}s", "", "higher", "global localisation",
             f"Fraction of walks with a convergence_s of at most {seconds} s, of those surveyed for {seconds + 10} s.",
             f"{GLOBAL}:converged_by", {"by_s": float(seconds), **FOUND})
      for seconds in (30, 60, 120)),
    Metric("lost_count", "", "lower", "global localisation",
           "Mean over the walks that converged of how often the error was then above 10 m, or the level wrong, for "
           "more than 10 s.", f"{GLOBAL}:lost_count", LOST),
    Metric("lost_share", "", "lower", "global localisation",
           "Mean over the walks that converged of the fraction of the time from then on that lies between a loss and "
           "the convergence after it.", f"{GLOBAL}:lost_share", LOST),
    Metric("recovery_s", "s", "lower", "global localisation",
           "Time after which half of the losses of a walk are followed by a convergence, on half of the walks that "
           "have a loss; 'never' where fewer are.",
           f"{GLOBAL}:recovery_s", LOST, over_walks="median"),
    Metric("claimed_convergence_s", "s", "lower", "claimed convergence",
           "Time by which half of the walks have an answer that claims to have converged; 'never' where fewer do.",
           f"{GLOBAL}:claimed_convergence_s", takes=("answered", "reference"), over_walks="median"),
    Metric("claimed_correct", "", "higher", "claimed convergence",
           "Fraction of walks whose first claim to have converged was within 3 m on the right level; a walk without "
           "one counts as wrong.",
           f"{GLOBAL}:claimed_correct", {"within_m": 3.0}, ("held", "reference", "answered")),
    Metric("converged_share", "", "none", "claimed convergence",
           "Mean over walks of the fraction of positions at which the estimate claims to have converged.",
           f"{GLOBAL}:converged_share"),
    Metric("converged_mean_m", "m", "lower", "claimed convergence",
           "Mean over walks of the walk's mean error where the estimate claims to have converged.",
           f"{GLOBAL}:converged_mean_m"),
    *(Metric(f"converged_p{percent}_m", "m", "lower", "claimed convergence",
             f"Mean over walks of the walk's {percent}th percentile (Hazen) of the error where the estimate claims to "
             "have converged.", f"{GLOBAL}:converged_percentile_m", {"quantile": percent / 100, **HAZEN})
      for percent in (75, 95)),
    Metric("energy_score_m", "m", "lower", "uncertainty",
           "Mean over walks of the walk's mean energy score of the claimed normal; of a point it is the error.",
           f"{UNCERTAINTY}:energy_score_m"),
    *(Metric(f"coverage_{percent}", "", "none", "uncertainty",
             f"Mean over walks of the fraction of positions in the disc that should hold {percent} % of them.",
             f"{UNCERTAINTY}:coverage", {"fraction": percent / 100})
      for percent in (50, 90, 95)),
    Metric("anees", "", "none", "uncertainty",
           "Mean over walks of the walk's mean squared error over the claimed one; 1 is consistent, within the band "
           "that anees_band gives for so many walks; above is overconfident.", f"{UNCERTAINTY}:anees"),
    Metric("sigma_unusable", "", "lower", "uncertainty",
           "Mean over walks of the number of positions whose sigma is missing, zero, negative or not finite; the rest "
           "of this family leaves those out.", f"{UNCERTAINTY}:sigma_unusable"),
    Metric("outside_pct", "%", "lower", "map",
           "Mean over walks of the fraction of answers outside the walkable floor of their level.",
           f"{FLOOR_PLAN}:outside_pct", {"tolerance_m": 0.001}, ("answered", "building")),
    Metric("crossings_per_100m", "", "lower", "map",
           "Mean over walks of the number of walls that the lines between consecutive answers on one level cross, per "
           "100 m of them.",
           f"{FLOOR_PLAN}:crossings_per_100m", {"tolerance_m": 0.001}, ("answered", "building")),
    *(Metric(f"step_p{percent}_ms", "ms", "lower", "cost",
             f"Mean over walks of the walk's {nth} (Hazen) of the wall time per step.",
             "pdrbench.metrics.cost:step_percentile_ms", {"quantile": percent / 100, **HAZEN}, ("step_s",))
      for percent, nth in ((50, "median"), (95, "95th percentile"), (99, "99th percentile"))),
    Metric("step_max_ms", "ms", "lower", "cost",
           "Mean over walks of the walk's slowest step.",
           "pdrbench.metrics.cost:step_percentile_ms", {"quantile": 1.0, **HAZEN}, ("step_s",)),
    Metric("realtime_factor", "", "lower", "cost",
           "Mean over walks of computing time over walking time; below 1 keeps up.",
           "pdrbench.metrics.cost:realtime_factor", takes=("step_s", "period_s")),
    Metric("startup_s", "s", "lower", "cost",
           "Mean over walks of the wall time of reset.", "pdrbench.metrics.cost:startup_s", takes=("reset_s",)),
    Metric("peak_mb", "MB", "lower", "cost",
           "Mean over walks of the peak memory, where it was measured.",
           "pdrbench.metrics.cost:peak_mb", takes=("peak_mb",)),
    Metric("missed", "", "lower", "cost",
           "Mean over walks of the number of answers that count as missing: late, NaN, wrong shape, nothing.",
           "pdrbench.metrics.cost:missed", takes=("missing",)),
    Metric("availability", "", "higher", "rules",
           "Mean over walks of the fraction of positions at which the newest observation had been answered.",
           "pdrbench.metrics.hold:availability", {"slack_s": 0.01}, ("held", "reference", "period_s")),
    Metric("staleness_s", "s", "lower", "rules",
           "Mean over walks of the walk's mean age of the estimate in force.", "pdrbench.metrics.hold:staleness_s"),
)

# Over all samples of all walks: no function of one walk computes them, so `score` does not return them.
POOLED_TARGET: Final = "pdrbench.metrics.pooling:pooled"
POOLED: Final = _by_name(
    Metric("pooled_mean_m", "m", "lower", "pooled",
           "Mean error of all positions of all walks together.", POOLED_TARGET, takes=("errors_by_walk_m",)),
    Metric("pooled_rmse_m", "m", "lower", "pooled",
           "Root mean square error of all positions of all walks together.",
           POOLED_TARGET, takes=("errors_by_walk_m",)),
    *(Metric(f"pooled_p{percent}_m", "m", "lower", "pooled",
             f"{nth[:1].upper()}{nth[1:]} (Hazen) of the error of all positions of all walks together.",
             POOLED_TARGET, HAZEN, ("errors_by_walk_m",))
      for percent, nth in NTH),
    Metric("pooled_p75_level_penalised_m", "m", "lower", "pooled",
           "Third quartile (Hazen) of error + 15 m per wrong level + 50 m in the wrong building of all positions of "
           "all walks together: the official figure of IPIN and EvAAL.",
           POOLED_TARGET, HAZEN, ("penalised_by_walk_m",)),
    Metric("pooled_max_m", "m", "lower", "pooled",
           "Largest error of all walks.", POOLED_TARGET, takes=("errors_by_walk_m",)),
    Metric("pooled_n", "", "none", "pooled",
           "Number of positions of all walks.", POOLED_TARGET, takes=("errors_by_walk_m",)),
)
# fmt: on

METRICS: Final[Table[Metric]] = Table("pdrbench.metrics", "metric", BUILTIN)
