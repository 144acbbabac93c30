"""Objects of other packages, and files that only these read, become what our own readers find."""
