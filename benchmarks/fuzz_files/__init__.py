"""Mutated files of every format that is read: nothing may crash, hang, or be lost in silence."""
