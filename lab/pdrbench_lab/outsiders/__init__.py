"""Methods from outside under their own names: adapters around packages of the registry, at most 80 lines each.

They need the extra `outsiders`, in an environment of its own: see lab/outsiders-constraints.txt.
"""
