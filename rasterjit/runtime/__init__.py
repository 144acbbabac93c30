"""Compile, keep, load and run kernels; share work among threads. Knows nothing of graphics."""
