"""Other tools on the same data: the same poses held out, the same judge (`make peers`)."""
