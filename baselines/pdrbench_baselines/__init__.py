"""The localizers of pdrbench, one file or folder each.

The tables hold strings only, so that nothing is imported early.
"""

LOCALIZERS = {
    "foot_ins": "pdrbench_baselines.foot_ins.localizer:FootIns",
    "foot_ins_robust": "pdrbench_baselines.foot_ins.localizer:FootInsRobust",
    "fusion": "pdrbench_baselines.fusion.localizer:Fusion",
    "learned": "pdrbench_baselines.learned.localizer:Learned",
    "learned_map": "pdrbench_baselines.learned.localizer:LearnedMap",
    "viterbi_map": "pdrbench_baselines.viterbi_map.localizer:ViterbiMap",
    "dead_reckoning-v0": "pdrbench_baselines.dead_reckoning:DeadReckoning",
    "frank2009-v0": "pdrbench_baselines.frank2009.localizer:Frank2009",
    "frank2009_robust-v0": "pdrbench_baselines.frank2009.localizer:robust",
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
    "oracle-v0": "pdrbench_baselines.oracle:Oracle",
    "stay-v0": "pdrbench_baselines.stay:Stay",
    "wifi_knn-v0": "pdrbench_baselines.wifi_knn:WifiKnn",
    "wlan_frank2009-v0": "pdrbench_baselines.frank2009.localizer:WlanFrank2009",
    "wlan_frank2009_penalised-v0": "pdrbench_baselines.frank2009.localizer:penalised",
    "woodman2008-v0": "pdrbench_baselines.woodman2008.localizer:Woodman2008",
    "woodman2008_drift-v0": "pdrbench_baselines.woodman2008.localizer:drift_learned",
    "woodman2008_drift-v1": "pdrbench_baselines.woodman2008.localizer:drift_prior_elsewhere",
    "woodman2008_smooth-v0": "pdrbench_baselines.woodman2008.localizer:smoothed",
}

LOCALIZERS |= {  # former ids
    "foot_ins_adaptive": "renamed:foot_ins_robust",
    "foot_ins_are": "renamed:foot_ins?detector=are",
    "foot_ins_interval": "renamed:foot_ins?detector=interval",
    "foot_ins_mag": "renamed:foot_ins?detector=mag",
    "foot_ins_mv": "renamed:foot_ins?detector=mv",
    "foot_ins_smooth": "renamed:foot_ins_robust",
    "fusion_smooth": "renamed:fusion",
    "learned_map_smooth": "renamed:learned_map",
    "viterbi_map_smooth": "renamed:viterbi_map",
}

WARM_UPS = {
    "pdrbench_baselines.frank2009": "pdrbench_baselines.frank2009.warm:warm_up",
    "pdrbench_baselines.fusion": "pdrbench_baselines.fusion.kernels:warm_up",
    "pdrbench_baselines.learned": "pdrbench_baselines.learned.compiled:warm_up",
    "pdrbench_baselines.li2012": "pdrbench_baselines.li2012.kernels:warm_up",
    "pdrbench_baselines.woodman2008": "pdrbench_baselines.woodman2008.warm:warm_up",
}
