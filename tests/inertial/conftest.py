"""A unit with errors on a foot whose true motion is known."""

from foot_fixtures import earth_field as earth_field
from foot_fixtures import measure as measure
from foot_fixtures import run_kernel as run_kernel
from foot_fixtures import true_rest as true_rest
