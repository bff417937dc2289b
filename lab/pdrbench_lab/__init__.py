"""The laboratory of pdrbench: papers with replicas and claims, training, realism, benches, more localizers.

The tables hold strings only, so that nothing is imported early.
"""

ENVIRONMENTS = {
    "BuildingSite-v1": "pdrbench_lab.papers.koeping2012.building_site.environment:task",
    "BuildingSiteDrift-v1": "pdrbench_lab.papers.koeping2012.building_site.environment:task_drift",
    "CorridorPhone-v1": "pdrbench_lab.papers.li2012.corridor_phone.environment:task",
    "FootDual-v1": "pdrbench_lab.environments.foot_recordings:task_dual",
    "FootLoops-v1": "pdrbench_lab.environments.foot_recordings:task_loops",
    "FootShort-v1": "pdrbench_lab.environments.foot_recordings:task_short",
    "LabStrideLost-v2": "pdrbench_lab.papers.woodman2008.lab_stride.environment:task",
    "LabStrideWifi-v2": "pdrbench_lab.papers.woodman2008.lab_stride.environment:task_wifi",
    "MallPhoneMagnetic-v1": "pdrbench_lab.malls.magnetic:task",
    "MallPhoneMagneticLost-v1": "pdrbench_lab.malls.magnetic:task_lost",
    "OfficePhoneLevels-v1": "pdrbench_lab.environments.office_levels:task",
    "PhoneHandling-v1": "pdrbench_lab.environments.phone_handling:task",
    "PhoneSteps-v1": "pdrbench_lab.environments.phone_steps:task",
    "WlanHallway-v1": "pdrbench_lab.papers.frank2009.wlan_hallway.environment:task",
    "BuildingSite-v0": "renamed:BuildingSite-v1",
    "BuildingSiteDrift-v0": "renamed:BuildingSiteDrift-v1",
    "CorridorPhone-v0": "renamed:CorridorPhone-v1",
    "FootDual-v0": "renamed:FootDual-v1",
    "FootLoops-v0": "renamed:FootLoops-v1",
    "FootShort-v0": "renamed:FootShort-v1",
    "LabStrideLost-v0": "renamed:LabStrideLost-v2",
    "LabStrideLost-v1": "renamed:LabStrideLost-v2",
    "LabStrideWifi-v0": "renamed:LabStrideWifi-v2",
    "LabStrideWifi-v1": "renamed:LabStrideWifi-v2",
    "MallPhoneMagnetic-v0": "renamed:MallPhoneMagnetic-v1",
    "MallPhoneMagneticLost-v0": "renamed:MallPhoneMagneticLost-v1",
    "OfficePhoneLevels-v0": "renamed:OfficePhoneLevels-v1",
    "PhoneFiddle-v0": "renamed:PhoneHandling-v1",
    "PhoneHandling-v0": "renamed:PhoneHandling-v1",
    "PhoneSteps-v0": "renamed:PhoneSteps-v1",
    "WlanHallway-v0": "renamed:WlanHallway-v1",
}

LOCALIZERS = {
    "ahrs_madgwick": "pdrbench_lab.outsiders.ahrs_madgwick:AhrsMadgwick",
    "factor_graph": "pdrbench_lab.factor_graph.localizer:FactorGraph",
    "foot_ins_lstm": "pdrbench_lab.learned.zero_velocity:FootInsLstm",
    "foot_pair": "pdrbench_lab.foot_ins.pair:FootPair",
    "footslam": "pdrbench_lab.footslam.localizer:FootSlam",
    "gaitmap_rts": "pdrbench_lab.outsiders.gaitmap_rts:GaitmapRts",
    "imufusion_gait": "pdrbench_lab.outsiders.imufusion_gait:ImufusionGait",
    "indoorloc_wknn": "pdrbench_lab.outsiders.indoorloc_wknn:IndoorlocWknn",
    "koeping2012_heading": "pdrbench_lab.papers.koeping2012.heading:Koeping2012Heading",
    "magnetic": "pdrbench_lab.magnetic.localizer:Magnetic",
    "ronin": "pdrbench_lab.learned.odometry.localizer:Ronin",
    "sklearn_knn": "pdrbench_lab.outsiders.sklearn_knn:SklearnKnn",
    "step_count": "pdrbench_lab.step_count:StepCount",
    "stonesoup_particles": "pdrbench_lab.outsiders.stonesoup_particles:StonesoupParticles",
    "vqf_steps": "pdrbench_lab.outsiders.vqf_steps:VqfSteps",
    "woodman2008_gpu": "pdrbench_lab.papers.woodman2008.gpu_localizer:Woodman2008Gpu",
    # ids of former versions
    "factor_graph_smooth": "renamed:factor_graph",
    "footslam_nomap": "renamed:footslam?cloud.uses_map=false",
    "footslam_smooth": "renamed:footslam",
    "step_count_literal": "renamed:step_count?adapts=false&detection.swing_g=0.2,2",
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
    "simulate": "pdrbench_lab.speed.simulate:run",
}

READERS = {
    "foot_loops": "pdrbench_lab.readers.foot_loops:READER",
    "foot_short": "pdrbench_lab.readers.foot_short:READER",
    "mvf": "pdrbench_lab.plans.mvf:READER",
    "phone_steps": "pdrbench_lab.readers.phone_steps:READER",
    "wrld3d": "pdrbench_lab.plans.wrld3d:READER",
}

WARM_UPS = {"pdrbench_lab.footslam": "pdrbench_lab.footslam.warm:warm_up"}
