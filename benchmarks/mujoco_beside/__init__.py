"""Models drawn by MuJoCo and by ``rasterjit.compat.mujoco``."""
