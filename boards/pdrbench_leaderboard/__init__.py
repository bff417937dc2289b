"""Submissions: suites, bundles, checking, verification, and the leaderboards made of them."""

COMMANDS = {
    "submit": "pdrbench_leaderboard.submit_command:app",
    "leaderboard": "pdrbench_leaderboard.leaderboard_command:app",
}
