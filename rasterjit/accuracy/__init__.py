"""Measure what each accuracy setting costs in time and what it buys in error."""
