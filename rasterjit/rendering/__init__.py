"""Plan frames and run their stages: renderer, batches, streams, lenses, regions."""
