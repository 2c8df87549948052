"""Many replays: which are wanted, which were done, and the processes that do the others."""
