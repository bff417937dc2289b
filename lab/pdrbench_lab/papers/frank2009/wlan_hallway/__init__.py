"""Frank et al.'s hallway: a replica, and the environment in it."""
