"""Environments that are files: a `task.toml` beside recordings and a plan, and folders of them to give to others."""

from __future__ import annotations

from pdrbench_formats.taskfile.load import Walks, task_of_file, walks_of_file
from pdrbench_formats.taskfile.schema import TaskFile, read_task_file
from pdrbench_formats.toml import as_toml

__all__ = ["TaskFile", "Walks", "as_toml", "read_task_file", "task_of_file", "walks_of_file"]
