"""The motion of a foot-mounted inertial unit.

`foot.foot_motion` moves a unit from rest to rest: `shape` has the recorded shapes of swings, `style` how one person
varies them, `shake` what a heel strike adds, `site` where on the shoe the unit sits.
"""
