"""What is imported before a process is forked, so that it need not be imported for every walk."""

from __future__ import annotations

from typing import Final

TOOLBOX: Final = ("pdrbench.filters", "pdrbench.inertial", "pdrbench.radio")  # packages with compiled functions
# Libraries that take long to import: a launcher imports them for children whose sources name them.
LIBRARIES: Final = (
    *("joblib", "pandas", "scipy.cluster", "scipy.interpolate", "scipy.linalg", "scipy.ndimage", "scipy.optimize"),
    *("scipy.signal", "scipy.sparse", "scipy.sparse.csgraph", "scipy.spatial", "scipy.special", "scipy.stats"),
    *("shapely", "sklearn.cluster"),
    *("sklearn.ensemble", "sklearn.linear_model", "sklearn.neighbors", "sklearn.preprocessing", "sklearn.svm", "torch"),
)
