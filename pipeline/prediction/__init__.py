"""What the identified model predicts, and how far to trust it."""
