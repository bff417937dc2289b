"""A small building for what is drawn."""

from picture_fixtures import building as building
