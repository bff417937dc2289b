"""The localizers of pdrbench, one file each, and the claims of their papers.

The tables hold strings only, so that nothing is imported early.
"""

LOCALIZERS = {
    "dead_reckoning-v0": "pdrbench_baselines.dead_reckoning:DeadReckoning",
    "oracle-v0": "pdrbench_baselines.oracle:Oracle",
    "stay-v0": "pdrbench_baselines.stay:Stay",
    "wifi_knn-v0": "pdrbench_baselines.wifi_knn:WifiKnn",
    "woodman2008-v0": "pdrbench_baselines.woodman2008:Woodman2008",
    "woodman2008_drift-v0": "pdrbench_baselines.woodman2008:drift_learned",
}

REPRODUCTIONS = {
    "woodman2008": "pdrbench_baselines.woodman2008_claims:REPRODUCTION",
}
