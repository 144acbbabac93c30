"""Point clouds: what a file says of one, and the readers of formats that hold nothing else."""
