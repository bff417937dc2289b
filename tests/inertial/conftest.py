"""A unit with errors on a foot whose true motion is known."""

from foot_fixtures import earth_field, measure, run_kernel, true_rest  # noqa: F401 fixtures
