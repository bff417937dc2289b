"""Conformance: tests any environment and any localizer, and names the likely cause of what fails."""

from pdrbench.gym.check import Check
from pdrbench.gym.localizer_checks import check_localizer
from pdrbench.gym.task_checks import check_task

__all__ = ["Check", "check_localizer", "check_task"]
