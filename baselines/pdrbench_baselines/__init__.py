"""The localizers of pdrbench, one file each, and the claims of their papers.

The tables hold strings only, so that nothing is imported early.
"""

LOCALIZERS = {
    "dead_reckoning-v0": "pdrbench_baselines.dead_reckoning:DeadReckoning",
    "foot_ins-v0": "pdrbench_baselines.foot_ins.localizer:literal",
    "foot_ins_adaptive-v0": "pdrbench_baselines.foot_ins.localizer:adaptive",
    "foot_ins_adaptive-v1": "pdrbench_baselines.foot_ins.localizer:robust",
    "foot_ins_are-v0": "pdrbench_baselines.foot_ins.localizer:angular_rate",
    "foot_ins_interval-v0": "pdrbench_baselines.foot_ins.localizer:interval",
    "foot_ins_mag-v0": "pdrbench_baselines.foot_ins.localizer:magnitude",
    "foot_ins_mv-v0": "pdrbench_baselines.foot_ins.localizer:moving_variance",
    "foot_ins_smooth-v0": "pdrbench_baselines.foot_ins.localizer:smoothed",
    "foot_ins_smooth-v1": "pdrbench_baselines.foot_ins.localizer:robust_smoothed",
    "foot_pair-v0": "pdrbench_baselines.foot_ins.pair:FootPair",
    "footslam-v0": "pdrbench_baselines.footslam.localizer:FootSlam",
    "footslam_nomap-v0": "pdrbench_baselines.footslam.localizer:without_map",
    "footslam_smooth-v0": "pdrbench_baselines.footslam.localizer:smoothed",
    "frank2009-v0": "pdrbench_baselines.frank2009.localizer:Frank2009",
    "frank2009_robust-v0": "pdrbench_baselines.frank2009.localizer:robust",
    "fusion-v0": "pdrbench_baselines.fusion.localizer:Fusion",
    "fusion_smooth-v0": "pdrbench_baselines.fusion.localizer:smoothed",
    "gp_wifi-v0": "pdrbench_baselines.gp_wifi.localizer:GpWifi",
    "koeping2012-v0": "pdrbench_baselines.koeping2012.localizer:Koeping2012",
    "koeping2012_heading-v0": "pdrbench_baselines.koeping2012.heading:Koeping2012Heading",
    "koeping2012_smooth-v0": "pdrbench_baselines.koeping2012.localizer:smoothed",
    "li2012-v0": "pdrbench_baselines.li2012.localizer:Li2012",
    "li2012_bias-v0": "pdrbench_baselines.li2012.localizer:heading_bias_learned",
    "li2012_generic-v0": "pdrbench_baselines.li2012.localizer:generic",
    "li2012_narrow-v0": "pdrbench_baselines.li2012.localizer:narrow",
    "li2012_nodtw-v0": "pdrbench_baselines.li2012.localizer:without_warping",
    "li2012_nomap-v0": "pdrbench_baselines.li2012.localizer:without_map",
    "li2012_smooth-v0": "pdrbench_baselines.li2012.localizer:smoothed",
    "learned-v0": "pdrbench_baselines.learned.localizer:Learned",
    "learned-v1": "pdrbench_baselines.learned.localizer:retrained",
    "learned-v2": "pdrbench_baselines.learned.localizer:transferred",
    "learned_map-v0": "pdrbench_baselines.learned.localizer:LearnedMap",
    "learned_map-v1": "pdrbench_baselines.learned.localizer:retrained_map",
    "learned_map-v2": "pdrbench_baselines.learned.localizer:transferred_map",
    "learned_map_smooth-v1": "pdrbench_baselines.learned.localizer:smoothed_map",
    "oracle-v0": "pdrbench_baselines.oracle:Oracle",
    "stay-v0": "pdrbench_baselines.stay:Stay",
    "step_count-v0": "pdrbench_baselines.step_count:StepCount",
    "step_count-v1": "pdrbench_baselines.step_count:adaptive",
    "step_count_literal-v0": "pdrbench_baselines.step_count:literal",
    "viterbi_map-v0": "pdrbench_baselines.viterbi_map.localizer:ViterbiMap",
    "viterbi_map_smooth-v0": "pdrbench_baselines.viterbi_map.localizer:smoothed",
    "wifi_knn-v0": "pdrbench_baselines.wifi_knn:WifiKnn",
    "wlan_frank2009-v0": "pdrbench_baselines.frank2009.localizer:WlanFrank2009",
    "wlan_frank2009_penalised-v0": "pdrbench_baselines.frank2009.localizer:penalised",
    "woodman2008-v0": "pdrbench_baselines.woodman2008.localizer:Woodman2008",
    "woodman2008_drift-v0": "pdrbench_baselines.woodman2008.localizer:drift_learned",
    "woodman2008_drift-v1": "pdrbench_baselines.woodman2008.localizer:drift_prior_elsewhere",
    "woodman2008_smooth-v0": "pdrbench_baselines.woodman2008.localizer:smoothed",
}

REPRODUCTIONS = {
    "foot_ins": "pdrbench_baselines.foot_ins.claims:REPRODUCTION",
    "foot_left_out": "pdrbench_baselines.foot_ins.claims:LEFT_OUT",
    "foot_strides": "pdrbench_baselines.foot_ins.swings:REPRODUCTION",
    "footslam": "pdrbench_baselines.footslam.claims:REPRODUCTION",
    "frank2009": "pdrbench_baselines.frank2009.claims:REPRODUCTION",
    "koeping2012": "pdrbench_baselines.koeping2012.claims:REPRODUCTION",
    "li2012": "pdrbench_baselines.li2012.claims:REPRODUCTION",
    "steps_left_out": "pdrbench_baselines.li2012.left_out:REPRODUCTION",
    "woodman2008": "pdrbench_baselines.woodman2008.claims:REPRODUCTION",
}

BENCHES = {
    "inertial": "pdrbench_baselines.foot_ins.bench:run",
    "particles": "pdrbench_baselines.woodman2008.bench:run",
    "phone": "pdrbench_baselines.li2012.bench:run",
    "radio": "pdrbench_baselines.frank2009.bench:run",
}

WARM_UPS = {
    "pdrbench_baselines.footslam": "pdrbench_baselines.footslam.kernels:warm_up",
    "pdrbench_baselines.frank2009": "pdrbench_baselines.frank2009.warm:warm_up",
    "pdrbench_baselines.li2012": "pdrbench_baselines.li2012.kernels:warm_up",
    "pdrbench_baselines.woodman2008": "pdrbench_baselines.woodman2008.warm:warm_up",
}
