"""The localizers of pdrbench, one file each, and the claims of their papers.

The tables hold strings only, so that nothing is imported early.
"""

LOCALIZERS = {
    "dead_reckoning-v0": "pdrbench_baselines.dead_reckoning:DeadReckoning",
    "foot_ins-v0": "pdrbench_baselines.foot_ins:literal",
    "foot_ins_adaptive-v0": "pdrbench_baselines.foot_ins:adaptive",
    "foot_ins_are-v0": "pdrbench_baselines.foot_ins:angular_rate",
    "foot_ins_interval-v0": "pdrbench_baselines.foot_ins:interval",
    "foot_ins_mag-v0": "pdrbench_baselines.foot_ins:magnitude",
    "foot_ins_mv-v0": "pdrbench_baselines.foot_ins:moving_variance",
    "foot_ins_smooth-v0": "pdrbench_baselines.foot_ins:smoothed",
    "frank2009-v0": "pdrbench_baselines.frank2009:Frank2009",
    "frank2009_robust-v0": "pdrbench_baselines.frank2009:robust",
    "koeping2012-v0": "pdrbench_baselines.koeping2012:Koeping2012",
    "koeping2012_heading-v0": "pdrbench_baselines.koeping2012_heading:Koeping2012Heading",
    "li2012-v0": "pdrbench_baselines.li2012:Li2012",
    "li2012_bias-v0": "pdrbench_baselines.li2012:heading_bias_learned",
    "li2012_generic-v0": "pdrbench_baselines.li2012:generic",
    "li2012_narrow-v0": "pdrbench_baselines.li2012:narrow",
    "li2012_nodtw-v0": "pdrbench_baselines.li2012:without_warping",
    "li2012_nomap-v0": "pdrbench_baselines.li2012:without_map",
    "learned-v0": "pdrbench_baselines.learned.localizer:Learned",
    "learned_map-v0": "pdrbench_baselines.learned.localizer:LearnedMap",
    "oracle-v0": "pdrbench_baselines.oracle:Oracle",
    "stay-v0": "pdrbench_baselines.stay:Stay",
    "step_count-v0": "pdrbench_baselines.step_count:StepCount",
    "step_count_literal-v0": "pdrbench_baselines.step_count:literal",
    "wifi_knn-v0": "pdrbench_baselines.wifi_knn:WifiKnn",
    "wlan_frank2009-v0": "pdrbench_baselines.frank2009:WlanFrank2009",
    "wlan_frank2009_penalised-v0": "pdrbench_baselines.frank2009:penalised",
    "woodman2008-v0": "pdrbench_baselines.woodman2008:Woodman2008",
    "woodman2008_drift-v0": "pdrbench_baselines.woodman2008:drift_learned",
}

REPRODUCTIONS = {
    "foot_ins": "pdrbench_baselines.foot_ins_claims:REPRODUCTION",
    "frank2009": "pdrbench_baselines.frank2009_claims:REPRODUCTION",
    "koeping2012": "pdrbench_baselines.koeping2012_claims:REPRODUCTION",
    "li2012": "pdrbench_baselines.li2012_claims:REPRODUCTION",
    "woodman2008": "pdrbench_baselines.woodman2008_claims:REPRODUCTION",
}
