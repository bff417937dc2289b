"""The environments of pdrbench, one file each; this table holds strings only, so that nothing is imported early."""

ENVIRONMENTS = {
    "BuildingSite-v0": "pdrbench_envs.building_site.environment:task",
    "BuildingSiteDrift-v0": "pdrbench_envs.building_site.environment:task_drift",
    "CorridorPhone-v0": "pdrbench_envs.corridor_phone.environment:task",
    "FootLoops-v0": "pdrbench_envs.foot_recordings:task_loops",
    "FootShort-v0": "pdrbench_envs.foot_recordings:task_short",
    "FootVicon-v0": "pdrbench_envs.foot_recordings:task_vicon",
    "FootWalks-v0": "pdrbench_envs.foot_recordings:task_walks",
    "Ipin2023Phone-v0": "pdrbench_envs.ipin2023_phone:task",
    "LabStrideLost-v0": "pdrbench_envs.lab_stride.environment:task",
    "LabStrideLost-v1": "pdrbench_envs.lab_stride.environment:task_v1",
    "LabStrideWifi-v0": "pdrbench_envs.lab_stride.environment:task_wifi",
    "LabStrideWifi-v1": "pdrbench_envs.lab_stride.environment:task_wifi_v1",
    "MallPhone-v0": "pdrbench_envs.mall_phone:task",
    "MallPhone-v1": "pdrbench_envs.malls.environment:task",
    "MallPhoneLost-v0": "pdrbench_envs.mall_phone:task_lost",
    "MallPhoneLost-v1": "pdrbench_envs.malls.environment:task_lost",
    "OfficeFoot-v0": "pdrbench_envs.office_signals:task_foot",
    "OfficePhone-v0": "pdrbench_envs.office_signals:task_phone",
    "OfficePhoneAbroad-v0": "pdrbench_envs.office_abroad:task",
    "OfficePhoneLevels-v0": "pdrbench_envs.office_levels:task",
    "OfficeStride-v0": "pdrbench_envs.office_stride:task",
    "OfficeStride-v1": "pdrbench_envs.office_stride:task_v1",
    "PhoneFiddle-v0": "renamed:PhoneHandling-v0",
    "PhoneHandling-v0": "pdrbench_envs.phone_handling:task",
    "PhoneSteps-v0": "pdrbench_envs.phone_steps:task",
    "WestportFoot-v0": "pdrbench_envs.westport:task_foot",
    "WestportPhone-v0": "pdrbench_envs.westport:task_phone",
    "WlanHallway-v0": "pdrbench_envs.wlan_hallway.environment:task",
}

COMMANDS = {"malls": "pdrbench_envs.malls.command:app"}
