"""Boards: what is played on them, submissions, confinement, ranks and pages."""

BOARDS = {"leaderboard": "pdrbench_leaderboard.boards:ranked_walks"}

LAUNCHERS = {"confined": "pdrbench_leaderboard.confine.launching:ConfinedLauncher"}

HELD_OUT = {"recorded": "pdrbench_leaderboard.replays:replayed"}

COMMANDS = {
    "submit": "pdrbench_leaderboard.submit_command:app",
    "leaderboard": "pdrbench_leaderboard.leaderboard_command:app",
    "power": "pdrbench_leaderboard.power_command:power",
}
