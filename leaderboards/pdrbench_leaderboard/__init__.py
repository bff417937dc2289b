"""Submissions: suites, bundles, checking, verification, confinement, and the leaderboards made of them."""

LAUNCHERS = {"confined": "pdrbench_leaderboard.confine.launching:ConfinedLauncher"}

HELD_OUT = {"recorded": "pdrbench_leaderboard.replays:replayed"}

COMMANDS = {
    "submit": "pdrbench_leaderboard.submit_command:app",
    "leaderboard": "pdrbench_leaderboard.leaderboard_command:app",
}
