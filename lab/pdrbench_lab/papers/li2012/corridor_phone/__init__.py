"""Li et al.'s corridor: a replica, and the environment in it."""
