"""The laboratory of pdrbench: papers with replicas and claims, training, realism, benches, more localizers.

The tables hold strings only, so that nothing is imported early.
"""

ENVIRONMENTS = {
    "BuildingSite-v0": "pdrbench_lab.papers.koeping2012.building_site.environment:task",
    "BuildingSiteDrift-v0": "pdrbench_lab.papers.koeping2012.building_site.environment:task_drift",
    "CorridorPhone-v0": "pdrbench_lab.papers.li2012.corridor_phone.environment:task",
    "LabStrideLost-v0": "pdrbench_lab.papers.woodman2008.lab_stride.environment:task",
    "LabStrideLost-v1": "pdrbench_lab.papers.woodman2008.lab_stride.environment:task_v1",
    "LabStrideWifi-v0": "pdrbench_lab.papers.woodman2008.lab_stride.environment:task_wifi",
    "LabStrideWifi-v1": "pdrbench_lab.papers.woodman2008.lab_stride.environment:task_wifi_v1",
    "MallPhoneMagnetic-v0": "pdrbench_lab.malls.magnetic:task",
    "MallPhoneMagneticLost-v0": "pdrbench_lab.malls.magnetic:task_lost",
    "OfficePhoneLevels-v0": "pdrbench_lab.environments.office_levels:task",
    "PhoneHandling-v0": "pdrbench_lab.environments.phone_handling:task",
    "PhoneSteps-v0": "pdrbench_lab.environments.phone_steps:task",
    "WlanHallway-v0": "pdrbench_lab.papers.frank2009.wlan_hallway.environment:task",
}

LOCALIZERS = {
    "factor_graph-v0": "pdrbench_lab.factor_graph.localizer:FactorGraph",
    "factor_graph_smooth-v0": "pdrbench_lab.factor_graph.localizer:smoothed",
    "foot_ins_lstm-v0": "pdrbench_lab.learned.zero_velocity:FootInsLstm",
    "foot_pair-v0": "pdrbench_lab.foot_ins.pair:FootPair",
    "foot_pair-v1": "pdrbench_lab.foot_ins.pair:reweighted_pair",
    "footslam-v0": "pdrbench_lab.footslam.localizer:FootSlam",
    "footslam_nomap-v0": "pdrbench_lab.footslam.localizer:without_map",
    "footslam_smooth-v0": "pdrbench_lab.footslam.localizer:smoothed",
    "magnetic-v0": "pdrbench_lab.magnetic.localizer:Magnetic",
    "ronin-v0": "pdrbench_lab.learned.odometry.localizer:ronin",
    "step_count-v0": "pdrbench_lab.step_count:StepCount",
    "step_count-v1": "pdrbench_lab.step_count:adaptive",
    "step_count_literal-v0": "pdrbench_lab.step_count:literal",
    "tlio-v0": "pdrbench_lab.learned.odometry.localizer:tlio",
    "woodman2008_gpu-v0": "pdrbench_lab.papers.woodman2008.gpu_localizer:Woodman2008Gpu",
}

REPRODUCTIONS = {
    "foot_ins": "pdrbench_lab.foot_ins.claims:REPRODUCTION",
    "foot_left_out": "pdrbench_lab.foot_ins.claims:LEFT_OUT",
    "foot_strides": "pdrbench_lab.foot_ins.swings:REPRODUCTION",
    "footslam": "pdrbench_lab.footslam.claims:REPRODUCTION",
    "frank2009": "pdrbench_lab.papers.frank2009.claims:REPRODUCTION",
    "koeping2012": "pdrbench_lab.papers.koeping2012.claims:REPRODUCTION",
    "li2012": "pdrbench_lab.papers.li2012.claims:REPRODUCTION",
    "steps_left_out": "pdrbench_lab.papers.li2012.left_out:REPRODUCTION",
    "woodman2008": "pdrbench_lab.papers.woodman2008.claims:REPRODUCTION",
}

COMMANDS = {
    "bench": "pdrbench_lab.cli.bench:bench",
    "error-model": "pdrbench_lab.stride_errors.command:error_model",
    "malls": "pdrbench_lab.malls.command:app",
    "reproduce": "pdrbench_lab.cli.reproduce:reproduce",
    "tune": "pdrbench_lab.cli.tune:tune",
    "validate-sim": "pdrbench_lab.realism.command:validate_sim",
    "warm-up": "pdrbench_lab.cli.bench:warm_up",
}

BENCHES = {
    "environment": "pdrbench_lab.speed.environment:run",
    "evaluation": "pdrbench_lab.speed.evaluation:run",
    "inertial": "pdrbench_lab.foot_ins.bench:run",
    "particles": "pdrbench_lab.papers.woodman2008.bench:run",
    "phone": "pdrbench_lab.papers.li2012.bench:run",
    "processes": "pdrbench_lab.speed.processes:run",
    "radio": "pdrbench_lab.papers.frank2009.bench:run",
    "readers": "pdrbench_lab.speed.readers:run",
    "simulate": "pdrbench_lab.speed.simulate:run",
}

WARM_UPS = {
    "pdrbench_lab.footslam": "pdrbench_lab.footslam.kernels:warm_up",
}

READERS = {
    "mvf": "pdrbench_lab.plans.mvf:READER",
    "wrld3d": "pdrbench_lab.plans.wrld3d:READER",
}
