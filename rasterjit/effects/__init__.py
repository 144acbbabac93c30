"""Effects: one folder each; why it is in a frame or not, and how it is drawn."""
