"""String the stages together: a plan, then a frame."""
