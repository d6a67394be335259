"""Other tools on the same data: the same held-out poses, the same judge (`make peers`)."""
