"""The localizers of pdrbench, one file or folder each.

The tables hold strings only, so that nothing is imported early.
"""

LOCALIZERS = {
    "dead_reckoning": "pdrbench_baselines.dead_reckoning:DeadReckoning",
    "foot_ins": "pdrbench_baselines.foot_ins.localizer:FootIns",
    "foot_ins_robust": "pdrbench_baselines.foot_ins.localizer:FootInsRobust",
    "frank2009": "pdrbench_baselines.frank2009.localizer:Frank2009",
    "fusion": "pdrbench_baselines.fusion.localizer:Fusion",
    "gp_wifi": "pdrbench_baselines.gp_wifi.localizer:GpWifi",
    "koeping2012": "pdrbench_baselines.koeping2012.localizer:Koeping2012",
    "learned": "pdrbench_baselines.learned.localizer:Learned",
    "li2012": "pdrbench_baselines.li2012.localizer:Li2012",
    "oracle": "pdrbench_baselines.oracle:Oracle",
    "stay": "pdrbench_baselines.stay:Stay",
    "wifi_knn": "pdrbench_baselines.wifi_knn:WifiKnn",
    "wlan_frank2009": "pdrbench_baselines.frank2009.localizer:WlanFrank2009",
    "woodman2008": "pdrbench_baselines.woodman2008.localizer:Woodman2008",
    # former ids
    "eqnio": "renamed:learned",
    "foot_ins_adaptive": "renamed:foot_ins_robust",
    "foot_ins_are": "renamed:foot_ins?detector=are",
    "foot_ins_interval": "renamed:foot_ins?detector=interval",
    "foot_ins_mag": "renamed:foot_ins?detector=mag",
    "foot_ins_mv": "renamed:foot_ins?detector=mv",
    "foot_ins_smooth": "renamed:foot_ins_robust",
    "frank2009_robust": "renamed:frank2009?degrees=3",
    "fusion_smooth": "renamed:fusion",
    "koeping2012_smooth": "renamed:koeping2012",
    "learned_map": "renamed:fusion",
    "learned_map_smooth": "renamed:fusion",
    "li2012_bias": "renamed:li2012?heading_bias=true",
    "li2012_generic": "renamed:li2012?generic=true",
    "li2012_narrow": "renamed:li2012?filter.delta_a=0.05&filter.delta_b=0.075",
    "li2012_nodtw": "renamed:li2012?generic=true&warping=false",
    "li2012_nomap": "renamed:li2012?map=false",
    "li2012_smooth": "renamed:li2012?generic=true",
    "viterbi_map": "renamed:fusion",
    "viterbi_map_smooth": "renamed:fusion",
    "wlan_frank2009_penalised": "renamed:wlan_frank2009",
    "woodman2008_drift": "renamed:woodman2008?learns_drift=true",
    "woodman2008_smooth": "renamed:woodman2008",
}

WARM_UPS = {
    "pdrbench_baselines.frank2009": "pdrbench_baselines.frank2009.warm:warm_up",
    "pdrbench_baselines.gp_wifi": "pdrbench_baselines.gp_wifi.kernels:warm_up",
    "pdrbench_baselines.learned": "pdrbench_baselines.learned.compiled:warm_up",
    "pdrbench_baselines.li2012": "pdrbench_baselines.li2012.kernels:warm_up",
    "pdrbench_baselines.woodman2008": "pdrbench_baselines.woodman2008.warm:warm_up",
}
