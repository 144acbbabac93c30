"""Effects, one folder each: when a frame needs it, and how it is drawn."""
