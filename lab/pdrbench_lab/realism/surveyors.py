"""The people who recorded the public ILC20 walks, as `pdrbench_sim` draws people."""

from __future__ import annotations

from typing import Final

from pdrbench_sim.people.person import PersonParams

# Undisturbed on the straight. Fitted on the 46 train and survey walks of the
# first site, over whose turns, starts and stops 1.11 m/s are left in the median, 1.96 +- 0.22 Hz on the 15 with an
# accelerometer, whatever the speed. On short slow legs their steps are short and a little quicker than elsewhere (from
# leg to leg of a walk the cadence goes with the speed to the power -0.19 +- 0.05, here 0.09), hence the steep slope.
SURVEYORS: Final = PersonParams(cadence_hz=(1.95, 0.13), step_factor=(0.95, 0.08), step_slope_m_per_hz=(2.6, 0.2))
