"""The localizers of pdrbench, one file each; this table holds strings only, so that nothing is imported early."""

LOCALIZERS = {
    "dead_reckoning-v0": "pdrbench_baselines.dead_reckoning:DeadReckoning",
    "oracle-v0": "pdrbench_baselines.oracle:Oracle",
    "stay-v0": "pdrbench_baselines.stay:Stay",
    "wifi_knn-v0": "pdrbench_baselines.wifi_knn:WifiKnn",
}
