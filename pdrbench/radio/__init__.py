"""Toolbox for radio: surveys, fingerprints, the distance of a scan from each of them, and cells of a floor.

What is named here stays as it is within a major version; the modules below it may change.
"""

from pdrbench.radio.cells import Cells, divide
from pdrbench.radio.fingerprints import UNHEARD_DBM, FingerprintTable, strength
from pdrbench.radio.matching import ScanMatcher
from pdrbench.radio.surveys import middle_of_survey, scans_of, survey_of_readings, survey_of_table

__all__ = [
    "UNHEARD_DBM",
    "Cells",
    "FingerprintTable",
    "ScanMatcher",
    "divide",
    "middle_of_survey",
    "scans_of",
    "strength",
    "survey_of_readings",
    "survey_of_table",
]
