"""Submissions: suites, bundles, checking, verification, and the leaderboards made of them."""

PROTOCOLS = {"leaderboard": "pdrbench_leaderboard.suites:protocol"}

COMMANDS = {
    "submit": "pdrbench_leaderboard.submit_command:app",
    "leaderboard": "pdrbench_leaderboard.leaderboard_command:app",
}
