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
    "oracle-v0": "pdrbench_baselines.oracle:Oracle",
    "stay-v0": "pdrbench_baselines.stay:Stay",
    "wifi_knn-v0": "pdrbench_baselines.wifi_knn:WifiKnn",
    "woodman2008-v0": "pdrbench_baselines.woodman2008:Woodman2008",
    "woodman2008_drift-v0": "pdrbench_baselines.woodman2008:drift_learned",
}

REPRODUCTIONS = {
    "foot_ins": "pdrbench_baselines.foot_ins_claims:REPRODUCTION",
    "woodman2008": "pdrbench_baselines.woodman2008_claims:REPRODUCTION",
}
