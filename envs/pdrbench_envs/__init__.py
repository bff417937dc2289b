"""The environments of pdrbench, one file each; this table holds strings only, so that nothing is imported early."""

ENVIRONMENTS = {
    "FootDual-v0": "pdrbench_envs.foot_recordings:task_dual",
    "FootLoops-v0": "pdrbench_envs.foot_recordings:task_loops",
    "FootShort-v0": "pdrbench_envs.foot_recordings:task_short",
    "FootVicon-v0": "pdrbench_envs.foot_recordings:task_vicon",
    "FootWalks-v0": "pdrbench_envs.foot_recordings:task_walks",
    "Ipin2023Phone-v0": "pdrbench_envs.ipin2023_phone:task",
    "MallPhone-v0": "pdrbench_envs.mall_phone:task",
    "MallPhone-v1": "pdrbench_envs.malls.environment:task",
    "MallPhoneLost-v0": "pdrbench_envs.mall_phone:task_lost",
    "MallPhoneLost-v1": "pdrbench_envs.malls.environment:task_lost",
    "OfficeFoot-v0": "pdrbench_envs.office_signals:task_foot",
    "OfficeFoot-v1": "pdrbench_envs.office_signals:task_foot_v1",
    "OfficePhone-v0": "pdrbench_envs.office_signals:task_phone",
    "OfficePhoneAbroad-v0": "pdrbench_envs.office_abroad:task",
    "OfficeStride-v0": "pdrbench_envs.office_stride:task",
    "OfficeStride-v1": "pdrbench_envs.office_stride:task_v1",
    "WestportFoot-v0": "pdrbench_envs.westport:task_foot",
    "WestportFoot-v1": "pdrbench_envs.westport:task_foot_v1",
    "WestportPhone-v0": "pdrbench_envs.westport:task_phone",
}
