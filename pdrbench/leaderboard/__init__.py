"""Submissions: suites, bundles, checking, verification, and the leaderboards made of them."""
