"""A map of speed: sizes by faces by looks by threads, each cell beside its peers in turns."""
